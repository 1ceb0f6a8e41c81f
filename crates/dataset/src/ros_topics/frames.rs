//! Frames: pairs of colour and depth, with a camera pose if there is one.

use super::cameras::{Calibration, Camera};
use super::choice::{Choice, NoPoses, PoseChoice};
use super::clock::{Recorded, Stamped, Timeline};
use super::contents::{Content, Contents, Images, MessagePlace, StampedPlace, Topic};
use super::frame_names::bare_frame;
use super::transforms::{Instant, Rigid, Route, Tolerance};
use crate::plausibility::warn_once;
use crate::recorded_poses::PoseCoverage;
use crate::stamps::time_range;
use crate::tum::associate;
use crate::{DatasetError, DatasetSettings, LeftOut};
use splatseg_geometry::{Intrinsics, Pose};
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum time of a camera info before the first image or after the last, nanoseconds.
const INFO_SLACK: i64 = 10_000_000_000;
const NANOSECONDS_PER_MS: f64 = 1e6;

/// A frame whose images have not been read yet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairedFrame {
    /// Stamp of the colour image, nanoseconds.
    pub(crate) stamp: i64,
    /// Recording time of the colour image.
    pub(crate) recorded: Recorded,
    pub(crate) color: MessagePlace,
    pub(crate) depth: MessagePlace,
    pub(crate) pose: Option<Pose>,
    /// Indices of the colour and depth camera in the lists of their topics.
    pub(crate) cameras: (usize, usize),
}

/// The cameras of a topic, each valid from some time on.
#[derive(Debug)]
pub(crate) struct Cameras {
    pub(crate) topic: String,
    pub(crate) list: Vec<Camera>,
    /// The messages that describe them.
    starts: Vec<StampedPlace>,
    /// True if their stamps are increasing and match those of the images.
    in_order: bool,
}

impl Cameras {
    /// Returns the cameras described by a topic, for the images of topic `images`.
    pub(crate) fn new(topic: &Topic, images: &Topic, path: &Path) -> Result<Self, DatasetError> {
        let list: &[(StampedPlace, Calibration)] = match &topic.content {
            Content::Calibrations { list, .. } => list,
            _ => &[],
        };
        // Names of undistorted images in drivers and image_proc: image_rect, image_rect_raw, image_rect_color.
        let is_rectified = images.name.contains("image_rect");
        let place = format!("{}: {}", path.display(), topic.name);
        let cameras = list.iter().map(|(_, calibration)| calibration.camera(is_rectified, Path::new(&place)));
        let list_of_cameras = cameras.collect::<Result<Vec<_>, _>>()?;
        let starts: Vec<StampedPlace> = list.iter().map(|(place, _)| *place).collect();
        let in_order = starts.is_sorted_by_key(|start| start.stamp) && starts.iter().all(|start| fits(start, images));
        Ok(Self { topic: topic.name.clone(), list: list_of_cameras, starts, in_order })
    }

    /// Replaces the intrinsics. `of_size` returns them for images of a size, `(width, height)`.
    pub(crate) fn replace_intrinsics(&mut self, of_size: impl Fn((usize, usize)) -> Intrinsics) {
        for camera in &mut self.list {
            camera.intrinsics = of_size((camera.intrinsics.width, camera.intrinsics.height));
        }
    }

    /// Returns the camera of an image. Before the first camera info, its camera is used.
    pub(crate) fn at(&self, image: &StampedPlace) -> usize {
        let is_before = |start: &StampedPlace| match self.in_order {
            true => start.stamp <= image.stamp,
            // The clock was set back, or a stamp is wrong.
            false => start.recorded.number <= image.recorded.number,
        };
        self.starts.partition_point(is_before).saturating_sub(1)
    }
}

/// Source of colour camera poses.
#[derive(Debug)]
pub(crate) enum PoseSource {
    /// Transforms from the camera's frame to the world frame.
    Tree(Route),
    /// Index of a topic with poses of a body, and the transform from camera to body.
    Topic(usize, Rigid),
    /// Frames have no poses.
    None,
}

impl PoseSource {
    /// Returns the pose of the camera at an instant; `None` if it is unknown.
    pub(crate) fn at(&self, contents: &Contents, at: Instant, tolerance: Tolerance) -> Option<Pose> {
        let rigid = match self {
            Self::Tree(route) => contents.tree.transform(route, at, tolerance)?,
            Self::Topic(topic, body_from_camera) => {
                contents.poses(*topic)?.timeline.at(at, tolerance)?.after(body_from_camera)
            }
            Self::None => return None,
        };
        rigid.to_pose().ok()
    }

    /// Returns true if a stream has come to this time, so that nothing is missing for interpolating at it.
    pub(crate) fn reaches(&self, contents: &Contents, stamp: i64) -> bool {
        match self {
            Self::Tree(route) => contents.tree.reaches(route, stamp),
            Self::Topic(topic, _) => contents.poses(*topic).is_some_and(|poses| poses.timeline.newest() >= Some(stamp)),
            Self::None => true,
        }
    }
}

/// The frames of a recording.
pub(crate) struct Frames {
    /// In time order.
    pub(crate) list: Vec<PairedFrame>,
    pub(crate) poses: PoseCoverage,
    pub(crate) left_out: Vec<LeftOut>,
}

/// Builds frames from the chosen topics.
pub(crate) struct FrameMaker<'a> {
    pub(crate) path: &'a Path,
    pub(crate) contents: &'a Contents,
    pub(crate) settings: &'a DatasetSettings,
    pub(crate) choice: Choice<'a>,
}

impl<'a> FrameMaker<'a> {
    pub(crate) fn tolerance(&self) -> Tolerance {
        tolerance(self.settings)
    }

    pub(crate) fn error(&self, field: &str, found: String, expected: String) -> DatasetError {
        DatasetError::Field { path: self.path.to_owned(), field: field.to_owned(), found, expected }
    }

    /// Returns the source of the poses, and its description.
    pub(crate) fn pose_source(&self) -> Result<(PoseSource, String), DatasetError> {
        let tree = &self.contents.tree;
        let camera = self.choice.color.1.frame.as_str();
        match self.choice.pose {
            PoseChoice::Tree => {
                let world = self.tree_world(camera);
                let route = tree.route(camera, world).filter(|_| tree.has(camera));
                let route = route.ok_or_else(|| {
                    let frames = super::choice::listed(tree.frames().into_iter().map(str::to_owned).collect());
                    let expected = format!("a frame connected to {camera:?} by /tf; frames: {frames}");
                    self.error("dataset.world_frame", format!("{world:?}"), expected)
                })?;
                let text = format!("/tf, from {camera} to {world}");
                Ok((PoseSource::Tree(route), text))
            }
            PoseChoice::Topic(topic, poses) => {
                let named = self.settings.pose_frame.as_deref().map(bare_frame).or(poses.body.as_deref());
                let route =
                    named.and_then(|body| tree.route(camera, body).filter(|_| body == camera || tree.has(camera)));
                let fixed = route.filter(|route| !tree.is_moving(route)).and_then(|route| tree.fixed_transform(&route));
                let of = match (named, fixed) {
                    (Some(body), Some(_)) if body == camera => format!("of the camera, {camera}"),
                    (Some(body), Some(_)) => format!("of {body}, with /tf_static from {camera}"),
                    (Some(body), None) => {
                        format!("of {body}, assumed to be the camera: /tf_static does not connect {camera} to it")
                    }
                    (None, _) => {
                        format!("assumed to be of {camera}: its messages do not name a frame (dataset.pose_frame)")
                    }
                };
                let text = format!("{} ({}) in {}, {of}", topic.name, topic.type_name, poses.world);
                let source = self
                    .contents
                    .index_of(topic)
                    .map_or(PoseSource::None, |index| PoseSource::Topic(index, fixed.unwrap_or(Rigid::IDENTITY)));
                Ok((source, text))
            }
            PoseChoice::None(reason) => Ok((PoseSource::None, no_poses_text(reason, camera))),
        }
    }

    /// Returns the world frame if poses come from `/tf`: the one that the settings name, or the root above the camera.
    fn tree_world<'n>(&'n self, camera: &'n str) -> &'n str {
        let named = self.settings.world_frame.as_deref().map(bare_frame);
        named.or_else(|| self.contents.tree.ancestors(camera).last().copied()).unwrap_or(camera)
    }

    /// Returns the name of the frame that poses are in; `None` if there are none, or they do not name it.
    pub(crate) fn world_frame(&self) -> Option<String> {
        match self.choice.pose {
            PoseChoice::Tree => Some(self.tree_world(&self.choice.color.1.frame).to_owned()),
            PoseChoice::Topic(_, poses) => Some(poses.world.clone()).filter(|world| !world.is_empty()),
            PoseChoice::None(_) => None,
        }
    }

    /// Pairs colour and depth images by time, in time order.
    fn pairs(&self) -> Vec<(StampedPlace, StampedPlace)> {
        let (color, depth) = (&self.choice.color.1.timeline, &self.choice.depth.1.timeline);
        let mut pairs = Vec::with_capacity(color.len());
        for stretch in &color.stretches {
            // Contains one entry if the clock is never set back.
            let mut by_depth: BTreeMap<usize, Vec<StampedPlace>> = BTreeMap::new();
            for image in &stretch.messages {
                if let Some(index) = depth.index_of_stretch(image) {
                    by_depth.entry(index).or_default().push(*image);
                }
            }
            for (index, color) in by_depth {
                if let Some(depth) = depth.stretches.get(index) {
                    pairs.extend(paired(&color, &depth.messages, self.settings.max_time_difference_ms));
                }
            }
        }
        pairs
    }

    /// Returns the frames in time order.
    ///
    /// # Errors
    /// If no colour image has a depth image, or there is a source of poses and no frame has one.
    pub(crate) fn frames(&self, source: &PoseSource, cameras: (&Cameras, &Cameras)) -> Result<Frames, DatasetError> {
        let ((color_topic, color), (depth_topic, depth)) = (self.choice.color, self.choice.depth);
        let (color, depth) = (&color.timeline, &depth.timeline);
        let limit_ms = self.settings.max_time_difference_ms;
        let pairs = self.pairs();
        let frame = |(color, depth): &(StampedPlace, StampedPlace)| PairedFrame {
            stamp: color.stamp,
            recorded: color.recorded,
            color: color.place,
            depth: depth.place,
            pose: source.at(self.contents, color.instant(), self.tolerance()),
            cameras: (cameras.0.at(color), cameras.1.at(depth)),
        };
        let list: Vec<PairedFrame> = pairs.iter().map(frame).collect();
        self.warn_of_clock(source);
        let without_pose = list.iter().filter(|frame| frame.pose.is_none()).count();
        let has_source = !matches!(source, PoseSource::None);
        if list.is_empty() || has_source && without_pose == list.len() {
            let found = format!(
                "{} images of {} and {} of {}: {} pairs within {limit_ms} ms{}; {}",
                color.len(),
                color_topic.name,
                depth.len(),
                depth_topic.name,
                pairs.len(),
                if list.is_empty() { "" } else { ", none with a pose" },
                self.spans_text(source)
            );
            let expected = "colour and depth at the same times, with poses: see dataset.max_time_difference_ms and \
                            dataset.max_pose_gap_ms; --pose none uses no poses";
            return Err(self.error("frames", found, expected.to_owned()));
        }
        let left_out = LeftOut::list([
            (color.len() - pairs.len(), format!("without a depth image within {limit_ms} ms of their colour image")),
            (color.misfits + color.duplicates, misfit_text(&color_topic.name)),
            (depth.misfits + depth.duplicates, misfit_text(&depth_topic.name)),
        ]);
        let gap_ms = self.settings.max_pose_gap_ms;
        let reason = format!("without a pose at their time (or within {gap_ms} ms)");
        let poses =
            if has_source { PoseCoverage::new(list.len(), [(without_pose, reason)]) } else { PoseCoverage::NONE };
        Ok(Frames { list, poses, left_out })
    }

    /// Returns the times of the images and of poses from a topic, for messages.
    fn spans_text(&self, source: &PoseSource) -> String {
        let (color, depth) = (&self.choice.color.1.timeline, &self.choice.depth.1.timeline);
        let poses = match source {
            PoseSource::Topic(topic, _) => self.contents.poses(*topic).map(|poses| span_text(&poses.timeline)),
            PoseSource::Tree(_) | PoseSource::None => None,
        };
        let poses = poses.map_or_else(String::new, |poses| format!(", poses {poses}"));
        format!("colour {}, depth {}{poses}", span_text(color), span_text(depth))
    }

    /// Warns if the clock was set back, and about poses and transforms with wrong stamps.
    fn warn_of_clock(&self, source: &PoseSource) {
        let (topic, images) = self.choice.color;
        let path = self.path.display();
        let set_back = images.timeline.stretches.len().saturating_sub(1);
        if set_back > 0 {
            let times = if set_back == 1 { "once".to_owned() } else { format!("{set_back} times") };
            warn_once(format!("{path}: the clock of {} was set back {times}: stamps repeat", topic.name));
        }
        let misfits = match source {
            PoseSource::Tree(route) => self.contents.tree.misfits(route),
            PoseSource::Topic(topic, _) => self.contents.poses(*topic).map_or(0, |poses| poses.timeline.misfits),
            PoseSource::None => 0,
        };
        if misfits > 0 {
            warn_once(format!(
                "{path}: {misfits} poses are not used: their stamps do not fit those of their neighbours"
            ));
        }
    }

    /// Returns the transform from depth camera to colour camera coordinates; `None` if their frames are the same.
    pub(crate) fn color_from_depth(&self) -> Result<Option<Rigid>, DatasetError> {
        let (color, depth) = (&self.choice.color.1.frame, &self.choice.depth.1.frame);
        if color == depth {
            return Ok(None);
        }
        let tree = &self.contents.tree;
        let route = tree.route(depth, color).filter(|route| !tree.is_moving(route));
        let transform = route.and_then(|route| tree.fixed_transform(&route));
        transform.map(Some).ok_or_else(|| {
            let found = format!("depth in frame {depth:?}, colour in frame {color:?}");
            let expected =
                "a fixed transform between them in /tf_static, or depth that is registered to colour (--depth)";
            self.error("frames of the cameras", found, expected.to_owned())
        })
    }
}

/// Returns the tolerances for poses that the settings give.
pub(crate) fn tolerance(settings: &DatasetSettings) -> Tolerance {
    let nanoseconds = |milliseconds: f64| (milliseconds * NANOSECONDS_PER_MS) as i64;
    let (nearest, gap) = (settings.max_time_difference_ms, settings.max_pose_gap_ms);
    Tolerance { nearest: nanoseconds(nearest), gap: nanoseconds(gap) }
}

/// Pairs images of two lists, each in time order, that are at most `limit_ms` milliseconds apart: the closest first.
/// Returns the pairs in time order.
pub(crate) fn paired(
    color: &[StampedPlace],
    depth: &[StampedPlace],
    limit_ms: f64,
) -> Vec<(StampedPlace, StampedPlace)> {
    let Some(first) = color.first().map(|first| first.stamp) else { return Vec::new() };
    // `associate` excludes pairs exactly at the limit, which should be included here.
    let limit = limit_ms * 1e-3 + 1e-9;
    let seconds = |list: &[StampedPlace]| -> Vec<f64> {
        list.iter().map(|place| place.stamp.saturating_sub(first) as f64 * 1e-9).collect()
    };
    let found = associate(&seconds(color), &seconds(depth), limit);
    let pair = |(color_index, depth_index): (usize, usize)| {
        color.get(color_index).copied().zip(depth.get(depth_index).copied())
    };
    found.into_iter().filter_map(pair).collect()
}

/// Returns true if a message's stamp matches those of the images, to within seconds. A camera info has the stamp of its
/// image.
fn fits(message: &StampedPlace, images: &Topic) -> bool {
    let Content::Images(Images { timeline, .. }) = &images.content else { return true };
    timeline.stretches.iter().any(|stretch| {
        let ends =
            [stretch.messages.first(), stretch.messages.last()].map(|end| end.map_or(message.stamp, |end| end.stamp));
        message.stamp >= ends[0].saturating_sub(INFO_SLACK) && message.stamp <= ends[1].saturating_add(INFO_SLACK)
    })
}

fn no_poses_text(reason: NoPoses<'_>, camera: &str) -> String {
    let missing = "none: no topic has poses";
    match reason {
        NoPoses::Chosen => "none (dataset.pose)".to_owned(),
        NoPoses::Stationary(root) => {
            format!("{missing}, and {camera} does not move in {root}; for a stationary camera use --pose /tf_static")
        }
        NoPoses::NotInTree => format!("{missing}, and {camera:?} is not in /tf"),
    }
}

/// Returns the first and last stamp of a topic, for messages.
fn span_text<T: Stamped>(timeline: &Timeline<T>) -> String {
    let stamps = timeline.stretches.iter().flat_map(|stretch| &stretch.messages);
    time_range(&stamps.map(|message| message.stamp() as f64 * 1e-9).collect::<Vec<_>>())
}

fn misfit_text(topic: &str) -> String {
    format!("of {topic} whose stamp does not fit its neighbours' or is a duplicate")
}

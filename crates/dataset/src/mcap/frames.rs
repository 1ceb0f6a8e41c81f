//! Frames of a recording: pairs of colour and depth, with a camera pose if there is one.

use super::cameras::{Calibration, Camera};
use super::clock::Recorded;
use super::container::MessagePlace;
use super::contents::{Content, Contents, Images, StampedPlace, Topic};
use super::frame_names::bare_frame;
use super::poses::Poses;
use super::topics::{Choice, NoPoses, PoseChoice};
use super::transforms::{Instant, Rigid, Route, Tolerance};
use crate::plausibility::warn_once;
use crate::recorded_poses::PoseCoverage;
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
pub(super) struct PairedFrame {
    /// Stamp of the colour image, nanoseconds.
    pub(super) stamp: i64,
    /// Recording time of the colour image.
    pub(super) recorded: Recorded,
    pub(super) color: MessagePlace,
    pub(super) depth: MessagePlace,
    pub(super) pose: Option<Pose>,
    /// Indices of the colour and depth camera in the lists of their topics.
    pub(super) cameras: (usize, usize),
}

/// The cameras of a topic, each valid from some time on.
#[derive(Debug)]
pub(super) struct Cameras {
    pub(super) topic: String,
    pub(super) list: Vec<Camera>,
    /// The messages that describe them.
    starts: Vec<StampedPlace>,
    /// True if their stamps are increasing and match those of the images.
    in_order: bool,
}

impl Cameras {
    /// Returns the cameras described by a topic, for the images of topic `images`.
    pub(super) fn new(topic: &Topic, images: &Topic, path: &Path) -> Result<Self, DatasetError> {
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
    pub(super) fn replace_intrinsics(&mut self, of_size: impl Fn((usize, usize)) -> Intrinsics) {
        for camera in &mut self.list {
            camera.intrinsics = of_size((camera.intrinsics.width, camera.intrinsics.height));
        }
    }

    /// Returns the camera of an image. Before the first camera info, its camera is used.
    fn at(&self, image: &StampedPlace) -> usize {
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
pub(super) enum PoseSource<'a> {
    /// Transforms from the camera's frame to the world frame.
    Tree(Route),
    /// Poses of a body, and the transform from camera to body.
    Topic(&'a Poses, Rigid),
    /// Frames have no poses.
    None,
}

/// The frames of a recording.
pub(super) struct Frames {
    /// In time order.
    pub(super) list: Vec<PairedFrame>,
    pub(super) poses: PoseCoverage,
    pub(super) left_out: Vec<LeftOut>,
}

/// Builds frames from the chosen topics.
pub(super) struct FrameMaker<'a> {
    pub(super) path: &'a Path,
    pub(super) contents: &'a Contents,
    pub(super) settings: &'a DatasetSettings,
    pub(super) choice: Choice<'a>,
}

impl<'a> FrameMaker<'a> {
    pub(super) fn tolerance(&self) -> Tolerance {
        let nanoseconds = |milliseconds: f64| (milliseconds * NANOSECONDS_PER_MS) as i64;
        let (nearest, gap) = (self.settings.max_time_difference_ms, self.settings.max_pose_gap_ms);
        Tolerance { nearest: nanoseconds(nearest), gap: nanoseconds(gap) }
    }

    pub(super) fn error(&self, field: &str, found: String, expected: String) -> DatasetError {
        DatasetError::Field { path: self.path.to_owned(), field: field.to_owned(), found, expected }
    }

    /// Returns the source of the poses, and its description.
    pub(super) fn pose_source(&self) -> Result<(PoseSource<'a>, String), DatasetError> {
        let tree = &self.contents.tree;
        let camera = self.choice.color.1.frame.as_str();
        match self.choice.pose {
            PoseChoice::Tree => {
                let ancestors = tree.ancestors(camera);
                let root = ancestors.last().copied().unwrap_or(camera);
                let world = self.settings.world_frame.as_deref().map_or(root, bare_frame);
                let route = tree.route(camera, world).filter(|_| tree.has(camera));
                let route = route.ok_or_else(|| {
                    let frames = super::topics::listed(tree.frames().into_iter().map(str::to_owned).collect());
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
                Ok((PoseSource::Topic(poses, fixed.unwrap_or(Rigid::IDENTITY)), text))
            }
            PoseChoice::None(reason) => Ok((PoseSource::None, no_poses_text(reason, camera))),
        }
    }

    fn pose_at(&self, source: &PoseSource<'_>, image: &StampedPlace) -> Option<Pose> {
        let at = Instant { stamp: image.stamp, recorded: image.recorded };
        let rigid = match source {
            PoseSource::Tree(route) => self.contents.tree.transform(route, at, self.tolerance())?,
            PoseSource::Topic(poses, body_from_camera) => {
                poses.timeline.at(at, self.tolerance())?.after(body_from_camera)
            }
            PoseSource::None => return None,
        };
        rigid.to_pose().ok()
    }

    /// Pairs colour and depth images by time, in time order.
    fn pairs(&self) -> Vec<(StampedPlace, StampedPlace)> {
        let (color, depth) = (&self.choice.color.1.timeline, &self.choice.depth.1.timeline);
        // `associate` excludes pairs exactly at the limit, which should be included here.
        let limit = self.settings.max_time_difference_ms * 1e-3 + 1e-9;
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
                let Some((first, depth)) = color.first().map(|first| first.stamp).zip(depth.stretches.get(index))
                else {
                    continue;
                };
                let seconds = |list: &[StampedPlace]| -> Vec<f64> {
                    list.iter().map(|place| place.stamp.saturating_sub(first) as f64 * 1e-9).collect()
                };
                let found = associate(&seconds(&color), &seconds(&depth.messages), limit);
                pairs.extend(found.into_iter().filter_map(|(color_index, depth_index)| {
                    color.get(color_index).copied().zip(depth.messages.get(depth_index).copied())
                }));
            }
        }
        pairs
    }

    /// Returns the frames in time order.
    ///
    /// # Errors
    /// If no colour image has a depth image, or there is a source of poses and no frame has one.
    pub(super) fn frames(
        &self,
        source: &PoseSource<'_>,
        cameras: (&Cameras, &Cameras),
    ) -> Result<Frames, DatasetError> {
        let ((color_topic, color), (depth_topic, depth)) = (self.choice.color, self.choice.depth);
        let (color, depth) = (&color.timeline, &depth.timeline);
        let limit_ms = self.settings.max_time_difference_ms;
        let pairs = self.pairs();
        let frame = |(color, depth): &(StampedPlace, StampedPlace)| PairedFrame {
            stamp: color.stamp,
            recorded: color.recorded,
            color: color.place,
            depth: depth.place,
            pose: self.pose_at(source, color),
            cameras: (cameras.0.at(color), cameras.1.at(depth)),
        };
        let list: Vec<PairedFrame> = pairs.iter().map(frame).collect();
        self.warn_of_clock(source);
        let without_pose = list.iter().filter(|frame| frame.pose.is_none()).count();
        let has_source = !matches!(source, PoseSource::None);
        if list.is_empty() || has_source && without_pose == list.len() {
            let found = format!(
                "{} images of {} and {} of {}: {} pairs within {limit_ms} ms{}",
                color.len(),
                color_topic.name,
                depth.len(),
                depth_topic.name,
                pairs.len(),
                if list.is_empty() { "" } else { ", none with a pose" }
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

    /// Warns if the clock was set back, and about poses and transforms with wrong stamps.
    fn warn_of_clock(&self, source: &PoseSource<'_>) {
        let (topic, images) = self.choice.color;
        let path = self.path.display();
        let set_back = images.timeline.stretches.len().saturating_sub(1);
        if set_back > 0 {
            let times = if set_back == 1 { "once".to_owned() } else { format!("{set_back} times") };
            warn_once(format!("{path}: the clock of {} was set back {times}: stamps repeat", topic.name));
        }
        let misfits = match source {
            PoseSource::Tree(route) => self.contents.tree.misfits(route),
            PoseSource::Topic(poses, _) => poses.timeline.misfits,
            PoseSource::None => 0,
        };
        if misfits > 0 {
            warn_once(format!(
                "{path}: {misfits} poses are not used: their stamps do not fit those of their neighbours"
            ));
        }
    }

    /// Returns the transform from depth camera to colour camera coordinates; `None` if their frames are the same.
    pub(super) fn color_from_depth(&self) -> Result<Option<Rigid>, DatasetError> {
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

fn misfit_text(topic: &str) -> String {
    format!("of {topic} whose stamp does not fit its neighbours' or is a duplicate")
}

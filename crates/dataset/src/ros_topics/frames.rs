//! Frames: pairs of colour and depth, with a camera pose if there is one.

use super::camera_list::Cameras;
use super::choice::{Choice, NoPoses, PoseChoice};
use super::clock::{Recorded, Stamped};
use super::contents::{Contents, MessagePlace, StampedPlace};
use super::frame_names::bare_frame;
use super::timeline::Timeline;
use super::transform_tree::{Purpose, Route};
use super::transforms::{Instant, Rigid, Tolerance};
use super::world::{TreePoses, no_poses_text, tree_poses};
use crate::plausibility::warn_once;
use crate::pose_convention::PoseConvention;
use crate::recorded_poses::PoseCoverage;
use crate::stamps::time_range;
use crate::tum::associate;
use crate::{DatasetError, DatasetSettings, LeftOut};
use splatseg_geometry::Pose;
use std::collections::BTreeMap;
use std::path::Path;

const NANOSECONDS_PER_MS: f64 = 1e6;
/// Names of frames that have x forward (REP 103), besides those that end in `link`.
const LINK_FRAMES: [&str; 5] = ["base_footprint", "base", "body", "chassis", "robot"];
/// Angle of a transform that may turn a link into an optical frame, radians. It is 120 degrees for a camera that looks
/// ahead.
const OPTICAL_TURN: f64 = 0.8;

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

impl PairedFrame {
    /// Creates the frame of a pair of images, taken by cameras of two lists.
    pub(crate) fn new(
        (color, depth): (&StampedPlace, &StampedPlace),
        pose: Option<Pose>,
        (color_cameras, depth_cameras): (&Cameras, &Cameras),
    ) -> Self {
        Self {
            stamp: color.stamp,
            recorded: color.recorded,
            color: color.place,
            depth: depth.place,
            pose,
            cameras: (color_cameras.at(color), depth_cameras.at(depth)),
        }
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

    /// Warns about transforms and poses whose quaternions do not have length 1: all transforms, and the poses that are
    /// used.
    pub(crate) fn warn_of_quaternions(&self) {
        let topic = match self.choice.pose {
            PoseChoice::Topic(topic, _) => Some(topic.name.as_str()),
            PoseChoice::Tree | PoseChoice::None(_) => None,
        };
        for line in self.contents.quaternions.warnings(topic) {
            warn_once(format!("{}: {line}", self.path.display()));
        }
    }

    /// Returns the source of the poses, and its description. Warns about contradictory transforms, and poses of another
    /// body that are taken for the camera's.
    ///
    /// # Errors
    /// If poses are to come from `/tf`, which does not connect the camera to a world.
    pub(crate) fn pose_source(&self) -> Result<(PoseSource, String), DatasetError> {
        let tree = &self.contents.tree;
        let camera = self.choice.color.1.frame.as_str();
        match self.choice.pose {
            PoseChoice::Tree => self.tree_source(camera),
            PoseChoice::Topic(topic, poses) => {
                let named = self.settings.pose_frame.as_deref().map(bare_frame).or(poses.body.as_deref());
                let fixed = named
                    .filter(|body| *body == camera || tree.has(camera))
                    .and_then(|body| tree.fixed_transform(camera, body));
                if let (Some(body), Some(_)) = (named, fixed) {
                    self.warn_of_contradictions(tree.route(camera, body, Purpose::Fixed).as_ref());
                }
                let turn = fixed.map_or(0.0, |fixed| fixed.apart(&Rigid::IDENTITY).1);
                self.hint_at_link_frame(named.filter(|body| *body == camera || fixed.is_some()), camera, turn);
                let of = match (named, fixed) {
                    (Some(body), Some(_)) if body == camera => format!("of the camera, {camera}"),
                    (Some(body), Some(_)) => format!("of {body}, with /tf_static from {camera}"),
                    (Some(body), None) => {
                        self.warn_of_other_body(&topic.name, body, camera);
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
            PoseChoice::None(NoPoses::Chosen) => Ok((PoseSource::None, "none (dataset.pose)".to_owned())),
            PoseChoice::None(NoPoses::NotFound) => {
                Ok((PoseSource::None, no_poses_text(self.contents, self.settings, camera)))
            }
        }
    }

    /// Returns the source of poses in `/tf`, and its description.
    fn tree_source(&self, camera: &str) -> Result<(PoseSource, String), DatasetError> {
        let tree = &self.contents.tree;
        let listed = |frames: Vec<&str>| super::frame_names::listed(frames.into_iter().map(str::to_owned).collect());
        let TreePoses { body, world, route, remark, candidates } = tree_poses(self.contents, self.settings, camera);
        if self.settings.world_frame.is_none() && !candidates.is_empty() {
            let found = format!("{camera:?}, relative to which these move: {}", listed(candidates));
            let expected = "a parent in /tf in which it moves: name the world with --world-frame, or use --pose /tf_static \
                            for a stationary camera";
            return Err(self.error("frame of the colour images", found, expected.to_owned()));
        }
        let Some(route) = route else {
            let frames = listed(tree.frames());
            let (field, found) = match self.settings.world_frame {
                Some(_) => ("dataset.world_frame", format!("{world:?}")),
                None => ("frame of the colour images", format!("{camera:?}")),
            };
            let expected = match (tree.has(body), self.settings.world_frame.is_some()) {
                (true, true) => format!("a frame connected to {body:?} by /tf; frames: {frames}"),
                _ => format!(
                    "a frame in /tf: record /tf_static, or take the poses of a frame for the camera's with --pose-frame; \
                     frames: {frames}"
                ),
            };
            return Err(self.error(field, found, expected));
        };
        if let Some(remark) = remark {
            warn_once(format!("{}: {remark}", self.path.display()));
        }
        self.warn_of_contradictions(Some(&route));
        self.hint_at_link_frame(Some(body).filter(|body| *body == camera), camera, tree.largest_fixed_turn(&route));
        if body != camera {
            self.warn_of_other_body("/tf", body, camera);
            return Ok((PoseSource::Tree(route), format!("/tf, from {body}, assumed to be the camera, to {world}")));
        }
        Ok((PoseSource::Tree(route), format!("/tf, from {camera} to {world}")))
    }

    /// Hints that the camera's frame may have x forward instead of z, by its name alone: it is that of a link, and no
    /// transform turns it as an optical frame is turned. `connected` is a frame with poses that is connected to it.
    fn hint_at_link_frame(&self, connected: Option<&str>, camera: &str, largest_turn: f64) {
        let name = camera.rsplit('/').next().unwrap_or_default().to_ascii_lowercase();
        let is_link = name.ends_with("link") || LINK_FRAMES.contains(&name.as_str());
        let is_stated = self.settings.pose_convention != PoseConvention::default();
        if connected.is_some() && is_link && !name.contains("optical") && largest_turn < OPTICAL_TURN && !is_stated {
            warn_once(format!(
                "{}: the images are in {camera}, whose name is that of a link (x forward), not of an optical frame (z \
                 forward): if its poses have x forward, say so with --pose-convention",
                self.path.display()
            ));
        }
    }

    /// Warns about frames with several parents and about transforms that are static and moving, along a route.
    fn warn_of_contradictions(&self, route: Option<&Route>) {
        for line in route.into_iter().flat_map(|route| self.contents.tree.contradictions(route)) {
            warn_once(format!("{}: {line}", self.path.display()));
        }
    }

    /// Warns about contradictory transforms between the frames of depth and colour.
    pub(super) fn warn_of_fixed_contradictions(&self) {
        let (color, depth) = (&self.choice.color.1.frame, &self.choice.depth.1.frame);
        self.warn_of_contradictions(self.contents.tree.route(depth, color, Purpose::Fixed).as_ref());
    }

    /// Warns that the poses of another body are taken for the camera's.
    fn warn_of_other_body(&self, topic: &str, body: &str, camera: &str) {
        if self.settings.pose_convention != PoseConvention::default() {
            return;
        }
        warn_once(format!(
            "{}: {topic} has poses of {body}, and no transform connects {camera} to it: they are taken for the camera's; \
             record /tf_static, name another frame with --pose-frame, or say with --pose-convention that {body} has x \
             forward",
            self.path.display()
        ));
    }

    /// Returns the name of the frame that poses are in, empty if they do not name it; `None` if there are none.
    pub(crate) fn world_frame(&self) -> Option<&'a str> {
        let camera = self.choice.color.1.frame.as_str();
        match self.choice.pose {
            PoseChoice::Tree => Some(tree_poses(self.contents, self.settings, camera).world),
            PoseChoice::Topic(_, poses) => Some(&poses.world),
            PoseChoice::None(_) => None,
        }
    }

    /// Pairs colour and depth images by time, in time order. Without depth, each colour image is its own partner.
    fn pairs(&self) -> Vec<(StampedPlace, StampedPlace)> {
        let (color, depth) = (&self.choice.color.1.timeline, &self.choice.depth.1.timeline);
        if !self.choice.has_depth {
            let images = color.stretches.iter().flat_map(|stretch| &stretch.messages);
            return images.map(|image| (*image, *image)).collect();
        }
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
        let (color_topic, color_images) = self.choice.color;
        let (depth_topic, depth_images) = self.choice.depth;
        let (color, depth) = (&color_images.timeline, &depth_images.timeline);
        let limit_ms = self.settings.max_time_difference_ms;
        let pairs = self.pairs();
        let frame = |(color, depth): &(StampedPlace, StampedPlace)| {
            let pose = source.at(self.contents, color.instant(), self.tolerance());
            PairedFrame::new((color, depth), pose, cameras)
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
            (if self.choice.has_depth { depth.misfits + depth.duplicates } else { 0 }, misfit_text(&depth_topic.name)),
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

/// Returns the first and last stamp of a topic, for messages.
fn span_text<T: Stamped>(timeline: &Timeline<T>) -> String {
    let stamps = timeline.stretches.iter().flat_map(|stretch| &stretch.messages);
    time_range(&stamps.map(|message| message.stamp() as f64 * 1e-9).collect::<Vec<_>>())
}

fn misfit_text(topic: &str) -> String {
    format!("of {topic} whose stamp does not fit its neighbours' or is a duplicate")
}

//! Choice of a recording's topics: those named in the settings, otherwise the only suitable ones.

use super::contents::{Content, Contents, Images, Topic};
use super::frame_names::bare_frame;
use super::images::{COLOR_ENCODINGS, DEPTH_ENCODINGS, ImageKind};
use super::poses::Poses;
use crate::error::NAMES_IN_MESSAGES;
use crate::{DatasetError, DatasetSettings};
use std::path::Path;

/// Suffixes of compressed versions of an image topic.
const TRANSPORTS: [&str; 2] = ["/compressedDepth", "/compressed"];
const TF: &str = "/tf";
const TF_STATIC: &str = "/tf_static";
/// Value of the setting `pose` for a recording whose poses are not used.
pub(crate) const NO_POSES: &str = "none";

/// The topics used.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Choice<'a> {
    pub(crate) color: (&'a Topic, &'a Images),
    pub(crate) depth: (&'a Topic, &'a Images),
    pub(crate) color_info: &'a Topic,
    /// Equal to `color_info` if the depth camera has no camera info but the frame of the colour camera.
    pub(crate) depth_info: &'a Topic,
    pub(crate) pose: PoseChoice<'a>,
}

/// Source of poses.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PoseChoice<'a> {
    /// The transform tree.
    Tree,
    /// A topic with poses.
    Topic(&'a Topic, &'a Poses),
    /// None.
    None(NoPoses<'a>),
}

/// Reason why a recording's frames have no poses.
#[derive(Clone, Copy, Debug)]
pub(crate) enum NoPoses<'a> {
    /// The settings say so.
    Chosen,
    /// No topic has poses, and the frame of the colour images does not move in this one.
    Stationary(&'a str),
    /// No topic has poses, and the frame of the colour images is not in `/tf`.
    NotInTree,
}

/// Chooses among the topics of a recording.
pub(crate) struct Chooser<'a> {
    pub(crate) path: &'a Path,
    pub(crate) contents: &'a Contents,
    pub(crate) settings: &'a DatasetSettings,
}

impl<'a> Chooser<'a> {
    /// Chooses the topics to use.
    ///
    /// # Errors
    /// [`DatasetError::Field`] lists the topics if several are suitable, none is (except for poses, which are optional),
    /// or the requested one is not.
    pub(crate) fn choose(&self) -> Result<Choice<'a>, DatasetError> {
        let color = self.color()?;
        let depth = self.depth(color.1)?;
        let color_info = match &self.settings.camera_info {
            Some(name) => self.info_named("camera_info", name)?,
            None => self.info_of(color)?.ok_or_else(|| self.no_info("colour", color.0, "--camera-info"))?,
        };
        let depth_info = match &self.settings.depth_camera_info {
            Some(name) => self.info_named("depth_camera_info", name)?,
            None => match self.info_of(depth)? {
                Some(info) => info,
                None if depth.1.frame == color.1.frame => color_info,
                None => return Err(self.no_info("depth", depth.0, "--set dataset.depth_camera_info=TOPIC")),
            },
        };
        Ok(Choice { color, depth, color_info, depth_info, pose: self.pose(color.1)? })
    }

    fn error(&self, field: impl Into<String>, found: String, expected: impl Into<String>) -> DatasetError {
        DatasetError::Field { path: self.path.to_owned(), field: field.into(), found, expected: expected.into() }
    }

    /// Returns the image topics that have messages.
    fn images(&self) -> impl Iterator<Item = (&'a Topic, &'a Images)> {
        self.contents.topics.iter().filter_map(|topic| match &topic.content {
            Content::Images(images) if images.kind.is_some() => Some((topic, images)),
            _ => None,
        })
    }

    fn image_named(&self, key: &str, name: &str) -> Result<(&'a Topic, &'a Images), DatasetError> {
        let found =
            self.contents.find(name).and_then(|topic| self.images().find(|(other, _)| std::ptr::eq(*other, topic)));
        found.ok_or_else(|| {
            let images = self.images().map(|(topic, _)| topic.name.clone()).collect();
            self.error(
                format!("dataset.{key}"),
                format!("{name:?}"),
                format!("a topic with images: {}", listed(images)),
            )
        })
    }

    fn color(&self) -> Result<(&'a Topic, &'a Images), DatasetError> {
        if let Some(name) = &self.settings.color {
            return self.image_named("color", name);
        }
        let of_kind =
            |wanted: ImageKind| without_transports(self.images().filter(|(_, images)| images.kind == Some(wanted)));
        let mut candidates = of_kind(ImageKind::Color);
        if candidates.is_empty() {
            candidates = of_kind(ImageKind::Grey);
        }
        self.only(&candidates, "topics of colour images", "--color")
            .ok_or_else(|| self.no_images("colour images", COLOR_ENCODINGS))?
    }

    fn depth(&self, color: &Images) -> Result<(&'a Topic, &'a Images), DatasetError> {
        if let Some(name) = &self.settings.depth {
            return self.image_named("depth", name);
        }
        let mut candidates =
            without_transports(self.images().filter(|(_, images)| images.kind == Some(ImageKind::Depth)));
        let is_registered = |(_, images): &(&Topic, &Images)| images.frame == color.frame && !images.frame.is_empty();
        // If the driver also provides registered depth, it is better than registering it later.
        if candidates.len() > 1 && candidates.iter().filter(|candidate| is_registered(candidate)).count() == 1 {
            candidates.retain(is_registered);
        }
        self.only(&candidates, "topics of depth images", "--depth")
            .ok_or_else(|| self.no_images("depth images", DEPTH_ENCODINGS))?
    }

    /// Returns the only candidate, or an error that lists several; `None` if there are none.
    fn only<T: Copy>(
        &self,
        candidates: &[(&'a Topic, T)],
        field: &str,
        flag: &str,
    ) -> Option<Result<(&'a Topic, T), DatasetError>> {
        match candidates {
            [] => None,
            [only] => Some(Ok(*only)),
            several => {
                let names = several.iter().map(|(topic, _)| topic.name.clone()).collect();
                let expected = format!("one: choose it with {flag}");
                Some(Err(self.error(field, listed(names), expected)))
            }
        }
    }

    /// Returns the error for a recording without images of a kind. It lists the images or topics there are.
    fn no_images(&self, what: &str, encodings: &str) -> DatasetError {
        let mut found: Vec<String> =
            self.images().map(|(topic, images)| format!("{} ({})", topic.name, images.encoding)).collect();
        if found.is_empty() {
            let types = self
                .contents
                .topics
                .iter()
                .map(|topic| format!("{} ({}, {})", topic.name, topic.type_name, topic.encoding));
            found = types.collect();
        }
        let expected = format!("a topic of sensor_msgs/msg/Image or CompressedImage (ROS 2, cdr) with {encodings}");
        let found = if found.is_empty() { "no topic".to_owned() } else { format!("none, but {}", listed(found)) };
        self.error(what, found, expected)
    }

    fn infos(&self) -> impl Iterator<Item = (&'a Topic, &'a str)> {
        self.contents.topics.iter().filter_map(|topic| match &topic.content {
            Content::Calibrations { frame, list } if !list.is_empty() => Some((topic, frame.as_str())),
            _ => None,
        })
    }

    fn info_named(&self, key: &str, name: &str) -> Result<&'a Topic, DatasetError> {
        let topic = self.contents.find(name).filter(|topic| self.infos().any(|(info, _)| std::ptr::eq(info, *topic)));
        topic.ok_or_else(|| {
            let names = self.infos().map(|(topic, _)| topic.name.clone()).collect();
            self.error(
                format!("dataset.{key}"),
                format!("{name:?}"),
                format!("a topic with camera infos: {}", listed(names)),
            )
        })
    }

    /// Returns the camera info of images: the one next to them, or else the only one with their frame; `None` if there
    /// is none.
    fn info_of(&self, (topic, images): (&'a Topic, &'a Images)) -> Result<Option<&'a Topic>, DatasetError> {
        let base = without_transport(&topic.name);
        let folder = base.rsplit_once('/').map_or("", |(folder, _)| folder);
        let beside = format!("{folder}/camera_info");
        if let Some((topic, _)) = self.infos().find(|(topic, _)| topic.name == beside) {
            return Ok(Some(topic));
        }
        let same_frame: Vec<_> = self.infos().filter(|(_, frame)| *frame == images.frame).collect();
        let field = format!("topics of camera infos of {}", topic.name);
        self.only(&same_frame, &field, "--camera-info").transpose().map(|found| found.map(|(topic, _)| topic))
    }

    fn no_info(&self, what: &str, topic: &Topic, flag: &str) -> DatasetError {
        let names: Vec<String> = self.infos().map(|(topic, frame)| format!("{} (frame {frame})", topic.name)).collect();
        let found =
            if names.is_empty() { "none".to_owned() } else { format!("none with its frame, but {}", listed(names)) };
        let expected = "a topic of sensor_msgs/msg/CameraInfo beside it, or with its frame";
        self.error(format!("camera info of {what} ({})", topic.name), found, format!("{expected}; {flag} chooses one"))
    }

    fn pose_topics(&self) -> impl Iterator<Item = (&'a Topic, &'a Poses)> {
        self.contents.topics.iter().filter_map(|topic| match &topic.content {
            Content::Poses(poses) if !poses.timeline.is_empty() => Some((topic, poses)),
            _ => None,
        })
    }

    fn pose(&self, color: &'a Images) -> Result<PoseChoice<'a>, DatasetError> {
        let tree = &self.contents.tree;
        if let Some(name) = &self.settings.pose {
            if name == NO_POSES {
                return Ok(PoseChoice::None(NoPoses::Chosen));
            }
            if is_tree(name) {
                return Ok(PoseChoice::Tree);
            }
            let topic = self.contents.find(name);
            let found = self.pose_topics().find(|(pose, _)| topic.is_some_and(|topic| std::ptr::eq(*pose, topic)));
            return found.map(|(topic, poses)| PoseChoice::Topic(topic, poses)).ok_or_else(|| {
                let names = [TF.to_owned()].into_iter().chain(self.pose_topics().map(|(topic, _)| topic.name.clone()));
                let expected = format!("{NO_POSES}, or a topic with poses: {}", listed(names.collect()));
                self.error("dataset.pose", format!("{name:?}"), expected)
            });
        }
        let root = self
            .settings
            .world_frame
            .as_deref()
            .map(bare_frame)
            .or_else(|| tree.ancestors(&color.frame).last().copied());
        let route = root.and_then(|root| tree.route(&color.frame, root));
        let is_requested = self.settings.world_frame.is_some() && tree.has(&color.frame);
        if is_requested || route.is_some_and(|route| tree.is_moving(&route)) {
            return Ok(PoseChoice::Tree);
        }
        let candidates: Vec<_> = self.pose_topics().collect();
        match self.only(&candidates, "topics of poses", "--pose") {
            Some(only) => only.map(|(topic, poses)| PoseChoice::Topic(topic, poses)),
            // Poses are wanted, so their lack is an error.
            None if self.settings.world_frame.is_some() => Ok(PoseChoice::Tree),
            None => Ok(PoseChoice::None(match tree.ancestors(&color.frame).last().copied() {
                Some(root) if root != color.frame => NoPoses::Stationary(root),
                _ => NoPoses::NotInTree,
            })),
        }
    }
}

/// Returns true if a value of the setting `pose` is the transform tree.
pub(crate) fn is_tree(name: &str) -> bool {
    [TF, TF_STATIC].iter().any(|tf| tf.trim_start_matches('/') == name.trim_start_matches('/'))
}

/// Returns the name of the topic with the raw images.
fn without_transport(name: &str) -> &str {
    TRANSPORTS.iter().find_map(|ending| name.strip_suffix(ending)).unwrap_or(name)
}

/// Keeps one topic for each image, raw rather than compressed.
fn without_transports<'a>(topics: impl Iterator<Item = (&'a Topic, &'a Images)>) -> Vec<(&'a Topic, &'a Images)> {
    let mut chosen: Vec<(&Topic, &Images)> = Vec::new();
    for (topic, images) in topics {
        let same =
            |(other, _): &&mut (&Topic, &Images)| without_transport(&other.name) == without_transport(&topic.name);
        match chosen.iter_mut().find(same) {
            Some(known) if known.1.is_compressed && !images.is_compressed => *known = (topic, images),
            Some(_) => {}
            None => chosen.push((topic, images)),
        }
    }
    chosen
}

/// Lists the first few names and the number of the others.
pub(crate) fn listed(names: Vec<String>) -> String {
    let more = names.len().saturating_sub(2 * NAMES_IN_MESSAGES);
    let first = names.into_iter().take(2 * NAMES_IN_MESSAGES).collect::<Vec<_>>().join(", ");
    match (first.is_empty(), more) {
        (true, _) => "none found".to_owned(),
        (_, 0) => first,
        (_, more) => format!("{first} and {more} more"),
    }
}

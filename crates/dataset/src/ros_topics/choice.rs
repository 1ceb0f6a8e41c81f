//! Choice of a recording's topics: those named in the settings, otherwise the only suitable ones.

use super::camera_list::calibrations;
use super::contents::{Content, Contents, Images, Topic};
use super::frame_names::listed;
use super::images::{COLOR_ENCODINGS, DEPTH_ENCODINGS, ImageKind};
use super::poses::Poses;
use super::world::tree_poses;
use crate::own_camera::OwnCamera;
use crate::plausibility::warn_once;
use crate::{DatasetError, DatasetSettings, DepthRegistration};
use std::path::Path;

/// Images, and their camera, that this project itself writes and publishes below its name: results, which are never taken
/// for a camera's unless they are named.
const RESULTS: [&str; 4] = ["overlay", "segments", "ids", "camera_info"];
const RESULTS_FOLDER: &str = "splatseg";
/// Suffixes of compressed versions of an image topic.
const TRANSPORTS: [&str; 2] = ["/compressedDepth", "/compressed"];
/// Remedies if colour or depth has no camera info.
const COLOR_INFO_REMEDY: &str = "--camera-info chooses one, or --fx describes the camera";
const DEPTH_INFO_REMEDY: &str = "--set dataset.depth_camera_info=TOPIC chooses one, or --register-depth false takes the \
                                 pixels of depth for those of colour";
const TF: &str = "/tf";
const TF_STATIC: &str = "/tf_static";
/// Value of the setting `pose` for a recording whose poses are not used.
pub(crate) const NO_POSES: &str = "none";
/// Remedy for a camera without a depth sensor.
const NO_DEPTH_REMEDY: &str = "for a camera without depth, --depth none and --depth-weights FILE predict it";

/// The topics used.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Choice<'a> {
    pub(crate) color: (&'a Topic, &'a Images),
    /// Equal to `color` if depth is not read, as `has_depth` says: each image is then its own partner.
    pub(crate) depth: (&'a Topic, &'a Images),
    pub(crate) has_depth: bool,
    /// `None` if the settings alone describe the camera.
    pub(crate) color_info: Option<&'a Topic>,
    /// Equal to `color_info` if the depth camera has no camera info but the frame of the colour camera. `None` if depth
    /// is taken as that of the colour camera.
    pub(crate) depth_info: Option<&'a Topic>,
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
    None(NoPoses),
}

/// Reason why a recording's frames have no poses.
#[derive(Clone, Copy, Debug)]
pub(crate) enum NoPoses {
    /// The settings say so.
    Chosen,
    /// No topic has poses of the camera, and it does not move in `/tf`.
    NotFound,
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
        let has_depth = self.settings.reads_depth_topic();
        let depth = if has_depth { self.depth(color.1)? } else { color };
        let is_described = self.settings.fx.is_some();
        let color_info = match &self.settings.camera_info {
            Some(name) => Some(self.info_named("camera_info", name)?),
            None => match self.info_of(color)? {
                None if !is_described => return Err(self.no_info("colour", color.0, COLOR_INFO_REMEDY)),
                info => {
                    if !is_described && has_depth {
                        self.warn_of_depth_info((color.0, depth.0), info);
                    }
                    info
                }
            },
        };
        let pose = self.pose(color.1)?;
        if !has_depth {
            return Ok(Choice { color, depth, has_depth, color_info, depth_info: None, pose });
        }
        self.warn_of_eight_bits(depth.0);
        let follows_color = depth.1.frame == color.1.frame
            || self.settings.register_depth == DepthRegistration::False
            || color_info.is_none();
        let depth_info = match &self.settings.depth_camera_info {
            Some(name) => Some(self.info_named("depth_camera_info", name)?),
            None => match self.info_of(depth)? {
                None if follows_color => color_info,
                None => return Err(self.no_info("depth", depth.0, DEPTH_INFO_REMEDY)),
                info => info,
            },
        };
        Ok(Choice { color, depth, has_depth, color_info, depth_info, pose })
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

    /// Returns the image topics that may be those of a camera.
    fn camera_images(&self) -> impl Iterator<Item = (&'a Topic, &'a Images)> {
        self.images().filter(|(topic, _)| !is_result(&topic.name))
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
        let of_kind = |wanted: ImageKind| {
            without_transports(self.camera_images().filter(|(_, images)| images.kind == Some(wanted)))
        };
        let mut candidates = of_kind(ImageKind::Color);
        if candidates.is_empty() {
            candidates = of_kind(ImageKind::Grey);
        }
        // A JPEG that does not say what it was made of, beside depth of the same images.
        let bases = self.images().filter(|(_, images)| images.kind == Some(ImageKind::Depth));
        let bases: Vec<&str> = bases.map(|(topic, _)| without_transport(&topic.name)).collect();
        candidates.retain(|(topic, _)| !bases.contains(&without_transport(&topic.name)));
        self.only(&candidates, "topics of colour images", "--color")
            .ok_or_else(|| self.no_images("colour images", COLOR_ENCODINGS.to_owned()))?
    }

    fn depth(&self, color: &Images) -> Result<(&'a Topic, &'a Images), DatasetError> {
        if let Some(name) = &self.settings.depth {
            let (topic, images) = self.image_named("depth", name)?;
            if images.kind == Some(ImageKind::EightBitDepth) {
                let found = format!("{name:?}, whose images have 8 bits ({})", images.encoding.trim());
                return Err(self.error("dataset.depth", found, "a topic with depth of 16 or 32 bits"));
            }
            return Ok((topic, images));
        }
        let mut candidates =
            without_transports(self.camera_images().filter(|(_, images)| images.kind == Some(ImageKind::Depth)));
        let is_registered = |(_, images): &(&Topic, &Images)| images.frame == color.frame && !images.frame.is_empty();
        // If the driver also provides registered depth, it is better than registering it later.
        if candidates.len() > 1 && candidates.iter().filter(|candidate| is_registered(candidate)).count() == 1 {
            candidates.retain(is_registered);
        }
        self.only(&candidates, "topics of depth images", "--depth")
            .ok_or_else(|| self.no_images("depth images", format!("{DEPTH_ENCODINGS}; {NO_DEPTH_REMEDY}")))?
    }

    /// Warns about depth of 8 bits beside the depth that is used.
    fn warn_of_eight_bits(&self, used: &Topic) {
        let is_beside = |(topic, images): &(&Topic, &Images)| {
            let is_shallow = matches!(images.kind, Some(ImageKind::EightBitDepth | ImageKind::Color | ImageKind::Grey));
            is_shallow && without_transport(&topic.name) == without_transport(&used.name)
        };
        for (topic, images) in self.images().filter(is_beside) {
            warn_once(format!(
                "{}: {} has depth of 8 bits ({}), which has lost its precision: {} is used",
                self.path.display(),
                topic.name,
                images.encoding.trim(),
                used.name
            ));
        }
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
    fn no_images(&self, what: &str, encodings: String) -> DatasetError {
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
        let mut expected = format!("a topic of sensor_msgs/msg/Image or CompressedImage (ROS 2, cdr) with {encodings}");
        if self.images().any(|(topic, _)| is_result(&topic.name)) {
            expected += "; overlay and ids are results of splatseg, not images of a camera";
        }
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
    /// is none. One without a usable camera is taken only if there is no other.
    fn info_of(&self, (topic, images): (&'a Topic, &'a Images)) -> Result<Option<&'a Topic>, DatasetError> {
        let beside = info_beside(topic);
        let own = OwnCamera::from_settings(self.settings).ok().flatten();
        let is_usable = |topic: &Topic| calibrations(topic).iter().any(|(_, calibration)| calibration.is_usable(own));
        let beside = self.infos().map(|(topic, _)| topic).find(|topic| topic.name == beside);
        if let Some(topic) = beside.filter(|topic| is_usable(topic)) {
            return Ok(Some(topic));
        }
        let may_be =
            |(topic, frame): &(&Topic, &str)| *frame == images.frame && !is_result(&topic.name) && is_usable(topic);
        let same_frame: Vec<_> = self.infos().filter(may_be).collect();
        let field = format!("topics of camera infos of {}", topic.name);
        let found = self.only(&same_frame, &field, "--camera-info").transpose()?.map(|(topic, _)| topic);
        if let (Some(beside), Some(found)) = (beside, found)
            && let Some((_, first)) = calibrations(beside).first()
        {
            let path = self.path.display();
            warn_once(format!("{path}: {}: {}: {} is used instead", beside.name, first.text(), found.name));
        }
        Ok(found.or(beside))
    }

    /// Warns if the camera info of colour is that beside the topic of depth, because colour has none of its own.
    fn warn_of_depth_info(&self, (color, depth): (&Topic, &Topic), info: Option<&Topic>) {
        let has_own = self.infos().any(|(topic, _)| topic.name == info_beside(color));
        if let Some(info) = info.filter(|info| info.name == info_beside(depth) && !has_own) {
            warn_once(format!(
                "{}: {} has no camera info of its own: that of {}, {}, is used, as it has the same frame; {COLOR_INFO_REMEDY}",
                self.path.display(),
                color.name,
                depth.name,
                info.name
            ));
        }
    }

    fn no_info(&self, what: &str, topic: &Topic, remedy: &str) -> DatasetError {
        let names: Vec<String> = self.infos().map(|(topic, frame)| format!("{} (frame {frame})", topic.name)).collect();
        let found =
            if names.is_empty() { "none".to_owned() } else { format!("none with its frame, but {}", listed(names)) };
        let expected = "a topic of sensor_msgs/msg/CameraInfo beside it, or with its frame";
        self.error(format!("camera info of {what} ({})", topic.name), found, format!("{expected}; {remedy}"))
    }

    fn pose_topics(&self) -> impl Iterator<Item = (&'a Topic, &'a Poses)> {
        self.contents.topics.iter().filter_map(|topic| match &topic.content {
            Content::Poses(poses) if !poses.timeline.is_empty() => Some((topic, poses)),
            _ => None,
        })
    }

    fn pose(&self, color: &'a Images) -> Result<PoseChoice<'a>, DatasetError> {
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
        let tree = &self.contents.tree;
        let found = tree_poses(self.contents, self.settings, &color.frame);
        let is_requested = self.settings.world_frame.is_some() && tree.has(found.body);
        if is_requested || found.moves(tree) {
            return Ok(PoseChoice::Tree);
        }
        let candidates: Vec<_> = self.pose_topics().collect();
        match self.only(&candidates, "topics of poses", "--pose") {
            Some(only) => only.map(|(topic, poses)| PoseChoice::Topic(topic, poses)),
            // Poses are wanted, so their lack is an error.
            None if self.settings.world_frame.is_some() => Ok(PoseChoice::Tree),
            None => Ok(PoseChoice::None(NoPoses::NotFound)),
        }
    }
}

/// Returns true if a value of the setting `pose` is the transform tree.
pub(crate) fn is_tree(name: &str) -> bool {
    [TF, TF_STATIC].iter().any(|tf| tf.trim_start_matches('/') == name.trim_start_matches('/'))
}

/// Returns the name that the camera info of an image topic usually has.
fn info_beside(topic: &Topic) -> String {
    let folder = without_transport(&topic.name).rsplit_once('/').map_or("", |(folder, _)| folder);
    format!("{folder}/camera_info")
}

/// Returns true for a topic with results of this project, e.g. `/robot1/splatseg/ids`.
fn is_result(name: &str) -> bool {
    let mut parts = without_transport(name).rsplit('/');
    parts.next().is_some_and(|last| RESULTS.contains(&last)) && parts.next() == Some(RESULTS_FOLDER)
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

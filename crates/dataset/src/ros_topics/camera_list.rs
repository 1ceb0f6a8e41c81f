//! The cameras of a topic's images, each valid from some time on.

use super::cameras::{Calibration, ImageFacts};
use super::contents::{Content, Images, StampedPlace, Topic};
use crate::DatasetError;
use crate::own_camera::{OwnCamera, has_shape};
use crate::plausibility::warn_once;
use crate::undistort::Camera;
use splatseg_geometry::{Distortion, Intrinsics};
use std::path::Path;

/// Maximum time of a camera info before the first image or after the last, nanoseconds.
const INFO_SLACK: i64 = 10_000_000_000;
/// Name of the camera of the settings in descriptions.
const OWN_CAMERA: &str = "dataset.fx, fy, cx and cy";
/// Name of a depth camera that nothing describes.
const UNKNOWN_CAMERA: &str = "as colour's";

/// The cameras of a topic, each valid from some time on.
#[derive(Debug)]
pub(crate) struct Cameras {
    pub(crate) topic: String,
    /// Empty if nothing describes them.
    pub(crate) list: Vec<Camera>,
    /// The messages that describe them.
    starts: Vec<StampedPlace>,
    /// True if their stamps are increasing and match those of the images.
    in_order: bool,
}

impl Cameras {
    /// Returns the cameras of images: described by a topic, or by the settings alone. Camera infos without a usable camera
    /// are left out if there are others.
    ///
    /// # Errors
    /// If no camera info has a usable camera, or the lens of one is not supported.
    pub(crate) fn new(
        info: Option<&Topic>,
        images: (&Topic, &Images),
        own: Option<OwnCamera>,
        path: &Path,
    ) -> Result<Self, DatasetError> {
        let facts = image_facts(images, info, own);
        let Some(topic) = info else { return Self::of_settings(facts, path) };
        let place = format!("{}: {}", path.display(), topic.name);
        let (mut list, mut starts, mut unusable) = (Vec::new(), Vec::new(), None);
        for (start, calibration) in calibrations(topic) {
            match calibration.camera(facts, Path::new(&place)) {
                Ok(camera) => {
                    list.push(camera);
                    starts.push(*start);
                }
                Err(DatasetError::Intrinsics { .. }) => {
                    let (count, _) = unusable.get_or_insert((0, calibration));
                    *count += 1;
                }
                Err(error) => return Err(error),
            }
        }
        match unusable {
            Some((_, first)) if list.is_empty() => {
                let expected =
                    "the focal lengths and principal point of a camera: give them with --fx (--fy, --cx, --cy)";
                return Err(DatasetError::Field {
                    path: place.into(),
                    field: "camera info".to_owned(),
                    found: first.text(),
                    expected: expected.to_owned(),
                });
            }
            Some((count, first)) => {
                warn_once(format!("{place}: {count} camera infos are left out, as {}", first.text()));
            }
            None => {}
        }
        let in_order = starts.is_sorted_by_key(|start: &StampedPlace| start.stamp)
            && starts.iter().all(|start| fits(start, images.1));
        Ok(Self { topic: topic.name.clone(), list, starts, in_order })
    }

    /// Returns the camera of the settings, for images that nothing else describes; no camera if there is none.
    fn of_settings(facts: ImageFacts, path: &Path) -> Result<Self, DatasetError> {
        let list = match facts.own {
            None => Vec::new(),
            Some(own) => {
                let size = facts.size.unwrap_or_default();
                let intrinsics = own.intrinsics(size).validated();
                let intrinsics =
                    intrinsics.map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })?;
                vec![Camera { intrinsics, distortion: Distortion::None }]
            }
        };
        let topic = if facts.own.is_some() { OWN_CAMERA } else { UNKNOWN_CAMERA };
        Ok(Self { topic: topic.to_owned(), list, starts: Vec::new(), in_order: true })
    }

    /// Returns cameras that nothing describes.
    pub(crate) fn unknown() -> Self {
        Self { topic: UNKNOWN_CAMERA.to_owned(), list: Vec::new(), starts: Vec::new(), in_order: true }
    }

    /// Replaces the intrinsics. `of_size` returns them for images of a stated size, `(width, height)`.
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

/// Warns if P is used for K, K is scaled, or the lens is ignored in the cameras of [`Cameras::new`], which has the same
/// arguments.
pub(crate) fn warn_of_assumptions(
    info: Option<&Topic>,
    images: (&Topic, &Images),
    own: Option<OwnCamera>,
    path: &Path,
) {
    let Some(topic) = info else { return };
    let facts = image_facts(images, info, own);
    let place = format!("{}: {}", path.display(), topic.name);
    let remedy = "--fx (--fy, --cx, --cy)";
    let mut infos = calibrations(topic).iter().map(|(_, calibration)| calibration);
    if facts.own.is_some() {
        if let Some(error) = infos.find_map(|info| info.lens().err()).filter(|_| !facts.is_rectified) {
            warn_once(format!("{place}: {error}: the lens is ignored, as the settings describe the camera"));
        }
        return;
    }
    if let Some(first) = infos.clone().find(|info| info.has_only_p(facts)) {
        warn_once(format!(
            "{place}: {}: P is used as the camera's intrinsics; {remedy} gives other ones",
            first.text()
        ));
    }
    if let Some(((stated, size), first)) =
        infos.next().and_then(|info| Some((info.stated_size().zip(facts.unstated_size())?, info)))
        && has_shape(stated, size)
    {
        warn_once(format!(
            "{place}: it is that of images of {}x{} pixels, but they have {}x{}: {}, scaled to them; {remedy} gives other ones",
            stated.0,
            stated.1,
            size.0,
            size.1,
            first.text()
        ));
    }
}

/// Returns what is known about the images of a topic, whose camera infos are in the topic `info`. `own` is the camera of
/// the settings, if it is theirs.
pub(crate) fn image_facts(
    (topic, images): (&Topic, &Images),
    info: Option<&Topic>,
    own: Option<OwnCamera>,
) -> ImageFacts {
    let mut stated = info.into_iter().flat_map(calibrations).filter_map(|(_, calibration)| calibration.stated_size());
    let is_of_other_size = stated.clone().next().is_some() && stated.all(|stated| Some(stated) != images.size);
    // Names of undistorted images in drivers and image_proc: image_rect, image_rect_raw, image_rect_color.
    ImageFacts { is_rectified: topic.name.contains("image_rect"), size: images.size, is_of_other_size, own }
}

/// Returns the camera infos of a topic that differ.
pub(crate) fn calibrations(topic: &Topic) -> &[(StampedPlace, Calibration)] {
    match &topic.content {
        Content::Calibrations { list, .. } => list,
        _ => &[],
    }
}

/// Returns true if a message's stamp matches those of the images, to within seconds. A camera info has the stamp of its
/// image.
fn fits(message: &StampedPlace, images: &Images) -> bool {
    if images.timeline.is_empty() {
        return true;
    }
    images.timeline.stretches.iter().any(|stretch| {
        let ends =
            [stretch.messages.first(), stretch.messages.last()].map(|end| end.map_or(message.stamp, |end| end.stamp));
        message.stamp >= ends[0].saturating_sub(INFO_SLACK) && message.stamp <= ends[1].saturating_add(INFO_SLACK)
    })
}

//! Input that is valid but unlikely to be right: each kind is reported once per scene, with its file and likely cause.

use crate::{DatasetError, FramePart, Scene};
use glam::DVec3;
use splatseg_geometry::{Intrinsics, RgbdFrame};
use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// A camera further than this from the origin is not on Earth, metres.
const MAX_DISTANCE_M: f64 = 1e8;
/// Where the camera moves less between two frames, nothing is wrong, metres.
const USUAL_STEP_M: f32 = 4.0;
/// How many times as far as it sees the camera can move between two frames.
const MAX_STEP_PER_DEPTH: f32 = 3.0;
/// Every how many pixels one is looked at for the mean depth.
const DEPTH_SAMPLING: usize = 7;
/// Focal lengths in image widths that no pinhole camera has: fields of view of less than 0.06 and more than 179 degrees.
const POSSIBLE_FOCAL: std::ops::RangeInclusive<f32> = 0.005..=1000.0;
/// Focal lengths in image widths that are worth a warning: fields of view of less than 3 and more than 157 degrees.
const USUAL_FOCAL: std::ops::RangeInclusive<f32> = 0.1..=20.0;

/// Warns, unless the same was said before: a benchmark opens a scene for each of its runs.
pub(crate) fn warn_once(text: String) {
    static SAID: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    if !said.contains(&text) {
        tracing::warn!("{text}");
        said.insert(text);
    }
}

/// What was seen and told of the frames so far.
#[derive(Debug, Default)]
pub(crate) struct Plausibility {
    /// The last frame's name and where its camera was, world coordinates, metres.
    last: Option<(String, DVec3)>,
    told_of_steps: bool,
    told_of_depth: bool,
}

impl Plausibility {
    /// Looks at the next frame, as it was read, and warns of what is unlikely.
    ///
    /// # Errors
    /// [`DatasetError::Field`] for a camera where none can be.
    pub(crate) fn check(&mut self, scene: &dyn Scene, index: usize, frame: &RgbdFrame<'_>) -> Result<(), DatasetError> {
        let position = frame.world_from_camera().translation();
        if position.abs().max_element() > MAX_DISTANCE_M {
            return Err(DatasetError::Field {
                path: scene.file_of(index, FramePart::Pose),
                field: "camera position".to_owned(),
                found: format!("({:e}, {:e}, {:e})", position.x, position.y, position.z),
                expected: format!("metres, at most {MAX_DISTANCE_M:e} from the origin"),
            });
        }
        for (part, text) in self.warnings(frame, position) {
            warn_once(format!("{}: {text}", scene.file_of(index, part).display()));
        }
        Ok(())
    }

    fn warnings(&mut self, frame: &RgbdFrame<'_>, position: DVec3) -> Vec<(FramePart, String)> {
        let mut warnings = Vec::new();
        let mean_depth = mean_depth(frame);
        if mean_depth.is_none() && !self.told_of_depth {
            self.told_of_depth = true;
            let text = "no pixel has depth: objects cannot be placed in the map from such frames".to_owned();
            warnings.push((FramePart::Depth, text));
        }
        let last = self.last.replace((frame.name().to_owned(), position));
        if let (Some((last_name, last_position)), Some(mean_depth), false) = (last, mean_depth, self.told_of_steps) {
            let step = position.distance(last_position);
            if step > f64::from(USUAL_STEP_M.max(MAX_STEP_PER_DEPTH * mean_depth)) {
                self.told_of_steps = true;
                let text = format!(
                    "poses look like millimetres, or tracking was lost: the camera moves {step:.0} m between frames \
                     {last_name} and {}, and depth is {mean_depth:.1} m on average; poses must be in metres",
                    frame.name()
                );
                warnings.push((FramePart::Pose, text));
            }
        }
        warnings
    }
}

/// The mean of the measured depths, metres; `None` if there are none.
fn mean_depth(frame: &RgbdFrame<'_>) -> Option<f32> {
    let pixels = frame.depth().pixels();
    let (mut sum, mut count) = (0.0, 0_usize);
    for depth in pixels.iter().step_by(DEPTH_SAMPLING).filter(|depth| **depth > 0.0) {
        sum += f64::from(*depth);
        count += 1;
    }
    if count == 0 {
        // Rather all pixels than to say by mistake that there is no depth.
        return pixels.iter().copied().find(|depth| *depth > 0.0);
    }
    Some((sum / count as f64) as f32)
}

/// Looks at a scene's intrinsics, of which `index` is the first good frame, and warns of what is unlikely.
///
/// # Errors
/// [`DatasetError::Field`] for focal lengths that no camera has.
pub(crate) fn check_intrinsics(scene: &dyn Scene, index: usize, intrinsics: &Intrinsics) -> Result<(), DatasetError> {
    let path = || scene.file_of(index, FramePart::Intrinsics);
    let Intrinsics { fx, fy, width, height, .. } = *intrinsics;
    let focal = [fx / width as f32, fy / height as f32];
    if focal.iter().any(|focal| !POSSIBLE_FOCAL.contains(focal)) {
        return Err(DatasetError::Field {
            path: path(),
            field: "focal lengths".to_owned(),
            found: format!("{fx:e} and {fy:e} pixels"),
            expected: format!("those of a camera of {width}x{height} pixels, about {width}"),
        });
    }
    for warning in intrinsics_warnings(intrinsics) {
        warn_once(format!("{}: {warning}", path().display()));
    }
    Ok(())
}

fn intrinsics_warnings(intrinsics: &Intrinsics) -> Vec<String> {
    let Intrinsics { fx, fy, cx, cy, width, height } = *intrinsics;
    let mut warnings = Vec::new();
    if [fx / width as f32, fy / height as f32].iter().any(|focal| !USUAL_FOCAL.contains(focal)) {
        let degrees = 2.0 * (0.5 * width as f32 / fx).atan().to_degrees();
        warnings.push(format!(
            "focal lengths {fx} and {fy} of {width}x{height} pixels mean a field of view of {degrees:.1} degrees: they may \
             be those of another image size, or in millimetres"
        ));
    }
    let inside = |center: f32, side: usize| (0.0..side as f32).contains(&center);
    if !(inside(cx, width) && inside(cy, height)) {
        warnings.push(format!(
            "the principal point ({cx}, {cy}) is outside the image of {width}x{height} pixels: the intrinsics may be those \
             of another image size"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Pose};

    const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width: 64, height: 48 };

    fn warnings(checks: &mut Plausibility, depth: f32, x: f32) -> Vec<String> {
        let (color, depth) = (Image::filled(64, 48, [9; 3]), Image::filled(64, 48, depth));
        let pose = Pose::from_translation(DVec3::X * f64::from(x));
        let frame = RgbdFrame::new(format!("at {x}"), color, depth, CAMERA, pose).unwrap();
        let warnings = checks.warnings(&frame, frame.world_from_camera().translation());
        warnings.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn poses_in_millimetres_are_told_once() {
        let mut checks = Plausibility::default();
        assert!(warnings(&mut checks, 2.0, 0.0).is_empty());
        assert!(warnings(&mut checks, 2.0, 0.9).is_empty());
        assert!(warnings(&mut checks, 30.0, 60.9).is_empty(), "a car that sees 30 m");
        let told = warnings(&mut checks, 2.0, 812.9);
        assert!(told[0].starts_with("poses look like millimetres"), "{told:?}");
        assert!(told[0].contains("moves 752 m between frames at 60.9 and at 812.9, and depth is 2.0 m"), "{told:?}");
        assert!(warnings(&mut checks, 2.0, 0.0).is_empty(), "once");
    }

    #[test]
    fn frames_without_any_depth_are_told_once() {
        let mut checks = Plausibility::default();
        assert_eq!(warnings(&mut checks, 0.0, 0.0).len(), 1);
        assert!(warnings(&mut checks, 0.0, 0.0).is_empty());
    }

    #[test]
    fn intrinsics_of_another_image_are_told() {
        assert!(intrinsics_warnings(&CAMERA).is_empty());
        let outside = intrinsics_warnings(&Intrinsics { cx: 319.5, ..CAMERA });
        assert!(outside[0].contains("principal point (319.5, 23.5) is outside the image of 64x48"), "{outside:?}");
        let wide = intrinsics_warnings(&Intrinsics { fx: 3.5, fy: 3.5, ..CAMERA });
        assert!(wide[0].contains("a field of view of 167.5 degrees"), "{wide:?}");
    }
}

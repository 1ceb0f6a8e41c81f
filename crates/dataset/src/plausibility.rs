//! Warnings about input that is valid but unlikely to be correct, once per scene and kind, with the file and likely
//! cause.

use crate::depth_ceiling::DepthCeiling;
use crate::{DatasetError, FramePart, RecordedFrame};
use glam::DVec3;
use splatseg_geometry::{CameraFrame, Intrinsics};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// A camera farther than this from the origin is not on Earth, metres.
const MAX_DISTANCE_M: f64 = 1e8;
/// Camera movement between two frames that is always plausible, metres.
const USUAL_STEP_M: f32 = 4.0;
/// Maximum plausible camera movement between two frames, as a multiple of the mean depth.
const MAX_STEP_PER_DEPTH: f32 = 3.0;
/// The mean depth uses every Nth pixel.
const DEPTH_SAMPLING: usize = 7;
/// Possible focal lengths in image widths; others are errors. Fields of view from 0.06 to 179 degrees.
const POSSIBLE_FOCAL: std::ops::RangeInclusive<f32> = 0.005..=1000.0;
/// Usual focal lengths in image widths; others cause a warning. Fields of view from 3 to 157 degrees.
const USUAL_FOCAL: std::ops::RangeInclusive<f32> = 0.1..=20.0;
/// A principal point farther from the middle of the image than this causes a warning, image sides.
const MAX_OFF_CENTER: f32 = 0.3;
/// Intrinsics are those of another image size if the principal point has moved by the same factor along both sides, within
/// this share.
const SAME_SIZE_FACTOR: f32 = 0.1;
/// Such factors for images half as large, whose principal point is nearer to the middle than [`MAX_OFF_CENTER`].
const HALF_SIZE: std::ops::RangeInclusive<f32> = 0.46..=0.54;

/// So many bytes of warnings are remembered: a process that opens many damaged recordings would collect theirs without end.
const REMEMBERED_BYTES: usize = 1 << 20;

/// Warnings that were logged.
#[derive(Debug)]
struct Logged {
    texts: BTreeSet<String>,
    bytes: usize,
}

impl Logged {
    const NONE: Self = Self { texts: BTreeSet::new(), bytes: 0 };

    /// Remembers a warning. Returns false if it was logged before, as far as that is remembered.
    fn add(&mut self, text: &str) -> bool {
        if self.texts.contains(text) {
            return false;
        }
        if self.bytes + text.len() > REMEMBERED_BYTES {
            *self = Self::NONE;
        }
        self.bytes += text.len();
        self.texts.insert(text.to_owned())
    }
}

/// Logs a warning once per process, as far as it is remembered: a benchmark opens a scene for each of its runs.
pub(crate) fn warn_once(text: String) {
    static LOGGED: Mutex<Logged> = Mutex::new(Logged::NONE);
    if LOGGED.lock().unwrap_or_else(PoisonError::into_inner).add(&text) {
        tracing::warn!("{text}");
    }
}

/// State of the checks: the last frame and the warnings already given.
#[derive(Debug, Default)]
pub(crate) struct Plausibility {
    /// Name and camera position of the last frame, world coordinates, metres.
    last: Option<(String, DVec3)>,
    warned_of_steps: bool,
    warned_of_depth: bool,
    ceiling: Option<DepthCeiling>,
}

impl Plausibility {
    /// Checks of frames whose depth is used up to `max_depth`, metres. Where it ends has been considered then.
    pub(crate) fn new(max_depth: Option<f32>) -> Self {
        Self { ceiling: max_depth.is_none().then(DepthCeiling::default), ..Self::default() }
    }

    /// Checks of frames that have no depth.
    pub(crate) fn without_depth() -> Self {
        Self { warned_of_depth: true, ..Self::default() }
    }

    /// Checks the next frame, as read, and warns about unlikely values. `place` names the file of a part of it.
    ///
    /// # Errors
    /// [`DatasetError::Field`] if the camera position is impossible.
    pub(crate) fn check(
        &mut self,
        recorded: &RecordedFrame,
        place: &dyn Fn(FramePart) -> PathBuf,
    ) -> Result<(), DatasetError> {
        let position = recorded.world_from_camera.map(|pose| pose.translation());
        if let Some(position) = position.filter(|position| position.abs().max_element() > MAX_DISTANCE_M) {
            return Err(DatasetError::Field {
                path: place(FramePart::Pose),
                field: "camera position".to_owned(),
                found: format!("({:e}, {:e}, {:e})", position.x, position.y, position.z),
                expected: format!("metres, at most {MAX_DISTANCE_M:e} from the origin"),
            });
        }
        for (part, text) in self.warnings(&recorded.frame, position) {
            warn_once(format!("{}: {text}", place(part).display()));
        }
        Ok(())
    }

    fn warnings(&mut self, frame: &CameraFrame<'_>, position: Option<DVec3>) -> Vec<(FramePart, String)> {
        let mut warnings = Vec::new();
        let mean_depth = mean_depth(frame);
        if mean_depth.is_none() && !self.warned_of_depth {
            self.warned_of_depth = true;
            let text = "no pixel has depth: objects cannot be placed in the map from such frames".to_owned();
            warnings.push((FramePart::Depth, text));
        }
        let ceiling = self.ceiling.as_mut().and_then(|ceiling| ceiling.check(frame.depth()));
        warnings.extend(ceiling.map(|text| (FramePart::Depth, text)));
        let Some(position) = position else { return warnings };
        let last = self.last.replace((frame.name().to_owned(), position));
        if let (Some((last_name, last_position)), Some(mean_depth), false) = (last, mean_depth, self.warned_of_steps) {
            let step = position.distance(last_position);
            if step > f64::from(USUAL_STEP_M.max(MAX_STEP_PER_DEPTH * mean_depth)) {
                self.warned_of_steps = true;
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

/// Returns the mean measured depth, metres. `None` if the frame has no depth.
fn mean_depth(frame: &CameraFrame<'_>) -> Option<f32> {
    let pixels = frame.depth().pixels();
    let (mut sum, mut count) = (0.0, 0_usize);
    for depth in pixels.iter().step_by(DEPTH_SAMPLING).filter(|depth| **depth > 0.0) {
        sum += f64::from(*depth);
        count += 1;
    }
    if count == 0 {
        // Check all pixels before reporting that there is no depth.
        return pixels.iter().copied().find(|depth| *depth > 0.0);
    }
    Some((sum / count as f64) as f32)
}

/// Checks a scene's intrinsics and warns about unlikely values. `place` names their file.
///
/// # Errors
/// [`DatasetError::Field`] if the focal lengths are impossible.
pub(crate) fn check_intrinsics(
    intrinsics: &Intrinsics,
    place: &dyn Fn(FramePart) -> PathBuf,
) -> Result<(), DatasetError> {
    let path = || place(FramePart::Intrinsics);
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
    let Intrinsics { fx, fy, width, height, .. } = *intrinsics;
    let mut warnings = Vec::new();
    if [fx / width as f32, fy / height as f32].iter().any(|focal| !USUAL_FOCAL.contains(focal)) {
        let degrees = 2.0 * (0.5 * width as f32 / fx).atan().to_degrees();
        warnings.push(format!(
            "focal lengths {fx} and {fy} of {width}x{height} pixels mean a field of view of {degrees:.1} degrees: they may \
             be those of another image size, or in millimetres"
        ));
    }
    warnings.extend(principal_point_warning(intrinsics));
    warnings
}

/// Returns how many times as large as its own the image is whose middle the principal point is; `None` if that differs along
/// the sides.
pub(crate) fn size_factor(intrinsics: &Intrinsics) -> Option<f32> {
    let [across, down] = size_factors(intrinsics);
    ((across / down - 1.0).abs() < SAME_SIZE_FACTOR).then_some((across + down) / 2.0)
}

fn size_factors(&Intrinsics { cx, cy, width, height, .. }: &Intrinsics) -> [f32; 2] {
    [(2.0 * cx + 1.0) / width as f32, (2.0 * cy + 1.0) / height as f32]
}

/// Returns a warning about a principal point that is far from the middle of the image.
fn principal_point_warning(intrinsics: &Intrinsics) -> Option<String> {
    let Intrinsics { cx, cy, width, height, .. } = *intrinsics;
    let (across, down) = (width as f32, height as f32);
    let off = [(cx + 0.5) / across, (cy + 0.5) / down].map(|place| (place - 0.5).abs());
    let size_factors = size_factors(intrinsics);
    let is_scaled = size_factor(intrinsics).is_some();
    let factor = (size_factors[0] + size_factors[1]) / 2.0;
    let is_of_half = HALF_SIZE.contains(&size_factors[0]) && HALF_SIZE.contains(&size_factors[1]);
    let is_far = off.iter().any(|off| *off > MAX_OFF_CENTER);
    if !is_far && !is_of_half {
        return None;
    }
    let place = if off.iter().all(|off| *off <= 0.5) { "far from the middle of" } else { "outside" };
    let reason = if cx.abs() <= 1.0 && cy.abs() <= 1.0 {
        "it seems not to be set".to_owned()
    } else if is_of_half || is_scaled && factor > 1.5 {
        format!("it is the middle of an image {factor:.1} times as large, whose intrinsics these may be")
    } else {
        "the intrinsics may be those of another image size".to_owned()
    };
    Some(format!(
        "the principal point ({cx}, {cy}) is {place} the image of {width}x{height} pixels: {reason}; --fx (--fy, --cx, --cy) \
         gives other ones"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width: 64, height: 48 };

    fn warnings(checks: &mut Plausibility, depth: f32, x: f32) -> Vec<String> {
        let (color, depth) = (Image::filled(64, 48, [9; 3]), Image::filled(64, 48, depth));
        let frame = CameraFrame::new(format!("at {x}"), color, depth, CAMERA).unwrap();
        let warnings = checks.warnings(&frame, Some(DVec3::X * f64::from(x)));
        warnings.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn warnings_are_remembered_within_limits() {
        let mut logged = Logged::NONE;
        assert!(logged.add("a") && !logged.add("a") && logged.add("b"));
        for number in 0..3000 {
            let text = format!("{number:01000}");
            assert!(logged.add(&text) && !logged.add(&text));
            assert!(logged.bytes <= REMEMBERED_BYTES && logged.texts.len() <= REMEMBERED_BYTES / 1000 + 2);
        }
        assert!(logged.add("a"), "it is forgotten");
    }

    #[test]
    fn poses_in_millimetres_are_reported_once() {
        let mut checks = Plausibility::default();
        assert!(warnings(&mut checks, 2.0, 0.0).is_empty());
        assert!(warnings(&mut checks, 2.0, 0.9).is_empty());
        assert!(warnings(&mut checks, 30.0, 60.9).is_empty(), "a car that sees 30 m");
        let reported = warnings(&mut checks, 2.0, 812.9);
        assert!(reported[0].starts_with("poses look like millimetres"), "{reported:?}");
        assert!(
            reported[0].contains("moves 752 m between frames at 60.9 and at 812.9, and depth is 2.0 m"),
            "{reported:?}"
        );
        assert!(warnings(&mut checks, 2.0, 0.0).is_empty(), "once");
    }

    #[test]
    fn frames_without_any_depth_are_reported_once() {
        let mut checks = Plausibility::default();
        assert_eq!(warnings(&mut checks, 0.0, 0.0).len(), 1);
        assert!(warnings(&mut checks, 0.0, 0.0).is_empty());
    }

    #[test]
    fn intrinsics_of_another_image_size_are_reported() {
        assert!(intrinsics_warnings(&CAMERA).is_empty());
        let outside = intrinsics_warnings(&Intrinsics { cx: 319.5, ..CAMERA });
        assert!(outside[0].contains("principal point (319.5, 23.5) is outside the image of 64x48"), "{outside:?}");
        for (cx, cy, expected) in [
            (0.0, 0.0, "(0, 0) is far from the middle of the image of 64x48 pixels: it seems not to be set; --fx"),
            (63.5, 47.5, "it is the middle of an image 2.0 times as large"),
            (65.0, 46.0, "it is the middle of an image 2.0 times as large"),
            (127.5, 95.5, "it is the middle of an image 4.0 times as large"),
            (15.5, 11.5, "it is the middle of an image 0.5 times as large"),
            (60.0, 23.5, "is far from the middle of the image of 64x48 pixels: the intrinsics may be"),
            (0.0, 23.5, "is far from the middle of the image of 64x48 pixels: the intrinsics may be"),
        ] {
            let found = intrinsics_warnings(&Intrinsics { cx, cy, ..CAMERA });
            assert!(found.len() == 1 && found[0].contains(expected), "{cx} {cy}: {found:?}");
        }
        for (cx, cy) in [(23.5, 31.5), (45.0, 12.0), (20.0, 35.0), (31.0, 24.5)] {
            assert!(intrinsics_warnings(&Intrinsics { cx, cy, ..CAMERA }).is_empty(), "{cx} {cy}");
        }
        assert!(
            intrinsics_warnings(&Intrinsics { cx: 0.0, cy: 0.0, width: 1, height: 1, fx: 1.0, fy: 1.0 }).is_empty()
        );
        let wide = intrinsics_warnings(&Intrinsics { fx: 3.5, fy: 3.5, ..CAMERA });
        assert!(wide[0].contains("a field of view of 167.5 degrees"), "{wide:?}");
    }
}

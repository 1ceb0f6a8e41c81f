//! Doubts of the tracked frames about the camera's intrinsics and its unit of depth.

use serde::{Deserialize, Serialize};
use splatseg_geometry::{CameraFrame, Intrinsics};

/// One in this many frames is asked about the focal length.
pub(crate) const FOCAL_STRIDE: u32 = 4;

/// The focal length is judged from this many asked frames on.
const MIN_FRAMES: u32 = 8;

/// The linear estimate of a focal length's error is this fraction of the true one, since residuals of a wrong focal length
/// lose weight. Measured with focal lengths that were 10 to 30 % wrong: 0.5 to 0.7.
const SHRINKAGE: f64 = 0.6;

/// Smallest error of the focal length's logarithm that is reported. With the right intrinsics a Kinect's video reached
/// 0.043: rolling shutter and distortion look like a longer focal length.
const MIN_ERROR: f64 = 0.06;

/// The error must be this many times its deviation. Frames that are aligned with the same keyframe share errors.
const MIN_DEVIATIONS: f64 = 8.0;

/// Plausible median depth in rooms, metres.
const USUAL_DEPTH: std::ops::RangeInclusive<f32> = 0.3..=15.0;

/// The unit of depth is judged by this many frames.
const DEPTH_FRAMES: usize = 30;

/// A frame's depth is judged by every Nth pixel: a prime, so that all columns count.
const DEPTH_SAMPLING: usize = 97;

/// The estimate of the focal length's error over all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FocalEstimate {
    /// Number of tracked frames.
    frames: u32,
    asked: u32,
    /// Information about the logarithm of the focal length.
    information: f64,
    /// Derivative of the cost.
    gradient: f64,
}

impl FocalEstimate {
    /// Counts a frame. Returns true if it should be asked.
    pub(crate) fn wants_frame(&mut self) -> bool {
        self.frames = self.frames.wrapping_add(1);
        self.frames.is_multiple_of(FOCAL_STRIDE)
    }

    /// Adds what a frame says.
    pub(crate) fn add(&mut self, (information, gradient): (f64, f64)) {
        self.asked = self.asked.saturating_add(1);
        self.information += information;
        self.gradient += gradient;
    }

    /// The factor by which the focal length should be multiplied, if that is significant.
    fn factor(&self) -> Option<f64> {
        let error = -self.gradient / self.information;
        let is_significant = error.abs() * self.information.sqrt() > MIN_DEVIATIONS;
        let error = error / SHRINKAGE;
        (self.asked >= MIN_FRAMES && is_significant && error.abs() > MIN_ERROR).then(|| libm::exp(error))
    }

    /// A sentence about a wrong focal length, if the frames say so. `intrinsics` are those of the frames.
    pub(crate) fn doubt(&self, intrinsics: &Intrinsics) -> Option<String> {
        let factor = self.factor()?;
        let Intrinsics { fx, width, height, .. } = *intrinsics;
        let side = if factor > 1.0 { "short" } else { "long" };
        Some(format!(
            "the focal length seems to be too {side}: frames taken from other directions fit best with about {factor:.2} \
             times its value ({:.0} instead of {fx:.0} pixels for {width}x{height}); check the intrinsics",
            factor * f64::from(fx)
        ))
    }
}

/// Median depths of the first tracked frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct UsualDepth(Vec<f32>);

impl UsualDepth {
    /// Adds a frame, unless there are enough.
    pub(crate) fn add(&mut self, frame: &CameraFrame<'_>) {
        if self.0.len() < DEPTH_FRAMES {
            let depths = frame.depth().pixels().iter().step_by(DEPTH_SAMPLING).copied();
            self.0.extend(median(depths.filter(|depth| *depth > 0.0).collect()));
        }
    }

    /// A sentence about a wrong unit of depth, if depth is not that of a room.
    pub(crate) fn doubt(&self) -> Option<String> {
        let found = median(self.0.clone()).filter(|depth| !USUAL_DEPTH.contains(depth))?;
        Some(format!(
            "the median depth is {found:.2} m, expected {} to {} m in a room: check the unit of the depth, for tracking \
             relies on it",
            USUAL_DEPTH.start(),
            USUAL_DEPTH.end()
        ))
    }
}

fn median(mut values: Vec<f32>) -> Option<f32> {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    const CAMERA: Intrinsics = Intrinsics { fx: 250.0, fy: 250.0, cx: 15.5, cy: 11.5, width: 32, height: 24 };

    fn estimate(frames: u32, error: f64) -> FocalEstimate {
        let mut estimate = FocalEstimate::default();
        (0..frames).for_each(|_| estimate.add((1e4, -1e4 * error)));
        estimate
    }

    #[test]
    fn a_focal_length_is_doubted_from_enough_frames_only() {
        let doubt = estimate(20, 0.1).doubt(&CAMERA).unwrap();
        assert!(doubt.contains("too short") && doubt.contains("1.18 times its value (295 instead of 250"), "{doubt}");
        assert!(estimate(20, -0.1).doubt(&CAMERA).unwrap().contains("too long"));
        assert_eq!(estimate(20, 0.026).doubt(&CAMERA), None, "a Kinect with the right intrinsics");
        assert_eq!(estimate(3, 0.1).doubt(&CAMERA), None);
        assert_eq!(FocalEstimate::default().doubt(&CAMERA), None);
    }

    #[test]
    fn depth_in_a_wrong_unit_is_doubted() {
        let doubt = |depth: f32| {
            let (color, depth) = (Image::filled(32, 24, [9; 3]), Image::filled(32, 24, depth));
            let mut usual = UsualDepth::default();
            usual.add(&CameraFrame::new("frame", color, depth, CAMERA).unwrap());
            usual.doubt()
        };
        assert_eq!((doubt(0.0), doubt(2.0)), (None, None));
        assert!(doubt(20.0).unwrap().starts_with("the median depth is 20.00 m, expected 0.3 to 15 m"));
        assert!(doubt(0.2).unwrap().contains("check the unit"));
    }
}

//! Doubts of the tracked frames about the camera's focal length and its exposure.

use crate::{CameraPose, DoubtKind, InputDoubt, PoseState};
use serde::{Deserialize, Serialize};
use splatseg_geometry::Intrinsics;

/// The focal length is checked in one of this many frames.
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

/// Frames that were tracked by depth alone are reported if there are this many...
const MIN_DEPTH_ALONE: usize = 8;
/// ...and they are this share of the tracked ones.
const DEPTH_ALONE_SHARE: f32 = 0.2;

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

    /// A doubt about the focal length, if the frames say that it is wrong. `intrinsics` are those of the frames.
    pub(crate) fn doubt(&self, intrinsics: &Intrinsics) -> Option<InputDoubt> {
        let factor = self.factor()?;
        let Intrinsics { fx, width, height, .. } = *intrinsics;
        let side = if factor > 1.0 { "short" } else { "long" };
        let text = format!(
            "the focal length seems to be too {side}: frames taken from other directions fit best with about {factor:.2} \
             times its value ({:.0} instead of {fx:.0} pixels for {width}x{height}); check the intrinsics",
            factor * f64::from(fx)
        );
        Some(InputDoubt { kind: DoubtKind::FocalLength, text })
    }
}

/// Tracked frames, and how many of them had an image that could be used.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ImageUse {
    tracked: usize,
    by_depth_alone: usize,
}

impl ImageUse {
    /// Adds a frame.
    pub(crate) fn add(&mut self, pose: &CameraPose) {
        if let (PoseState::Tracked, Some(quality)) = (pose.state, &pose.quality) {
            self.tracked += 1;
            self.by_depth_alone += usize::from(!quality.uses_image);
        }
    }

    /// A doubt about images that show too little, if there are many.
    pub(crate) fn doubt(&self) -> Option<InputDoubt> {
        let Self { tracked, by_depth_alone } = *self;
        let is_much = by_depth_alone >= MIN_DEPTH_ALONE && by_depth_alone as f32 >= DEPTH_ALONE_SHARE * tracked as f32;
        is_much.then(|| {
            let text = format!(
                "the image was too dark, or had too little contrast, to track the camera in {by_depth_alone} of {tracked} \
                 tracked frames: their poses are from depth alone and drift, by centimetres within a few metres; check the \
                 light and the exposure"
            );
            InputDoubt { kind: DoubtKind::Exposure, text }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PoseQuality;
    use splatseg_geometry::Pose;

    const CAMERA: Intrinsics = Intrinsics { fx: 250.0, fy: 250.0, cx: 15.5, cy: 11.5, width: 32, height: 24 };

    fn estimate(frames: u32, error: f64) -> FocalEstimate {
        let mut estimate = FocalEstimate::default();
        (0..frames).for_each(|_| estimate.add((1e4, -1e4 * error)));
        estimate
    }

    #[test]
    fn a_focal_length_is_doubted_from_enough_frames_only() {
        let doubt = estimate(20, 0.1).doubt(&CAMERA).unwrap().text;
        assert!(doubt.contains("too short") && doubt.contains("1.18 times its value (295 instead of 250"), "{doubt}");
        assert!(estimate(20, -0.1).doubt(&CAMERA).unwrap().text.contains("too long"));
        assert_eq!(estimate(20, 0.026).doubt(&CAMERA), None, "a Kinect with the right intrinsics");
        assert_eq!(estimate(3, 0.1).doubt(&CAMERA), None);
        assert_eq!(FocalEstimate::default().doubt(&CAMERA), None);
    }

    #[test]
    fn many_frames_without_an_image_are_reported() {
        let doubt = |with_image: usize, without: usize| {
            let quality = |uses_image| PoseQuality {
                overlap: 1.0,
                inliers: 1.0,
                residual: 1.0,
                uses_image,
                position_deviation: 0.01,
                rotation_deviation: 0.01,
            };
            let pose = |uses_image| CameraPose {
                world_from_camera: Pose::IDENTITY,
                state: PoseState::Tracked,
                quality: Some(quality(uses_image)),
            };
            let mut images = ImageUse::default();
            (0..with_image).for_each(|_| images.add(&pose(true)));
            (0..without).for_each(|_| images.add(&pose(false)));
            (0..50).for_each(|_| images.add(&CameraPose::given(Pose::IDENTITY)));
            images.doubt()
        };
        assert_eq!((doubt(0, 0), doubt(9, 7), doubt(90, 10)), (None, None, None));
        assert!(doubt(30, 10).unwrap().text.contains("in 10 of 40 tracked frames"));
    }
}

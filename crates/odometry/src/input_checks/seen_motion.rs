//! The motion between two frames as the images show it, whatever poses came with them.

use super::units::median_depth;
use crate::keyframe::{Aligned, Reference};
use crate::odometry::{deviations, is_found_again};
use crate::prior::{MAX_ERROR, MotionPrior};
use crate::pyramid::{GreyFrame, Pyramid};
use crate::se3;
use splatseg_geometry::{CameraFrame, Pose};

/// Frames are reduced until they are at most this wide, pixels.
const MAX_WIDTH: usize = 120;

/// A median depth in this range is left as it is, metres. Otherwise depth is scaled to [`USUAL_MEDIAN`], so that motion is
/// seen even if the unit of depth is wrong by a factor of a thousand.
const USUAL_MEDIANS: std::ops::RangeInclusive<f32> = 0.6..=5.0;
/// See [`USUAL_MEDIANS`].
const USUAL_MEDIAN: f32 = 2.0;

/// A frame with fewer points says nothing.
const MIN_POINTS: usize = 150;

/// The deviation of a seen motion may be at most this share of it...
const MAX_DEVIATION: f64 = 0.15;
/// ...or of this motion, if the seen one is smaller; as [`SeenMotion::size`].
const SMALL_MOTION: f64 = 0.04;

/// Candidates that move surfaces farther than this in the image leave nothing to compare; as [`SeenMotion::size`].
const MAX_MOTION: f64 = 1.5;

/// A frame at a size that is quick to align.
pub(super) struct SmallFrame {
    pyramid: Pyramid,
    /// Factor by which its depth was multiplied.
    factor: f32,
    /// Median of its depth before that, metres.
    median_depth: f32,
}

/// A frame to compare others with.
#[derive(Clone, Debug)]
pub(super) struct SeenFrame {
    reference: Reference,
    /// As [`SmallFrame::factor`].
    factor: f32,
    /// Median of its depth as it came with the frame, metres.
    pub(super) median_depth: f64,
}

/// The motion between two frames.
#[derive(Clone, Copy, Debug)]
pub(super) struct SeenMotion {
    /// The later camera's pose in the coordinates of the earlier one, in the unit of the frames' depth.
    pub(super) motion: Pose,
    /// Median depth of the earlier frame, in the same unit.
    pub(super) depth: f64,
}

/// How far a motion moves surfaces at `depth` in the image, about: radians.
pub(super) fn image_motion(motion: &Pose, depth: f64) -> f64 {
    let (translation, rotation) = se3::size(motion);
    rotation + translation / depth
}

impl SmallFrame {
    /// Reduces a frame. Its depth is scaled as that of an earlier frame, if there is one. `None` if it has no depth.
    pub(super) fn new(frame: &CameraFrame<'_>, earlier: Option<&SeenFrame>) -> Option<Self> {
        let step = frame.width().div_ceil(MAX_WIDTH);
        let median_depth = median_depth(frame)?;
        let usual = if USUAL_MEDIANS.contains(&median_depth) { 1.0 } else { USUAL_MEDIAN / median_depth };
        let factor = earlier.map_or(usual, |earlier| earlier.factor);
        let pyramid = Pyramid::new(&GreyFrame::reduced(frame, step, factor));
        factor.is_normal().then_some(Self { pyramid, factor, median_depth })
    }
}

impl SeenFrame {
    /// `None` if the frame shows too little.
    pub(super) fn new(frame: &SmallFrame) -> Option<Self> {
        let reference = Reference::new(&frame.pyramid, Pose::IDENTITY);
        let (factor, median_depth) = (frame.factor, f64::from(frame.median_depth));
        (reference.size() >= MIN_POINTS).then_some(Self { reference, factor, median_depth })
    }

    /// The motion from this frame to a later one. `candidates` are motions that it may be, in the unit of depth; they only
    /// say where to start. `None` if it cannot be seen.
    pub(super) fn motion_to(&self, later: &SmallFrame, candidates: &[Pose]) -> Option<SeenMotion> {
        let factor = f64::from(self.factor);
        let still = MotionPrior { predicted: Pose::IDENTITY, deviation: MAX_ERROR };
        let mut best = (self.reference.score(&later.pyramid, &Pose::IDENTITY, &still), Pose::IDENTITY);
        for candidate in candidates.iter().filter(|motion| image_motion(motion, self.median_depth) < MAX_MOTION) {
            let start = candidate.scaled(factor);
            let score = self.reference.score(&later.pyramid, &start, &still);
            if score > best.0 {
                best = (score, start);
            }
        }
        let found = self.aligned(&later.pyramid, &best.1).or_else(|| {
            let start = self.reference.search(&later.pyramid, &Pose::IDENTITY, &still);
            self.aligned(&later.pyramid, &start)
        })?;
        let motion = found.world_from_camera.scaled(1.0 / factor);
        let (position, rotation) = deviations(&found);
        let uncertainty = rotation + position / (factor * self.median_depth);
        let size = image_motion(&motion, self.median_depth);
        let is_certain = uncertainty <= MAX_DEVIATION * size.max(SMALL_MOTION);
        is_certain.then_some(SeenMotion { motion, depth: self.median_depth })
    }

    fn aligned(&self, frame: &Pyramid, start: &Pose) -> Option<Aligned> {
        let prior = MotionPrior { predicted: *start, deviation: MAX_ERROR };
        let aligned = self.reference.align(frame, start, &prior);
        is_found_again(&aligned, &self.reference).then_some(aligned)
    }
}

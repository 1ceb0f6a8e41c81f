//! Search for a start when the motion model fails: turns of the camera are tried at the coarsest level.

use crate::keyframe::Reference;
use crate::prior::MotionPrior;
use crate::pyramid::Pyramid;
use crate::se3;
use splatseg_geometry::Pose;

/// Step of the search at the coarsest level, pixels.
const STEP: f64 = 2.5;

/// Number of steps to each side, horizontally and vertically.
const STEPS: (i32, i32) = (5, 4);

impl Reference {
    /// The best of many turns of the camera about its last pose and about the keyframe's own.
    pub(crate) fn search(&self, frame: &Pyramid, last: &Pose, prior: &MotionPrior) -> Pose {
        let coarsest = &frame.levels[frame.levels.len() - 1];
        let angles = [STEP / f64::from(coarsest.intrinsics.fy), STEP / f64::from(coarsest.intrinsics.fx)];
        let mut best = (0.0, *last);
        for start in [last, &self.world_from_key] {
            for (pitch, yaw) in (-STEPS.1..=STEPS.1).flat_map(|pitch| (-STEPS.0..=STEPS.0).map(move |yaw| (pitch, yaw)))
            {
                let turn = [0.0, 0.0, 0.0, f64::from(pitch) * angles[0], f64::from(yaw) * angles[1], 0.0];
                let pose = *start * se3::exponential(&turn);
                let score = self.score(frame, &pose, prior);
                if score > best.0 {
                    best = (score, pose);
                }
            }
        }
        best.1
    }
}

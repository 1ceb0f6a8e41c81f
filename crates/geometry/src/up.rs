//! Estimates the up direction. Data sets use different world axes for it, and some are not aligned with any axis.

use crate::Pose;
use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// Weight of the cameras' mean up direction, relative to the term of their x axes.
const WEIGHT_OF_MEAN: f32 = 0.02;
/// The estimate snaps to a world axis with at least this cosine to it (within about 8 degrees).
const CLOSE: f32 = 0.99;
/// Steps of the power iteration. The start is close, and the orbit's axis need not be exact.
const STEPS: usize = 64;

/// Estimates up from the poses of a video.
///
/// A camera held by a person or a robot is pitched and turned, but hardly rolled. So up is the direction most nearly
/// perpendicular to the cameras' x axes, with the cost `Σ x xᵀ`. If the camera does not turn, that is ambiguous, and
/// the mean of the cameras' own up directions decides.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct UpEstimate {
    across: Mat3,
    up: Vec3,
    frames: f32,
}

impl Default for UpEstimate {
    fn default() -> Self {
        Self { across: Mat3::ZERO, up: Vec3::ZERO, frames: 0.0 }
    }
}

impl UpEstimate {
    /// Unit vector pointing up, in world coordinates, from the poses of a camera; `None` without any.
    pub fn of<'a>(world_from_camera: impl IntoIterator<Item = &'a Pose>) -> Option<Vec3> {
        let mut up = Self::default();
        world_from_camera.into_iter().for_each(|pose| up.add(pose));
        (up.frames > 0.0).then(|| up.direction())
    }

    /// Records a frame's pose.
    pub fn add(&mut self, world_from_camera: &Pose) {
        let axes = world_from_camera.rotation().as_mat3();
        let x = axes.x_axis;
        self.across += Mat3::from_cols(x * x.x, x * x.y, x * x.z);
        self.up -= axes.y_axis;
        self.frames += 1.0;
    }

    /// Unit vector pointing up, in world coordinates.
    pub fn direction(&self) -> Vec3 {
        let mean = self.up.try_normalize().unwrap_or(Vec3::Z);
        let away_from_mean = Mat3::IDENTITY - Mat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z);
        let cost = self.across * self.frames.max(1.0).recip() + away_from_mean * WEIGHT_OF_MEAN;
        // The direction of lowest cost is the eigenvector of this matrix's largest eigenvalue: no cost is above 1 plus
        // the weight.
        let gain = Mat3::IDENTITY * (1.0 + WEIGHT_OF_MEAN) - cost;
        let up = (0..STEPS).fold(mean, |up, _| (gain * up).try_normalize().unwrap_or(up));
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
        axes.into_iter().find(|axis| axis.dot(up) > CLOSE).unwrap_or(up)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat4;

    /// A camera at the origin of a world whose z axis points up.
    fn level(turn: f32, pitch: f32) -> Mat4 {
        // Camera x right, y down, z forward, to world x right, y forward, z up.
        let upright = Mat4::from_rotation_x(-std::f32::consts::FRAC_PI_2);
        Mat4::from_rotation_z(turn) * upright * Mat4::from_rotation_x(pitch)
    }

    fn estimate(poses: impl IntoIterator<Item = Mat4>) -> Vec3 {
        let poses: Vec<Pose> = poses.into_iter().map(|pose| Pose::from_matrix(pose.as_dmat4()).unwrap()).collect();
        UpEstimate::of(&poses).unwrap()
    }

    #[test]
    fn cameras_that_turn_and_look_down_show_which_axis_is_up() {
        let steps = || (0..20u8).map(|step| f32::from(step) * 0.08);
        assert_eq!(estimate(steps().map(|turn| level(turn, -0.6))), Vec3::Z);
        // The same in a world whose -y axis points up.
        let other = Mat4::from_rotation_x(std::f32::consts::FRAC_PI_2);
        assert!((estimate(steps().map(|turn| other * level(turn, -0.6))) - Vec3::NEG_Y).length() < 1e-6);
        // And in one that is oblique.
        let oblique = Mat4::from_rotation_x(0.5) * Mat4::from_rotation_y(0.4);
        let found = estimate(steps().map(|turn| oblique * level(turn, -0.6)));
        assert!(found.dot(oblique.transform_vector3(Vec3::Z)) > 0.995, "{found}");
    }

    #[test]
    fn a_camera_that_stands_still_has_its_own_up() {
        let found = estimate([level(0.3, -0.4)]);
        assert!((found - level(0.3, -0.4).transform_vector3(Vec3::NEG_Y)).length() < 1e-3, "{found}");
        assert_eq!((UpEstimate::default().direction(), UpEstimate::of([])), (Vec3::Z, None));
    }
}

//! Rigid camera poses.

use crate::LocalPose;
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::Mul;
use thiserror::Error;

/// Tolerance for entries of `RᵀR − I` and for `det R − 1`, since published trajectories are rounded to text.
const RIGID_TOLERANCE: f64 = 1e-2;

/// Largest entry of |RᵀR − I| that is attributed to rounding to `f64`.
const ROUNDING: f64 = 1e-14;

/// A rigid transform from camera to world coordinates (metres; camera x right, y down, z forward). It uses double
/// precision, since the world may be a map projection with coordinates of millions of metres.
///
/// Transforms are composed with `*`, right to left: `world_from_body * body_from_camera` is `world_from_camera`.
/// Computations near the camera use [`LocalPose`], in single precision.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "PoseParts")]
pub struct Pose {
    rotation: DMat3,
    translation: DVec3,
}

/// The serialised form of a pose, before validation.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseParts {
    rotation: DMat3,
    translation: DVec3,
}

impl TryFrom<PoseParts> for Pose {
    type Error = PoseError;

    /// Validates the pose and keeps its exact bits, without orthonormalising.
    fn try_from(PoseParts { rotation, translation }: PoseParts) -> Result<Self, PoseError> {
        Self::from_matrix(DMat4::from_mat3_translation(rotation, translation)).map(|_| Self { rotation, translation })
    }
}

/// Errors in a matrix or quaternion that should be a rigid transform.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PoseError {
    /// An entry is NaN or infinite. ScanNet writes `-inf` where tracking was lost.
    #[error("the pose is not finite (tracking was lost in this frame)")]
    NotFinite,
    /// A coordinate of the camera exceeds [`Pose::MAX_DISTANCE`].
    #[error("the camera is {0:e} m from the world's origin, expected at most {max:e} m", max = Pose::MAX_DISTANCE)]
    TooFar(f64),
    /// The quaternion has length zero.
    #[error("the pose's quaternion has length zero")]
    ZeroQuaternion,
    /// The last row is not 0 0 0 1.
    #[error("the pose's last row is {0} {1} {2} {3}, expected 0 0 0 1")]
    LastRow(f64, f64, f64, f64),
    /// The upper-left 3×3 part is not a rotation.
    #[error(
        "the pose is not a rigid transform: its 3x3 part has determinant {determinant} and deviates from a rotation by {deviation}"
    )]
    NotRigid {
        /// Determinant of the 3×3 part; 1 for a rotation.
        determinant: f64,
        /// Largest entry of |RᵀR − I|; 0 for a rotation.
        deviation: f64,
    },
}

impl Pose {
    /// The camera at the world's origin, looking along +z.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// Maximum absolute coordinate of a camera, metres.
    pub const MAX_DISTANCE: f64 = f32::MAX as f64;

    /// Creates a pose from a 4×4 camera-to-world matrix. A rotation with rounding errors (up to 1e-2) is
    /// orthonormalised.
    ///
    /// # Errors
    /// [`PoseError`] if the matrix is not a valid pose.
    pub fn from_matrix(world_from_camera: DMat4) -> Result<Self, PoseError> {
        if !world_from_camera.is_finite() {
            return Err(PoseError::NotFinite);
        }
        let last = world_from_camera.row(3);
        if (last - DVec4::W).abs().max_element() > 1e-4 {
            return Err(PoseError::LastRow(last.x, last.y, last.z, last.w));
        }
        let rotation = DMat3::from_mat4(world_from_camera);
        let determinant = rotation.determinant();
        let deviation = deviation(rotation);
        if deviation > RIGID_TOLERANCE || (determinant - 1.0).abs() > RIGID_TOLERANCE {
            return Err(PoseError::NotRigid { determinant, deviation });
        }
        let translation = world_from_camera.w_axis.truncate();
        let farthest = translation.abs().max_element();
        if farthest > Self::MAX_DISTANCE {
            return Err(PoseError::TooFar(farthest));
        }
        Ok(Self::orthonormalised(rotation, translation))
    }

    /// Creates a pose from a position and an orientation, as used by ROS, TUM RGB-D and most SLAM systems: the camera's
    /// centre in world coordinates, metres, and the rotation from camera to world axes. The quaternion need not be
    /// normalised.
    ///
    /// ```
    /// use glam::{DQuat, DVec3, Vec3};
    /// use splatseg_geometry::Pose;
    /// let half_turn_about_z = DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0);
    /// let pose = Pose::from_quaternion(DVec3::new(1.0, 2.0, 3.0), half_turn_about_z)?;
    /// assert_eq!(pose.to_world(Vec3::X), DVec3::new(0.0, 2.0, 3.0));
    /// # Ok::<(), splatseg_geometry::PoseError>(())
    /// ```
    ///
    /// # Errors
    /// [`PoseError::NotFinite`] for NaN and infinite values, [`PoseError::TooFar`] for positions beyond
    /// [`Self::MAX_DISTANCE`], [`PoseError::ZeroQuaternion`] for a quaternion of length zero.
    pub fn from_quaternion(position: DVec3, world_from_camera: DQuat) -> Result<Self, PoseError> {
        if !world_from_camera.is_finite() {
            return Err(PoseError::NotFinite);
        }
        // The square of a very small or large number would underflow or overflow.
        let largest = world_from_camera.to_array().into_iter().fold(0.0, |largest: f64, part| largest.max(part.abs()));
        let scaled = world_from_camera * largest.recip();
        if !(largest > 0.0 && scaled.is_finite()) {
            return Err(PoseError::ZeroQuaternion);
        }
        Self::from_matrix(DMat4::from_rotation_translation(scaled.normalize(), position))
    }

    /// Creates a pose without rotation, with the camera's centre at `position`, metres.
    pub const fn from_translation(position: DVec3) -> Self {
        Self { rotation: DMat3::IDENTITY, translation: position }
    }

    /// Creates a pose from a camera-to-world matrix of 16 row-major numbers, as stored in datasets.
    ///
    /// # Errors
    /// [`PoseError`] if the matrix is not a valid pose.
    pub fn from_row_major(matrix: [f64; 16]) -> Result<Self, PoseError> {
        Self::from_matrix(DMat4::from_cols_array(&matrix).transpose())
    }

    /// Restores a pose from [`Self::to_row_major`], to the same bits: the rotation is not orthonormalised.
    ///
    /// # Errors
    /// As [`Self::from_matrix`].
    pub fn from_saved_row_major(matrix: [f64; 16]) -> Result<Self, PoseError> {
        let matrix = DMat4::from_cols_array(&matrix).transpose();
        let pose = Self::from_matrix(matrix)?;
        Ok(Self { rotation: DMat3::from_mat4(matrix), ..pose })
    }

    /// The camera-to-world matrix, row-major, as stored in datasets.
    pub fn to_row_major(&self) -> [f64; 16] {
        self.to_matrix().transpose().to_cols_array()
    }

    /// The camera-to-world matrix.
    pub fn to_matrix(&self) -> DMat4 {
        DMat4::from_mat3_translation(self.rotation, self.translation)
    }

    /// The camera's axes in world coordinates, as columns.
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// The camera's centre in world coordinates, metres.
    pub fn translation(&self) -> DVec3 {
        self.translation
    }

    /// Transforms a point from the camera frame to world coordinates.
    pub fn to_world(&self, point_camera: Vec3) -> DVec3 {
        self.rotation * point_camera.as_dvec3() + self.translation
    }

    /// Transforms a point from world coordinates to the camera frame.
    pub fn to_camera(&self, point_world: DVec3) -> Vec3 {
        (self.rotation.transpose() * (point_world - self.translation)).as_vec3()
    }

    /// The motion of what is attached to this pose when that becomes `now`: new world coordinates from old ones. `None` if
    /// it stays as it is.
    pub fn motion_to(&self, now: &Self) -> Option<Self> {
        (now != self).then(|| *now * self.inverse())
    }

    /// Returns the inverse transform, from world to camera coordinates.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Returns the pose with its position multiplied by a finite factor: the same pose in another unit of length.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { translation: self.translation * factor, ..*self }
    }

    /// Returns the pose relative to `origin` (world coordinates, metres), with the world's axes. `origin` should be
    /// near the camera, since the result is in single precision.
    pub fn relative_to(&self, origin: DVec3) -> LocalPose {
        LocalPose::new(self.rotation.as_mat3(), (self.translation - origin).as_vec3())
    }

    pub(crate) fn orthonormalised(rotation: DMat3, translation: DVec3) -> Self {
        let rotation = if deviation(rotation) > ROUNDING { nearest_rotation(rotation) } else { rotation };
        Self { rotation, translation }
    }
}

/// `a_from_b * b_from_c` is `a_from_c`. Re-orthonormalises, so long products stay rigid up to rounding.
impl Mul for Pose {
    type Output = Self;

    fn mul(self, right: Self) -> Self {
        let translation = self.rotation * right.translation + self.translation;
        Self::orthonormalised(self.rotation * right.rotation, translation)
    }
}

/// Largest entry of |RᵀR − I|; 0 for a rotation.
fn deviation(rotation: DMat3) -> f64 {
    let difference = rotation.transpose() * rotation - DMat3::IDENTITY;
    difference.to_cols_array().iter().fold(0.0, |largest, entry| largest.max(entry.abs()))
}

/// Returns the nearest rotation, by three Newton steps of the polar decomposition.
fn nearest_rotation(mut rotation: DMat3) -> DMat3 {
    for _ in 0..3 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::EulerRot;
    use proptest::prelude::*;

    #[test]
    fn lost_tracking_is_named() {
        let error = Pose::from_row_major([f64::NEG_INFINITY; 16]).unwrap_err();
        assert_eq!(error, PoseError::NotFinite);
    }

    #[test]
    fn scaled_and_mirrored_matrices_are_refused() {
        assert!(matches!(Pose::from_matrix(DMat4::from_scale(DVec3::splat(1.1))), Err(PoseError::NotRigid { .. })));
        let mirrored = DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0));
        assert!(matches!(Pose::from_matrix(mirrored), Err(PoseError::NotRigid { .. })));
        assert!(matches!(Pose::from_matrix(DMat4::ZERO), Err(PoseError::LastRow(..))));
    }

    #[test]
    fn a_quaternion_of_any_length_gives_the_same_rotation() {
        let pose = |scale: f64| {
            let rotation = DQuat::from_xyzw(0.0, 0.0, 0.6 * scale, 0.8 * scale);
            Pose::from_quaternion(DVec3::new(1.0, 2.0, 3.0), rotation).unwrap()
        };
        for scale in [1e-200, 0.5, 3.0, 1e200] {
            assert!(pose(scale).to_matrix().abs_diff_eq(pose(1.0).to_matrix(), 1e-15));
        }
        assert!((pose(1.0).to_world(Vec3::X) - DVec3::new(1.28, 2.96, 3.0)).length() < 1e-12);
    }

    #[test]
    fn a_saved_pose_is_restored_to_the_bit() {
        let turn = DQuat::from_euler(EulerRot::XYZ, 0.3, -1.1, 2.0);
        let step = Pose::from_quaternion(DVec3::new(0.1, -2.0, 1e-9), turn).unwrap();
        let pose = (0..100).fold(step, |pose, _| pose * step);
        let restored = Pose::from_saved_row_major(pose.to_row_major()).unwrap();
        assert_eq!(restored.to_row_major().map(f64::to_bits), pose.to_row_major().map(f64::to_bits));
        assert!(Pose::from_saved_row_major([f64::NAN; 16]).is_err() && Pose::from_saved_row_major([1.0; 16]).is_err());
    }

    #[test]
    fn quaternions_without_a_rotation_are_refused() {
        let pose = |rotation, x| Pose::from_quaternion(DVec3::new(x, 0.0, 0.0), DQuat::from_array(rotation));
        assert_eq!(pose([0.0; 4], 0.0), Err(PoseError::ZeroQuaternion));
        assert_eq!(pose([f64::MIN_POSITIVE / 4.0, 0.0, 0.0, 0.0], 0.0), Err(PoseError::ZeroQuaternion));
        assert_eq!(pose([f64::NAN, 0.0, 0.0, 1.0], 0.0), Err(PoseError::NotFinite));
        assert_eq!(pose([f64::INFINITY, 0.0, 0.0, 1.0], 0.0), Err(PoseError::NotFinite));
        assert_eq!(pose([0.0, 0.0, 0.0, 1.0], f64::NAN), Err(PoseError::NotFinite));
        assert_eq!(pose([0.0, 0.0, 0.0, 1.0], 1e300), Err(PoseError::TooFar(1e300)));
    }

    #[test]
    fn a_long_chain_of_poses_stays_rigid() {
        let turn = DQuat::from_euler(EulerRot::XYZ, 0.1, 0.2, 0.3);
        let step = Pose::from_quaternion(DVec3::X * 1e-3, turn).unwrap();
        let end = (0..100_000).fold(Pose::IDENTITY, |pose, _| pose * step);
        assert!(deviation(end.rotation()) < 1e-12, "{:?}", end.rotation());
    }

    #[test]
    fn a_chain_through_a_far_origin_keeps_micrometres() {
        // A pose in a map projection, given as the transform from the world to the robot.
        let far = DVec3::new(5e5, 5.4e6, 120.0);
        for step in 0..100 {
            let turn = DQuat::from_euler(EulerRot::XYZ, 0.1, 0.02 * f64::from(step), 0.3);
            let near = DVec3::new(0.01 * f64::from(step), 0.5, 0.25);
            let robot_from_world = Pose::from_quaternion(near + far, turn).unwrap().inverse();
            let found = robot_from_world.inverse().relative_to(far).translation();
            assert!((found.as_dvec3() - near).length() < 1e-6, "{found} {near}");
        }
    }

    proptest! {
        #[test]
        fn composition_and_inverse_act_on_points_as_the_transforms_do(
            q in prop::array::uniform4(0.1f64..1.0), r in prop::array::uniform4(-1.0f64..-0.1),
            t in prop::array::uniform3(-5.0f64..5.0), p in prop::array::uniform3(-5.0f32..5.0),
        ) {
            let first = Pose::from_quaternion(DVec3::from(t), DQuat::from_array(q)).unwrap();
            let second = Pose::from_quaternion(DVec3::new(t[2], t[0], t[1]), DQuat::from_array(r)).unwrap();
            let point = Vec3::from(p);
            let in_turn = first.to_world(second.to_world(point).as_vec3());
            prop_assert!(((first * second).to_world(point) - in_turn).length() < 1e-5);
            prop_assert!(((first.inverse() * first).to_world(point) - point.as_dvec3()).length() < 1e-12);
            prop_assert!((first.inverse().to_world(point).as_vec3() - first.to_camera(point.as_dvec3())).length() < 1e-5);
        }

        #[test]
        fn world_and_camera_are_inverse(
            angles in prop::array::uniform3(-3.0f64..3.0), t in prop::array::uniform3(-1e7f64..1e7),
            p in prop::array::uniform3(-5.0f32..5.0), noise in -1e-3f64..1e-3,
        ) {
            let rotation = DQuat::from_euler(EulerRot::XYZ, angles[0], angles[1], angles[2]);
            let mut matrix = DMat4::from_rotation_translation(rotation, DVec3::from(t));
            matrix.x_axis.x += noise;
            let pose = Pose::from_matrix(matrix).unwrap();
            let point = Vec3::from(p);
            prop_assert!((pose.to_camera(pose.to_world(point)) - point).length() < 1e-5);
            let local = pose.relative_to(pose.translation().round());
            prop_assert!((local.to_camera(local.to_world(point)) - point).length() < 1e-4);
            let world = local.to_world(point).as_dvec3() + pose.translation().round();
            prop_assert!((world - pose.to_world(point)).length() < 1e-5);
            prop_assert_eq!(Pose::from_row_major(pose.to_row_major()).unwrap(), pose);
        }
    }
}

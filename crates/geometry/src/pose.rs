//! Rigid camera poses.

use glam::{Affine3A, DQuat, DVec3, Mat3, Mat4, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::Mul;
use thiserror::Error;

/// How far `RᵀR` may be from the identity, and `det R` from 1: published trajectories are rounded text.
const RIGID_TOLERANCE: f32 = 1e-2;

/// A rigid transform from camera to world coordinates (metres; camera x right, y down, z forward).
///
/// Transforms are composed with `*`, right to left: `world_from_body * body_from_camera` is `world_from_camera`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "PoseParts")]
pub struct Pose {
    rotation: Mat3,
    translation: Vec3,
}

/// A pose as it is written, which may be none.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PoseParts {
    rotation: Mat3,
    translation: Vec3,
}

impl TryFrom<PoseParts> for Pose {
    type Error = PoseError;

    /// The same numbers, to the last bit: they are not made orthonormal again.
    fn try_from(PoseParts { rotation, translation }: PoseParts) -> Result<Self, PoseError> {
        Self::from_matrix(Mat4::from_mat3_translation(rotation, translation)).map(|_| Self { rotation, translation })
    }
}

/// The largest entry of |RᵀR − I| that rounding to `f32` leaves.
const ROUNDING: f32 = 1e-6;

/// A matrix or quaternion that does not give a rigid transform.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PoseError {
    /// An entry is NaN or infinite. ScanNet writes `-inf` where tracking was lost.
    #[error("the pose is not finite (tracking was lost in this frame)")]
    NotFinite,
    /// The quaternion has length zero, so it has no direction.
    #[error("the pose's quaternion has length zero")]
    ZeroQuaternion,
    /// The last row is not 0 0 0 1.
    #[error("the pose's last row is {0} {1} {2} {3}, expected 0 0 0 1")]
    LastRow(f32, f32, f32, f32),
    /// The upper left 3×3 part is not a rotation.
    #[error(
        "the pose is not a rigid transform: its 3x3 part has determinant {determinant} and deviates from a rotation by {deviation}"
    )]
    NotRigid {
        /// Determinant of the 3×3 part; 1 for a rotation.
        determinant: f32,
        /// Largest entry of |RᵀR − I|; 0 for a rotation.
        deviation: f32,
    },
}

impl Pose {
    /// The camera at the world's origin, looking along +z.
    pub const IDENTITY: Self = Self { rotation: Mat3::IDENTITY, translation: Vec3::ZERO };

    /// A pose from a 4×4 camera-to-world matrix. A rotation that is off by rounding (up to 1e-2) is made orthonormal.
    ///
    /// # Errors
    /// [`PoseError`] says what is wrong with the matrix.
    pub fn from_matrix(world_from_camera: Mat4) -> Result<Self, PoseError> {
        if !world_from_camera.is_finite() {
            return Err(PoseError::NotFinite);
        }
        let last = world_from_camera.row(3);
        if (last - glam::Vec4::W).abs().max_element() > 1e-4 {
            return Err(PoseError::LastRow(last.x, last.y, last.z, last.w));
        }
        let rotation = Mat3::from_mat4(world_from_camera);
        let determinant = rotation.determinant();
        let deviation = deviation(rotation);
        if deviation > RIGID_TOLERANCE || (determinant - 1.0).abs() > RIGID_TOLERANCE {
            return Err(PoseError::NotRigid { determinant, deviation });
        }
        Ok(Self::orthonormalised(rotation, world_from_camera.w_axis.truncate()))
    }

    /// A pose from a 4×4 camera-to-world matrix that another pose may have given ([`Self::to_matrix`]): a rotation that
    /// is exact up to the rounding of `f32` is taken as it is, to the last bit. All others are treated as by
    /// [`Self::from_matrix`].
    ///
    /// # Errors
    /// As [`Self::from_matrix`].
    pub fn from_own_matrix(world_from_camera: Mat4) -> Result<Self, PoseError> {
        let rounded = Self::from_matrix(world_from_camera)?;
        let rotation = Mat3::from_mat4(world_from_camera);
        Ok(if deviation(rotation) <= ROUNDING { Self { rotation, ..rounded } } else { rounded })
    }

    /// A pose from a position and an orientation, as ROS, TUM RGB-D and most SLAM systems write it: the camera's centre
    /// in world coordinates, metres, and the rotation from camera to world axes. The quaternion may have any length but
    /// zero.
    ///
    /// ```
    /// use glam::{DQuat, DVec3, Vec3};
    /// use splatseg_geometry::Pose;
    /// let half_turn_about_z = DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0);
    /// let pose = Pose::from_quaternion(DVec3::new(1.0, 2.0, 3.0), half_turn_about_z)?;
    /// assert_eq!(pose.to_world(Vec3::X), Vec3::new(0.0, 2.0, 3.0));
    /// # Ok::<(), splatseg_geometry::PoseError>(())
    /// ```
    ///
    /// # Errors
    /// [`PoseError::NotFinite`] for NaN and infinite numbers (also those beyond the range of `f32`),
    /// [`PoseError::ZeroQuaternion`] for a quaternion of length zero.
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
        Self::from_matrix(Mat4::from_rotation_translation(scaled.normalize().as_quat(), position.as_vec3()))
    }

    /// A pose with the world's axes and the camera's centre at `position`, metres.
    pub const fn from_translation(position: Vec3) -> Self {
        Self { rotation: Mat3::IDENTITY, translation: position }
    }

    /// A pose from a camera-to-world matrix given as 16 row-major numbers, as datasets store it.
    ///
    /// # Errors
    /// [`PoseError`] says what is wrong with the matrix.
    pub fn from_row_major(matrix: [f32; 16]) -> Result<Self, PoseError> {
        Self::from_matrix(Mat4::from_cols_array(&matrix).transpose())
    }

    /// The camera-to-world matrix, row-major, as datasets store it.
    pub fn to_row_major(&self) -> [f32; 16] {
        self.to_matrix().transpose().to_cols_array()
    }

    /// The camera-to-world matrix.
    pub fn to_matrix(&self) -> Mat4 {
        Mat4::from_mat3_translation(self.rotation, self.translation)
    }

    /// The camera's axes in world coordinates, as columns.
    pub fn rotation(&self) -> Mat3 {
        self.rotation
    }

    /// The camera's centre in world coordinates, metres.
    pub fn translation(&self) -> Vec3 {
        self.translation
    }

    /// A camera-frame point in world coordinates.
    pub fn to_world(&self, point_camera: Vec3) -> Vec3 {
        self.rotation * point_camera + self.translation
    }

    /// A world point in the camera's frame.
    pub fn to_camera(&self, point_world: Vec3) -> Vec3 {
        self.rotation.transpose() * (point_world - self.translation)
    }

    /// The inverse transform: from world to camera coordinates.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// The world-to-camera transform as an affine matrix.
    pub fn camera_from_world(&self) -> Affine3A {
        let Self { rotation, translation } = self.inverse();
        Affine3A::from_mat3_translation(rotation, translation)
    }

    fn orthonormalised(rotation: Mat3, translation: Vec3) -> Self {
        let rotation = if deviation(rotation) > 1e-6 { nearest_rotation(rotation) } else { rotation };
        Self { rotation, translation }
    }
}

/// `a_from_b * b_from_c` is `a_from_c`. The result is a rotation to within rounding, however many are multiplied.
impl Mul for Pose {
    type Output = Self;

    fn mul(self, right: Self) -> Self {
        Self::orthonormalised(self.rotation * right.rotation, self.to_world(right.translation))
    }
}

/// Largest entry of |RᵀR − I|; 0 for a rotation.
fn deviation(rotation: Mat3) -> f32 {
    let difference = rotation.transpose() * rotation - Mat3::IDENTITY;
    difference.to_cols_array().iter().fold(0.0, |largest, entry| largest.max(entry.abs()))
}

/// The nearest rotation, by three Newton steps of the polar decomposition.
fn nearest_rotation(mut rotation: Mat3) -> Mat3 {
    for _ in 0..3 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3Swizzles as _};
    use proptest::prelude::*;

    #[test]
    fn lost_tracking_is_named() {
        let error = Pose::from_row_major([f32::NEG_INFINITY; 16]).unwrap_err();
        assert_eq!(error, PoseError::NotFinite);
    }

    #[test]
    fn scaled_and_mirrored_matrices_are_refused() {
        assert!(matches!(Pose::from_matrix(Mat4::from_scale(Vec3::splat(1.1))), Err(PoseError::NotRigid { .. })));
        assert!(matches!(
            Pose::from_matrix(Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0))),
            Err(PoseError::NotRigid { .. })
        ));
        assert!(matches!(Pose::from_matrix(Mat4::ZERO), Err(PoseError::LastRow(..))));
    }

    #[test]
    fn a_quaternion_of_any_length_gives_the_same_rotation() {
        let pose = |scale: f64| {
            let rotation = DQuat::from_xyzw(0.0, 0.0, 0.6 * scale, 0.8 * scale);
            Pose::from_quaternion(DVec3::new(1.0, 2.0, 3.0), rotation).unwrap()
        };
        for scale in [1e-200, 0.5, 3.0, 1e200] {
            assert_eq!(pose(scale), pose(1.0));
        }
        assert!((pose(1.0).to_world(Vec3::X) - Vec3::new(1.28, 2.96, 3.0)).length() < 1e-6);
    }

    #[test]
    fn quaternions_without_a_rotation_are_refused() {
        let pose = |rotation, x| Pose::from_quaternion(DVec3::new(x, 0.0, 0.0), DQuat::from_array(rotation));
        assert_eq!(pose([0.0; 4], 0.0), Err(PoseError::ZeroQuaternion));
        assert_eq!(pose([f64::MIN_POSITIVE / 4.0, 0.0, 0.0, 0.0], 0.0), Err(PoseError::ZeroQuaternion));
        assert_eq!(pose([f64::NAN, 0.0, 0.0, 1.0], 0.0), Err(PoseError::NotFinite));
        assert_eq!(pose([f64::INFINITY, 0.0, 0.0, 1.0], 0.0), Err(PoseError::NotFinite));
        assert_eq!(pose([0.0, 0.0, 0.0, 1.0], f64::NAN), Err(PoseError::NotFinite));
        assert_eq!(pose([0.0, 0.0, 0.0, 1.0], 1e300), Err(PoseError::NotFinite));
    }

    #[test]
    fn a_long_chain_of_poses_stays_rigid() {
        let step =
            Pose::from_quaternion(DVec3::X * 1e-3, DQuat::from_euler(glam::EulerRot::XYZ, 0.1, 0.2, 0.3)).unwrap();
        let end = (0..100_000).fold(Pose::IDENTITY, |pose, _| pose * step);
        assert!(deviation(end.rotation()) < 1e-5, "{:?}", end.rotation());
    }

    proptest! {
        #[test]
        fn composition_and_inverse_act_on_points_as_the_transforms_do(
            q in prop::array::uniform4(0.1f64..1.0), r in prop::array::uniform4(-1.0f64..-0.1),
            t in prop::array::uniform3(-5.0f64..5.0), p in prop::array::uniform3(-5.0f32..5.0),
        ) {
            let first = Pose::from_quaternion(DVec3::from(t), DQuat::from_array(q)).unwrap();
            let second = Pose::from_quaternion(DVec3::from(t).zxy(), DQuat::from_array(r)).unwrap();
            let point = Vec3::from(p);
            prop_assert!(((first * second).to_world(point) - first.to_world(second.to_world(point))).length() < 1e-4);
            prop_assert!(((first.inverse() * first).to_world(point) - point).length() < 1e-4);
            prop_assert!((first.inverse().to_world(point) - first.to_camera(point)).length() < 1e-4);
        }

        #[test]
        fn world_and_camera_are_inverse(angles in prop::array::uniform3(-3.0f32..3.0), t in prop::array::uniform3(-5.0f32..5.0),
                                        p in prop::array::uniform3(-5.0f32..5.0), noise in -1e-3f32..1e-3) {
            let rotation = Quat::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]);
            let mut matrix = Mat4::from_rotation_translation(rotation, Vec3::from(t));
            matrix.x_axis.x += noise;
            let pose = Pose::from_matrix(matrix).unwrap();
            let point = Vec3::from(p);
            prop_assert!((pose.to_camera(pose.to_world(point)) - point).length() < 1e-4);
            let camera: Vec3 = pose.camera_from_world().transform_point3(pose.to_world(point));
            prop_assert!((camera - point).length() < 1e-4);
            prop_assert_eq!(Pose::from_row_major(pose.to_row_major()).unwrap().translation(), pose.translation());
        }
    }
}

//! Rigid camera poses.

use glam::{Affine3A, Mat3, Mat4, Vec3};
use thiserror::Error;

/// How far `RᵀR` may be from the identity, and `det R` from 1: published trajectories are rounded text.
const RIGID_TOLERANCE: f32 = 1e-2;

/// A rigid transform from camera to world coordinates (metres; camera x right, y down, z forward).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    rotation: Mat3,
    translation: Vec3,
}

/// A matrix that is not a rigid transform.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum PoseError {
    /// An entry is NaN or infinite. ScanNet writes `-inf` where tracking was lost.
    #[error("the pose is not finite (tracking was lost in this frame)")]
    NotFinite,
    /// The last row is not 0 0 0 1.
    #[error("the pose's last row is {0} {1} {2} {3}, expected 0 0 0 1")]
    LastRow(f32, f32, f32, f32),
    /// The upper left 3×3 part is not a rotation.
    #[error(
        "the pose is not a rigid transform: its 3x3 part has determinant {determinant} and is off a rotation by {deviation}"
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

    /// Checks that `world_from_camera` is a rigid transform.
    ///
    /// A rotation that is off by rounding (up to 1e-2) is made orthonormal.
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
        let deviation_matrix = rotation.transpose() * rotation - Mat3::IDENTITY;
        let deviation = deviation_matrix.to_cols_array().iter().fold(0.0f32, |largest, entry| largest.max(entry.abs()));
        if deviation > RIGID_TOLERANCE || (determinant - 1.0).abs() > RIGID_TOLERANCE {
            return Err(PoseError::NotRigid { determinant, deviation });
        }
        let rotation = if deviation > 1e-6 { orthonormalised(rotation) } else { rotation };
        Ok(Self { rotation, translation: world_from_camera.w_axis.truncate() })
    }

    /// Checks a camera-to-world matrix given as 16 row-major numbers, as datasets store it.
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

    /// The world-to-camera transform.
    pub fn camera_from_world(&self) -> Affine3A {
        let rotation = self.rotation.transpose();
        Affine3A::from_mat3_translation(rotation, -(rotation * self.translation))
    }
}

/// The nearest rotation, by two Newton steps of the polar decomposition.
fn orthonormalised(mut rotation: Mat3) -> Mat3 {
    for _ in 0..3 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;
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

    proptest! {
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

//! Camera poses relative to a nearby origin.

use crate::{Pose, PoseError};
use glam::{DMat4, DVec3, Mat3, Mat4, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::Mul;

/// Largest entry of |RᵀR − I| that is attributed to rounding to `f32`.
const ROUNDING: f32 = 1e-6;

/// A rigid transform in single precision, from a camera to the coordinates of a map or from one camera to another.
/// Exact to micrometres for coordinates of a few metres. Created by [`Pose::relative_to`].
///
/// Transforms are composed with `*`, right to left.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "LocalPoseParts")]
pub struct LocalPose {
    rotation: Mat3,
    translation: Vec3,
}

/// The serialised form of a pose, before validation.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LocalPoseParts {
    rotation: Mat3,
    translation: Vec3,
}

impl TryFrom<LocalPoseParts> for LocalPose {
    type Error = PoseError;

    /// Validates the pose and keeps its exact bits, without orthonormalising.
    fn try_from(LocalPoseParts { rotation, translation }: LocalPoseParts) -> Result<Self, PoseError> {
        let matrix: DMat4 = Mat4::from_mat3_translation(rotation, translation).as_dmat4();
        Pose::from_matrix(matrix).map(|_| Self { rotation, translation })
    }
}

impl LocalPose {
    /// The camera at the origin, looking along +z.
    pub const IDENTITY: Self = Self { rotation: Mat3::IDENTITY, translation: Vec3::ZERO };

    /// Creates a pose from the camera's axes, as columns, and its centre.
    pub(crate) fn new(rotation: Mat3, translation: Vec3) -> Self {
        Self { rotation, translation }
    }

    /// Creates a pose without rotation, with the camera's centre at `position`, metres.
    pub const fn from_translation(position: Vec3) -> Self {
        Self { rotation: Mat3::IDENTITY, translation: position }
    }

    /// The camera's axes, as columns.
    pub fn rotation(&self) -> Mat3 {
        self.rotation
    }

    /// The camera's centre, metres.
    pub fn translation(&self) -> Vec3 {
        self.translation
    }

    /// Transforms a point from the camera frame to the local coordinates.
    pub fn to_world(&self, point_camera: Vec3) -> Vec3 {
        self.rotation * point_camera + self.translation
    }

    /// Transforms a point from the local coordinates to the camera frame.
    pub fn to_camera(&self, point: Vec3) -> Vec3 {
        self.rotation.transpose() * (point - self.translation)
    }

    /// Returns the inverse transform.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Returns the pose in world coordinates, given the world position of the local `origin`, metres. Reverses
    /// [`Pose::relative_to`].
    pub fn at(&self, origin: DVec3) -> Pose {
        Pose::orthonormalised(self.rotation.as_dmat3(), self.translation.as_dvec3() + origin)
    }
}

/// `a_from_b * b_from_c` is `a_from_c`. Re-orthonormalises, so long products stay rigid up to rounding.
impl Mul for LocalPose {
    type Output = Self;

    fn mul(self, right: Self) -> Self {
        let rotation = self.rotation * right.rotation;
        let rotation = if deviation(rotation) > ROUNDING { nearest_rotation(rotation) } else { rotation };
        Self { rotation, translation: self.to_world(right.translation) }
    }
}

/// Largest entry of |RᵀR − I|; 0 for a rotation.
fn deviation(rotation: Mat3) -> f32 {
    let difference = rotation.transpose() * rotation - Mat3::IDENTITY;
    difference.to_cols_array().iter().fold(0.0, |largest, entry| largest.max(entry.abs()))
}

/// Returns the nearest rotation, by three Newton steps of the polar decomposition.
fn nearest_rotation(mut rotation: Mat3) -> Mat3 {
    for _ in 0..3 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, EulerRot};
    use proptest::prelude::*;

    fn pose(position: [f64; 3], angles: [f64; 3]) -> LocalPose {
        let turn = DQuat::from_euler(EulerRot::XYZ, angles[0], angles[1], angles[2]);
        Pose::from_quaternion(DVec3::from(position), turn).unwrap().relative_to(DVec3::ZERO)
    }

    #[test]
    fn a_long_chain_of_poses_stays_rigid() {
        let step = pose([1e-3, 0.0, 0.0], [0.1, 0.2, 0.3]);
        let end = (0..100_000).fold(LocalPose::IDENTITY, |pose, _| pose * step);
        assert!(deviation(end.rotation()) < 1e-5, "{:?}", end.rotation());
    }

    proptest! {
        #[test]
        fn composition_and_inverse_act_on_points_as_the_transforms_do(
            angles in prop::array::uniform3(-3.0f64..3.0), turns in prop::array::uniform3(-3.0f64..3.0),
            t in prop::array::uniform3(-5.0f64..5.0), p in prop::array::uniform3(-5.0f32..5.0),
        ) {
            let (first, second, point) = (pose(t, angles), pose([t[2], t[0], t[1]], turns), Vec3::from(p));
            prop_assert!(((first * second).to_world(point) - first.to_world(second.to_world(point))).length() < 1e-4);
            prop_assert!(((first.inverse() * first).to_world(point) - point).length() < 1e-4);
            prop_assert!((first.inverse().to_world(point) - first.to_camera(point)).length() < 1e-4);
            let far = DVec3::new(5e5, 5.4e6, -1e7);
            prop_assert!((first.at(far).relative_to(far).to_world(point) - first.to_world(point)).length() < 1e-5);
        }
    }
}

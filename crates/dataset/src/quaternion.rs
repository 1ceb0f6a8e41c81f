//! Camera poses written as a position and a quaternion.

use crate::DatasetError;
use glam::{DQuat, DVec3, Mat4};
use splatseg_geometry::Pose;
use std::path::Path;

/// A pose as data sets store it, camera-to-world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct QuaternionPose {
    /// Where the camera stands, metres.
    pub(crate) position: DVec3,
    /// How it is turned: x, y, z, w, of any length but zero.
    pub(crate) rotation: DQuat,
}

impl QuaternionPose {
    /// The pose of a camera whose axes, as its data set names them, are the columns of `dataset_from_ours` (x right, y
    /// down, z forward) turned by it. The quaternion is normalised. `path` and `field` are named in errors.
    ///
    /// # Errors
    /// [`DatasetError::Field`] for a quaternion without a direction, [`DatasetError::Pose`] for numbers that are not
    /// finite.
    pub(crate) fn to_pose(self, dataset_from_ours: DQuat, path: &Path, field: &str) -> Result<Pose, DatasetError> {
        // Numbers whose square is too small or too large for a length would give a quaternion of another length than 1.
        let largest = self.rotation.to_array().into_iter().fold(0.0, |largest: f64, part| largest.max(part.abs()));
        let rotation = self.rotation * largest.recip();
        if self.rotation.is_finite() && !(largest > 0.0 && rotation.is_finite()) {
            return Err(DatasetError::Field {
                path: path.to_owned(),
                field: field.to_owned(),
                found: format!("the quaternion {:?}", self.rotation.to_array()),
                expected: "one whose length is not zero".to_owned(),
            });
        }
        let world_from_ours = rotation.normalize() * dataset_from_ours;
        let matrix = Mat4::from_rotation_translation(world_from_ours.as_quat(), self.position.as_vec3());
        Pose::from_matrix(matrix).map_err(|source| DatasetError::Pose { path: path.to_owned(), source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn pose(rotation: [f64; 4]) -> Result<Pose, DatasetError> {
        let stored = QuaternionPose { position: DVec3::new(1.0, 2.0, 3.0), rotation: DQuat::from_array(rotation) };
        stored.to_pose(DQuat::IDENTITY, Path::new("poses.txt"), "line 7")
    }

    #[test]
    fn any_length_gives_the_same_rotation() {
        let turned = pose([0.0, 0.0, 0.6, 0.8]).unwrap();
        for scale in [1e-200, 0.5, 3.0, 1e200] {
            assert_eq!(pose([0.0, 0.0, 0.6 * scale, 0.8 * scale]).unwrap(), turned);
        }
        assert!((turned.to_world(Vec3::X) - Vec3::new(1.28, 2.96, 3.0)).length() < 1e-6);
    }

    #[test]
    fn zero_and_infinity_are_refused() {
        let zero = pose([0.0; 4]).unwrap_err().to_string();
        assert!(zero.starts_with("poses.txt: line 7: found the quaternion [0.0"), "{zero}");
        assert!(matches!(pose([f64::NAN, 0.0, 0.0, 1.0]), Err(DatasetError::Pose { .. })));
        assert!(matches!(pose([f64::INFINITY, 0.0, 0.0, 1.0]), Err(DatasetError::Pose { .. })));
    }
}

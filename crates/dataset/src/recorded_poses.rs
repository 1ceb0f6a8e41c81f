//! Poses in recordings: which frames have one.
//!
//! Three cases are distinguished, the same way in every format:
//! - A frame **has no pose** if its pose file, line or message is missing, or if a number in it is NaN or infinite, which
//!   recorders write where tracking was lost. The frame is read without a pose.
//! - A pose is **damaged** if it is text that is not numbers, or numbers that are not a rigid transform. Reading the
//!   frame, or opening the scene, is an error: an unnoticed wrong pose would damage the map.
//! - A scene **has no poses** if it has no source of poses at all. A source without any usable pose is an error on opening,
//!   because it is more likely to be a mistake than meant.

use crate::stamps::time_range;
use crate::{DatasetError, LeftOut};
use glam::{DQuat, DVec3};
use splatseg_geometry::{Pose, PoseError};
use std::path::{Path, PathBuf};

/// End of the reason for frames whose poses are not finite.
pub(crate) const LOST: &str = "is NaN or infinite: tracking was lost";

/// Tolerance for the length of a quaternion, because text is rounded. Other lengths mean numbers in the wrong order.
const QUATERNION_TOLERANCE: f64 = 0.02;

/// Returns true if a quaternion has length 1, as far as it is rounded.
pub(crate) fn has_unit_length(rotation: DQuat) -> bool {
    (rotation.length() - 1.0).abs() <= QUATERNION_TOLERANCE
}

/// Makes a pose of a position and a quaternion in text that is rounded.
///
/// # Errors
/// [`DatasetError::Field`] if the quaternion does not have length 1. `place` is the file and field.
pub(crate) fn listed_quaternion(
    position: DVec3,
    rotation: DQuat,
    (path, field): (&Path, &str),
) -> Result<Result<Pose, PoseError>, DatasetError> {
    if rotation.is_finite() && position.is_finite() && !has_unit_length(rotation) {
        return Err(DatasetError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found: format!("a quaternion of length {:.3}", rotation.length()),
            expected: "qx qy qz qw of length 1".to_owned(),
        });
    }
    Ok(Pose::from_quaternion(position, rotation))
}

/// Returns a stated pose, or `None` if tracking was lost. `place` names the file and line in errors.
///
/// # Errors
/// [`DatasetError::Pose`] if the pose is damaged.
pub(crate) fn tracked(
    stated: Result<Pose, PoseError>,
    place: impl FnOnce() -> PathBuf,
) -> Result<Option<Pose>, DatasetError> {
    match stated {
        Ok(pose) => Ok(Some(pose)),
        // Some programs write the largest number of 64 bits instead of infinity.
        Err(PoseError::NotFinite | PoseError::TooFar(_)) => Ok(None),
        Err(source) => Err(DatasetError::Pose { path: place(), source }),
    }
}

/// Returns the error for a list of poses, none of which was measured near an image. Both lists of times are in seconds.
pub(crate) fn no_common_time(path: &Path, pose_times: &[f64], image_times: &[f64]) -> DatasetError {
    DatasetError::Field {
        path: path.to_owned(),
        field: "times of the poses".to_owned(),
        found: if pose_times.is_empty() { "no pose".to_owned() } else { time_range(pose_times) },
        expected: format!(
            "those of the images, {}; without this file, the scene has no poses",
            time_range(image_times)
        ),
    }
}

/// The frames of a scene that have poses, as far as this is known on opening.
#[derive(Debug)]
pub(crate) struct PoseCoverage {
    has_poses: bool,
    without_pose: Vec<LeftOut>,
}

impl PoseCoverage {
    /// No frame has a pose.
    pub(crate) const NONE: Self = Self { has_poses: false, without_pose: Vec::new() };

    /// Creates the coverage of `frames` frames, from counts of those without a pose, each with its reason.
    pub(crate) fn new<const N: usize>(frames: usize, without_pose: [(usize, String); N]) -> Self {
        let has_poses = without_pose.iter().map(|(count, _)| count).sum::<usize>() < frames;
        Self { has_poses, without_pose: LeftOut::list(without_pose) }
    }

    /// Returns true if any frame may have a pose.
    pub(crate) fn has_poses(&self) -> bool {
        self.has_poses
    }

    /// Returns the frames without a pose, one entry per reason. Empty if no frame has one for lack of a source.
    pub(crate) fn without_pose(&self) -> &[LeftOut] {
        &self.without_pose
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn lost_tracking_is_no_pose_and_damage_is_an_error() {
        let of = |matrix| tracked(Pose::from_row_major(matrix), || "a.txt".into());
        let good = Pose::IDENTITY.to_row_major();
        assert_eq!(of(good).unwrap(), Some(Pose::IDENTITY));
        for lost in [f64::NAN, f64::NEG_INFINITY] {
            let mut matrix = good;
            matrix[3] = lost;
            assert_eq!(of(matrix).unwrap(), None);
            assert_eq!(of([lost; 16]).unwrap(), None);
        }
        assert_eq!(tracked(Ok(Pose::IDENTITY), PathBuf::new).unwrap(), Some(Pose::IDENTITY));
        let largest = Pose::from_quaternion(DVec3::splat(f64::MAX), DQuat::IDENTITY);
        assert_eq!(tracked(largest, PathBuf::new).unwrap(), None);
        let mut scaled = good;
        scaled[0] = 2.0;
        assert!(of(scaled).unwrap_err().to_string().starts_with("a.txt: the pose is not a rigid transform"));
        assert!(of([0.0; 16]).unwrap_err().to_string().starts_with("a.txt: the pose's last row is 0 0 0 0"));
    }

    #[test]
    fn a_scene_has_poses_if_any_frame_may_have_one() {
        let coverage = |missing, lost| PoseCoverage::new(5, [(missing, "missing".into()), (lost, "lost".into())]);
        assert!(coverage(0, 0).has_poses() && coverage(0, 0).without_pose().is_empty());
        assert!(coverage(2, 2).has_poses() && coverage(2, 0).without_pose().len() == 1);
        assert!(!coverage(2, 3).has_poses() && !PoseCoverage::NONE.has_poses());
    }
}

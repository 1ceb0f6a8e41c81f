//! Poses of formats that have a convention of their own, and settings that change it.

use crate::recorded_poses::tracked;
use crate::{DatasetError, DatasetSettings};
use splatseg_geometry::{CameraAxes, Pose, PoseError, PoseFormat};
use std::path::PathBuf;

/// How the poses of a recording are stated: the format's convention between the two parts of the settings. What the
/// settings say about numbers applies to them as stored; what they say about axes and direction applies to poses that are
/// read as the format says, which are those that warnings are about.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StatedPoses {
    numbers: PoseFormat,
    format: PoseFormat,
    convention: PoseFormat,
}

impl StatedPoses {
    /// Poses of a format with these camera axes, camera-to-world.
    pub(crate) fn camera_to_world(axes: CameraAxes, settings: &DatasetSettings) -> Self {
        Self::new(PoseFormat { axes, ..PoseFormat::default() }, settings)
    }

    /// Poses of a format that are world-to-camera, with optical axes.
    pub(crate) fn world_to_camera(settings: &DatasetSettings) -> Self {
        Self::new(PoseFormat { is_inverse: true, ..PoseFormat::default() }, settings)
    }

    fn new(format: PoseFormat, settings: &DatasetSettings) -> Self {
        let PoseFormat { w_first, scale, is_inverse, axes } = settings.pose_format();
        let numbers = PoseFormat { w_first, scale, ..PoseFormat::default() };
        Self { numbers, format, convention: PoseFormat { is_inverse, axes, ..PoseFormat::default() } }
    }

    /// Returns a pose as in this project; `None` if tracking was lost. `place` names the file and line in errors.
    ///
    /// # Errors
    /// [`DatasetError::Pose`] if the pose is damaged.
    pub(crate) fn pose(
        &self,
        stated: Result<Pose, PoseError>,
        place: impl FnOnce() -> PathBuf,
    ) -> Result<Option<Pose>, DatasetError> {
        let parts = [self.numbers, self.format, self.convention];
        let convert = |pose: Pose| parts.iter().fold(pose, |pose, part| part.pose(&pose));
        Ok(tracked(stated, place)?.map(convert))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorded_poses::listed_quaternion;
    use crate::{PoseConvention, QuaternionOrder};
    use glam::{DQuat, DVec3};
    use splatseg_geometry::CameraAxes::OpenGl;
    use std::path::Path;

    fn stated() -> Pose {
        Pose::from_quaternion(DVec3::new(1.0, 2.0, 3.0), DQuat::from_rotation_y(0.4)).unwrap()
    }

    fn read(poses: &StatedPoses, pose: Pose) -> Pose {
        poses.pose(Ok(pose), PathBuf::new).unwrap().unwrap()
    }

    #[test]
    fn the_format_says_which_way_the_camera_looks() {
        let poses = StatedPoses::camera_to_world(OpenGl, &DatasetSettings::default());
        let pose = read(&poses, Pose::IDENTITY);
        let ahead = pose.to_world(glam::Vec3::new(0.1, 0.2, 1.0));
        assert!((ahead - DVec3::new(0.1, -0.2, -1.0)).length() < 1e-6, "{ahead}");
        let inverse = read(&StatedPoses::world_to_camera(&DatasetSettings::default()), stated());
        assert!(inverse.to_matrix().abs_diff_eq(stated().inverse().to_matrix(), 1e-12));
    }

    #[test]
    fn settings_about_numbers_come_before_the_format_and_others_after_it() {
        let settings = DatasetSettings::default().with(|settings| {
            settings.quaternion_order = QuaternionOrder::Wxyz;
            settings.pose_scale = 0.01;
            settings.pose_convention = PoseConvention::WorldToCamera;
        });
        // The stored numbers are w, x, y, z, but were read as x, y, z, w.
        let [x, y, z, w] = DQuat::from_mat3(&stated().rotation()).to_array();
        let read_wrong = Pose::from_quaternion(stated().translation() * 100.0, DQuat::from_xyzw(w, x, y, z)).unwrap();
        let found = read(&StatedPoses::camera_to_world(OpenGl, &settings), read_wrong);
        let plain = read(&StatedPoses::camera_to_world(OpenGl, &DatasetSettings::default()), stated());
        assert!(found.to_matrix().abs_diff_eq(plain.inverse().to_matrix(), 1e-9));
    }

    #[test]
    fn lost_tracking_is_no_pose_and_other_lengths_are_errors() {
        let place = (Path::new("a"), "frame 3");
        let poses = StatedPoses::camera_to_world(OpenGl, &DatasetSettings::default());
        let lost = listed_quaternion(DVec3::NAN, DQuat::from_array([f64::NAN; 4]), place).unwrap();
        assert_eq!(poses.pose(lost, PathBuf::new).unwrap(), None);
        let error = listed_quaternion(DVec3::ZERO, DQuat::from_array([1.0; 4]), place).unwrap_err().to_string();
        assert_eq!(error, "a: frame 3: found a quaternion of length 2.000, expected qx qy qz qw of length 1");
    }
}

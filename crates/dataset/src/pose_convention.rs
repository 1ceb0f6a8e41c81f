//! Conventions of recorded poses that the settings choose, and scenes read with them.

use crate::scene::{FramePart, LeftOut};
use crate::{CorrectedPose, DatasetError, Format, GuessedCamera, RecordedFrame, Scene};
use splatseg_geometry::{CameraAxes, PoseFormat, SegmentMap};
use splatseg_settings::choices;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

choices! {
    /// Convention of recorded poses: direction and camera axes.
    pub enum PoseConvention, default CameraToWorld {
        /// Camera-to-world; camera axes x right, y down, z forward.
        CameraToWorld = "camera-to-world",
        /// World-to-camera, as COLMAP writes them; the same axes.
        WorldToCamera = "world-to-camera",
        /// Camera-to-world; camera axes x right, y up, z backward: OpenGL, ARKit, Blender, NeRF.
        OpenGl = "opengl",
        /// World-to-camera, with the axes of `opengl`.
        OpenGlWorldToCamera = "opengl-world-to-camera",
        /// Camera-to-world; axes x forward, y left, z up: a robot's body in ROS, a camera in Gazebo.
        XForward = "x-forward",
        /// World-to-camera, with the axes of `x-forward`.
        XForwardWorldToCamera = "x-forward-world-to-camera",
        /// Camera-to-world; axes x forward, y right, z down: an aircraft's body.
        XForwardZDown = "x-forward-z-down",
        /// World-to-camera, with the axes of `x-forward-z-down`.
        XForwardZDownWorldToCamera = "x-forward-z-down-world-to-camera",
    }
}

choices! {
    /// Order of the numbers of a quaternion.
    pub enum QuaternionOrder, default Xyzw {
        /// As the format says: w last in lists of poses.
        Xyzw = "xyzw",
        /// The quaternions were written with w first.
        Wxyz = "wxyz",
    }
}

impl PoseConvention {
    /// True if poses are world-to-camera, and the camera's axes.
    pub(crate) fn parts(self) -> (bool, CameraAxes) {
        match self {
            Self::CameraToWorld => (false, CameraAxes::Optical),
            Self::WorldToCamera => (true, CameraAxes::Optical),
            Self::OpenGl => (false, CameraAxes::OpenGl),
            Self::OpenGlWorldToCamera => (true, CameraAxes::OpenGl),
            Self::XForward => (false, CameraAxes::Forward),
            Self::XForwardWorldToCamera => (true, CameraAxes::Forward),
            Self::XForwardZDown => (false, CameraAxes::ForwardDown),
            Self::XForwardZDownWorldToCamera => (true, CameraAxes::ForwardDown),
        }
    }
}

/// A scene whose recorded poses are stated in another way than this project's.
#[derive(Debug)]
pub(crate) struct ConvertedPoses {
    pub(crate) scene: Arc<dyn Scene>,
    pub(crate) format: PoseFormat,
}

impl Scene for ConvertedPoses {
    fn name(&self) -> &str {
        self.scene.name()
    }

    fn frame_count(&self) -> usize {
        self.scene.frame_count()
    }

    fn frame_name(&self, index: usize) -> String {
        self.scene.frame_name(index)
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let recorded = self.scene.read_recorded(index)?;
        let world_from_camera = recorded.world_from_camera.map(|stated| self.format.pose(&stated));
        Ok(RecordedFrame { world_from_camera, ..recorded })
    }

    fn has_poses(&self) -> bool {
        self.scene.has_poses()
    }

    fn has_depth(&self) -> bool {
        self.scene.has_depth()
    }

    fn guessed_camera(&self) -> Option<GuessedCamera> {
        self.scene.guessed_camera()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.scene.without_pose()
    }

    fn corrections(&self, known_with: Range<usize>) -> Vec<CorrectedPose> {
        let mut corrections = self.scene.corrections(known_with);
        for corrected in &mut corrections {
            corrected.world_from_camera = self.format.pose(&corrected.world_from_camera);
        }
        corrections
    }

    fn has_ground_truth(&self) -> bool {
        self.scene.has_ground_truth()
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        self.scene.read_ground_truth(index)
    }

    fn format(&self) -> Option<Format> {
        self.scene.format()
    }

    fn stored_color_size(&self, index: usize) -> Option<(usize, usize)> {
        self.scene.stored_color_size(index)
    }

    fn left_out(&self) -> &[LeftOut] {
        self.scene.left_out()
    }

    fn sources(&self) -> &[String] {
        self.scene.sources()
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        self.scene.file_of(index, part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DatasetSettings, open_scene};
    use splatseg_settings::Choice;

    #[test]
    fn names_are_those_that_warnings_tell() {
        for convention in PoseConvention::ALL.iter().copied() {
            let (is_inverse, axes) = convention.parts();
            let format = PoseFormat { is_inverse, axes, ..PoseFormat::default() };
            assert_eq!(format.convention(), convention.name());
        }
    }

    #[test]
    fn poses_are_converted_as_the_settings_say() {
        let settings = DatasetSettings {
            pose_convention: PoseConvention::OpenGlWorldToCamera,
            quaternion_order: QuaternionOrder::Wxyz,
            pose_scale: 0.01,
            ..Default::default()
        };
        let pose = |settings: &DatasetSettings| {
            let scene = open_scene("synthetic:frames=3", settings).unwrap();
            scene.read_recorded(2).unwrap().world_from_camera.unwrap()
        };
        let stated = pose(&DatasetSettings::default());
        assert_eq!(pose(&settings), settings.pose_format().pose(&stated));
        assert_ne!(pose(&settings), stated);
    }
}

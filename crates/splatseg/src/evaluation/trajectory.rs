//! The trajectory of a scene's camera.

use super::EvaluationError;
use rayon::prelude::*;
use splatseg_annotations::{AnnotationError, frame_time};
use splatseg_dataset::{DatasetError, DatasetSettings, Scene};
use splatseg_geometry::StampedPose;
use std::path::Path;

/// The poses of a scene.
#[derive(Clone, Debug)]
pub struct SceneTrajectory {
    /// The pose of each frame that has one, in the scene's order. The time is that of [`frame_time`].
    pub poses: Vec<StampedPose>,
    /// Number of frames that have no pose or cannot be read.
    pub left_out: usize,
}

impl SceneTrajectory {
    /// Reads the poses of the frames that `dataset` selects. It takes as long as reading the frames.
    ///
    /// # Errors
    /// If the settings select no frame, or no frame has a pose.
    pub fn read(scene: &dyn Scene, dataset: &DatasetSettings) -> Result<Self, EvaluationError> {
        let selected = dataset.selected_frames(scene.frame_count()).map_err(DatasetError::from)?;
        let read = |index: &usize| -> Result<Option<StampedPose>, DatasetError> {
            let recorded = scene.read_recorded(*index)?;
            let seconds = frame_time(recorded.frame.timestamp(), *index).as_secs_f64();
            Ok(recorded.world_from_camera.map(|world_from_camera| StampedPose { seconds, world_from_camera }))
        };
        let found: Vec<Result<Option<StampedPose>, DatasetError>> = selected.par_iter().map(read).collect();
        let (count, mut poses, mut first_error) = (found.len(), Vec::new(), None);
        for pose in found {
            match pose {
                Ok(pose) => poses.extend(pose),
                Err(error) => first_error = first_error.or(Some(error)),
            }
        }
        match (poses.is_empty(), first_error) {
            (true, Some(error)) => Err(error.into()),
            (true, None) => Err(AnnotationError::at(Path::new(scene.name()), "the scene has no poses").into()),
            (false, _) => Ok(Self { left_out: count - poses.len(), poses }),
        }
    }
}

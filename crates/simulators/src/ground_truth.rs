//! Sources of ground truth.

use crate::SimulatorError;
use splatseg_dataset::{Framing, Scene};
use splatseg_geometry::{CameraFrame, SegmentMap};
use std::collections::HashMap;
use std::sync::Arc;

/// A source of true segments. Closures `FnMut(&CameraFrame) -> Result<SegmentMap, SimulatorError>` implement it.
pub trait GroundTruthSource: Send {
    /// Returns the true segments of `frame`, with its size; 0 where unlabelled. An object has the same id in every
    /// frame.
    ///
    /// # Errors
    /// If the frame is unknown or not labelled, or its labels cannot be read.
    fn ground_truth(&mut self, frame: &CameraFrame) -> Result<SegmentMap, SimulatorError>;
}

impl<F> GroundTruthSource for F
where
    F: FnMut(&CameraFrame) -> Result<SegmentMap, SimulatorError> + Send,
{
    fn ground_truth(&mut self, frame: &CameraFrame) -> Result<SegmentMap, SimulatorError> {
        self(frame)
    }
}

/// The labels of a scene, looked up by frame name and resized and cropped like the frame. Frames may be requested in
/// any order or skipped.
#[derive(Debug)]
pub struct SceneGroundTruth {
    scene: Arc<dyn Scene>,
    framing: Framing,
    index_of_name: HashMap<String, usize>,
}

impl SceneGroundTruth {
    /// Creates a source from the labels of `scene`, whose frames are resized and cropped by `framing`.
    ///
    /// # Errors
    /// [`SimulatorError::NoGroundTruth`] if the scene is not labelled.
    pub fn new(scene: Arc<dyn Scene>, framing: Framing) -> Result<Self, SimulatorError> {
        if !scene.has_ground_truth() {
            return Err(SimulatorError::NoGroundTruth { scene: scene.name().to_owned() });
        }
        let index_of_name = (0..scene.frame_count()).map(|index| (scene.frame_name(index), index)).collect();
        Ok(Self { scene, framing, index_of_name })
    }
}

impl GroundTruthSource for SceneGroundTruth {
    fn ground_truth(&mut self, frame: &CameraFrame) -> Result<SegmentMap, SimulatorError> {
        let unlabelled =
            || SimulatorError::UnlabelledFrame { scene: self.scene.name().to_owned(), frame: frame.name().to_owned() };
        let index = *self.index_of_name.get(frame.name()).ok_or_else(unlabelled)?;
        let read_error =
            |source| SimulatorError::GroundTruth { frame: frame.name().to_owned(), source: Box::new(source) };
        let labels = self.scene.read_ground_truth(index).map_err(read_error)?.ok_or_else(unlabelled)?;
        self.framing.apply_to_labels(labels).map_err(read_error)
    }
}

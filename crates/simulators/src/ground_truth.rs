//! Sources of ground truth.

use crate::SimulatorError;
use splatseg_dataset::{Framing, Scene};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::collections::HashMap;
use std::sync::Arc;

/// A source of true segments. Closures `FnMut(&RgbdFrame) -> Result<SegmentMap, SimulatorError>` are sources as well.
pub trait GroundTruthSource: Send {
    /// The true segments of `frame`, in its size; 0 where unlabelled. An object has the same id in every frame.
    ///
    /// # Errors
    /// If the frame is unknown or not labelled, or its labels cannot be read.
    fn ground_truth(&mut self, frame: &RgbdFrame) -> Result<SegmentMap, SimulatorError>;
}

impl<F> GroundTruthSource for F
where
    F: FnMut(&RgbdFrame) -> Result<SegmentMap, SimulatorError> + Send,
{
    fn ground_truth(&mut self, frame: &RgbdFrame) -> Result<SegmentMap, SimulatorError> {
        self(frame)
    }
}

/// The labels of a scene, found by the name of the frame and resized and cropped like the frame. Frames may come in any
/// order, and may be left out.
#[derive(Debug)]
pub struct SceneGroundTruth {
    scene: Arc<dyn Scene>,
    framing: Framing,
    index_of_name: HashMap<String, usize>,
}

impl SceneGroundTruth {
    /// The labels of `scene`, whose frames are resized and cropped by `framing`.
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
    fn ground_truth(&mut self, frame: &RgbdFrame) -> Result<SegmentMap, SimulatorError> {
        let unlabelled =
            || SimulatorError::UnlabelledFrame { scene: self.scene.name().to_owned(), frame: frame.name().to_owned() };
        let index = *self.index_of_name.get(frame.name()).ok_or_else(unlabelled)?;
        let read_error =
            |source| SimulatorError::GroundTruth { frame: frame.name().to_owned(), source: Box::new(source) };
        let labels = self.scene.read_ground_truth(index).map_err(read_error)?.ok_or_else(unlabelled)?;
        self.framing.apply_to_labels(labels).map_err(read_error)
    }
}

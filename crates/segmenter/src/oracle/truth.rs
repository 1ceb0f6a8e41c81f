//! Where the oracle knows the true segments from.

use crate::SegmenterError;
use splatseg_dataset::{Framing, Scene};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::collections::HashMap;
use std::sync::Arc;

/// Knows the true segments of frames. Closures `FnMut(&RgbdFrame) -> Result<SegmentMap, SegmenterError>` are sources.
pub trait GroundTruthSource: Send {
    /// The true segments of `frame`, of its size; 0 where unlabelled. An object has the same id in every frame.
    ///
    /// # Errors
    /// If the frame is unknown or not labelled, or its labels cannot be read.
    fn ground_truth(&mut self, frame: &RgbdFrame) -> Result<SegmentMap, SegmenterError>;
}

impl<F> GroundTruthSource for F
where
    F: FnMut(&RgbdFrame) -> Result<SegmentMap, SegmenterError> + Send,
{
    fn ground_truth(&mut self, frame: &RgbdFrame) -> Result<SegmentMap, SegmenterError> {
        self(frame)
    }
}

/// The labels of a scene, looked up by the frame's name and framed (resized, cropped) like the frame. Which frames of
/// the scene are used, and in which order, does not matter.
#[derive(Debug)]
pub struct SceneGroundTruth {
    scene: Arc<dyn Scene>,
    framing: Framing,
    index_of_name: HashMap<String, usize>,
}

impl SceneGroundTruth {
    /// The labels of `scene`, whose frames are framed by `framing`.
    ///
    /// # Errors
    /// [`SegmenterError::NoGroundTruth`] if the scene is not labelled.
    pub fn new(scene: Arc<dyn Scene>, framing: Framing) -> Result<Self, SegmenterError> {
        if !scene.has_ground_truth() {
            return Err(SegmenterError::NoGroundTruth { scene: scene.name().to_owned() });
        }
        let index_of_name = (0..scene.frame_count()).map(|index| (scene.frame_name(index), index)).collect();
        Ok(Self { scene, framing, index_of_name })
    }
}

impl GroundTruthSource for SceneGroundTruth {
    fn ground_truth(&mut self, frame: &RgbdFrame) -> Result<SegmentMap, SegmenterError> {
        let unlabelled =
            || SegmenterError::UnlabelledFrame { scene: self.scene.name().to_owned(), frame: frame.name().to_owned() };
        let index = *self.index_of_name.get(frame.name()).ok_or_else(unlabelled)?;
        let read_error =
            |source| SegmenterError::GroundTruth { frame: frame.name().to_owned(), source: Box::new(source) };
        let labels = self.scene.read_ground_truth(index).map_err(read_error)?.ok_or_else(unlabelled)?;
        self.framing.apply_to_labels(labels).map_err(read_error)
    }
}

//! SAM 2.1, EdgeTAM and EfficientTAM, without the networks.

#[path = "../sam2/error.rs"]
mod error;
#[path = "../sam2/settings.rs"]
mod settings;

pub use error::Sam2Error;
pub use settings::{MemoryPooling, Sam2PredictorSettings};

use super::Device;
use crate::checkpoint::Checkpoint;
use splatseg_geometry::{CowImage, Mask, Prompt};
use std::sync::Arc;

/// SAM 2.1, EdgeTAM or EfficientTAM, which this program does not contain.
#[derive(Clone, Debug)]
pub struct Sam2Network(Device);

/// A tracker of objects.
#[derive(Debug)]
pub struct Sam2Predictor {
    device: Device,
    state: VideoState,
}

/// The state of a video.
#[derive(Clone, Debug)]
pub struct VideoState(Device);

/// The output of the network for one object in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectMask {
    /// The object's id.
    pub object: u64,
    /// `(width, height)` of the frame.
    pub frame_size: (usize, usize),
    device: Device,
}

impl Sam2Network {
    /// Stands for loading the network of a checkpoint.
    ///
    /// # Errors
    /// Never, as there is no device.
    pub fn load(_: &Checkpoint, _: Option<usize>, device: &Device) -> Result<Self, Sam2Error> {
        device.unreachable()
    }

    /// Stands for pooling remembered maps.
    ///
    /// # Errors
    /// Never, as there is no network.
    pub fn with_memory_pooling(self, _: MemoryPooling) -> Result<Self, Sam2Error> {
        self.0.unreachable()
    }
}

impl Sam2Predictor {
    /// Stands for a predictor of a new video.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(network: impl Into<Arc<Sam2Network>>, settings: Sam2PredictorSettings) -> Result<Self, Sam2Error> {
        settings.validated()?;
        network.into().0.unreachable()
    }

    /// Stands for the state of the video so far.
    pub fn state(&self) -> &VideoState {
        &self.state
    }

    /// Stands for tracking every object into the next frame.
    ///
    /// # Errors
    /// Never, as there is no predictor.
    pub fn track(&mut self, _: &CowImage<'_, [u8; 3]>) -> Result<Vec<ObjectMask>, Sam2Error> {
        self.device.unreachable()
    }

    /// Stands for prompting many objects.
    ///
    /// # Errors
    /// Never, as there is no predictor.
    pub fn prompt_unless_empty(&mut self, _: &[(u64, Prompt)]) -> Result<Vec<Option<ObjectMask>>, Sam2Error> {
        self.device.unreachable()
    }

    /// Stands for removing an object.
    ///
    /// # Errors
    /// Never, as there is no predictor.
    pub fn remove(&mut self, _: u64) -> Result<(), Sam2Error> {
        self.device.unreachable()
    }
}

impl VideoState {
    /// Stands for the ids of the objects.
    pub fn objects(&self) -> impl Iterator<Item = u64> + '_ {
        std::iter::from_fn(|| self.0.unreachable())
    }
}

impl ObjectMask {
    /// Stands for the mask at the frame's size.
    pub fn mask(&self) -> Mask {
        self.device.unreachable()
    }

    /// Stands for whether the object is in the frame.
    pub fn is_present(&self) -> bool {
        self.device.unreachable()
    }
}

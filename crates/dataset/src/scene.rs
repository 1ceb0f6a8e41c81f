//! What every format offers.

use crate::DatasetError;
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::fmt::Debug;

/// A recorded or rendered RGB-D video whose frames can be read in any order, from any thread.
pub trait Scene: Debug + Send + Sync {
    /// The scene's name, e.g. its folder's.
    fn name(&self) -> &str;

    /// Number of frames.
    fn frame_count(&self) -> usize;

    /// The name of frame `index`, e.g. `frame-000150` or `42`; empty past the last frame.
    fn frame_name(&self, index: usize) -> String;

    /// Reads frame `index`, which carries the name [`Scene::frame_name`] gives.
    ///
    /// # Errors
    /// [`DatasetError`] names the file and what is wrong with it. Other frames can still be read.
    fn read_frame(&self, index: usize) -> Result<RgbdFrame<'static>, DatasetError>;

    /// Whether the scene comes with true segments.
    fn has_ground_truth(&self) -> bool;

    /// The true segments of frame `index`, of the size of the frame that [`Scene::read_frame`] gives; `None` if this
    /// frame, or the whole scene, is not labelled.
    ///
    /// # Errors
    /// [`DatasetError`] names the file and what is wrong with it.
    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError>;
}

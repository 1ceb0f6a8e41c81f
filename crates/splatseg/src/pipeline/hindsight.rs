//! Hindsight: frames are decided again with the map of the end.

use super::Pipeline;
use super::stages::in_thread_pool;
use splatseg_objects::ObjectLog;
use splatseg_tracking::{Hindsight, TrackingError};

impl Pipeline {
    /// Decides from all frames so far which parts of the map are one object, if the segmenter gives affinities; see
    /// [`SplatMemory::settle`](splatseg_memory::SplatMemory::settle). Returns false if nothing changes.
    ///
    /// # Errors
    /// If the memory fails.
    pub fn settle(&mut self) -> Result<bool, TrackingError> {
        in_thread_pool(|| self.method.settle())
    }

    /// Decides earlier frames again, with the map as it is now; `None` if the method cannot. The frames need their final poses,
    /// see [`Self::keyframes`], and what they showed: [`FrameOutput::segments`](splatseg_tracking::FrameOutput::segments) and
    /// [`FrameResult::regions`](super::FrameResult::regions).
    pub fn hindsight(&self) -> Option<&dyn Hindsight> {
        self.method.hindsight()
    }

    /// Replaces the log of objects by that of the frames as they were decided again.
    pub fn set_objects(&mut self, objects: ObjectLog) {
        self.objects = objects;
    }
}

//! Hindsight: frames are decided again with the map of the end.

use super::stages::in_thread_pool;
use super::{Pipeline, ReducedHindsight};
use splatseg_objects::ObjectLog;

impl Pipeline {
    /// Decides from all frames so far which parts of the map are one object, if the segmenter gives affinities; see
    /// [`SplatMemory::settle`](splatseg_memory::SplatMemory::settle). Returns false if nothing changes.
    pub fn settle(&mut self) -> bool {
        in_thread_pool(|| self.method.settle())
    }

    /// Decides the same about what the last `frames` frames have seen, for [`Self::hindsight`] and [`Self::map`] alone; see
    /// [`SplatMemory::decide_objects`](splatseg_memory::SplatMemory::decide_objects).
    pub fn decide_objects(&mut self, frames: u32) {
        in_thread_pool(|| self.method.decide_objects(frames));
    }

    /// Counts what was decided for good, for a map that is saved; see
    /// [`SplatMemory::keep_verdicts`](splatseg_memory::SplatMemory::keep_verdicts).
    pub fn keep_verdicts(&mut self) {
        self.method.keep_verdicts();
    }

    /// Decides earlier frames again, with the map as it is now; `None` if the method cannot. The frames need their final poses,
    /// see [`Self::keyframes`], and what they showed: [`FrameOutput::segments`](splatseg_tracking::FrameOutput::segments) and
    /// [`FrameResult::regions`](super::FrameResult::regions).
    pub fn hindsight(&self) -> Option<ReducedHindsight<'_>> {
        Some(ReducedHindsight { hindsight: self.method.hindsight()?, resolution: self.resolution })
    }

    /// Replaces the log of objects by that of the frames as they were decided again.
    pub fn set_objects(&mut self, objects: ObjectLog) {
        self.objects = objects;
    }
}

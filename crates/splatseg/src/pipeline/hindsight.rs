//! Hindsight: frames are decided again with the map of the end.

use super::predicted_depth::DepthStage;
use super::stages::in_thread_pool;
use super::{DepthAgain, Pipeline, ReducedHindsight};
use splatseg_geometry::SegmentId;
use splatseg_objects::{ObjectLog, SeenTimes};
use std::collections::BTreeSet;

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

    /// Decides earlier frames again, with the map as it is now; `None` if the method cannot, or depth is predicted in place of
    /// measured depth: surfaces are then too inexact for it (`docs/PREDICTED_DEPTH.md`). The frames need their final poses,
    /// see [`Self::keyframes`], and what they showed: [`FrameOutput::segments`](splatseg_tracking::FrameOutput::segments) and
    /// [`FrameResult::regions`](super::FrameResult::regions).
    pub fn hindsight(&self) -> Option<ReducedHindsight<'_>> {
        if self.depth.as_ref().is_some_and(DepthStage::predicts_all) {
            return None;
        }
        Some(ReducedHindsight { hindsight: self.method.hindsight()?, resolution: self.resolution })
    }

    /// Takes the depth predictor, which fills the holes of frames that are read again for [`Self::hindsight`]. `None` if no
    /// depth is predicted. Later frames keep the depth that they come with.
    pub fn take_depth_again(&mut self) -> Option<DepthAgain> {
        self.depth.take().map(DepthAgain)
    }

    /// Replaces the log of objects by that of the frames as they were decided again. The map's states follow: an object
    /// that fewer than two frames show in the end is tentative.
    /// `seen` has when those frames showed them.
    pub fn set_objects(&mut self, objects: ObjectLog, seen: SeenTimes) {
        self.history.set_run(seen);
        let before = std::mem::replace(&mut self.objects, objects);
        let frames = |log: &ObjectLog, id| log.records().get(&id).map_or(0, |record| record.frames);
        let ids: BTreeSet<SegmentId> = before.records().keys().chain(self.objects.records().keys()).copied().collect();
        let count = |frames| u32::try_from(frames).unwrap_or(u32::MAX);
        for id in ids {
            // The memory also counts frames for which it decided otherwise, so that it may have more.
            let before = if id > self.earlier_ids { u32::MAX } else { count(frames(&before, id)) };
            self.method.recount_sightings(id, before, count(frames(&self.objects, id)));
        }
    }

    /// The largest id in use before the first frame: that of a saved memory, 0 without one.
    pub fn earlier_ids(&self) -> SegmentId {
        self.earlier_ids
    }
}

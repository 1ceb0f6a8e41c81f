//! Results a while later: frames wait, and are decided again with what the frames after them have shown.

use super::stages::in_thread_pool;
use super::{FrameResult, Pipeline, PipelineError};
use splatseg_geometry::{RemappedId, RgbdFrame, SegmentId};
use splatseg_objects::{ObjectLog, ObjectSighting, RemapLog};
use splatseg_odometry::PoseState;
use splatseg_tracking::{FrameOutput, Hindsight, ShownFrame};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Frames with their results, which wait to be decided again. Each has a `T`, whatever belongs to it.
///
/// What the objects are is decided once in the time that a frame waits, from the evidence of all frames, about what the
/// waiting ones have seen ([`SplatMemory::decide_objects`](splatseg_memory::SplatMemory::decide_objects)). This does not change
/// the results of later frames. Memory grows with the waiting frames: 16 bytes per pixel of each.
#[derive(Debug)]
pub struct WaitingFrames<T> {
    frames: VecDeque<LateFrame<T>>,
    /// Frames added since it was last decided what the objects are.
    added: usize,
    /// The objects of the frames that were decided again.
    objects: ObjectLog,
    /// Ids that stand for new objects from a waiting frame on, with the frame's number in [`Self::objects`].
    new: BTreeMap<SegmentId, usize>,
}

/// A frame whose result is decided again.
#[derive(Debug)]
pub struct LateFrame<T> {
    /// The frame, with its pose as it is known now.
    pub frame: RgbdFrame<'static>,
    /// Its result of the time, with what it shows as far as is known now: `output`, `objects` and the pose are new.
    pub result: FrameResult,
    /// Its data.
    pub belongings: T,
}

impl<T> Default for WaitingFrames<T> {
    fn default() -> Self {
        Self { frames: VecDeque::new(), added: 0, objects: ObjectLog::default(), new: BTreeMap::new() }
    }
}

impl<T> WaitingFrames<T> {
    /// Adds the next frame and its result.
    pub fn add(&mut self, frame: RgbdFrame<'static>, result: FrameResult, belongings: T) {
        self.remap(&result.remapped);
        let number = self.objects.frames() + self.frames.len();
        self.new.extend(result.output.update.new_segments.iter().map(|id| (*id, number)));
        self.frames.push_back(LateFrame { frame, result, belongings });
        self.added += 1;
    }

    /// Tells the frames that ids turned out to be other ids' objects. [`Self::add`] does it with [`FrameResult::remapped`], so
    /// that this is for what becomes known between two frames.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        if remapped.is_empty() {
            return;
        }
        let mut log = RemapLog::default();
        log.add(1, remapped);
        let names = log.final_ids(0);
        self.frames.iter_mut().for_each(|waiting| rename(&mut waiting.result, &names));
        for id in remapped.iter().flat_map(|remapped| [remapped.from, remapped.into]) {
            if self.new.remove(&id).is_some() {
                // Earlier frames showed another object with this id.
                self.objects.forget(id);
            }
        }
        self.objects.remap(remapped);
    }

    /// Decides the first of the frames again if `is_due` returns true for what belongs to it and the number of frames after
    /// it; to be called until it returns `None`. Frames whose pose is unknown show what they showed.
    ///
    /// # Errors
    /// If the method fails.
    pub fn next_due(
        &mut self,
        pipeline: &mut Pipeline,
        is_due: impl FnOnce(&T, usize) -> bool,
    ) -> Result<Option<LateFrame<T>>, PipelineError> {
        let waiting = self.frames.len();
        let after = waiting.saturating_sub(1);
        let Some(first) = self.frames.pop_front_if(|first| is_due(&first.belongings, after)) else { return Ok(None) };
        let _rest = pipeline.names.rest_during_frame();
        if self.added >= waiting {
            pipeline.decide_objects(u32::try_from(waiting).unwrap_or(u32::MAX));
            self.added = 0;
        }
        let LateFrame { frame, mut result, belongings } = first;
        let pose = *frame.world_from_camera();
        let pose = pipeline.corrected(result.anchor.keyframe, &result.anchor.world_from_keyframe, pose);
        let frame = frame.into_camera_frame().at(pose);
        let shown = ShownFrame { segments: result.output.segments, regions: result.regions.take() };
        let mut output = match pipeline.hindsight() {
            Some(hindsight) if result.pose.state != PoseState::Lost => {
                let decided = in_thread_pool(|| hindsight.look_again(&frame, &shown));
                let failed =
                    |source| PipelineError::Method { frame: frame.name().to_owned(), source: Box::new(source) };
                FrameOutput { update: result.output.update, ..decided.map_err(failed)? }
            }
            _ => FrameOutput { segments: shown.segments, ..result.output },
        };
        self.forget_replaced(&output, &result.objects);
        let new_segments = std::mem::take(&mut output.update.new_segments);
        result.objects = self.objects.record(&output);
        output.update.new_segments = new_segments;
        result.pose.world_from_camera = pose;
        Ok(Some(LateFrame { frame, result: FrameResult { output, regions: shown.regions, ..result }, belongings }))
    }

    /// Forgets the objects whose ids stand for new ones now: from the frame on that was to show those first, or before, if only
    /// hindsight shows the id there. `at_the_time` has the objects that the frame showed.
    fn forget_replaced(&mut self, output: &FrameOutput, at_the_time: &[ObjectSighting]) {
        let Self { objects, new, .. } = self;
        let number = objects.frames();
        let is_early = |id| !at_the_time.iter().any(|object| object.id == id);
        let mut early: BTreeSet<SegmentId> = BTreeSet::new();
        if new.values().any(|first| *first > number) {
            let masks = output.masks.iter().map(|(id, _)| *id);
            early = output.segments.areas().into_keys().chain(masks).filter(|id| is_early(*id)).collect();
        }
        new.retain(|id, first| {
            let waits = *first > number && !early.contains(id);
            if !waits {
                objects.forget(*id);
            }
            waits
        });
    }
}

/// Renames the objects of a result. Of several that get one name, the masks are united.
fn rename(result: &mut FrameResult, names: &BTreeMap<SegmentId, SegmentId>) {
    let name = |id: SegmentId| names.get(&id).copied().unwrap_or(id);
    let FrameOutput { segments, masks, .. } = &mut result.output;
    segments.pixels_mut().iter_mut().for_each(|id| *id = name(*id));
    result.objects.iter_mut().for_each(|object| object.id = name(object.id));
    for (id, mask) in std::mem::take(masks) {
        let id = name(id);
        match masks.iter_mut().find(|(other, _)| *other == id) {
            Some((_, united)) => united.unite(&mask),
            None => masks.push((id, mask)),
        }
    }
}

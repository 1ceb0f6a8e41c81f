//! The pipeline, frame by frame.

use super::kept_names::KeptNames;
use super::map_history::MapHistory;
use super::predicted_depth::{DepthStage, MapScale};
use super::stage_times::StageClock;
use super::stages::{Decided, Placed, Segmented, in_thread_pool, process, segment, timed};
use super::working_resolution::{WorkingFrame, WorkingResolution};
use super::{FrameResult, PipelineError, Rotate};
use splatseg_geometry::{CameraFrame, KeyframeId, MapView, Pose, QuarterTurn, RemappedId, RgbdFrame, SegmentId};
use splatseg_memory::{Attached, SplatFileError, SplatMemory};
use splatseg_objects::ObjectLog;
use splatseg_odometry::{
    InputDoubt, KeyframePlace, MethodFindings, PoseEvent, PoseInput, PoseMode, PoseSource, PoseSourceError, PoseUpdate,
    StateScope, TrackedPoses,
};
use splatseg_segmenter::{Detail, Segmenter};
use splatseg_tracking::Method;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// A segmenter, a pose source and a method: frames go in, lasting ids come out.
pub struct Pipeline {
    pub(super) segmenter: Box<dyn Segmenter>,
    pub(super) poses: Box<dyn PoseSource>,
    pub(super) method: Box<dyn Method>,
    pub(super) segment_ahead: bool,
    pub(super) rotate: Rotate,
    pub(super) resolution: WorkingResolution,
    /// Predicts depth, if the settings choose that.
    pub(super) depth: Option<DepthStage>,
    /// The turn with which the next frame is segmented.
    pub(super) turn: QuarterTurn,
    pub(super) clock: StageClock,
    pub(super) objects: ObjectLog,
    /// The largest id in use before the first frame.
    pub(super) earlier_ids: SegmentId,
    pub(super) names: KeptNames,
    /// When objects were seen, and the rooms so far.
    pub(super) history: MapHistory,
    /// When the next frame was seen, if its stamp does not tell.
    seen_at: Option<Duration>,
    /// Corrected poses of earlier frames that the source of poses gets with the next frame.
    corrected: BTreeMap<usize, Pose>,
    unreported: Unreported,
}

/// News from frames without a result, to be reported with the next result.
#[derive(Default)]
struct Unreported {
    remapped: Vec<RemappedId>,
    events: Vec<PoseEvent>,
    doubts: Vec<InputDoubt>,
}

impl Pipeline {
    /// Creates a pipeline from your own parts.
    pub fn new(segmenter: Box<dyn Segmenter>, method: Box<dyn Method>) -> Self {
        Self {
            segmenter,
            poses: Box::new(TrackedPoses::new(PoseMode::Auto)),
            method,
            segment_ahead: false,
            rotate: Rotate::Auto,
            resolution: WorkingResolution::default(),
            depth: None,
            turn: QuarterTurn::None,
            clock: StageClock::new(),
            objects: ObjectLog::default(),
            earlier_ids: 0,
            names: KeptNames::default(),
            history: MapHistory::default(),
            seen_at: None,
            corrected: BTreeMap::new(),
            unreported: Unreported::default(),
        }
    }

    /// Processes the next frame of a camera whose pose is known. With [`PoseMode::Track`] and [`PoseMode::Refine`] the
    /// result may have another pose.
    ///
    /// # Errors
    /// [`PipelineError::Segmenter`] or [`PipelineError::Pose`] if the segmenter or the pose source failed: later frames
    /// can still be processed. [`PipelineError::Method`] or [`PipelineError::DeviceFailed`] if the method or the device
    /// failed: no later frame can be processed. [`PipelineError::Namer`] if the namer of the settings failed.
    pub fn step(&mut self, frame: &RgbdFrame) -> Result<FrameResult, PipelineError> {
        self.step_with(frame.as_borrowed(), Some(frame.world_from_camera()))
    }

    /// Processes the next frame of a camera whose pose is unknown: it is tracked, unless [`PoseMode::Given`] forbids it.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_unposed(&mut self, frame: CameraFrame<'_>) -> Result<FrameResult, PipelineError> {
        self.step_with(frame, None)
    }

    fn step_with(&mut self, frame: CameraFrame<'_>, given: Option<&Pose>) -> Result<FrameResult, PipelineError> {
        let _rest = self.names.rest_during_frame();
        let frame = self.predicted(frame)?;
        let mut working = self.working_frame(&frame);
        // First, so that a segmenter that fails leaves the source of poses as it was, and the frame can be tried again.
        // Holes in depth are filled when the frame is placed, and the segmenter sees them filled.
        let fills_holes = self.depth.as_ref().is_some_and(|depth| !depth.predicts_all());
        let segmented = (!fills_holes).then(|| self.segmented(&working).checked(&working)).transpose()?;
        let placed = self.place(&mut working, self.objects.frames(), given)?;
        self.step_placed(&working, placed, segmented)
    }

    /// How finely frames are segmented; `None` if the segmenter cannot be told.
    pub fn detail(&self) -> Option<Detail> {
        self.segmenter.detail()
    }

    /// Chooses how finely later frames are segmented. Does nothing if [`Self::detail`] is `None`.
    pub fn set_detail(&mut self, detail: Detail) {
        self.segmenter.set_detail(detail);
    }

    /// Sets when the next frame was seen, for [`ObjectList::add_seen_times`](splatseg_objects::ObjectList::add_seen_times), if
    /// its stamp is of another clock than those of earlier runs.
    pub fn set_seen_at(&mut self, time: Duration) {
        self.seen_at = Some(time);
    }

    /// Corrects the given poses of earlier frames, e.g. after a SLAM system has closed a loop: the number of each frame,
    /// from 0, and its pose. The map moves with them before the next frame is processed. Tracked poses are not changed.
    pub fn correct_poses(&mut self, corrected: &[(usize, Pose)]) {
        self.corrected.extend(corrected.iter().copied());
    }

    /// Where the map's scale is from, if all depth is predicted; `None` if depth is measured.
    pub fn map_scale(&self) -> Option<MapScale> {
        self.depth.as_ref().and_then(DepthStage::scale)
    }

    /// The frame with predicted depth, if depth is to be predicted.
    fn predicted<'a>(&mut self, frame: CameraFrame<'a>) -> Result<CameraFrame<'a>, PipelineError> {
        let Some(depth) = &mut self.depth else { return Ok(frame) };
        let name = frame.name().to_owned();
        in_thread_pool(|| depth.predicted(frame))
            .map_err(|source| PipelineError::Depth { frame: name, source: Box::new(source) })
    }

    /// The frame as it is processed.
    pub(super) fn working_frame<'a>(&self, frame: &'a CameraFrame<'_>) -> WorkingFrame<'a> {
        let resolution = self.resolution;
        in_thread_pool(|| resolution.frame(frame))
    }

    /// What the segmenter finds in a frame whose predicted depth is fitted to the map when it is placed: frames that are
    /// segmented ahead have not been fitted, either. `None` if nothing is fitted.
    pub(super) fn segmented_before_fit(&mut self, frame: &WorkingFrame<'_>) -> Option<Segmented> {
        let is_fitted = self.depth.as_ref().is_some_and(DepthStage::predicts_all);
        is_fitted.then(|| self.segmented(frame))
    }

    fn segmented(&mut self, frame: &WorkingFrame<'_>) -> Segmented {
        let (segmenter, turn) = (&mut self.segmenter, self.turn);
        in_thread_pool(|| segment(segmenter.as_mut(), frame, turn))
    }

    fn step_placed(
        &mut self,
        frame: &WorkingFrame<'_>,
        placed: Placed,
        segmented: Option<Segmented>,
    ) -> Result<FrameResult, PipelineError> {
        let Self { segmenter, method, clock, objects, .. } = self;
        let result = in_thread_pool(|| {
            let segmented = segmented.unwrap_or_else(|| segment(segmenter.as_mut(), frame, placed.turn));
            process(method.as_mut(), clock, objects, frame, placed, segmented)
        });
        self.completed(frame, result?)
    }

    /// Determines the pose of a frame, and passes what has become known with it to the method.
    pub(super) fn place(
        &mut self,
        frame: &mut WorkingFrame<'_>,
        index: usize,
        given: Option<&Pose>,
    ) -> Result<Placed, PoseSourceError> {
        if let Some(depth) = &mut self.depth {
            let memory = self.method.memory();
            in_thread_pool(|| depth.before_pose(frame, memory, given));
        }
        let corrected: Vec<(usize, Pose)> = std::mem::take(&mut self.corrected).into_iter().collect();
        let input = PoseInput { index, given, corrected: &corrected };
        let (update, time) = timed(|| in_thread_pool(|| self.poses.pose(frame.working(), input)));
        let PoseUpdate { pose, anchor, correction, events, doubts, turn } = update?;
        if let Some(correction) = &correction {
            self.correct_rooms(correction);
        }
        let remapped = correction.map_or_else(Vec::new, |correction| self.method.correct_map(&correction));
        if !remapped.is_empty() {
            self.poses.receive(MethodFindings { remapped: &remapped, segments: None });
            self.remap_known(&remapped);
        }
        if let Some(depth) = &mut self.depth {
            let memory = self.method.memory();
            in_thread_pool(|| depth.after_pose(frame, memory, &pose));
        }
        self.method.set_anchor(&anchor);
        self.unreported.events.extend(events);
        self.unreported.doubts.extend(doubts);
        // The next frame is segmented before its pose is known, so each frame's turn is that of the frame before.
        let next =
            if self.segmenter.prefers_upright() { self.rotate.turn().unwrap_or(turn) } else { QuarterTurn::None };
        let turn = std::mem::replace(&mut self.turn, next);
        Ok(Placed { pose, anchor, turn, time })
    }

    /// Ids of the map turned out to be other ids' objects: so do those of what is known of them, and the next result tells it.
    pub(super) fn remap_known(&mut self, remapped: &[RemappedId]) {
        self.objects.remap(remapped);
        self.names.remap(remapped);
        self.history.remap(remapped);
        self.unreported.remapped.extend(remapped);
    }

    /// Passes what the method has found to the source of poses, keeps views of the objects and names them, and adds
    /// what has become known since the previous result.
    pub(super) fn completed(
        &mut self,
        frame: &WorkingFrame<'_>,
        Decided { mut result, reduced }: Decided,
    ) -> Result<FrameResult, PipelineError> {
        let recognised = &result.output.update.remapped;
        let segments = reduced.as_ref().unwrap_or(&result.output.segments);
        self.poses.receive(MethodFindings { remapped: recognised, segments: Some(segments) });
        if !recognised.is_empty() {
            self.names.remap(recognised);
            self.history.remap(recognised);
            // Told even if naming fails: log, names and map have changed.
            self.unreported.remapped.extend(recognised);
        }
        let seen_at = self.seen_at.take().or(frame.whole.timestamp());
        let stamp = seen_at.map(|time| time.as_secs_f64());
        self.history.record(stamp, &result.output.update.new_segments, &result.objects);
        self.names.record(&frame.whole, &result);
        if self.names.namer.is_some() {
            let (named, time) = timed(|| self.name_after_frame());
            named.map_err(|source| PipelineError::Namer { frame: frame.whole.name().to_owned(), source })?;
            result.times.add("name", time);
        }
        let Unreported { remapped, events, doubts } = std::mem::take(&mut self.unreported);
        (result.remapped, result.events, result.doubts) = (remapped, events, doubts);
        Ok(result)
    }

    /// Returns, after the last frame, the doubts about the input that no result has told: those of frames without a
    /// result, and those that only all frames together justify.
    pub fn finish(&mut self) -> Vec<InputDoubt> {
        let unreported = std::mem::take(&mut self.unreported.doubts);
        unreported.into_iter().chain(self.poses.finish()).collect()
    }

    /// Name of the method.
    pub fn method_name(&self) -> &str {
        self.method.name()
    }

    /// The map, if the method has one.
    pub fn map(&self) -> Option<MapView<'_>> {
        self.method.map()
    }

    /// The splat memory, if the method has one. To read the map use [`Self::map`].
    pub fn memory(&self) -> Option<&SplatMemory> {
        self.method.memory()
    }

    /// Saves the memory with the names of objects, when they were seen, the rooms so far, and the camera's keyframes, by
    /// which a later run finds its place in the map.
    ///
    /// # Errors
    /// As [`SplatMemory::save`]; `Ok(false)` if the method has no memory.
    pub fn save_memory(&self, path: impl AsRef<Path>) -> Result<bool, SplatFileError> {
        let Some(memory) = self.memory() else { return Ok(false) };
        let (keyframes, names) = (self.saved_poses(StateScope::Map), self.names.of_present(memory));
        let history = self.history.of_present(memory, StateScope::Map);
        let (keyframes, names, history) = (keyframes.as_deref(), names.as_deref(), history.as_deref());
        memory.save_with(path, Attached { keyframes, names, history })?;
        Ok(true)
    }

    /// The state of the source of poses after the latest frame, as [`PoseSource::save`] returns it: for
    /// [`PipelineBuilder::saved_poses`](super::PipelineBuilder::saved_poses), or the keyframes of the map. `None` if it
    /// has none.
    pub fn saved_poses(&self, scope: StateScope) -> Option<Vec<u8>> {
        self.poses.save(scope)
    }

    /// The keyframes of the source of poses as they are now. Each frame's pose is attached to one of them: see
    /// [`FrameResult::anchor`].
    pub fn keyframes(&self) -> BTreeMap<KeyframeId, KeyframePlace> {
        self.poses.keyframes()
    }

    /// The keyframe of this number as it is now; `None` if there is no such one.
    pub fn keyframe(&self, id: KeyframeId) -> Option<KeyframePlace> {
        self.poses.keyframe(id)
    }

    /// The pose that an earlier frame has by now, camera to world, from `pose`, the one of the time: frames follow their
    /// keyframe, which was at `world_from_keyframe` then; see [`FrameResult::anchor`].
    pub fn corrected(&self, keyframe: KeyframeId, world_from_keyframe: &Pose, pose: Pose) -> Pose {
        let now = self.keyframe(keyframe);
        let correction = now.and_then(|now| world_from_keyframe.motion_to(&now.world_from_keyframe));
        correction.map_or(pose, |correction| correction * pose)
    }

    /// Log of every object seen so far.
    pub fn objects(&self) -> &ObjectLog {
        &self.objects
    }
}

//! The pipeline: frames → segmenter, pose → method ⇄ memory → ids and objects.
//!
//! [`Pipeline`] is the only frame loop. `splatseg run`, `bench` and `demo` run it on scenes. A robot passes it the frames
//! of its camera with [`Pipeline::step`].

mod builder;
mod error;
mod frames;
mod named_map;
mod naming;
mod networks;
mod stage_times;

pub use builder::PipelineBuilder;
pub use error::{PipelineError, UnusableFrame};
pub use frames::{Frames, Processed};
pub use named_map::NamedMap;
pub use naming::{NameObjectsError, ObjectToName};
pub use networks::LoadedNetworks;
pub use stage_times::StageTimes;

use crate::Settings;
use naming::Naming;
use splatseg_dataset::FrameSource;
use splatseg_geometry::{CameraFrame, FrameAnchor, KeyframeId, MapView, Pose, RemappedId, RgbdFrame, ScoredMask};
use splatseg_memory::{Attached, SplatFileError, SplatMemory};
use splatseg_models::fastsam::FastSamError;
use splatseg_objects::{ObjectLog, ObjectSighting};
use splatseg_odometry::{CameraPose, InputDoubt, PoseEvent, PoseMode, PoseSource, PoseState, TrackedPoses};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_tracking::{FrameOutput, Method};
use stage_times::StageClock;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// A segmenter, a pose source and a method: frames go in, lasting ids come out.
pub struct Pipeline {
    segmenter: Box<dyn Segmenter>,
    poses: Box<dyn PoseSource>,
    method: Box<dyn Method>,
    segment_ahead: bool,
    clock: StageClock,
    objects: ObjectLog,
    /// Ids found to be the same object by frames without a result.
    unreported: Vec<RemappedId>,
    /// Events of frames without a result.
    unreported_events: Vec<PoseEvent>,
    /// Doubts about the input from frames without a result.
    unreported_doubts: Vec<InputDoubt>,
    naming: Naming,
}

/// The result for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameResult {
    /// The method's result: an id per pixel, masks, changes to the memory.
    pub output: FrameOutput,
    /// The objects in the frame, by increasing id.
    pub objects: Vec<ObjectSighting>,
    /// Time of each stage.
    pub times: StageTimes,
    /// The camera's pose, from the pose source.
    pub pose: CameraPose,
    /// The keyframe to which the frame's surfaces are attached.
    pub anchor: FrameAnchor,
    /// Ids of earlier frames that turned out to be the same object, since the previous result.
    pub remapped: Vec<RemappedId>,
    /// Events of the pose source since the previous result: loops, a lost camera that was found.
    pub events: Vec<PoseEvent>,
    /// Contradictions between what came with the frames and what they show that were noticed since the previous result,
    /// each once.
    pub doubts: Vec<InputDoubt>,
}

/// The masks of a frame, and the segmenter's time.
struct Segmented {
    masks: Result<Vec<ScoredMask>, SegmenterError>,
    time: Duration,
}

/// A frame's pose, and its place in the map.
struct Placed {
    pose: CameraPose,
    anchor: FrameAnchor,
}

impl Pipeline {
    /// Creates a pipeline from your own parts.
    pub fn new(segmenter: Box<dyn Segmenter>, method: Box<dyn Method>) -> Self {
        Self {
            segmenter,
            poses: Box::new(TrackedPoses::new(PoseMode::Auto)),
            method,
            segment_ahead: false,
            clock: StageClock::new(),
            objects: ObjectLog::default(),
            unreported: Vec::new(),
            unreported_events: Vec::new(),
            unreported_doubts: Vec::new(),
            naming: Naming::default(),
        }
    }

    /// Returns a builder for the pipeline that `settings` describe. Its parts can be replaced by your own.
    pub fn builder(settings: &Settings) -> PipelineBuilder<'_> {
        PipelineBuilder::new(settings)
    }

    /// Processes the next frame of a camera whose pose is known. With [`PoseMode::Track`] and [`PoseMode::Refine`] the
    /// result may have another pose.
    ///
    /// # Errors
    /// [`PipelineError::Segmenter`] or [`PipelineError::Pose`] if the segmenter or the pose source failed: later frames
    /// can still be processed. [`PipelineError::Method`] or [`PipelineError::DeviceFailed`] if the method or the device
    /// failed: no later frame can be processed.
    pub fn step(&mut self, frame: &RgbdFrame) -> Result<FrameResult, PipelineError> {
        self.poses.begin_frame(self.objects.frames(), &[]);
        let (pose, time) = timed(|| in_thread_pool(|| self.poses.pose(frame, Some(frame.world_from_camera()))));
        let pose = pose?;
        if pose.world_from_camera == *frame.world_from_camera() {
            return self.step_at_pose(frame, pose, time);
        }
        self.step_at_pose(&frame.clone().into_camera_frame().at(pose.world_from_camera), pose, time)
    }

    /// Processes the next frame of a camera whose pose is unknown: it is tracked, unless [`PoseMode::Given`] forbids it.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_unposed(&mut self, frame: CameraFrame<'_>) -> Result<FrameResult, PipelineError> {
        self.poses.begin_frame(self.objects.frames(), &[]);
        let (pose, time) = timed(|| in_thread_pool(|| self.poses.pose(&frame, None)));
        let pose = pose?;
        self.step_at_pose(&frame.at(pose.world_from_camera), pose, time)
    }

    /// Corrects the given poses of earlier frames, e.g. after a SLAM system has closed a loop: the number of each frame, from
    /// 0, and its pose, by increasing number. The map moves with them before the next frame is processed. Tracked poses
    /// are not changed.
    pub fn correct_poses(&mut self, corrected: &[(usize, Pose)]) {
        self.poses.begin_frame(self.objects.frames(), corrected);
    }

    fn step_at_pose(
        &mut self,
        frame: &RgbdFrame,
        pose: CameraPose,
        time: Duration,
    ) -> Result<FrameResult, PipelineError> {
        let placed = self.place(pose);
        let Self { segmenter, method, clock, objects, .. } = self;
        let result = in_thread_pool(|| {
            let segmented = segment(segmenter.as_mut(), frame);
            process(method.as_mut(), clock, objects, frame, placed, segmented)
        });
        self.finish(frame, result, time)
    }

    /// Passes what the source of poses has found out with the latest frame to the method.
    fn place(&mut self, pose: CameraPose) -> Placed {
        let anchor = self.poses.anchor();
        let correction = self.poses.take_correction();
        let remapped = correction.map_or_else(Vec::new, |correction| self.method.correct_map(&correction));
        if !remapped.is_empty() {
            self.poses.remap(&remapped);
            self.objects.remap(&remapped);
            self.naming.remap(&remapped);
        }
        self.method.set_anchor(&anchor);
        self.unreported.extend(remapped);
        self.unreported_events.extend(self.poses.take_events());
        self.unreported_doubts.extend(self.poses.take_input_doubts());
        Placed { pose, anchor }
    }

    /// Passes a frame's segments to the source of poses, keeps views of its objects, and adds the time for the pose.
    fn finish(
        &mut self,
        frame: &RgbdFrame,
        result: Result<FrameResult, PipelineError>,
        time: Duration,
    ) -> Result<FrameResult, PipelineError> {
        let mut result = result?;
        let recognised = &result.output.update.remapped;
        if !recognised.is_empty() {
            self.poses.remap(recognised);
            self.naming.remap(recognised);
        }
        self.naming.record(frame, &result.output, &result.objects);
        self.unreported.extend(recognised);
        result.remapped = std::mem::take(&mut self.unreported);
        result.events = std::mem::take(&mut self.unreported_events);
        result.doubts = std::mem::take(&mut self.unreported_doubts);
        self.poses.set_segments(&result.output.segments);
        if result.pose.state != PoseState::Given || result.pose.quality.is_some() {
            result.times.add("pose", time);
        }
        Ok(result)
    }

    /// Processes every frame of a source, e.g. a [`FrameStream`](splatseg_dataset::FrameStream). With `segment_ahead`,
    /// each frame is segmented while the method works on the previous one.
    pub fn run<S: FrameSource>(&mut self, source: S) -> Frames<'_, S> {
        Frames::new(self, source)
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

    /// The keyframes of the map as bytes, as in [`PoseSource::keyframes`].
    pub fn keyframes(&self) -> Option<Vec<u8>> {
        self.poses.keyframes()
    }

    /// Saves the memory with the names of objects and the camera's keyframes, by which a later run finds its place in the
    /// map.
    ///
    /// # Errors
    /// As [`SplatMemory::save`]; `Ok(false)` if the method has no memory.
    pub fn save_memory(&self, path: impl AsRef<Path>) -> Result<bool, SplatFileError> {
        let Some(memory) = self.memory() else { return Ok(false) };
        let (keyframes, names) = (self.poses.keyframes(), self.saved_names());
        memory.save_with(path, Attached { keyframes: keyframes.as_deref(), names: names.as_deref() })?;
        Ok(true)
    }

    /// The state of the source of poses after the latest frame, for [`PipelineBuilder::saved_poses`]. `None` if it has
    /// none.
    pub fn pose_state(&self) -> Option<Vec<u8>> {
        self.poses.save()
    }

    /// Doubts of the tracked frames about the camera's focal length, a sentence each; see [`PoseSource::calibration_warnings`].
    pub fn calibration_warnings(&self) -> Vec<String> {
        self.poses.calibration_warnings()
    }

    /// Returns, after the last frame, contradictions between what came with the frames and what they show that no result
    /// has told, because more frames were awaited.
    pub fn take_last_doubts(&mut self) -> Vec<InputDoubt> {
        let unreported = std::mem::take(&mut self.unreported_doubts);
        unreported.into_iter().chain(self.poses.take_last_input_doubts()).collect()
    }

    /// The present poses of the keyframes of the source of poses, camera to world. Each frame's pose is attached to one of
    /// them: see [`FrameResult::anchor`].
    pub fn keyframe_poses(&self) -> BTreeMap<KeyframeId, Pose> {
        self.poses.keyframe_poses()
    }

    /// The part of the map that each keyframe is in, as in [`PoseSource::keyframe_parts`].
    pub fn keyframe_parts(&self) -> BTreeMap<KeyframeId, u32> {
        self.poses.keyframe_parts()
    }

    /// Log of every object seen so far.
    pub fn objects(&self) -> &ObjectLog {
        &self.objects
    }
}

/// Runs `work` on a thread of Rayon's pool. On any other thread, each of a frame's hundred parallel steps would send its
/// work to the pool, sleep and be woken, which takes as long as the work itself.
fn in_thread_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Runs `work` and measures its time.
fn timed<R>(work: impl FnOnce() -> R) -> (R, Duration) {
    let started = Instant::now();
    (work(), started.elapsed())
}

fn segment(segmenter: &mut dyn Segmenter, frame: &CameraFrame) -> Segmented {
    let (masks, time) = timed(|| segmenter.segment(frame));
    Segmented { masks, time }
}

fn process(
    method: &mut dyn Method,
    clock: &StageClock,
    objects: &mut ObjectLog,
    frame: &RgbdFrame,
    Placed { pose, anchor }: Placed,
    Segmented { masks, time }: Segmented,
) -> Result<FrameResult, PipelineError> {
    let name = || frame.name().to_owned();
    let masks = masks.map_err(|source| match source {
        SegmenterError::FastSam(FastSamError::Device { .. }) | SegmenterError::Device { .. } => {
            PipelineError::DeviceFailed { frame: name(), source: Box::new(source) }
        }
        source => PipelineError::Segmenter { frame: name(), source: Box::new(source) },
    })?;
    let (output, mut times) = clock.time(|| match pose.state {
        PoseState::Lost => method.process_without_pose(frame, &masks),
        _ => method.process(frame, &masks),
    });
    let output = output.map_err(|source| PipelineError::Method { frame: name(), source: Box::new(source) })?;
    times.add("segment", time);
    objects.remap(&output.update.remapped);
    let objects = objects.record(&output);
    let (remapped, events, doubts) = (Vec::new(), Vec::new(), Vec::new());
    Ok(FrameResult { output, objects, times, pose, anchor, remapped, events, doubts })
}

//! The pipeline: frames → segmenter, pose → method ⇄ memory → ids and objects.
//!
//! [`Pipeline`] is the only frame loop. `splatseg run`, `bench` and `demo` run it on scenes. A robot passes it the frames
//! of its camera with [`Pipeline::step`].

mod builder;
mod error;
mod frames;
mod networks;
mod stage_times;

pub use builder::PipelineBuilder;
pub use error::{PipelineError, UnusableFrame};
pub use frames::{Frames, Processed};
pub use networks::LoadedNetworks;
pub use stage_times::StageTimes;

use crate::Settings;
use splatseg_dataset::FrameSource;
use splatseg_geometry::{CameraFrame, Pose, RgbdFrame, ScoredMask};
use splatseg_memory::SplatMemory;
use splatseg_models::fastsam::FastSamError;
use splatseg_objects::{ObjectLog, ObjectSighting};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_tracking::{FrameOutput, GivenPoses, Method, PoseSource};
use stage_times::StageClock;
use std::time::{Duration, Instant};

/// A segmenter, a pose source and a method: frames go in, lasting ids come out.
pub struct Pipeline {
    segmenter: Box<dyn Segmenter>,
    poses: Box<dyn PoseSource>,
    method: Box<dyn Method>,
    segment_ahead: bool,
    clock: StageClock,
    objects: ObjectLog,
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
    pub world_from_camera: Pose,
}

/// The masks of a frame, and the segmenter's time.
struct Segmented {
    masks: Result<Vec<ScoredMask>, SegmenterError>,
    time: Duration,
}

impl Pipeline {
    /// Creates a pipeline from your own parts.
    pub fn new(segmenter: Box<dyn Segmenter>, method: Box<dyn Method>) -> Self {
        Self {
            segmenter,
            poses: Box::new(GivenPoses),
            method,
            segment_ahead: false,
            clock: StageClock::new(),
            objects: ObjectLog::default(),
        }
    }

    /// Returns a builder for the pipeline that `settings` describe. Its parts can be replaced by your own.
    pub fn builder(settings: &Settings) -> PipelineBuilder<'_> {
        PipelineBuilder::new(settings)
    }

    /// Processes the next frame of a camera whose pose is known. Pose sources other than
    /// [`GivenPoses`] may return another pose.
    ///
    /// # Errors
    /// [`PipelineError::Segmenter`] or [`PipelineError::Pose`] if the segmenter or the pose source failed: later frames
    /// can still be processed. [`PipelineError::Method`] or [`PipelineError::DeviceFailed`] if the method or the device
    /// failed: no later frame can be processed.
    pub fn step(&mut self, frame: &RgbdFrame) -> Result<FrameResult, PipelineError> {
        let pose = self.poses.pose(frame, Some(frame.world_from_camera()), self.method.memory())?;
        if pose == *frame.world_from_camera() {
            return self.step_at_pose(frame);
        }
        self.step_at_pose(&frame.clone().into_camera_frame().at(pose))
    }

    /// Processes the next frame of a camera whose pose is unknown: the pose source determines it.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_unposed(&mut self, frame: CameraFrame<'_>) -> Result<FrameResult, PipelineError> {
        let pose = self.poses.pose(&frame, None, self.method.memory())?;
        self.step_at_pose(&frame.at(pose))
    }

    fn step_at_pose(&mut self, frame: &RgbdFrame) -> Result<FrameResult, PipelineError> {
        let Self { segmenter, method, clock, objects, .. } = self;
        in_thread_pool(|| {
            let segmented = segment(segmenter.as_mut(), frame);
            process(method.as_mut(), clock, objects, frame, segmented)
        })
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

    /// The splat memory, if the method has one.
    pub fn memory(&self) -> Option<&SplatMemory> {
        self.method.memory()
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

fn segment(segmenter: &mut dyn Segmenter, frame: &CameraFrame) -> Segmented {
    let started = Instant::now();
    let masks = segmenter.segment(frame);
    Segmented { masks, time: started.elapsed() }
}

fn process(
    method: &mut dyn Method,
    clock: &StageClock,
    objects: &mut ObjectLog,
    frame: &RgbdFrame,
    Segmented { masks, time }: Segmented,
) -> Result<FrameResult, PipelineError> {
    let name = || frame.name().to_owned();
    let masks = masks.map_err(|source| match source {
        SegmenterError::FastSam(FastSamError::Device { .. }) | SegmenterError::Device { .. } => {
            PipelineError::DeviceFailed { frame: name(), source: Box::new(source) }
        }
        source => PipelineError::Segmenter { frame: name(), source: Box::new(source) },
    })?;
    let (output, mut times) = clock.time(|| method.process(frame, &masks));
    let output = output.map_err(|source| PipelineError::Method { frame: name(), source: Box::new(source) })?;
    times.add("segment", time);
    let objects = objects.record(&output);
    Ok(FrameResult { output, objects, times, world_from_camera: *frame.world_from_camera() })
}

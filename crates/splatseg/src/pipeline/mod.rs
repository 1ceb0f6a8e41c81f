//! The pipeline: frames → segmenter → method ⇄ memory → ids and objects.
//!
//! [`Pipeline`] is the only frame loop. `splatseg run`, `bench` and `demo` give it scenes; a robot gives it the frames
//! of its camera with [`Pipeline::step`].

mod builder;
mod error;
mod frames;
mod networks;
mod stage_times;

pub use builder::PipelineBuilder;
pub use error::PipelineError;
pub use frames::{Frames, Processed};
pub use networks::LoadedNetworks;
pub use stage_times::StageTimes;

use crate::Settings;
use splatseg_geometry::{RgbdFrame, ScoredMask};
use splatseg_memory::SplatMemory;
use splatseg_models::fastsam::FastSamError;
use splatseg_objects::{ObjectLog, ObjectSighting};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_tracking::{FrameOutput, Method};
use stage_times::StageClock;
use std::time::{Duration, Instant};

/// A segmenter and a method: frames go in, lasting ids come out.
pub struct Pipeline {
    segmenter: Box<dyn Segmenter>,
    method: Box<dyn Method>,
    segment_ahead: bool,
    clock: StageClock,
    objects: ObjectLog,
}

/// The result for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameResult {
    /// The method's result: an id per pixel, masks, changes of the memory.
    pub output: FrameOutput,
    /// The objects in the frame, by increasing id.
    pub objects: Vec<ObjectSighting>,
    /// How long each stage took.
    pub times: StageTimes,
}

/// The masks of a frame, and how long they took.
struct Segmented {
    masks: Result<Vec<ScoredMask>, SegmenterError>,
    time: Duration,
}

impl Pipeline {
    /// A pipeline from your own parts.
    pub fn new(segmenter: Box<dyn Segmenter>, method: Box<dyn Method>) -> Self {
        Self { segmenter, method, segment_ahead: false, clock: StageClock::new(), objects: ObjectLog::default() }
    }

    /// A builder for the pipeline that `settings` describe, in which your own parts can replace some of its parts.
    pub fn builder(settings: &Settings) -> PipelineBuilder<'_> {
        PipelineBuilder::new(settings)
    }

    /// Processes the next frame of a camera.
    ///
    /// # Errors
    /// [`PipelineError::Segmenter`] if the segmenter failed, after which the next frame can still be processed;
    /// [`PipelineError::Method`] or [`PipelineError::DeviceFailed`] if the method or the device failed, after which none
    /// can.
    pub fn step(&mut self, frame: &RgbdFrame) -> Result<FrameResult, PipelineError> {
        let Self { segmenter, method, clock, objects, .. } = self;
        in_thread_pool(|| {
            let segmented = segment(segmenter.as_mut(), frame);
            process(method.as_mut(), clock, objects, frame, segmented)
        })
    }

    /// Processes every frame of a stream, e.g. a [`FrameStream`](splatseg_dataset::FrameStream). With `segment_ahead`,
    /// each frame is segmented while the method works on the previous one.
    pub fn run<I: Iterator>(&mut self, frames: I) -> Frames<'_, I> {
        Frames::new(self, frames)
    }

    /// The name of the method.
    pub fn method_name(&self) -> &str {
        self.method.name()
    }

    /// The splat memory, if the method has one.
    pub fn memory(&self) -> Option<&SplatMemory> {
        self.method.memory()
    }

    /// Every object seen so far.
    pub fn objects(&self) -> &ObjectLog {
        &self.objects
    }
}

/// Works on a thread of Rayon's pool. From any other thread, each of the hundred parallel steps of a frame would send its
/// work to the pool, sleep and be woken, which takes as long as the work.
fn in_thread_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

fn segment(segmenter: &mut dyn Segmenter, frame: &RgbdFrame) -> Segmented {
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
    Ok(FrameResult { output, objects, times })
}

//! The frame loop.
//!
//! The segmenter does not depend on the method, so frame t + 1 is segmented while the method processes frame t, on the
//! same threads, unless `segment_ahead=false`. Results are the same bytes either way. Each stage takes longer, as both
//! share the processor. [`Pipeline::step`] has one frame only, and segments it first.

use super::predicted_depth::DepthStage;
use super::stages::{Segmented, in_thread_pool, process, segment};
use super::working_resolution::WorkingFrame;
use super::{FrameResult, NameObjectsError, ObjectToName, Pipeline, PipelineError, UnusableFrame};
use splatseg_dataset::{FrameReadError, FrameSource, StreamedFrame};
use splatseg_geometry::{CameraFrame, MapView, Pose, RgbdFrame, SegmentMap};
use splatseg_memory::{Attached, SplatFileError};
use splatseg_objects::ObjectName;
use splatseg_odometry::{InputDoubt, StateScope};
use std::error::Error;
use std::path::Path;

/// Iterator over the results of a [`FrameSource`].
///
/// Segmenting ahead changes the time of the results and nothing else: the segmenter does not depend on the method.
pub struct Frames<'p, S> {
    pipeline: &'p mut Pipeline,
    source: S,
    next: Option<NextFrame>,
}

/// A frame and its result.
#[derive(Debug)]
pub struct Processed {
    /// Index of the frame in its source.
    pub index: usize,
    /// The frame, with the pose from the pose source.
    pub frame: RgbdFrame<'static>,
    /// The true segments, if the source returned them.
    pub ground_truth: Option<SegmentMap>,
    /// The result. After [`PipelineError::Segmenter`] the stream can continue.
    pub result: Result<FrameResult, PipelineError>,
}

/// The next frame of the source, with what was prepared ahead.
type NextFrame = (Result<StreamedFrame, UnusableFrame>, Option<Prepared>);

/// A frame that was reduced, if it needs that, and segmented.
struct Prepared {
    reduced: Option<CameraFrame<'static>>,
    segmented: Segmented,
}

impl Pipeline {
    /// Processes every frame of a source, e.g. a [`FrameStream`](splatseg_dataset::FrameStream). With `segment_ahead`,
    /// each frame is segmented while the method works on the previous one.
    pub fn run<S: FrameSource>(&mut self, source: S) -> Frames<'_, S> {
        Frames { pipeline: self, source, next: None }
    }
}

impl<S: FrameSource> Frames<'_, S> {
    /// The pipeline after the latest frame.
    pub fn pipeline_mut(&mut self) -> &mut Pipeline {
        self.pipeline
    }

    /// The map after the latest frame, if the method has one.
    pub fn latest_map(&self) -> Option<MapView<'_>> {
        self.pipeline.map()
    }

    /// Saves the memory after the latest frame for a run that continues later: with the names of all objects, and without
    /// keyframes, which are part of [`Self::saved_poses`].
    ///
    /// # Errors
    /// As [`SplatMemory::save`](splatseg_memory::SplatMemory::save); `Ok(false)` if the method has no memory.
    pub fn save_memory(&self, path: impl AsRef<Path>) -> Result<bool, SplatFileError> {
        let Some(memory) = self.pipeline.memory() else { return Ok(false) };
        let names = &self.pipeline.names.names;
        // Forgotten objects keep their labels in the list of the whole run.
        let names = (!names.is_empty()).then(|| names.to_bytes());
        let history = self.pipeline.history.of_present(memory, StateScope::Run);
        let attached = Attached { keyframes: None, names: names.as_deref(), history: history.as_deref() };
        memory.save_with(path, attached)?;
        Ok(true)
    }

    /// State of the source of poses after the latest frame, for a run that continues later; see
    /// [`Pipeline::saved_poses`].
    pub fn saved_poses(&self) -> Option<Vec<u8>> {
        self.pipeline.saved_poses(StateScope::Run)
    }

    /// Names objects after the latest frame, as [`Pipeline::name_objects`].
    ///
    /// # Errors
    /// As [`Pipeline::name_objects`].
    pub fn name_objects(
        &mut self,
        namer: impl FnMut(ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>>,
    ) -> Result<usize, NameObjectsError> {
        self.pipeline.name_objects(namer)
    }

    /// Doubts that no result has told, after the last frame; see [`Pipeline::finish`].
    pub fn finish(&mut self) -> Vec<InputDoubt> {
        self.pipeline.finish()
    }

    /// Number of frames to come, including unusable ones. `None` if the end of the source is not known.
    pub fn frames_left(&self) -> Option<usize> {
        Some(self.source.frames_left()? + usize::from(self.next.is_some()))
    }
}

/// A frame with predicted depth, if depth is to be predicted.
fn predicted(
    streamed: Result<StreamedFrame, FrameReadError>,
    depth: &mut Option<DepthStage>,
) -> Result<StreamedFrame, UnusableFrame> {
    let StreamedFrame { frame, index, world_from_camera, corrections, ground_truth } = streamed?;
    let frame = match depth {
        Some(depth) => {
            let name = frame.name().to_owned();
            let unusable = |source| UnusableFrame::Depth { frame: name, source: Box::new(source) };
            depth.predicted(frame).map_err(unusable)?
        }
        None => frame,
    };
    Ok(StreamedFrame { frame, index, world_from_camera, corrections, ground_truth })
}

impl<S: FrameSource> Iterator for Frames<'_, S> {
    type Item = Result<Processed, UnusableFrame>;

    fn next(&mut self) -> Option<Self::Item> {
        let Self { pipeline, source, next } = self;
        let (streamed, prepared) = match next.take() {
            Some(next) => next,
            None => (predicted(source.next()?, &mut pipeline.depth), None),
        };
        let StreamedFrame { index, frame, world_from_camera, corrections, ground_truth } = match streamed {
            Ok(streamed) => streamed,
            Err(error) => return Some(Err(error)),
        };
        let rest = pipeline.names.rest_during_frame();
        let corrected: Vec<(usize, Pose)> =
            corrections.iter().map(|correction| (correction.frame, correction.world_from_camera)).collect();
        pipeline.correct_poses(&corrected);
        let (mut working, segmented) = match prepared {
            Some(Prepared { reduced, segmented }) => (WorkingFrame::new(&frame, reduced), Some(segmented)),
            None => (pipeline.working_frame(&frame), None),
        };
        let segmented = segmented.or_else(|| pipeline.segmented_before_fit(&working));
        let placed = match pipeline.place(&mut working, index, world_from_camera.as_ref()) {
            Ok(placed) => placed,
            Err(error) => return Some(Err(error.into())),
        };
        let world_from_camera = placed.pose.world_from_camera;
        let Pipeline { segmenter, method, segment_ahead, clock, objects, turn, resolution, depth, names, .. } =
            &mut **pipeline;
        // Read on this thread: a thread of the pool that waits for a frame could be the one that the frame waits for.
        drop(rest);
        let ahead = if *segment_ahead { source.next() } else { None };
        let _rest = names.rest_during_frame();
        let (result, ahead) = in_thread_pool(|| {
            let segmented = segmented.unwrap_or_else(|| segment(segmenter.as_mut(), &working, placed.turn));
            rayon::join(
                || process(method.as_mut(), clock, objects, &working, placed, segmented),
                || {
                    let ahead = predicted(ahead?, depth);
                    let prepared = ahead.as_ref().ok().map(|ahead| {
                        let working = resolution.frame(&ahead.frame);
                        let segmented = segment(segmenter.as_mut(), &working, *turn);
                        Prepared { reduced: working.into_reduced(), segmented }
                    });
                    Some((ahead, prepared))
                },
            )
        });
        let result = result.and_then(|decided| pipeline.completed(&working, decided));
        let frame = match working.into_changed() {
            Some(changed) => changed.at(world_from_camera),
            None => frame.at(world_from_camera),
        };
        *next = ahead;
        Some(Ok(Processed { index, frame, ground_truth, result }))
    }
}

//! The frame loop.
//!
//! The segmenter does not depend on the method, so frame t + 1 is segmented while the method processes frame t, on the
//! same threads, unless `segment_ahead=false`. Results are the same bytes either way. Each stage takes longer, as both
//! share the processor. [`Pipeline::step`] has one frame only, and segments it first.

use super::{FrameResult, Pipeline, PipelineError, Segmented, UnusableFrame};
use super::{in_thread_pool, process, segment, timed};
use splatseg_dataset::{FrameReadError, FrameSource, StreamedFrame};
use splatseg_geometry::{MapView, Pose, RgbdFrame, SegmentMap};
use splatseg_memory::{Attached, SplatFileError};
use splatseg_odometry::InputDoubt;
use std::path::Path;

/// Iterator over the results of a [`FrameSource`].
///
/// Segmenting ahead changes the time of the results and nothing else: the segmenter does not depend on the method.
pub struct Frames<'p, S> {
    pub(super) pipeline: &'p mut Pipeline,
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

/// The next frame of the source, with masks if it was segmented ahead.
type NextFrame = (Result<StreamedFrame, FrameReadError>, Option<Segmented>);

impl<'p, S: FrameSource> Frames<'p, S> {
    pub(super) fn new(pipeline: &'p mut Pipeline, source: S) -> Self {
        Self { pipeline, source, next: None }
    }

    /// The map after the latest frame, if the method has one.
    pub fn latest_map(&self) -> Option<MapView<'_>> {
        self.pipeline.map()
    }

    /// Saves the memory after the latest frame for a run that continues later: with the names of all objects, and without
    /// keyframes, which are part of [`Self::pose_state`].
    ///
    /// # Errors
    /// As [`SplatMemory::save`](splatseg_memory::SplatMemory::save); `Ok(false)` if the method has no memory.
    pub fn save_memory(&self, path: impl AsRef<Path>) -> Result<bool, SplatFileError> {
        let Some(memory) = self.pipeline.memory() else { return Ok(false) };
        let names = self.pipeline.names();
        // Forgotten objects keep their labels in the list of the whole run.
        let names = (!names.is_empty()).then(|| names.to_bytes());
        memory.save_with(path, Attached { keyframes: None, names: names.as_deref() })?;
        Ok(true)
    }

    /// State of the source of poses after the latest frame; see [`Pipeline::pose_state`].
    pub fn pose_state(&self) -> Option<Vec<u8>> {
        self.pipeline.pose_state()
    }

    /// Doubts about the camera after the latest frame; see [`Pipeline::calibration_warnings`].
    pub fn calibration_warnings(&self) -> Vec<String> {
        self.pipeline.calibration_warnings()
    }

    /// Contradictions that no result has told; see [`Pipeline::take_last_doubts`].
    pub fn take_last_doubts(&mut self) -> Vec<InputDoubt> {
        self.pipeline.take_last_doubts()
    }

    /// Number of frames to come, including unusable ones. `None` if the end of the source is not known.
    pub fn frames_left(&self) -> Option<usize> {
        Some(self.source.frames_left()? + usize::from(self.next.is_some()))
    }
}

impl<S: FrameSource> Iterator for Frames<'_, S> {
    type Item = Result<Processed, UnusableFrame>;

    fn next(&mut self) -> Option<Self::Item> {
        let Self { pipeline, source, next } = self;
        let (streamed, segmented) = next.take().or_else(|| Some((source.next()?, None)))?;
        let StreamedFrame { index, frame, world_from_camera, corrections, ground_truth } = match streamed {
            Ok(streamed) => streamed,
            Err(error) => return Some(Err(error.into())),
        };
        let corrected: Vec<(usize, Pose)> =
            corrections.iter().map(|correction| (correction.frame, correction.world_from_camera)).collect();
        pipeline.poses.begin_frame(index, &corrected);
        let (pose, pose_time) =
            match timed(|| in_thread_pool(|| pipeline.poses.pose(&frame, world_from_camera.as_ref()))) {
                (Ok(pose), time) => (pose, time),
                (Err(error), _) => return Some(Err(error.into())),
            };
        let frame = frame.at(pose.world_from_camera);
        let placed = pipeline.place(pose);
        let Pipeline { segmenter, method, segment_ahead, clock, objects, .. } = &mut **pipeline;
        // Read on this thread: a thread of the pool that waits for a frame could be the one that the frame waits for.
        let ahead = if *segment_ahead { source.next() } else { None };
        let (result, segmented_ahead) = in_thread_pool(|| {
            let segmented = segmented.unwrap_or_else(|| segment(segmenter.as_mut(), &frame));
            rayon::join(
                || process(method.as_mut(), clock, objects, &frame, placed, segmented),
                || Some(segment(segmenter.as_mut(), &ahead.as_ref()?.as_ref().ok()?.frame)),
            )
        });
        let result = pipeline.finish(&frame, result, pose_time);
        *next = ahead.map(|frame| (frame, segmented_ahead));
        Some(Ok(Processed { index, frame, ground_truth, result }))
    }
}

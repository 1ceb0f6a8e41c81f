//! The stages of a frame after its pose is known, each for itself.

use super::stage_times::StageClock;
use super::working_resolution::{WorkingFrame, enlarged_output, reduced_segmentation};
use super::{FrameResult, PipelineError};
use splatseg_geometry::{FrameAnchor, QuarterTurn, SegmentMap, Segmentation};
use splatseg_models::fastsam::FastSamError;
use splatseg_objects::ObjectLog;
use splatseg_odometry::{CameraPose, PoseState};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_tracking::Method;
use std::time::{Duration, Instant};

/// The segmenter's output for a frame, and its time.
pub(super) struct Segmented {
    found: Result<Segmentation, SegmenterError>,
    time: Duration,
}

impl Segmented {
    /// # Errors
    /// If the segmenter failed.
    pub(super) fn checked(self, frame: &WorkingFrame<'_>) -> Result<Self, PipelineError> {
        let (found, time) = self.into_parts(frame)?;
        Ok(Self { found: Ok(found), time })
    }

    fn into_parts(self, frame: &WorkingFrame<'_>) -> Result<(Segmentation, Duration), PipelineError> {
        let frame = || frame.whole.name().to_owned();
        let found = self.found.map_err(|source| match source {
            SegmenterError::FastSam(FastSamError::Device { .. }) | SegmenterError::Device { .. } => {
                PipelineError::DeviceFailed { frame: frame(), source: Box::new(source) }
            }
            source => PipelineError::Segmenter { frame: frame(), source: Box::new(source) },
        })?;
        Ok((found, self.time))
    }
}

/// A frame's pose, its place in the map, the time that they took, and the turn with which it is segmented.
#[derive(Clone)]
pub(super) struct Placed {
    pub(super) pose: CameraPose,
    pub(super) anchor: FrameAnchor,
    pub(super) turn: QuarterTurn,
    pub(super) time: Duration,
}

/// The result of a frame, and the segments as the method returned them if the frame was reduced for it.
pub(super) struct Decided {
    pub(super) result: FrameResult,
    pub(super) reduced: Option<SegmentMap>,
}

/// Runs `work` on a thread of Rayon's pool. On any other thread, each of a frame's hundred parallel steps would send its
/// work to the pool, sleep and be woken, which takes as long as the work itself.
pub(super) fn in_thread_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Runs `work` and measures its time.
pub(super) fn timed<R>(work: impl FnOnce() -> R) -> (R, Duration) {
    let started = Instant::now();
    (work(), started.elapsed())
}

/// Segments a frame that is upright after a turn. What is found has the size at which the frame is processed.
pub(super) fn segment(segmenter: &mut dyn Segmenter, frame: &WorkingFrame<'_>, turn: QuarterTurn) -> Segmented {
    let (found, time) = timed(|| {
        let seen = if segmenter.needs_all_pixels() { &frame.whole } else { frame.working() };
        let size = (seen.width(), seen.height());
        let found = match turn {
            QuarterTurn::None => segmenter.segment(seen)?,
            turn => segmenter.segment(&seen.turned(turn))?.turned(turn.inverse(), turn.size(size)),
        };
        let working = (frame.working().width(), frame.working().height());
        if size == working {
            return Ok(found);
        }
        reduced_segmentation(found, size, working)
            .map_err(|source| SegmenterError::Other { name: segmenter.name().to_owned(), source: Box::new(source) })
    });
    Segmented { found, time }
}

/// Passes a frame and what the segmenter has found in it to the method.
pub(super) fn process(
    method: &mut dyn Method,
    clock: &StageClock,
    objects: &mut ObjectLog,
    frame: &WorkingFrame,
    Placed { pose, anchor, turn, time: pose_time }: Placed,
    segmented: Segmented,
) -> Result<Decided, PipelineError> {
    let name = || frame.whole.name().to_owned();
    let (found, time) = segmented.into_parts(frame)?;
    let working = frame.working().as_borrowed().at(pose.world_from_camera);
    method.set_reduction(frame.whole.width() as f64 / working.width() as f64);
    let (output, mut times) = clock.time(|| match pose.state {
        PoseState::Lost => method.process_without_pose(&working, &found),
        _ => method.process(&working, &found),
    });
    let mut output = output.map_err(|source| PipelineError::Method { frame: name(), source: Box::new(source) })?;
    times.add("segment", time);
    if pose.state != PoseState::Given || pose.quality.is_some() {
        times.add("pose", pose_time);
    }
    let mut reduced = None;
    if frame.is_reduced() {
        let ((enlarged, segments), time) = timed(|| enlarged_output(output, &frame.whole));
        times.add("enlarge", time);
        (output, reduced) = (enlarged, Some(segments));
    }
    objects.remap(&output.update.remapped);
    let objects = objects.record(&output);
    let (remapped, events, doubts) = (Vec::new(), Vec::new(), Vec::new());
    let regions = found.regions;
    let result = FrameResult { output, regions, objects, times, pose, anchor, turn, remapped, events, doubts };
    Ok(Decided { result, reduced })
}

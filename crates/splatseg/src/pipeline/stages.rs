//! The stages of a frame after its pose is known, each for itself.

use super::stage_times::StageClock;
use super::{FrameResult, PipelineError};
use splatseg_geometry::{CameraFrame, FrameAnchor, QuarterTurn, RgbdFrame, Segmentation};
use splatseg_models::fastsam::FastSamError;
use splatseg_objects::ObjectLog;
use splatseg_odometry::{CameraPose, PoseState};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_tracking::Method;
use std::time::{Duration, Instant};

/// What the segmenter has found in a frame, and its time.
pub(super) struct Segmented {
    found: Result<Segmentation, SegmenterError>,
    time: Duration,
}

/// A frame's pose, its place in the map, the time that they took, and the turn with which it is segmented.
#[derive(Clone)]
pub(super) struct Placed {
    pub(super) pose: CameraPose,
    pub(super) anchor: FrameAnchor,
    pub(super) turn: QuarterTurn,
    pub(super) time: Duration,
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

/// Segments a frame that is upright after a turn.
pub(super) fn segment(segmenter: &mut dyn Segmenter, frame: &CameraFrame, turn: QuarterTurn) -> Segmented {
    let (found, time) = timed(|| {
        if turn == QuarterTurn::None {
            return segmenter.segment(frame);
        }
        let size = turn.size((frame.width(), frame.height()));
        Ok(segmenter.segment(&frame.turned(turn))?.turned(turn.inverse(), size))
    });
    Segmented { found, time }
}

/// Passes a frame and what the segmenter has found in it to the method.
pub(super) fn process(
    method: &mut dyn Method,
    clock: &StageClock,
    objects: &mut ObjectLog,
    frame: &RgbdFrame,
    Placed { pose, anchor, turn, time: pose_time }: Placed,
    Segmented { found, time }: Segmented,
) -> Result<FrameResult, PipelineError> {
    let name = || frame.name().to_owned();
    let found = found.map_err(|source| match source {
        SegmenterError::FastSam(FastSamError::Device { .. }) | SegmenterError::Device { .. } => {
            PipelineError::DeviceFailed { frame: name(), source: Box::new(source) }
        }
        source => PipelineError::Segmenter { frame: name(), source: Box::new(source) },
    })?;
    let (output, mut times) = clock.time(|| match pose.state {
        PoseState::Lost => method.process_without_pose(frame, &found),
        _ => method.process(frame, &found),
    });
    let output = output.map_err(|source| PipelineError::Method { frame: name(), source: Box::new(source) })?;
    times.add("segment", time);
    if pose.state != PoseState::Given || pose.quality.is_some() {
        times.add("pose", pose_time);
    }
    objects.remap(&output.update.remapped);
    let objects = objects.record(&output);
    let (remapped, events, doubts) = (Vec::new(), Vec::new(), Vec::new());
    Ok(FrameResult { output, regions: found.regions, objects, times, pose, anchor, turn, remapped, events, doubts })
}

//! Whether depth and colour are of the same time: while the camera moves, the edges of late depth are where those of
//! colour were before.

use super::edges::{DepthEdge, EdgeFrame, TELLING_CONTRAST};
use super::registration::Explained;
use super::units::{median, rounded};
use crate::se3::{self, Twist};
use crate::{DoubtKind, InputDoubt};
use glam::{Vec2, Vec3};
use splatseg_geometry::{CameraFrame, Intrinsics, Pose};
use std::time::Duration;

/// Delays that are tried: the smallest one, in intervals between frames, and the factor from one to the next.
const SMALLEST: f64 = 0.05;
/// See [`SMALLEST`].
const STEP: f64 = 1.18;
/// Number of delays of each sign, up to four intervals.
const DELAYS: i32 = 27;

/// Edges used of each frame, about.
const EDGES: usize = 120;
/// The delay is measured in this many frames in which the camera moves...
const FRAMES: usize = 24;
/// ...of at most this many...
const MAX_SEEN: usize = 120;
/// ...and in at least this many at the end.
const MIN_FRAMES: usize = 12;

/// Motion of the edges in the image from frame to frame that can be measured, in units: their median. A farther one is a
/// jump.
const MOTION: std::ops::RangeInclusive<f32> = 1.0..=80.0;
/// Edges that a delay would move farther than this are left out, units.
const MAX_SHIFT: f32 = 40.0;

/// Most edges are farther away than this, metres.
const NEAREST: f64 = 0.3;

/// A delay is reported if it explains at least this share of the contrast at edges...
const MIN_GAIN: f64 = 0.12;
/// ...and makes this share of the frames better.
const MIN_BETTER: f64 = 0.65;

/// A frame of a camera with 30 images per second, less what a delay can be wrong by, seconds.
const MIN_SECONDS: f64 = 0.03;
/// The same in intervals, if frames have no times.
const MIN_INTERVALS: f64 = 0.9;
/// Without times: from this median motion on, units, frames are not those of a video but picked from one, since nobody
/// turns a camera by 80 degrees per second for long...
const PICKED_MOTION: f32 = 15.0;
/// ...and this share of an interval can be a frame of it.
const MIN_PICKED_INTERVALS: f64 = 0.075;

/// Contrast at the edges of depth for each delay, of one frame.
#[derive(Clone, Debug)]
struct FrameContrast {
    /// Sum and number of edges, by delay.
    by_delay: Vec<(f32, u32)>,
    /// Median motion of the edges, units.
    motion: f32,
    /// Time since the frame before, seconds.
    interval: Option<f64>,
}

/// Measures the delay between depth and colour.
#[derive(Clone, Debug, Default)]
pub(super) struct DelayCheck {
    last: Option<(Pose, Option<Duration>)>,
    frames: Vec<FrameContrast>,
    seen: usize,
    is_closed: bool,
}

/// All delays in intervals between frames, 0 first. Positive if depth is older than colour.
fn delays() -> Vec<f64> {
    let positive = (0..DELAYS).scan(SMALLEST, |next, _| {
        let delay = *next;
        *next *= STEP;
        Some(delay)
    });
    std::iter::once(0.0).chain(positive.flat_map(|delay| [delay, -delay])).collect()
}

impl DelayCheck {
    /// Adds the next frame with its pose; `None` if it is not known.
    pub(super) fn add(&mut self, frame: &CameraFrame<'_>, pose: Option<&Pose>) {
        if self.is_complete() {
            return;
        }
        self.seen += 1;
        let before = std::mem::replace(&mut self.last, pose.map(|pose| (*pose, frame.timestamp())));
        let (Some((before, before_time)), Some(pose)) = (before, pose) else { return };
        let motion = se3::logarithm(&(before.inverse() * *pose));
        let interval = frame.timestamp().zip(before_time).and_then(|(now, before)| now.checked_sub(before));
        let interval = interval.map(|interval| interval.as_secs_f64()).filter(|seconds| *seconds > 0.0);
        self.frames.extend(contrasts(frame, &motion, interval));
    }

    /// True if no more frames are needed.
    pub(super) fn is_complete(&self) -> bool {
        self.is_closed || self.frames.len() >= FRAMES || self.seen >= MAX_SEEN
    }

    /// True if the camera has moved in at least a quarter of the frames, so that a delay may shift depth.
    pub(super) fn has_motion(&self) -> bool {
        4 * self.frames.len() >= self.seen && !self.frames.is_empty()
    }

    /// Returns the doubt that the frames justify, and forgets them.
    pub(super) fn doubt(&mut self) -> Option<Explained> {
        let frames = std::mem::take(&mut self.frames);
        self.is_closed = true;
        if frames.len() < MIN_FRAMES {
            return None;
        }
        let delays = delays();
        let total = |number: usize| {
            let (sum, count) = frames.iter().fold((0.0, 0), |(sum, count), frame| {
                let (more, edges) = frame.by_delay[number];
                (sum + f64::from(more), count + edges)
            });
            sum / f64::from(count.max(1))
        };
        let means: Vec<f64> = (0..delays.len()).map(total).collect();
        let best = (0..means.len()).max_by(|one, other| means[*one].total_cmp(&means[*other]))?;
        let mut sorted = means.clone();
        sorted.sort_by(f64::total_cmp);
        let unrelated = sorted[sorted.len() / 8];
        let gain = (means[best] - means[0]) / (means[best] - unrelated);
        let better = frames.iter().filter(|frame| frame.mean(best) > frame.mean(0)).count();
        let is_better = better as f64 >= MIN_BETTER * frames.len() as f64;
        let seconds = median(frames.iter().filter_map(|frame| frame.interval).collect());
        let motion = median(frames.iter().map(|frame| f64::from(frame.motion)).collect())?;
        let intervals = delays[best];
        let is_frame = match seconds {
            Some(seconds) => intervals.abs() * seconds >= MIN_SECONDS,
            None if motion >= f64::from(PICKED_MOTION) => intervals.abs() >= MIN_PICKED_INTERVALS,
            None => intervals.abs() >= MIN_INTERVALS,
        };
        (is_frame && gain >= MIN_GAIN && means[best] >= TELLING_CONTRAST && is_better).then(|| {
            let text = described(intervals, seconds, [means[0], means[best]]);
            let gain = means[best] / means[0].max(f64::MIN_POSITIVE);
            Explained { doubt: InputDoubt { kind: DoubtKind::Delay, text }, gain }
        })
    }
}

impl FrameContrast {
    fn mean(&self, number: usize) -> f32 {
        let (sum, count) = self.by_delay[number];
        sum / count.max(1) as f32
    }
}

/// Contrast at the edges of a frame's depth for each delay. `motion` is that of the camera since the frame before. `None`
/// if there are no edges, or they hardly move.
fn contrasts(frame: &CameraFrame<'_>, motion: &Twist, interval: Option<f64>) -> Option<FrameContrast> {
    let camera = frame.intrinsics();
    let length = |from: usize| motion[from..from + 3].iter().map(|part| part * part).sum::<f64>().sqrt();
    // Nothing nearer than this moves far enough: no need to look for edges.
    let most = (length(3) * 2.0 + length(0) / NEAREST) as f32 * camera.fx / (camera.width as f32 / 320.0);
    if most < *MOTION.start() {
        return None;
    }
    let edges = EdgeFrame::new(frame, EDGES)?;
    let unit = edges.unit as f32;
    let flows: Vec<Vec2> = edges.edges.iter().map(|edge| flow(edge, camera, motion)).collect();
    let median_motion = median(flows.iter().map(|flow| f64::from(flow.length() / unit)).collect())? as f32;
    if !MOTION.contains(&median_motion) {
        return None;
    }
    let of_delay = |delay: f64| {
        let shifts = flows.iter().map(|flow| *flow * delay as f32);
        let near = edges.edges.iter().zip(shifts).filter(|(_, shift)| shift.length() <= MAX_SHIFT * unit);
        let contrasts = near.filter_map(|(edge, shift)| edges.contrast(edge, shift));
        contrasts.fold((0.0, 0), |(sum, count), contrast| (sum + contrast, count + 1))
    };
    let by_delay = delays().into_iter().map(of_delay).collect();
    Some(FrameContrast { by_delay, motion: median_motion, interval })
}

/// How far an edge moves in the image while the camera makes a motion, pixels, about.
fn flow(edge: &DepthEdge, camera: &Intrinsics, motion: &Twist) -> Vec2 {
    let part = |from: usize| Vec3::new(motion[from] as f32, motion[from + 1] as f32, motion[from + 2] as f32);
    let point = camera.unproject(edge.place, edge.depth);
    let moved = -(part(0) + part(3).cross(point));
    let (right, down) = (moved.x - point.x * moved.z / point.z, moved.y - point.y * moved.z / point.z);
    Vec2::new(camera.fx * right, camera.fy * down) / point.z
}

fn described(intervals: f64, seconds: Option<f64>, [present, best]: [f64; 2]) -> String {
    let (older, newer) = if intervals > 0.0 { ("depth", "colour") } else { ("colour", "depth") };
    let frames = rounded((intervals.abs() * 100.0).round() / 100.0);
    let time = seconds.map_or_else(String::new, |seconds| format!(", {:.0} ms", intervals.abs() * seconds * 1e3));
    format!(
        "{older} seems to be older than {newer} by about {frames} of the interval between frames{time}: while the camera \
         moves, edges of depth would then be at edges of colour (contrast there {best:.2} instead of {present:.2} times the \
         mean); check the synchronisation of the two images and their stamps"
    )
}

//! Whether depth is registered to colour: edges of depth are compared with edges of colour, at several scales and shifts.

use super::edges::{DepthEdge, EdgeFrame, TELLING_CONTRAST};
use super::units::rounded;
use crate::{DoubtKind, InputDoubt};
use glam::Vec2;
use splatseg_geometry::CameraFrame;

/// Scales that are tried are powers of this, about the principal point: those of two cameras side by side.
const SCALE: f32 = 1.08;
/// The largest power, and the smallest one with the other sign.
const POWERS: i32 = 6;
/// Shifts that are tried, in steps of this many pixels of an image of 320 pixels, by columns and rows...
const STEPS: (f32, f32) = (2.0, 4.0);
/// ...and their number to each side.
const SHIFTS: (i32, i32) = (8, 2);

/// Edges used of each frame, about.
const EDGES: usize = 80;
/// Registration is judged by this many frames...
const FRAMES: usize = 5;
/// ...at most one in this many, so that they differ...
const STRIDE: usize = 4;
/// ...and by at least this many at the end.
const MIN_FRAMES: usize = 2;

/// Registration is doubted if another one explains at least this share of the contrast at edges, the rest being that at
/// places without any relation.
const MIN_GAIN: f64 = 0.4;
/// The contrast at the edges must be at least this many times that at such places.
const MIN_CONTRAST: f64 = 1.2;
/// Share of the frames that must be better with it.
const MIN_BETTER: f64 = 0.75;

/// A change of the place of depth in the image: scale about the principal point, then a shift in units.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Placement {
    scale: f32,
    shift: Vec2,
}

impl Placement {
    const AS_IT_IS: Self = Self { scale: 1.0, shift: Vec2::ZERO };
}

/// All placements, [`Placement::AS_IT_IS`] among them.
fn placements() -> Vec<Placement> {
    let mut all = Vec::new();
    for power in -POWERS..=POWERS {
        let scale = if power < 0 { 1.0 / SCALE } else { SCALE };
        let scale = (0..power.abs()).fold(1.0, |product, _| product * scale);
        for down in -SHIFTS.1..=SHIFTS.1 {
            let shifts = (-SHIFTS.0..=SHIFTS.0).map(|right| Vec2::new(right as f32 * STEPS.0, down as f32 * STEPS.1));
            all.extend(shifts.map(|shift| Placement { scale, shift }));
        }
    }
    all
}

/// A doubt, with the contrast at edges of depth that its explanation gives, per present one.
#[derive(Clone, Debug)]
pub(super) struct Explained {
    pub(super) doubt: InputDoubt,
    pub(super) gain: f64,
}

/// Contrast at the edges of depth of the first frames, for each placement.
#[derive(Clone, Debug, Default)]
pub(super) struct RegistrationCheck {
    /// Number of frames seen.
    seen: usize,
    /// Mean contrast for each placement, by frame.
    frames: Vec<Vec<f32>>,
    is_closed: bool,
}

impl RegistrationCheck {
    /// Adds a frame, unless there are enough.
    pub(super) fn add(&mut self, frame: &CameraFrame<'_>) {
        let is_due = self.seen.is_multiple_of(STRIDE) && !self.is_complete();
        self.seen = self.seen.wrapping_add(1);
        if is_due && let Some(edges) = EdgeFrame::new(frame, EDGES) {
            let camera = frame.intrinsics();
            let centre = Vec2::new(camera.cx, camera.cy);
            self.frames.push(placements().iter().map(|placement| contrast(&edges, centre, placement)).collect());
        }
    }

    /// True if no more frames are needed.
    pub(super) fn is_complete(&self) -> bool {
        self.is_closed || self.frames.len() >= FRAMES
    }

    /// Returns the doubt that the frames justify, and forgets them.
    pub(super) fn doubt(&mut self) -> Option<Explained> {
        let frames = std::mem::take(&mut self.frames);
        self.is_closed = true;
        if frames.len() < MIN_FRAMES {
            return None;
        }
        let placements = placements();
        let mean =
            |number: usize| frames.iter().map(|frame| f64::from(frame[number])).sum::<f64>() / frames.len() as f64;
        let means: Vec<f64> = (0..placements.len()).map(mean).collect();
        let present = placements.iter().position(|placement| *placement == Placement::AS_IT_IS)?;
        let best = (0..means.len()).max_by(|one, other| means[*one].total_cmp(&means[*other]))?;
        let mut sorted = means.clone();
        sorted.sort_by(f64::total_cmp);
        let unrelated = sorted[sorted.len() / 2];
        let gain = (means[best] - means[present]) / (means[best] - unrelated);
        let better = frames.iter().filter(|frame| frame[best] > frame[present]).count();
        let is_better = better as f64 >= MIN_BETTER * frames.len() as f64;
        let is_telling = means[best] >= TELLING_CONTRAST.max(MIN_CONTRAST * unrelated);
        if !(gain >= MIN_GAIN && is_telling && is_better) {
            return None;
        }
        let text = described(&placements[best], [means[present], means[best]]);
        let gain = means[best] / means[present].max(f64::MIN_POSITIVE);
        Some(Explained { doubt: InputDoubt { kind: DoubtKind::Registration, text }, gain })
    }
}

/// Mean contrast at the edges of depth in another place; 0 if they are outside the image.
fn contrast(edges: &EdgeFrame<'_>, centre: Vec2, placement: &Placement) -> f32 {
    let shift = placement.shift * edges.unit as f32;
    let of_edge = |edge: &DepthEdge| {
        let DepthEdge { place, .. } = *edge;
        edges.contrast(edge, (place - centre) * (placement.scale - 1.0) + shift)
    };
    let (sum, count) =
        edges.edges.iter().filter_map(of_edge).fold((0.0, 0), |(sum, count), contrast| (sum + contrast, count + 1));
    // A few edges that happen to be inside say nothing.
    if count * 3 >= edges.edges.len() { sum / count as f32 } else { 0.0 }
}

fn described(placement: &Placement, [present, best]: [f64; 2]) -> String {
    let percent = |side: f32| f64::from(side / 3.2).abs();
    let mut parts = Vec::new();
    if (placement.scale - 1.0).abs() > 0.01 {
        parts.push(format!("{} times as large", rounded(f64::from(placement.scale))));
    }
    let Vec2 { x, y } = placement.shift;
    if x != 0.0 {
        let side = if x < 0.0 { "left" } else { "right" };
        parts.push(format!("{:.1} % of the width farther {side}", percent(x)));
    }
    if y != 0.0 {
        let side = if y < 0.0 { "up" } else { "down" };
        parts.push(format!("{:.1} % of the width farther {side}", percent(y)));
    }
    format!(
        "depth does not fit colour: its edges would be at edges of colour if it were {} (contrast there {best:.2} instead of \
         {present:.2} times the mean); depth is not registered to colour, or was registered twice: check \
         dataset.register_depth and the calibration",
        parts.join(" and ")
    )
}

//! Whether given poses explain the motion that the images show, and if not, which other way of reading them does.

use super::format_fit::{FormatFit, Pair, formats, motion};
use super::seen_motion::{SeenFrame, SeenMotion, SmallFrame, image_motion};
use super::units::{mistaken_unit, remedy, rounded};
use crate::{DoubtKind, InputDoubt, se3};
use splatseg_geometry::{CameraFrame, Pose, PoseFormat};
use std::collections::VecDeque;

/// Pairs of frames count whose motion is at least this, radians in the image, so that errors of the alignment do not
/// matter.
const MIN_MOTION: f64 = 0.03;

/// Poses are judged by at least this many pairs, at the end by one less...
const MIN_PAIRS: usize = 4;
/// ...and by at most this many, the latest ones.
const MAX_PAIRS: usize = 12;
/// Poses that no reading explains are judged by at least this many.
const MIN_UNEXPLAINED_PAIRS: usize = 8;

/// Pairs are sought in every frame until poses explain [`MIN_PAIRS`], [`MAX_PAIRS`] are found, or after this many attempts.
const FIRST_ATTEMPTS: usize = 30;
/// After that, a pair is sought after this many frames.
const LATER_STRIDE: usize = 64;
/// Number of attempts to find one.
const LATER_ATTEMPTS: usize = 3;

/// Poses are doubted if they leave at least this share of the motion unexplained...
const MIN_UNEXPLAINED: f64 = 0.45;
/// ...and another reading leaves at most this share...
const MAX_UNEXPLAINED: f64 = 0.3;
/// ...and at most this share of what they leave...
const MAX_RELATIVE: f64 = 0.4;
/// ...and does better in at least this share of the pairs.
const MIN_BETTER: f64 = 0.75;
/// Poses that no reading explains are doubted if they leave at least this share.
const MIN_CONTRADICTED: f64 = 0.8;

/// Units of length are doubted if they differ by more than this factor...
const MIN_RATIO: f64 = 1.5;
/// ...and rotations leave at most this share unexplained.
const MAX_TURN_UNEXPLAINED: f64 = 0.2;
/// A unit of positions that programs use for poses instead of metres.
const POSE_UNITS: [f64; 2] = [0.01, 0.001];
/// A measured unit is one of them if it differs by less than this factor.
const SAME_UNIT: f64 = 1.35;

/// Positions that differ by less are the same, metres, and times their distance from the origin.
const SAME_POSITION: f64 = 1e-9;
/// A camera moves for certain if its translation moves surfaces in the image by at least this, radians...
const CLEAR_TRANSLATION: f64 = 0.01;
/// ...and by this share of what its rotation does: a turn may be mistaken for some translation.
const CLEAR_SHARE: f64 = 0.2;
/// Stated rotations above this are no rounding, radians.
const CLEAR_TURN: f64 = 0.01;

/// Median depth at which the unit of depth is not doubted if that of positions may be wrong, metres.
const ROOM_DEPTH: std::ops::RangeInclusive<f64> = 0.3..=15.0;

/// Checks given poses against the images.
#[derive(Clone, Debug)]
pub(crate) struct PoseCheck {
    /// How the poses are read at present.
    format: PoseFormat,
    earlier: Option<Earlier>,
    pairs: VecDeque<Pair>,
    /// Number of the next frame.
    number: usize,
    /// The next frame that may be compared.
    next: usize,
    attempts: usize,
    found: usize,
    is_told: bool,
}

/// The frame that later ones are compared with.
#[derive(Clone, Debug)]
struct Earlier {
    seen: SeenFrame,
    /// Its pose, as stated.
    stated: Pose,
    number: usize,
}

impl PoseCheck {
    /// Creates a check of poses that were read in a certain way.
    pub(super) fn new(format: PoseFormat) -> Self {
        let (number, next, attempts, found) = (0, 0, 0, 0);
        let pairs = VecDeque::new();
        Self { format, earlier: None, pairs, number, next, attempts, found, is_told: false }
    }

    /// Adds a frame with its given pose. Returns a doubt once the frames justify it.
    pub(super) fn add(&mut self, frame: &CameraFrame<'_>, given: &Pose) -> Option<InputDoubt> {
        let number = self.number;
        self.number += 1;
        if self.is_told || number < self.next {
            return None;
        }
        let stated = self.format.stated(given);
        let Some(earlier) = self.earlier.take() else {
            self.start(SmallFrame::new(frame, None).as_ref(), stated, number);
            return None;
        };
        let gap = number - earlier.number;
        let candidates: Vec<Pose> =
            formats(self.format.scale).map(|format| motion(&[earlier.stated, stated], &format)).collect();
        let given_size = candidates.iter().map(|motion| image_motion(motion, earlier.seen.median_depth));
        if given_size.fold(0.0, f64::max) < MIN_MOTION && !gap.is_power_of_two() {
            self.earlier = Some(earlier);
            return None;
        }
        self.attempts += 1;
        let small = SmallFrame::new(frame, Some(&earlier.seen));
        let seen = small.as_ref().and_then(|small| earlier.seen.motion_to(small, &with_turns(candidates)));
        match seen {
            Some(seen) if seen.size() < MIN_MOTION && !self.is_exhausted() => {
                (self.next, self.earlier) = (number + gap, Some(earlier));
                None
            }
            Some(seen) if seen.size() >= MIN_MOTION => {
                self.add_pair([earlier.stated, stated], seen);
                let doubt = self.doubt(false);
                self.start(small.as_ref(), stated, number);
                doubt
            }
            _ => {
                self.start(small.as_ref(), stated, number);
                None
            }
        }
    }

    /// A doubt at the end of the frames, if those that have come justify it.
    pub(super) fn last_doubt(&mut self) -> Option<InputDoubt> {
        self.doubt(true)
    }

    fn add_pair(&mut self, stated: [Pose; 2], seen: SeenMotion) {
        self.found += 1;
        if self.pairs.len() >= MAX_PAIRS {
            self.pairs.pop_front();
        }
        self.pairs.push_back(Pair { stated, seen });
    }

    /// True if no pair is sought before some more frames have come.
    fn is_exhausted(&self) -> bool {
        self.attempts >= FIRST_ATTEMPTS || self.found >= MAX_PAIRS
    }

    /// Compares the next frames with this one, or waits for some.
    fn start(&mut self, frame: Option<&SmallFrame>, stated: Pose, number: usize) {
        self.next = number + 1;
        if self.is_exhausted() {
            self.next = number + LATER_STRIDE;
            self.attempts = FIRST_ATTEMPTS - LATER_ATTEMPTS;
            self.found = MAX_PAIRS - 1;
            return;
        }
        let seen = frame.and_then(SeenFrame::new);
        self.earlier = seen.map(|seen| Earlier { seen, stated, number });
    }

    fn doubt(&mut self, is_last: bool) -> Option<InputDoubt> {
        if self.pairs.len() + usize::from(is_last) < MIN_PAIRS || self.is_told {
            return None;
        }
        let pairs: Vec<Pair> = self.pairs.iter().copied().collect();
        let given = FormatFit::new(&pairs, self.format);
        if given.error <= MAX_UNEXPLAINED {
            self.attempts = FIRST_ATTEMPTS;
        }
        let doubt = only_turns(&pairs, &given)
            .or_else(|| wrong_unit(&pairs, &given))
            .or_else(|| wrong_reading(&pairs, &given, is_last));
        self.is_told = doubt.is_some();
        doubt
    }
}

/// Motions, and their rotations alone: the unit of positions may be wrong.
fn with_turns(motions: Vec<Pose>) -> Vec<Pose> {
    let turns: Vec<Pose> = motions.iter().map(|motion| motion.scaled(0.0)).collect();
    motions.into_iter().chain(turns).collect()
}

/// A doubt about poses with orientations only: rotations fit, and the positions never change although the camera moves.
fn only_turns(pairs: &[Pair], given: &FormatFit) -> Option<InputDoubt> {
    let mut positions =
        pairs.iter().flat_map(|pair| pair.stated).map(|stated| given.format.pose(&stated).translation());
    let first = positions.next()?;
    let stands = positions.all(|position| position.distance(first) <= SAME_POSITION * (1.0 + first.length()));
    let turns = pairs.iter().any(|pair| se3::size(&motion(&pair.stated, &given.format)).1 > CLEAR_TURN);
    let is_moved = |pair: &&Pair| {
        let (translation, rotation) = se3::size(&pair.seen.motion);
        translation >= CLEAR_TRANSLATION.max(CLEAR_SHARE * rotation) * pair.seen.depth
    };
    let moved = pairs.iter().filter(is_moved).count();
    if !stands || !turns || given.rotation_error > MAX_TURN_UNEXPLAINED || moved < MIN_PAIRS {
        return None;
    }
    let text = format!(
        "the positions of the given poses never change, but {moved} pairs of frames show that the camera moves: the poses may \
         have orientations only; track the camera with --poses track"
    );
    Some(InputDoubt { kind: DoubtKind::Poses, text })
}

/// A doubt about units: rotations fit, and the lengths of translations differ by the same factor.
fn wrong_unit(pairs: &[Pair], given: &FormatFit) -> Option<InputDoubt> {
    let ratio = given.ratio.filter(|ratio| ratio.ln().abs() > MIN_RATIO.ln())?;
    let fitted = given.with_fitted_unit(pairs)?;
    if given.rotation_error > MAX_TURN_UNEXPLAINED || fitted.error > MAX_UNEXPLAINED.min(given.error) {
        return None;
    }
    let mut depths: Vec<f64> = pairs.iter().map(|pair| pair.seen.depth).collect();
    depths.sort_by(f64::total_cmp);
    let depth = depths[depths.len() / 2];
    let factor = 1.0 / ratio;
    let found = format!(
        "given poses and depth have different units: between {} pairs of frames, depth shows {} times the given motion",
        pairs.len(),
        rounded(ratio)
    );
    let is_room = ROOM_DEPTH.contains(&depth);
    let pose_unit = POSE_UNITS.into_iter().find(|unit| (ratio / unit).ln().abs() < SAME_UNIT.ln());
    let scale = given.format.scale;
    let set_scale = |unit: f64| format!("set dataset.pose_scale = {} (--pose-scale)", rounded(scale * unit));
    Some(match pose_unit.filter(|_| is_room) {
        Some(unit) => {
            let name = if unit < 0.005 { "millimetres" } else { "centimetres" };
            let text = format!("{found}: the positions may be in {name}; {}", set_scale(unit));
            InputDoubt { kind: DoubtKind::Poses, text }
        }
        None if mistaken_unit(factor).is_some() || !is_room => InputDoubt {
            kind: DoubtKind::DepthUnit,
            text: format!(
                "{found}: the median depth of {} m would be {} m, if you {}",
                rounded(depth),
                rounded(depth * factor),
                remedy(factor)
            ),
        },
        None => {
            let text = format!(
                "{found}: if depth is in the right unit, {}; otherwise {}; a wrong focal length looks alike, and --fx \
                 gives another one",
                set_scale(ratio),
                remedy(factor)
            );
            InputDoubt { kind: DoubtKind::Poses, text }
        }
    })
}

/// A doubt about the reading of poses.
fn wrong_reading(pairs: &[Pair], given: &FormatFit, is_last: bool) -> Option<InputDoubt> {
    if given.error < MIN_UNEXPLAINED {
        return None;
    }
    let mut fits: Vec<FormatFit> = formats(given.format.scale).map(|format| FormatFit::new(pairs, format)).collect();
    let refitted = |fit: &FormatFit| {
        let in_unit = |unit| FormatFit::new(pairs, PoseFormat { scale: fit.format.scale * unit, ..fit.format });
        // A camera that only turns does not tell by how much translations are too long.
        fit.with_fitted_unit(pairs).into_iter().chain(POSE_UNITS.map(in_unit)).collect::<Vec<_>>()
    };
    let refitted: Vec<FormatFit> = fits.iter().flat_map(refitted).collect();
    fits.extend(refitted);
    fits.sort_by(|one, other| one.rank().total_cmp(&other.rank()));
    let best = fits.first()?;
    let better = best.pair_errors.iter().zip(&given.pair_errors).filter(|(best, given)| best < given).count();
    let is_better = better as f64 >= MIN_BETTER * pairs.len() as f64;
    let explains = best.error <= MAX_UNEXPLAINED.min(MAX_RELATIVE * given.error) && is_better;
    let percent = |error: f64| (error * 100.0).min(100.0);
    if explains {
        let others = fits.iter().skip(1).filter(|fit| fit.format.convention() != best.format.convention());
        // More pairs will tell which, as far as there are any.
        let is_clear = others.map(|fit| fit.error).fold(f64::INFINITY, f64::min) > best.error + 0.1;
        if !is_clear && pairs.len() < MAX_PAIRS && !is_last {
            return None;
        }
        let text = format!(
            "the given poses do not fit the images, but they do as {}: of the motion between {} pairs of frames they leave \
             {:.0} % unexplained, and {:.0} % with {}",
            described(&best.format, &given.format),
            pairs.len(),
            percent(given.error),
            percent(best.error),
            settings(&best.format, &given.format)
        );
        return Some(InputDoubt { kind: DoubtKind::Poses, text });
    }
    unexplained(pairs, given)
}

/// A doubt about poses that no reading explains.
fn unexplained(pairs: &[Pair], given: &FormatFit) -> Option<InputDoubt> {
    let contradicted = given.pair_errors.iter().zip(pairs).filter(|(error, pair)| **error > 0.5 * pair.seen.size());
    let most = contradicted.count() as f64 >= MIN_BETTER * pairs.len() as f64;
    if pairs.len() < MIN_UNEXPLAINED_PAIRS || given.error < MIN_CONTRADICTED || !most {
        return None;
    }
    let moved = pairs.iter().map(|pair| image_motion(&motion(&pair.stated, &given.format), pair.seen.depth));
    let seen: f64 = pairs.iter().map(|pair| pair.seen.size()).sum();
    let what = if moved.sum::<f64>() < 0.2 * seen { "stand still, but" } else { "do not fit the images:" };
    let text = format!(
        "the given poses {what} {} pairs of frames show another motion of the camera, which no known convention explains; \
         choose another source of poses, or track the camera with --poses track",
        pairs.len()
    );
    Some(InputDoubt { kind: DoubtKind::Poses, text })
}

/// The measured unit of positions, or the usual one that it is about.
fn usual_scale(best: &PoseFormat, given: &PoseFormat) -> String {
    let ratio = best.scale / given.scale;
    let unit = POSE_UNITS.into_iter().find(|unit| (ratio / unit).ln().abs() < SAME_UNIT.ln());
    rounded(unit.map_or(best.scale, |unit| given.scale * unit))
}

/// Convention of the poses, where it differs from how they are read.
fn described(best: &PoseFormat, given: &PoseFormat) -> String {
    let mut parts = Vec::new();
    if best.w_first != given.w_first {
        let order = if best.w_first { "first" } else { "last" };
        parts.push(format!("poses whose quaternions have w {order}"));
    }
    if best.convention() != given.convention() {
        parts.push(format!("{} poses", best.convention()));
    }
    if best.scale != given.scale {
        parts.push(match usual_scale(best, given).as_str() {
            "0.01" => "positions in centimetres".to_owned(),
            "0.001" => "positions in millimetres".to_owned(),
            scale => format!("positions in units of {scale} m"),
        });
    }
    parts.join(" and ")
}

/// The settings that change the reading.
fn settings(best: &PoseFormat, given: &PoseFormat) -> String {
    let mut parts = Vec::new();
    if best.w_first != given.w_first {
        let order = if best.w_first { "wxyz" } else { "xyzw" };
        parts.push(format!("dataset.quaternion_order = {order} (--quaternion-order {order})"));
    }
    if best.convention() != given.convention() {
        let name = best.convention();
        parts.push(format!("dataset.pose_convention = {name} (--pose-convention {name})"));
    }
    if best.scale != given.scale {
        let scale = usual_scale(best, given);
        parts.push(format!("dataset.pose_scale = {scale} (--pose-scale {scale})"));
    }
    parts.join(" and ")
}

//! Which segments of a keyframe have moved by themselves, in one aligned frame.
//!
//! Each segment has its own 6×6 system at the aligned pose. The pose that all other segments ask for is computed without
//! those that move; a segment moves if its own measurements contradict that pose more than noise explains. The segment
//! that contradicts most is left out first, since all others contradict a pose that a large mover drags along.

use crate::keyframe::{Aligned, Reference};
use crate::linear::Matrix6;
use crate::prior::unscaled;
use crate::pyramid::Pyramid;
use crate::se3::Twist;
use crate::sums::Sums;
use splatseg_geometry::{Cholesky, SegmentId};
use std::collections::{BTreeMap, BTreeSet};

/// Parts of the image in which the typical contradiction is measured: columns and rows.
const PARTS: (usize, usize) = (3, 2);

/// Information about the pose that is known without the images, 1/m²: a deviation of 4.5 cm.
const PRIOR_INFORMATION: f64 = 500.0;

/// Segments with less than this share of the visible points are not judged.
const MIN_SHARE: f32 = 0.005;

/// A segment with more than this share of the points that stand still is the world, not a thing in it.
const MAX_SHARE: f32 = 0.5;

/// At most this many segments are left out.
const MAX_MOVING: usize = 8;

/// Contradictions are judged by at least this many of the image's parts.
const MIN_PARTS: usize = 3;

/// The system of some points, in the coordinates of [`crate::prior::scaled`].
#[derive(Clone, Copy, Default)]
struct System {
    hessian: Matrix6,
    gradient: Twist,
    points: f32,
}

/// The systems of one frame.
pub(crate) struct MotionTest {
    /// By segment and part of the image.
    systems: BTreeMap<(SegmentId, usize), System>,
}

/// Evidence of one frame about its segments.
pub(crate) struct Motions {
    /// How much each segment contradicts the pose of those that stand still: half a squared deviation for each direction
    /// that noise explains.
    pub(crate) contradictions: BTreeMap<SegmentId, f32>,
    /// Median contradiction of parts of the image that stand still, if there are enough.
    pub(crate) typical: Option<f32>,
}

impl MotionTest {
    /// Prepares the test. `None` if the keyframe has fewer than two segments.
    pub(crate) fn new(reference: &Reference, frame: &Pyramid, aligned: &Aligned) -> Option<Self> {
        if !reference.has_segments() {
            return None;
        }
        let sums = reference.segment_sums(frame, aligned, PARTS);
        let systems = sums.iter().map(|(key, block)| (*key, System::of(block))).collect();
        Some(Self { systems })
    }

    /// Judges all segments. Those that contradict more than `limit` are left out.
    pub(crate) fn motions(&self, limit: f32) -> Motions {
        let segments = merged(self.systems.iter().map(|((id, _), system)| (*id, system)));
        let mut still = System::default();
        segments.values().for_each(|system| still.add(system));
        let least = MIN_SHARE * still.points;
        let mut moving = BTreeSet::new();
        while moving.len() < MAX_MOVING {
            let candidates = segments.iter().filter(|(id, system)| {
                **id != 0 && !moving.contains(*id) && (least..=MAX_SHARE * still.points).contains(&system.points)
            });
            let judged = candidates.map(|(id, system)| (*id, system.contradiction(&still.without(system))));
            let most = judged.max_by(|one, other| one.1.total_cmp(&other.1));
            let Some((id, _)) = most.filter(|(_, contradiction)| *contradiction > limit) else { break };
            moving.insert(id);
            still = still.without(&segments[&id]);
        }
        let contradiction = |id: &SegmentId, system: &System| {
            let rest = if moving.contains(id) { still } else { still.without(system) };
            if system.points > MAX_SHARE * still.points && !moving.contains(id) {
                0.0
            } else {
                system.contradiction(&rest)
            }
        };
        let judged = segments.iter().filter(|(id, system)| **id != 0 && system.points >= least);
        Motions {
            contradictions: judged.map(|(id, system)| (*id, contradiction(id, system))).collect(),
            typical: self.typical(&moving, &still),
        }
    }

    fn typical(&self, moving: &BTreeSet<SegmentId>, still: &System) -> Option<f32> {
        let parts = self.systems.iter().filter(|((id, _), _)| !moving.contains(id));
        let parts = merged(parts.map(|((_, part), system)| (*part as SegmentId, system)));
        let mut found: Vec<f32> = parts
            .values()
            .filter(|part| part.points >= 0.05 * still.points)
            .map(|part| part.contradiction(&still.without(part)))
            .collect();
        found.sort_by(f32::total_cmp);
        (found.len() >= MIN_PARTS).then(|| found[found.len() / 2])
    }
}

/// Sums of systems with the same key.
fn merged<'a>(systems: impl Iterator<Item = (SegmentId, &'a System)>) -> BTreeMap<SegmentId, System> {
    let mut merged: BTreeMap<SegmentId, System> = BTreeMap::new();
    for (key, system) in systems {
        merged.entry(key).or_default().add(system);
    }
    merged
}

impl System {
    fn of(block: &Sums) -> Self {
        let mut sums = Sums::default();
        sums.add(block);
        let factors = unscaled(&[1.0; 6]);
        let hessian = sums.hessian();
        let element = |row: usize, column: usize| hessian[row][column] * factors[row] * factors[column];
        let hessian = std::array::from_fn(|row| std::array::from_fn(|column| element(row, column)));
        Self { hessian, gradient: unscaled(&sums.gradient()), points: sums.counts.visible }
    }

    fn add(&mut self, other: &Self) {
        for (row, more) in self.hessian.iter_mut().zip(&other.hessian) {
            row.iter_mut().zip(more).for_each(|(element, more)| *element += more);
        }
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(element, more)| *element += more);
        self.points += other.points;
    }

    fn without(&self, other: &Self) -> Self {
        let hessian = std::array::from_fn(|row| {
            std::array::from_fn(|column| self.hessian[row][column] - other.hessian[row][column])
        });
        let gradient = std::array::from_fn(|row| self.gradient[row] - other.gradient[row]);
        Self { hessian, gradient, points: self.points - other.points }
    }

    /// How much these points contradict the pose that `rest` asks for: gᵀ (H + H P H)⁻¹ g, where g is the gradient at that
    /// pose and P the pose's covariance.
    fn contradiction(&self, rest: &Self) -> f32 {
        let Some(factor) = Cholesky::new(&rest.hessian, PRIOR_INFORMATION) else { return 0.0 };
        let step = factor.solve(&rest.gradient);
        let moved = product(&self.hessian, &step);
        let gradient: Twist = std::array::from_fn(|row| self.gradient[row] - moved[row]);
        // P H, column by column; H is symmetric.
        let columns: Matrix6 = std::array::from_fn(|column| factor.solve(&self.hessian[column]));
        let covariance: Matrix6 = std::array::from_fn(|row| {
            let along = product(&self.hessian, &columns[row]);
            std::array::from_fn(|column| self.hessian[row][column] + along[column])
        });
        let Some(factor) = Cholesky::new(&covariance, 1.0) else { return 0.0 };
        factor.solve(&gradient).iter().zip(&gradient).map(|(one, other)| one * other).sum::<f64>() as f32
    }
}

fn product(matrix: &Matrix6, vector: &Twist) -> Twist {
    std::array::from_fn(|row| matrix[row].iter().zip(vector).map(|(one, other)| one * other).sum())
}

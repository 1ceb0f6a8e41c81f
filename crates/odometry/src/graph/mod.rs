//! The graph of keyframes' relative poses, and its correction when a loop is closed.
//!
//! An edge is a measured relative pose `from_from_to` with its information, the inverse covariance of its error as a
//! twist from the left in the coordinates of `from`. The poses minimise the sum of the edges' squared errors
//! `log(from_from_to_of_the_poses · measured⁻¹)`, with robust weights (Huber) for loops, by Gauss-Newton steps.

mod sparse;

use crate::keyframes::KeyframeStore;
use crate::linear::{Eigen, Matrix6};
use crate::prior::{scaled, unscaled};
use crate::se3::{self, Twist};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sparse::{BlockSystem, multiplied, product, transposed};
use splatseg_geometry::{KeyframeId, Pose};
use std::collections::{BTreeMap, BTreeSet};

/// Errors of a measured relative pose that the alignment does not know of, metres per direction, as in [`scaled`]:
/// distortion of the sensor, exposure with a rolling shutter.
const SYSTEMATIC_ERROR: f64 = 0.004;

/// A loop with an error of more than this many deviations counts for less.
const HUBER: f64 = 3.0;

const ITERATIONS: usize = 12;

/// Steps below this are the last, metres and radians: what remains after them is far less.
const CONVERGED: f64 = 1e-4;

/// How far a keyframe is away in a graph: a turn by a radian counts as this many metres.
const METRES_PER_RADIAN: f64 = 0.5;

/// A measured relative pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Edge {
    pub(crate) from: KeyframeId,
    pub(crate) to: KeyframeId,
    /// Pose of `to` in the coordinates of `from`.
    pub(crate) measured: Pose,
    pub(crate) information: Matrix6,
    pub(crate) kind: EdgeKind,
}

impl Edge {
    /// An edge that was measured by tracking. `hessian` is the information of the alignment.
    pub(crate) fn tracked(from: KeyframeId, to: KeyframeId, measured: Pose, hessian: Option<&Matrix6>) -> Self {
        Self { from, to, measured, information: information(hessian), kind: EdgeKind::Tracked }
    }

    /// Attaches the edge of a dropped keyframe to the one that replaces it.
    pub(crate) fn replace(&mut self, dropped: KeyframeId, kept: KeyframeId, kept_from_dropped: &Pose) {
        if self.from == dropped {
            (self.from, self.measured) = (kept, *kept_from_dropped * self.measured);
            // The error is a twist in the coordinates of `from`.
            let dropped_from_kept = adjoint(&kept_from_dropped.inverse());
            self.information =
                product(&product(&transposed(&dropped_from_kept), &self.information), &dropped_from_kept);
        } else if self.to == dropped {
            (self.to, self.measured) = (kept, self.measured * kept_from_dropped.inverse());
        }
    }
}

/// How a relative pose was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum EdgeKind {
    /// By tracking from one keyframe to the next.
    Tracked,
    /// By recognising a place. It may be wrong.
    Loop,
    /// The poses came with the frames. They do not drift.
    Given,
}

/// The edges between all keyframes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PoseGraph {
    pub(crate) edges: Vec<Edge>,
}

/// The information of a measured pose: that of its alignment, limited by errors that the alignment does not know of.
pub(crate) fn information(hessian: Option<&Matrix6>) -> Matrix6 {
    let Some(hessian) = hessian else {
        return diagonal(|k| if k < 3 { 1.0 / (0.02 * 0.02) } else { 1.0 / (0.01 * 0.01) });
    };
    let factors = unscaled(&[1.0; 6]);
    let in_metres: Matrix6 =
        std::array::from_fn(|row| std::array::from_fn(|column| hessian[row][column] * factors[row] * factors[column]));
    let system = Eigen::new(&in_metres);
    let limited = system.values.map(|value| {
        let value = value.max(1.0);
        value / (1.0 + value * SYSTEMATIC_ERROR * SYSTEMATIC_ERROR)
    });
    let factors = scaled(&[1.0; 6]);
    let unit = |k: usize| std::array::from_fn(|row| f64::from(u8::from(row == k)));
    // Column by column: V diag(limited) Vᵀ.
    let columns: [Twist; 6] = std::array::from_fn(|column| {
        let along = system.along(&unit(column));
        system.combined(&std::array::from_fn(|k| along[k] * limited[k]))
    });
    std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row] * factors[row] * factors[column]))
}

fn diagonal(value: impl Fn(usize) -> f64) -> Matrix6 {
    std::array::from_fn(|row| std::array::from_fn(|column| if row == column { value(row) } else { 0.0 }))
}

impl PoseGraph {
    pub(crate) fn add(&mut self, edge: Edge) {
        if edge.from != edge.to {
            self.edges.push(edge);
        }
    }

    /// Attaches the edges of a dropped keyframe to the one that replaces it.
    pub(crate) fn replace(&mut self, dropped: KeyframeId, kept: KeyframeId, kept_from_dropped: &Pose) {
        self.edges.iter_mut().for_each(|edge| edge.replace(dropped, kept, kept_from_dropped));
        // One edge per pair is enough, so that their number stays bounded.
        let mut known = BTreeSet::new();
        self.edges.retain(|edge| {
            let pair = (edge.from.min(edge.to), edge.from.max(edge.to));
            edge.from != edge.to && (known.insert(pair) || ![edge.from, edge.to].contains(&kept))
        });
    }

    /// Length of the shortest path from a keyframe to every other one that is connected with it, metres.
    pub(crate) fn path_lengths(&self, start: KeyframeId) -> BTreeMap<KeyframeId, f64> {
        let mut neighbours: BTreeMap<KeyframeId, Vec<(KeyframeId, f64)>> = BTreeMap::new();
        for edge in &self.edges {
            let (distance, angle) = se3::size(&edge.measured);
            let length = if edge.kind == EdgeKind::Given { 0.0 } else { distance + METRES_PER_RADIAN * angle };
            neighbours.entry(edge.from).or_default().push((edge.to, length));
            neighbours.entry(edge.to).or_default().push((edge.from, length));
        }
        let mut lengths = BTreeMap::from([(start, 0.0)]);
        // Lengths in micrometres, so that they can be sorted.
        let mut open = BTreeSet::from([(0u64, start)]);
        while let Some((_, id)) = open.pop_first() {
            let so_far = lengths[&id];
            for (other, length) in neighbours.get(&id).into_iter().flatten() {
                let total = so_far + length;
                if lengths.get(other).is_none_or(|known| total < *known) {
                    lengths.insert(*other, total);
                    open.insert(((total * 1e6) as u64, *other));
                }
            }
        }
        lengths
    }

    /// Computes the poses of all keyframes that are connected with `within`. The earliest of them stays where it is.
    pub(crate) fn optimised(&self, store: &KeyframeStore, within: KeyframeId) -> BTreeMap<KeyframeId, Pose> {
        let connected = self.path_lengths(within);
        let ids: Vec<KeyframeId> = connected.into_keys().collect();
        let numbers: BTreeMap<KeyframeId, usize> = ids.iter().enumerate().map(|(number, id)| (*id, number)).collect();
        let mut poses: Vec<Pose> =
            ids.iter().map(|id| store.get(*id).map_or(Pose::IDENTITY, |keyframe| keyframe.world_from_key)).collect();
        let edges: Vec<(usize, usize, &Edge)> = self
            .edges
            .iter()
            .filter_map(|edge| Some((*numbers.get(&edge.from)?, *numbers.get(&edge.to)?, edge)))
            .collect();
        let (mut damping, mut cost) = (1e-4, cost(&edges, &poses));
        for _ in 0..ITERATIONS {
            let Some(step) = step(&edges, &poses, damping) else { break };
            let moved: Vec<Pose> =
                poses.iter().zip(&step).map(|(pose, twist)| *pose * se3::exponential(twist)).collect();
            let new_cost = self::cost(&edges, &moved);
            if new_cost > cost {
                damping *= 10.0;
                continue;
            }
            (poses, cost, damping) = (moved, new_cost, damping * 0.1);
            let largest = step.iter().flatten().fold(0.0f64, |largest, part| largest.max(part.abs()));
            if largest < CONVERGED {
                break;
            }
        }
        ids.into_iter().zip(poses).collect()
    }
}

/// Error of an edge as a twist.
fn error(edge: &Edge, from: &Pose, to: &Pose) -> Twist {
    se3::logarithm(&(from.inverse() * *to * edge.measured.inverse()))
}

/// Squared error of an edge in units of its deviation.
fn squared(edge: &Edge, error: &Twist) -> f64 {
    multiplied(&edge.information, error).iter().zip(error).map(|(one, other)| one * other).sum()
}

/// Huber's weight.
fn weight(edge: &Edge, error: &Twist) -> f64 {
    let deviations = squared(edge, error).max(0.0).sqrt();
    if (edge.kind == EdgeKind::Loop) && deviations > HUBER { HUBER / deviations } else { 1.0 }
}

fn cost(edges: &[(usize, usize, &Edge)], poses: &[Pose]) -> f64 {
    let costs = edges.iter().map(|(from, to, edge)| {
        let squared = squared(edge, &error(edge, &poses[*from], &poses[*to])).max(0.0);
        if (edge.kind == EdgeKind::Loop) && squared > HUBER * HUBER {
            HUBER * (2.0 * squared.sqrt() - HUBER)
        } else {
            squared
        }
    });
    costs.sum()
}

/// A Gauss-Newton step: a twist for each pose, applied from the right.
fn step(edges: &[(usize, usize, &Edge)], poses: &[Pose], damping: f64) -> Option<Vec<Twist>> {
    let mut system = BlockSystem::new(poses.len());
    for (from, to, edge) in edges {
        let relative = poses[*from].inverse() * poses[*to];
        let error = error(edge, &poses[*from], &poses[*to]);
        let weight = weight(edge, &error);
        let information = edge.information.map(|row| row.map(|part| part * weight));
        let [by_from, by_to] = derivatives(&relative, &error);
        for (row, left) in [(*from, &by_from), (*to, &by_to)] {
            let weighted = product(&transposed(left), &information);
            let right = multiplied(&weighted, &error);
            system.add_right(row, &right.map(|part| -part));
            system.add(row, row, &product(&weighted, left));
        }
        let weighted = product(&transposed(&by_from), &information);
        system.add(*from, *to, &product(&weighted, &by_to));
    }
    system.damp(damping);
    // The first keyframe stays.
    system.add(0, 0, &diagonal(|_| 1e12));
    system.solve()
}

/// Derivatives of an edge's error with respect to twists of its two poses, applied from the right. To first order in the
/// error.
fn derivatives(relative: &Pose, error: &Twist) -> [Matrix6; 2] {
    let offset = DVec3::from_slice(&error[..3]);
    let (rotation, translation) = (relative.rotation(), relative.translation());
    let by_from = blocks(-DMat3::IDENTITY, skew(offset), -DMat3::IDENTITY);
    let turned = skew(translation) * rotation - skew(offset) * rotation;
    let by_to = blocks(rotation, turned, rotation);
    [by_from, by_to]
}

/// A matrix of translation by translation, translation by rotation and rotation by rotation.
fn blocks(translations: DMat3, mixed: DMat3, rotations: DMat3) -> Matrix6 {
    let part = |matrix: &DMat3, row: usize, column: usize| matrix.col(column)[row];
    std::array::from_fn(|row| {
        std::array::from_fn(|column| match (row < 3, column < 3) {
            (true, true) => part(&translations, row, column),
            (true, false) => part(&mixed, row, column - 3),
            (false, true) => 0.0,
            (false, false) => part(&rotations, row - 3, column - 3),
        })
    })
}

/// The matrix that takes twists to other coordinates.
fn adjoint(new_from_old: &Pose) -> Matrix6 {
    let rotation = new_from_old.rotation();
    blocks(rotation, skew(new_from_old.translation()) * rotation, rotation)
}

fn skew(axis: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn edge(measured: Pose) -> Edge {
        Edge { from: 0, to: 1, measured, information: diagonal(|_| 1.0), kind: EdgeKind::Tracked }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn derivatives_are_those_of_finite_differences(
            from in prop::array::uniform6(-1.0f64..1.0), to in prop::array::uniform6(-1.0f64..1.0),
            offset in prop::array::uniform6(-0.02f64..0.02),
        ) {
            let (from, to) = (se3::exponential(&from), se3::exponential(&to));
            let edge = edge(se3::exponential(&offset).inverse() * from.inverse() * to);
            let at_zero = error(&edge, &from, &to);
            let derivatives = derivatives(&(from.inverse() * to), &at_zero);
            for (which, derivative) in derivatives.iter().enumerate() {
                for column in 0..6 {
                    let mut twist = [0.0; 6];
                    twist[column] = 1e-6;
                    let moved = se3::exponential(&twist);
                    let after = match which { 0 => error(&edge, &(from * moved), &to), _ => error(&edge, &from, &(to * moved)) };
                    for row in 0..6 {
                        let difference = (after[row] - at_zero[row]) / 1e-6;
                        prop_assert!((difference - derivative[row][column]).abs() < 0.03, "{which} {row} {column}");
                    }
                }
            }
        }
    }

    #[test]
    fn information_is_limited_and_keeps_weak_directions_weak() {
        let strong = information(Some(&diagonal(|k| if k == 0 { 4.0 } else { 1e9 })));
        assert!((strong[0][0] - 4.0).abs() < 0.01, "{strong:?}");
        let limit = 1.0 / (SYSTEMATIC_ERROR * SYSTEMATIC_ERROR);
        assert!((strong[1][1] / limit - 1.0).abs() < 0.01 && strong[4][4] < 4.1 * limit, "{strong:?}");
    }

    #[test]
    fn paths_are_the_shortest_ones() {
        let step = |from, to, x| Edge { from, to, ..edge(Pose::from_translation(DVec3::X * x)) };
        let graph = PoseGraph { edges: vec![step(0, 1, 1.0), step(1, 2, 1.0), step(0, 2, 0.5), step(4, 5, 1.0)] };
        let lengths = graph.path_lengths(0);
        assert_eq!(lengths, BTreeMap::from([(0, 0.0), (1, 1.0), (2, 0.5)]));
        let mut graph = graph;
        graph.replace(2, 0, &Pose::from_translation(DVec3::X * 0.5));
        assert_eq!(graph.edges.len(), 2);
    }
}

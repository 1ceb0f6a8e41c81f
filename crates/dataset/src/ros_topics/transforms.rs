//! The tree of coordinate frames in `/tf` and `/tf_static`, and lookup of transforms by time.

use super::clock::{Order, Recorded, Stamped, Timeline};
use super::stream_clock::SetBack;
use glam::{DQuat, DVec3};
use splatseg_geometry::{Pose, PoseError};
use std::collections::BTreeMap;

/// A rigid transform from one frame to another, in the precision of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rigid {
    pub(crate) translation: DVec3,
    /// Unit quaternion.
    pub(crate) rotation: DQuat,
}

impl Rigid {
    pub(crate) const IDENTITY: Self = Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// Creates a transform; `None` for NaN, infinity, or a quaternion of length zero.
    pub(crate) fn new(translation: DVec3, rotation: DQuat) -> Option<Self> {
        let length = rotation.length();
        let usable = translation.is_finite() && length.is_finite() && length > 1e-6;
        usable.then(|| Self { translation, rotation: rotation * length.recip() })
    }

    /// Composes two transforms: `a_from_b.after(b_from_c)` is `a_from_c`.
    pub(crate) fn after(&self, inner: &Self) -> Self {
        Self {
            translation: self.rotation * inner.translation + self.translation,
            rotation: (self.rotation * inner.rotation).normalize(),
        }
    }

    pub(crate) fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { translation: -(rotation * self.translation), rotation }
    }

    pub(crate) fn to_pose(self) -> Result<Pose, PoseError> {
        Pose::from_quaternion(self.translation, self.rotation)
    }
}

/// A transform at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// Nanoseconds.
    pub(crate) stamp: i64,
    pub(crate) recorded: Recorded,
    pub(crate) transform: Rigid,
}

impl Stamped for Sample {
    const KEEPS_LAST: bool = true;

    fn stamp(&self) -> i64 {
        self.stamp
    }

    fn recorded(&self) -> Recorded {
        self.recorded
    }
}

/// A time in a recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instant {
    /// Stamp by the clock of the messages, nanoseconds.
    pub(crate) stamp: i64,
    /// Recording time, to distinguish repeated stamps.
    pub(crate) recorded: Recorded,
}

impl Stamped for Instant {
    fn stamp(&self) -> i64 {
        self.stamp
    }

    fn recorded(&self) -> Recorded {
        self.recorded
    }
}

/// Tolerances for looking up a transform by time, nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tolerance {
    /// Maximum distance from the nearest measurement, if there is none on the other side.
    pub(crate) nearest: i64,
    /// Maximum distance between two measurements for interpolating between them.
    pub(crate) gap: i64,
}

/// Returns the transform at a time: interpolated between two measurements, otherwise the nearest one; `None` if they
/// are too far away. `samples` must be in time order.
pub(crate) fn at_time(samples: &[Sample], stamp: i64, tolerance: Tolerance) -> Option<Rigid> {
    let after = samples.partition_point(|sample| sample.stamp < stamp);
    let next = samples.get(after);
    if let Some(exact) = next.filter(|next| next.stamp == stamp) {
        return Some(exact.transform);
    }
    let before = after.checked_sub(1).and_then(|before| samples.get(before));
    if let (Some(before), Some(next)) = (before, next) {
        let gap = next.stamp.saturating_sub(before.stamp);
        if gap <= tolerance.gap {
            let part = stamp.saturating_sub(before.stamp) as f64 / gap as f64;
            let translation = before.transform.translation.lerp(next.transform.translation, part);
            return Some(Rigid {
                translation,
                rotation: before.transform.rotation.slerp(next.transform.rotation, part).normalize(),
            });
        }
    }
    let apart = |sample: &&Sample| sample.stamp.abs_diff(stamp);
    let nearest = before.into_iter().chain(next).min_by_key(apart)?;
    (apart(&nearest) <= tolerance.nearest.unsigned_abs()).then_some(nearest.transform)
}

impl Timeline<Sample> {
    /// Returns the transform at an instant, as found by [`at_time`].
    pub(crate) fn at(&self, instant: Instant, tolerance: Tolerance) -> Option<Rigid> {
        at_time(&self.stretch_of(&instant)?.messages, instant.stamp, tolerance)
    }
}

/// Transform from a frame to its parent.
#[derive(Clone, Debug)]
struct Edge {
    parent: String,
    /// Last transform from `/tf_static`.
    fixed: Option<Rigid>,
    /// Transforms from `/tf`, in file order, until they are sorted.
    samples: Vec<Sample>,
    timeline: Timeline<Sample>,
    /// True if the samples differ.
    moves: bool,
    /// Transform of several equal samples: some drivers broadcast it repeatedly instead of using `/tf_static`.
    repeated: Option<Rigid>,
    /// For streams: the first sample.
    first: Option<Rigid>,
}

/// Maximum number of frames of a stream that have a parent, and of bytes in the name of one.
const MAX_FRAMES: usize = 512;
const MAX_NAME_BYTES: usize = 256;

/// All frames, each with its parent.
#[derive(Clone, Debug, Default)]
pub(crate) struct TransformTree {
    edges: BTreeMap<String, Edge>,
    /// True for a stream: a limited number of frames.
    is_streamed: bool,
}

/// A route through the tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Route {
    /// Frames whose transforms to their parents lead up from the start.
    up: Vec<String>,
    /// Frames whose transforms lead down to the end, topmost last.
    down: Vec<String>,
}

impl TransformTree {
    /// Adds a transform from `child` to `parent`. A frame keeps its first parent.
    pub(crate) fn add(&mut self, parent: &str, child: &str, sample: Sample, is_fixed: bool) {
        if let Some(edge) = self.edges.get_mut(child) {
            if edge.parent == parent {
                if is_fixed { edge.fixed = Some(sample.transform) } else { edge.samples.push(sample) }
            }
            return;
        }
        let is_too_much = self.edges.len() >= MAX_FRAMES || parent.len().max(child.len()) > MAX_NAME_BYTES;
        if self.is_streamed && is_too_much {
            return;
        }
        let (fixed, samples) = if is_fixed { (Some(sample.transform), Vec::new()) } else { (None, vec![sample]) };
        let (timeline, parent) = (Timeline::default(), parent.to_owned());
        let edge = Edge { parent, fixed, samples, timeline, moves: false, repeated: None, first: None };
        self.edges.insert(child.to_owned(), edge);
    }

    /// Creates the tree of a stream, of limited size.
    pub(crate) fn streamed() -> Self {
        Self { edges: BTreeMap::new(), is_streamed: true }
    }

    /// Sorts the transforms of a stream that were added since the last call into the others, and forgets old ones.
    pub(crate) fn arrive(&mut self) {
        for edge in self.edges.values_mut().filter(|edge| !edge.samples.is_empty()) {
            for sample in std::mem::take(&mut edge.samples) {
                let transform = sample.transform;
                edge.timeline.arrive(sample);
                if let Some(first) = edge.first {
                    edge.moves |= first != transform;
                    edge.repeated = Some(first).filter(|_| !edge.moves);
                }
                edge.first.get_or_insert(transform);
            }
            edge.timeline.trim_history();
        }
    }

    /// Forgets the moving transforms of a stream from before a clock was set back.
    pub(crate) fn restart(&mut self, at: &SetBack) {
        for edge in self.edges.values_mut() {
            edge.timeline.restart(at);
            (edge.first, edge.repeated) = (None, None);
        }
    }

    /// Returns true if transforms of a stream at a time or later are known along a route, so that nothing is missing
    /// for interpolating at that time.
    pub(crate) fn reaches(&self, route: &Route, stamp: i64) -> bool {
        let mut edges = route.up.iter().chain(&route.down).map(|frame| self.edges.get(frame));
        edges.all(|edge| edge.is_some_and(|edge| edge.fixed.is_some() || edge.timeline.newest() >= Some(stamp)))
    }

    /// Sorts all transforms by time.
    pub(crate) fn sort(&mut self, order: Order) {
        for edge in self.edges.values_mut() {
            edge.timeline = Timeline::new(std::mem::take(&mut edge.samples), order);
            let mut samples = edge.timeline.stretches.iter().flat_map(|stretch| &stretch.messages);
            let first = samples.next().map(|sample| sample.transform);
            edge.moves = samples.clone().any(|sample| Some(sample.transform) != first);
            edge.repeated = first.filter(|_| samples.next().is_some() && !edge.moves);
        }
    }

    /// Returns the number of transforms along a route whose stamps do not fit those of their neighbours.
    pub(crate) fn misfits(&self, route: &Route) -> usize {
        let edges = route.up.iter().chain(&route.down).filter_map(|frame| self.edges.get(frame));
        edges.map(|edge| edge.timeline.misfits).sum()
    }

    /// Returns true if a frame has a parent or is one.
    pub(crate) fn has(&self, frame: &str) -> bool {
        self.edges.contains_key(frame) || self.edges.values().any(|edge| edge.parent == frame)
    }

    /// Returns all frames, sorted.
    pub(crate) fn frames(&self) -> Vec<&str> {
        let mut frames: Vec<&str> =
            self.edges.iter().flat_map(|(child, edge)| [child.as_str(), edge.parent.as_str()]).collect();
        frames.sort_unstable();
        frames.dedup();
        frames
    }

    /// Returns a frame and its ancestors, the root last. Stops if frames form a cycle.
    pub(crate) fn ancestors<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        let mut chain = vec![frame];
        while let Some(edge) = chain.last().and_then(|last| self.edges.get(*last)) {
            if chain.len() > self.edges.len() || chain.contains(&edge.parent.as_str()) {
                break;
            }
            chain.push(&edge.parent);
        }
        chain
    }

    /// Returns the route from one frame to another, if both are in the same tree.
    pub(crate) fn route(&self, from: &str, to: &str) -> Option<Route> {
        let (up, down) = (self.ancestors(from), self.ancestors(to));
        let (top, meeting) =
            up.iter().enumerate().find_map(|(index, frame)| Some((index, down.iter().position(|f| f == frame)?)))?;
        let owned = |frames: &[&str]| frames.iter().map(|frame| (*frame).to_owned()).collect();
        Some(Route { up: owned(up.get(..top)?), down: owned(down.get(..meeting)?) })
    }

    /// Returns true if any transform on the route changes over time.
    pub(crate) fn is_moving(&self, route: &Route) -> bool {
        route
            .up
            .iter()
            .chain(&route.down)
            .any(|frame| self.edges.get(frame).is_some_and(|edge| edge.fixed.is_none() && edge.moves))
    }

    /// Returns the transform along a route on which nothing moves.
    pub(crate) fn fixed_transform(&self, route: &Route) -> Option<Rigid> {
        let anytime = Tolerance { nearest: i64::MAX, gap: i64::MAX };
        self.transform(route, Instant { stamp: 0, recorded: Recorded::default() }, anytime)
    }

    /// Returns the transform along the route at an instant, `to_from_from`. `None` if a part of it is unknown then.
    pub(crate) fn transform(&self, route: &Route, at: Instant, tolerance: Tolerance) -> Option<Rigid> {
        let to_top = |frames: &[String]| {
            frames
                .iter()
                .try_fold(Rigid::IDENTITY, |below, frame| Some(self.parent_from(frame, at, tolerance)?.after(&below)))
        };
        Some(to_top(&route.down)?.inverse().after(&to_top(&route.up)?))
    }

    fn parent_from(&self, frame: &str, at: Instant, tolerance: Tolerance) -> Option<Rigid> {
        let edge = self.edges.get(frame)?;
        edge.fixed.or(edge.repeated).or_else(|| edge.timeline.at(at, tolerance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MILLISECOND: i64 = 1_000_000;
    const TOLERANCE: Tolerance = Tolerance { nearest: 20 * MILLISECOND, gap: 500 * MILLISECOND };

    fn sample(milliseconds: i64, x: f64, angle: f64) -> Sample {
        let transform = Rigid { translation: DVec3::X * x, rotation: DQuat::from_rotation_z(angle) };
        Sample { stamp: milliseconds * MILLISECOND, recorded: Recorded::default(), transform }
    }

    fn instant(milliseconds: i64) -> Instant {
        Instant { stamp: milliseconds * MILLISECOND, recorded: Recorded::default() }
    }

    fn close(left: &Rigid, right: &Rigid) -> bool {
        let same_rotation = left.rotation.dot(right.rotation).abs() > 1.0 - 1e-12;
        left.translation.abs_diff_eq(right.translation, 1e-9) && same_rotation
    }

    #[test]
    fn transforms_are_interpolated_but_not_across_a_gap() {
        let samples = [sample(0, 0.0, 0.0), sample(100, 1.0, 0.8), sample(5000, 9.0, 0.0)];
        let at = |milliseconds: i64| at_time(&samples, milliseconds * MILLISECOND, TOLERANCE);
        assert!(close(&at(25).unwrap(), &sample(0, 0.25, 0.2).transform));
        assert_eq!(at(100), Some(samples[1].transform));
        assert_eq!(at(115), Some(samples[1].transform), "near enough to one of them");
        assert_eq!(at(-20), Some(samples[0].transform));
        for unknown in [-21, 200, 4900, 5021] {
            assert_eq!(at(unknown), None, "{unknown}");
        }
        assert_eq!(at_time(&[], 0, TOLERANCE), None);
        let far =
            [sample(0, 0.0, 0.0), Sample { stamp: i64::MAX, ..samples[0] }, Sample { stamp: i64::MIN, ..samples[0] }];
        assert_eq!(at_time(&far[1..2], i64::MIN, TOLERANCE), None);
    }

    #[test]
    fn a_route_leads_up_and_down_through_moving_and_fixed_frames() {
        let mut tree = TransformTree::default();
        tree.add("odom", "base", sample(0, 1.0, 0.0), false);
        tree.add("odom", "base", sample(100, 3.0, 0.0), false);
        tree.add("base", "color", sample(0, 0.1, 1.0), true);
        tree.add("base", "depth", sample(0, 0.3, 1.0), true);
        tree.add("elsewhere", "color", sample(0, 7.0, 0.0), true); // a second parent
        tree.sort(Order::LogTime);
        let route = tree.route("color", "odom").unwrap();
        assert!(tree.is_moving(&route));
        let transform = tree.transform(&route, instant(50), TOLERANCE).unwrap();
        assert!(close(&transform, &sample(0, 2.1, 1.0).transform), "{transform:?}");
        assert_eq!(tree.transform(&route, instant(900), TOLERANCE), None);
        let between = tree.route("depth", "color").unwrap();
        assert!(!tree.is_moving(&between), "what moves is above both");
        let transform = tree.transform(&between, instant(900), TOLERANCE).unwrap();
        let expected = DQuat::from_rotation_z(-1.0) * (DVec3::X * 0.2);
        assert!(close(&transform, &Rigid { translation: expected, rotation: DQuat::IDENTITY }), "{transform:?}");
        assert_eq!(tree.route("color", "map"), None);
        assert_eq!(tree.ancestors("color"), ["color", "base", "odom"]);
    }

    #[test]
    fn cycles_of_frames_end() {
        let mut tree = TransformTree::default();
        tree.add("a", "b", sample(0, 0.0, 0.0), true);
        tree.add("b", "a", sample(0, 0.0, 0.0), true);
        tree.add("c", "c", sample(0, 0.0, 0.0), true);
        assert_eq!(tree.ancestors("a"), ["a", "b"]);
        assert_eq!(tree.ancestors("c"), ["c"]);
        assert!(tree.route("a", "c").is_none());
    }

    #[test]
    fn invalid_transforms_are_refused() {
        assert_eq!(Rigid::new(DVec3::ZERO, DQuat::from_array([0.0; 4])), None);
        assert_eq!(Rigid::new(DVec3::X * f64::NAN, DQuat::IDENTITY), None);
        assert_eq!(Rigid::new(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, f64::INFINITY)), None);
        let scaled = Rigid::new(DVec3::X, DQuat::from_xyzw(0.0, 0.0, 0.0, 3.0)).unwrap();
        assert_eq!(scaled.rotation, DQuat::IDENTITY);
    }

    proptest! {
        #[test]
        fn the_route_back_is_the_inverse(
            angles in prop::array::uniform3(-3.0f64..3.0), t in prop::array::uniform3(-5.0f64..5.0),
        ) {
            let transform = Rigid { translation: DVec3::from(t), rotation: DQuat::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]) };
            let mut tree = TransformTree::default();
            for (parent, child) in [("a", "b"), ("b", "c"), ("a", "d")] {
                tree.add(parent, child, Sample { stamp: 0, recorded: Recorded::default(), transform }, true);
            }
            let through = |from, to| tree.transform(&tree.route(from, to).unwrap(), instant(0), TOLERANCE).unwrap();
            prop_assert!(close(&through("c", "d").after(&through("d", "c")), &Rigid::IDENTITY));
            prop_assert!(close(&through("c", "a"), &transform.after(&transform)));
        }
    }
}

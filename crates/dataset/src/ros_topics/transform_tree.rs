//! The tree of coordinate frames in `/tf` and `/tf_static`.
//!
//! A frame should have one parent. Where several programs publish it, it has more. All are kept, and a route between two
//! frames takes the one that leads there. A warning names it ([`TransformTree::contradictions`]).

use super::clock::Recorded;
use super::links::Link;
use super::stream_clock::SetBack;
use super::timeline::Order;
use super::transforms::{Instant, Rigid, Sample, Tolerance};
use std::collections::BTreeMap;

/// Maximum number of links of a stream, and of bytes in the name of a frame.
const MAX_LINKS: usize = 512;
const MAX_NAME_BYTES: usize = 256;
/// Maximum number of parents of a frame, and of ways up from a frame, that are considered.
const MAX_PARENTS: usize = 8;
const MAX_CHAINS: usize = 8;
/// Maximum number of frames above another one that are considered.
const MAX_DEPTH: usize = 64;
/// Maximum number of frames that are considered as the world.
const MAX_CANDIDATES: usize = 128;
/// Of two moving parents, the one that was known first is taken, unless the other one has this many times as many
/// transforms.
const CLEARLY_MORE: usize = 4;

/// All frames, each with its parents.
#[derive(Clone, Debug, Default)]
pub(crate) struct TransformTree {
    /// The links of each frame to its parents, in order of appearance. Usually one.
    links: BTreeMap<String, Vec<Link>>,
    /// Number of links.
    count: usize,
    /// True for a stream: a limited number of links.
    is_streamed: bool,
}

/// A frame, and the index of one of its parents.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Step {
    frame: String,
    parent: usize,
}

/// A route through the tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Route {
    /// Steps from frames to their parents that lead up from the start.
    up: Vec<Step>,
    /// Steps that lead down to the end, topmost last.
    down: Vec<Step>,
}

impl Route {
    fn steps(&self) -> impl Iterator<Item = &Step> {
        self.up.iter().chain(&self.down)
    }
}

/// The purpose of a route, which decides between several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// Between two parts of a rigid body, which do not move.
    Fixed,
    /// To the world, in which the start moves.
    Poses,
}

impl TransformTree {
    /// Creates the tree of a stream, of limited size.
    pub(crate) fn streamed() -> Self {
        Self { is_streamed: true, ..Self::default() }
    }

    /// Adds a transform from `child` to `parent`. One without names, or from a frame to itself, is ignored, as in tf2.
    pub(crate) fn add(&mut self, parent: &str, child: &str, sample: Sample, is_fixed: bool) {
        if parent.is_empty() || child.is_empty() || parent == child {
            return;
        }
        let known = self.links.get(child);
        let is_new = known.is_none_or(|links| links.iter().all(|link| link.parent != parent));
        if is_new {
            let is_too_long = parent.len().max(child.len()) > MAX_NAME_BYTES;
            let is_too_much = self.is_streamed && (self.count >= MAX_LINKS || is_too_long);
            if is_too_much || known.is_some_and(|links| links.len() >= MAX_PARENTS) {
                return;
            }
            self.count += 1;
            self.links.entry(child.to_owned()).or_default().push(Link::new(parent));
        }
        let links = self.links.get_mut(child);
        if let Some(link) = links.and_then(|links| links.iter_mut().find(|link| link.parent == parent)) {
            link.add(sample, is_fixed);
        }
    }

    /// Returns true if [`Self::arrive`] would forget the transforms before, because the clock was set back.
    pub(crate) fn are_set_back(&self) -> bool {
        self.links.values().flatten().any(Link::is_set_back)
    }

    /// Sorts the transforms of a stream that were added since the last call into the others, and forgets old ones.
    pub(crate) fn arrive(&mut self) {
        self.links.values_mut().flatten().for_each(Link::arrive);
    }

    /// Forgets the moving transforms of a stream from before a clock was set back.
    pub(crate) fn restart(&mut self, at: &SetBack) {
        self.links.values_mut().flatten().for_each(|link| link.restart(at));
    }

    /// Replaces the stamps of moving transforms by their recording times, where all of a frame are the same.
    pub(crate) fn replace_constant_stamps(&mut self) {
        self.links.values_mut().flatten().for_each(Link::replace_constant_stamp);
    }

    /// Sorts all transforms by time.
    pub(crate) fn sort(&mut self, order: Order) {
        self.links.values_mut().flatten().for_each(|link| link.sort(order));
    }

    fn link(&self, step: &Step) -> Option<&Link> {
        self.links.get(&step.frame)?.get(step.parent)
    }

    /// Returns true if transforms of a stream at a time or later are known along a route, so that nothing is missing
    /// for interpolating at that time.
    pub(crate) fn reaches(&self, route: &Route, stamp: i64) -> bool {
        route.steps().all(|step| self.link(step).is_some_and(|link| link.reaches(stamp)))
    }

    /// Returns the number of transforms along a route whose stamps do not fit those of their neighbours.
    pub(crate) fn misfits(&self, route: &Route) -> usize {
        route.steps().filter_map(|step| self.link(step)).map(Link::misfits).sum()
    }

    /// Returns true if a frame has a parent or is one.
    pub(crate) fn has(&self, frame: &str) -> bool {
        self.links.contains_key(frame) || self.links.values().flatten().any(|link| link.parent == frame)
    }

    /// Returns all frames, sorted.
    pub(crate) fn frames(&self) -> Vec<&str> {
        let parents = self.links.values().flatten().map(|link| link.parent.as_str());
        let mut frames: Vec<&str> = self.links.keys().map(String::as_str).chain(parents).collect();
        frames.sort_unstable();
        frames.dedup();
        frames
    }

    /// Returns the frames that move relative to one of their parents, sorted.
    pub(crate) fn moving_frames(&self) -> Vec<&str> {
        let moving = self.links.iter().filter(|(_, links)| links.iter().any(Link::is_moving));
        moving.map(|(frame, _)| frame.as_str()).collect()
    }

    /// Returns all ways up from a frame, first those through its first parent. Each ends at a frame without a parent, or
    /// before a frame that is already in it.
    fn chains(&self, frame: &str) -> Vec<Vec<Step>> {
        let (mut chains, mut open) = (Vec::new(), vec![Vec::<Step>::new()]);
        while let Some(mut chain) = open.pop() {
            loop {
                let last = self.end_of(&chain).unwrap_or(frame);
                let is_new = |link: &Link| link.parent != frame && chain.iter().all(|step| step.frame != link.parent);
                let parents = self.links.get(last).into_iter().flatten().enumerate();
                let steps = parents.filter(|(_, link)| is_new(link));
                let mut steps: Vec<Step> =
                    steps.map(|(parent, _)| Step { frame: last.to_owned(), parent }).take(MAX_CHAINS).collect();
                if steps.is_empty() || chain.len() >= MAX_DEPTH {
                    chains.push(chain);
                    break;
                }
                // The first parent is followed at once, the others later, as long as there are not too many ways.
                let first = steps.remove(0);
                steps.truncate(MAX_CHAINS.saturating_sub(chains.len() + open.len() + 1));
                open.extend(steps.into_iter().rev().map(|step| chain.iter().cloned().chain([step]).collect()));
                chain.push(first);
            }
        }
        chains
    }

    /// Returns the frame at which steps that lead up end.
    fn end_of(&self, chain: &[Step]) -> Option<&str> {
        self.link(chain.last()?).map(|link| link.parent.as_str())
    }

    /// Returns the best of several ways for a purpose.
    fn best<T>(&self, ways: Vec<T>, purpose: Purpose, steps: impl Fn(&T) -> Vec<Step>) -> Option<T> {
        let moves = |steps: &[Step]| steps.iter().filter_map(|step| self.link(step)).any(Link::is_moving);
        // The fewest transforms of a link that moves.
        let transforms = |steps: &[Step]| {
            let links = steps.iter().filter_map(|step| self.link(step));
            links.filter(|link| link.is_moving()).map(Link::moving_count).min().unwrap_or_default()
        };
        let is_better = |new: &[Step], old: &[Step]| match purpose {
            Purpose::Fixed => (moves(new), new.len()) < (moves(old), old.len()),
            Purpose::Poses => match (moves(new), moves(old)) {
                (true, true) => transforms(new) >= CLEARLY_MORE.saturating_mul(transforms(old).max(1)),
                (new, old) => new && !old,
            },
        };
        ways.into_iter().reduce(|best, next| if is_better(&steps(&next), &steps(&best)) { next } else { best })
    }

    /// Returns a frame and its ancestors, the root last: the way that moves, if there are several.
    pub(crate) fn ancestors<'a>(&'a self, frame: &'a str) -> Vec<&'a str> {
        let best = self.best(self.chains(frame), Purpose::Poses, Clone::clone).unwrap_or_default();
        self.frames_of(frame, &best)
    }

    /// Returns the route from one frame to another, if both are in the same tree.
    pub(crate) fn route(&self, from: &str, to: &str, purpose: Purpose) -> Option<Route> {
        let (ups, downs) = (self.chains(from), self.chains(to));
        let places: Vec<BTreeMap<&str, usize>> = downs
            .iter()
            .map(|down| self.frames_of(to, down).into_iter().enumerate().map(|(at, frame)| (frame, at)).collect())
            .collect();
        let mut routes: Vec<Route> = Vec::new();
        for up in &ups {
            let frames = self.frames_of(from, up);
            for (down, places) in downs.iter().zip(&places) {
                // Up to the first frame that is in both, and down from there.
                let meeting = frames.iter().enumerate().find_map(|(top, frame)| Some((top, *places.get(frame)?)));
                let steps = meeting.and_then(|(top, below)| Some((up.get(..top)?, down.get(..below)?)));
                if let Some((up, down)) = steps
                    && routes.iter().all(|route| (route.up.as_slice(), route.down.as_slice()) != (up, down))
                {
                    routes.push(Route { up: up.to_vec(), down: down.to_vec() });
                }
            }
        }
        self.best(routes, purpose, |route| route.steps().cloned().collect())
    }

    /// Returns the frames of a way up from a frame, which is the first one.
    fn frames_of<'a>(&'a self, frame: &'a str, chain: &[Step]) -> Vec<&'a str> {
        let parents = chain.iter().filter_map(|step| self.link(step)).map(|link| link.parent.as_str());
        [frame].into_iter().chain(parents).collect()
    }

    /// Returns true if any transform on the route changes over time.
    pub(crate) fn is_moving(&self, route: &Route) -> bool {
        route.steps().filter_map(|step| self.link(step)).any(Link::is_moving)
    }

    /// Returns the transform from one frame to another, `to_from_from`, if nothing moves between them.
    pub(crate) fn fixed_transform(&self, from: &str, to: &str) -> Option<Rigid> {
        let route = self.route(from, to, Purpose::Fixed).filter(|route| !self.is_moving(route))?;
        let anytime = Tolerance { nearest: i64::MAX, gap: i64::MAX };
        self.transform(&route, Instant { stamp: 0, recorded: Recorded::default() }, anytime)
    }

    /// Returns the transform along the route at an instant, `to_from_from`. `None` if a part of it is unknown then.
    pub(crate) fn transform(&self, route: &Route, at: Instant, tolerance: Tolerance) -> Option<Rigid> {
        let to_top = |steps: &[Step]| {
            let link_at = |step| self.link(step)?.at(at, tolerance);
            steps.iter().try_fold(Rigid::IDENTITY, |below, step| Some(link_at(step)?.after(&below)))
        };
        Some(to_top(&route.down)?.inverse().after(&to_top(&route.up)?))
    }

    /// Returns the largest angle of a transform along a route that does not change, radians.
    pub(crate) fn largest_fixed_turn(&self, route: &Route) -> f64 {
        let anytime = Tolerance { nearest: i64::MAX, gap: i64::MAX };
        let links = route.steps().filter_map(|step| self.link(step)).filter(|link| !link.is_moving());
        let transforms = links.filter_map(|link| link.at(Instant { stamp: 0, recorded: Recorded::default() }, anytime));
        transforms.map(|transform| transform.apart(&Rigid::IDENTITY).1).fold(0.0, f64::max)
    }

    /// Returns what is contradictory about the transforms along a route, one line each: frames with several parents, and
    /// transforms that are static and moving.
    pub(crate) fn contradictions(&self, route: &Route) -> Vec<String> {
        let mut lines = Vec::new();
        for step in route.steps() {
            let Some((used, links)) = self.link(step).zip(self.links.get(&step.frame)) else { continue };
            if links.len() > 1 {
                let mut parents: Vec<String> =
                    links.iter().map(|link| format!("{} ({})", link.parent, link.counts())).collect();
                let last = parents.pop().unwrap_or_default();
                lines.push(format!(
                    "{} has {} parents, {} and {last}: {} is used; record only one of them, or choose with --world-frame",
                    step.frame,
                    links.len(),
                    parents.join(", "),
                    used.parent
                ));
            }
            lines.extend(used.contradiction(&step.frame));
        }
        lines
    }

    /// Returns the frames that move relative to a frame, sorted: those that a route which moves leads to.
    pub(crate) fn moving_from(&self, frame: &str) -> Vec<&str> {
        let is_moving = |other: &&str| {
            *other != frame && self.route(frame, other, Purpose::Poses).is_some_and(|route| self.is_moving(&route))
        };
        self.frames().into_iter().take(MAX_CANDIDATES).filter(is_moving).collect()
    }

    /// Returns true if a frame has no parent.
    pub(crate) fn is_root(&self, frame: &str) -> bool {
        !self.links.contains_key(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
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
    fn a_route_leads_up_and_down_through_moving_and_fixed_frames() {
        let mut tree = TransformTree::default();
        tree.add("odom", "base", sample(0, 1.0, 0.0), false);
        tree.add("odom", "base", sample(100, 3.0, 0.0), false);
        tree.add("base", "color", sample(0, 0.1, 1.0), true);
        tree.add("base", "depth", sample(0, 0.3, 1.0), true);
        tree.add("elsewhere", "color", sample(0, 7.0, 0.0), true); // a second parent
        tree.sort(Order::LogTime);
        let route = tree.route("color", "odom", Purpose::Poses).unwrap();
        assert!(tree.is_moving(&route));
        let transform = tree.transform(&route, instant(50), TOLERANCE).unwrap();
        assert!(close(&transform, &sample(0, 2.1, 1.0).transform), "{transform:?}");
        assert_eq!(tree.transform(&route, instant(900), TOLERANCE), None);
        let between = tree.route("depth", "color", Purpose::Fixed).unwrap();
        assert!(!tree.is_moving(&between), "what moves is above both");
        let transform = tree.transform(&between, instant(900), TOLERANCE).unwrap();
        let expected = DQuat::from_rotation_z(-1.0) * (DVec3::X * 0.2);
        assert!(close(&transform, &Rigid { translation: expected, rotation: DQuat::IDENTITY }), "{transform:?}");
        assert_eq!(tree.route("color", "map", Purpose::Poses), None);
        assert_eq!(tree.ancestors("color"), ["color", "base", "odom"]);
        assert!(tree.route("color", "elsewhere", Purpose::Fixed).is_some());
        assert_eq!(
            tree.contradictions(&route),
            [
                "color has 2 parents, base (/tf_static, 1 transform) and elsewhere (/tf_static, 1 transform): base is used; \
                 record only one of them, or choose with --world-frame"
            ]
        );
    }

    #[test]
    fn of_two_parents_the_one_that_moves_is_taken() {
        let mut tree = TransformTree::default();
        tree.add("mount", "camera", sample(0, 9.0, 0.0), true);
        for index in 0..10 {
            tree.add("odom", "camera", sample(100 * index, index as f64, 0.0), false);
            if index % 4 == 0 {
                tree.add("map", "camera", sample(100 * index, 2.0 * index as f64, 0.0), false);
            }
        }
        tree.sort(Order::LogTime);
        assert_eq!(tree.ancestors("camera"), ["camera", "odom"], "the first of those that move");
        let at = |world| {
            let route = tree.route("camera", world, Purpose::Poses).unwrap();
            tree.transform(&route, instant(400), TOLERANCE).unwrap().translation.x
        };
        assert_eq!((at("mount"), at("odom"), at("map")), (9.0, 4.0, 8.0));
    }

    #[test]
    fn a_moving_transform_is_used_instead_of_a_static_one() {
        let of = |moving: &[f64], is_streamed: bool| {
            let mut tree = if is_streamed { TransformTree::streamed() } else { TransformTree::default() };
            tree.add("map", "camera", sample(0, 5.0, 0.0), true);
            for (x, index) in moving.iter().zip(0..) {
                tree.add("map", "camera", sample(100 * index, *x, 0.0), false);
            }
            if is_streamed {
                tree.arrive()
            } else {
                tree.sort(Order::LogTime)
            }
            let route = tree.route("camera", "map", Purpose::Poses).unwrap();
            let at = |milliseconds| tree.transform(&route, instant(milliseconds), TOLERANCE).map(|t| t.translation.x);
            (at(50), at(5000), tree.is_moving(&route), tree.contradictions(&route).len())
        };
        for is_streamed in [true, false] {
            assert_eq!(of(&[], is_streamed), (Some(5.0), Some(5.0), false, 0));
            assert_eq!(of(&[5.0, 5.0], is_streamed), (Some(5.0), Some(5.0), false, 0), "the same one");
            assert_eq!(of(&[5.0, 7.0], is_streamed), (Some(6.0), None, true, 1));
            assert_eq!(of(&[7.0, 7.0], is_streamed), (Some(7.0), Some(7.0), false, 1), "repeated, another one");
            assert_eq!(of(&[7.0], is_streamed), (None, None, true, 1), "only at its time");
        }
    }

    #[test]
    fn static_transforms_that_differ_are_told() {
        let mut tree = TransformTree::default();
        for x in [1.0, 1.0, 1.05] {
            tree.add("base", "camera", sample(0, x, 0.0), true);
        }
        let route = tree.route("camera", "base", Purpose::Fixed).unwrap();
        assert_eq!(
            tree.contradictions(&route),
            [
                "the 3 transforms from base to camera in /tf_static differ, by up to 5.0 cm and 0.0 degrees: the last one \
                 is used"
            ]
        );
        assert_eq!(tree.fixed_transform("camera", "base"), Some(sample(0, 1.05, 0.0).transform));
    }

    #[test]
    fn cycles_of_frames_end() {
        let mut tree = TransformTree::default();
        tree.add("a", "b", sample(0, 0.0, 0.0), true);
        tree.add("b", "a", sample(0, 0.0, 0.0), true);
        tree.add("c", "c", sample(0, 0.0, 0.0), true);
        assert_eq!(tree.ancestors("a"), ["a", "b"]);
        assert_eq!(tree.ancestors("c"), ["c"]);
        assert!(tree.route("a", "c", Purpose::Poses).is_none());
    }

    #[test]
    fn large_trees_are_limited() {
        let mut tree = TransformTree::default();
        for index in 0..600 {
            // Each with two parents: 2^600 ways up.
            tree.add(&format!("{}", index + 1), &format!("{index}"), sample(0, 0.0, 0.0), true);
            tree.add(&format!("{}", index + 2), &format!("{index}"), sample(0, 0.0, 0.0), true);
        }
        assert!(tree.ancestors("0").len() > 50 && tree.route("0", "50", Purpose::Fixed).is_some());
        assert_eq!(tree.moving_from("0"), Vec::<&str>::new());
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
            let through = |from, to| {
                let route = tree.route(from, to, Purpose::Fixed).unwrap();
                tree.transform(&route, instant(0), TOLERANCE).unwrap()
            };
            prop_assert!(close(&through("c", "d").after(&through("d", "c")), &Rigid::IDENTITY));
            prop_assert!(close(&through("c", "a"), &transform.after(&transform)));
        }
    }
}

//! The transforms from one frame to one of its parents, static and moving.

use super::stream_clock::SetBack;
use super::timeline::{Order, Timeline};
use super::transforms::{Instant, Rigid, Sample, Tolerance};

/// Transforms from a frame to one of its parents.
///
/// The same transform may be in `/tf_static` and in `/tf`. Then the one in `/tf` is used if it differs: a static one says
/// that nothing moves, and a single moving one proves it wrong.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    pub(crate) parent: String,
    /// Last transform from `/tf_static`.
    fixed: Option<Rigid>,
    /// Number of transforms from `/tf_static`, and the largest differences between them, metres and radians.
    fixed_count: usize,
    fixed_apart: (f64, f64),
    /// Transforms from `/tf`.
    timeline: Timeline<Sample>,
    /// Number of transforms from `/tf`.
    count: usize,
    /// True if they differ.
    moves: bool,
    /// The first of them.
    first: Option<Rigid>,
    /// The first of several equal ones: some drivers broadcast it repeatedly instead of using `/tf_static`.
    repeated: Option<Rigid>,
}

impl Link {
    pub(crate) fn new(parent: &str) -> Self {
        Self {
            parent: parent.to_owned(),
            fixed: None,
            fixed_count: 0,
            fixed_apart: (0.0, 0.0),
            timeline: Timeline::default(),
            count: 0,
            moves: false,
            first: None,
            repeated: None,
        }
    }

    /// Adds a transform from `/tf_static` (`is_fixed`) or `/tf`.
    pub(crate) fn add(&mut self, sample: Sample, is_fixed: bool) {
        if !is_fixed {
            self.count += 1;
            self.timeline.record(sample);
            return;
        }
        self.fixed_count += 1;
        if let Some(before) = self.fixed.replace(sample.transform) {
            let (distance, angle) = before.apart(&sample.transform);
            self.fixed_apart = (self.fixed_apart.0.max(distance), self.fixed_apart.1.max(angle));
        }
    }

    /// Sorts the transforms of a stream that were added since the last call into the others, and forgets old ones.
    pub(crate) fn arrive(&mut self) {
        if self.timeline.unsorted() == 0 {
            return;
        }
        for sample in self.timeline.take_unsorted() {
            let transform = sample.transform;
            self.timeline.arrive(sample);
            if let Some(first) = self.first {
                self.moves |= !first.is_about(&transform);
                self.repeated = Some(first).filter(|_| !self.moves);
            }
            self.first.get_or_insert(transform);
        }
        self.timeline.trim_history();
    }

    /// Returns true if a transform that was added since the last call of [`Self::arrive`] is from after the clock was set
    /// back.
    pub(crate) fn is_set_back(&self) -> bool {
        self.timeline.is_set_back()
    }

    /// Forgets the moving transforms of a stream from before a clock was set back.
    pub(crate) fn restart(&mut self, at: &SetBack) {
        self.timeline.restart(at);
        self.first = None;
        self.repeated = None;
    }

    /// Replaces the stamps of the transforms from `/tf` in a recording by their recording times, if all are the same.
    pub(crate) fn replace_constant_stamp(&mut self) {
        self.timeline.replace_constant_stamp();
    }

    /// Sorts all transforms of a recording by time.
    pub(crate) fn sort(&mut self, order: Order) {
        self.timeline.sort(order);
        let mut samples = self.timeline.stretches.iter().flat_map(|stretch| &stretch.messages);
        self.first = samples.next().map(|sample| sample.transform);
        let differs = |sample: &Sample| self.first.is_none_or(|first| !first.is_about(&sample.transform));
        self.moves = samples.clone().any(differs);
        self.repeated = self.first.filter(|_| samples.next().is_some() && !self.moves);
    }

    /// Returns the number of transforms from `/tf` whose stamps do not fit those of their neighbours.
    pub(crate) fn misfits(&self) -> usize {
        self.timeline.misfits
    }

    /// Returns the number of transforms from `/tf`.
    pub(crate) fn moving_count(&self) -> usize {
        self.count
    }

    /// Returns true if the transform changes over time.
    pub(crate) fn is_moving(&self) -> bool {
        self.moves || self.repeated.is_none() && self.is_contradicted()
    }

    /// Returns true if the first transform in `/tf` is another one than that in `/tf_static`.
    fn is_contradicted(&self) -> bool {
        self.fixed.zip(self.first).is_some_and(|(fixed, first)| !fixed.is_about(&first))
    }

    /// Returns the transform at an instant; `None` if it is unknown then.
    pub(crate) fn at(&self, at: Instant, tolerance: Tolerance) -> Option<Rigid> {
        let constant = if self.is_moving() {
            None
        } else if self.is_contradicted() {
            self.repeated
        } else {
            self.fixed.or(self.repeated)
        };
        constant.or_else(|| self.timeline.at(at, tolerance))
    }

    /// Returns true if transforms of a stream at a time or later are known, so that nothing is missing for interpolating
    /// at that time.
    pub(crate) fn reaches(&self, stamp: i64) -> bool {
        let is_fixed = self.fixed.is_some() && !self.is_moving() && !self.is_contradicted();
        is_fixed || self.timeline.newest() >= Some(stamp)
    }

    /// Returns the topics that it is in, and the number of transforms in each: `/tf_static, 1 transform`.
    pub(crate) fn counts(&self) -> String {
        let of = |topic: &str, count: usize| match count {
            0 => None,
            1 => Some(format!("{topic}, 1 transform")),
            count => Some(format!("{topic}, {count} transforms")),
        };
        let both = [of("/tf_static", self.fixed_count), of("/tf", self.count)];
        both.into_iter().flatten().collect::<Vec<_>>().join("; ")
    }

    /// Returns what is contradictory about the transforms to `child`, and what is used, in one line; `None` if nothing
    /// is.
    pub(crate) fn contradiction(&self, child: &str) -> Option<String> {
        let Self { parent, fixed_count, count, .. } = self;
        if self.fixed.is_some() && (self.moves || self.is_contradicted()) {
            let kind = if self.moves { "moving " } else { "" };
            return Some(format!(
                "the transform from {parent} to {child} is in /tf_static ({fixed_count}) and, another one, in /tf \
                 ({count}): the {kind}one in /tf is used; the static one is wrong, or from another run"
            ));
        }
        let (distance, angle) = self.fixed_apart;
        let differ = distance > NOTED_DISTANCE_M || angle > NOTED_ANGLE;
        differ.then(|| {
            format!(
                "the {fixed_count} transforms from {parent} to {child} in /tf_static differ, by up to {:.1} cm and {:.1} \
                 degrees: the last one is used",
                100.0 * distance,
                angle.to_degrees()
            )
        })
    }
}

/// Differences between static transforms that are told: metres, and radians.
const NOTED_DISTANCE_M: f64 = 1e-3;
const NOTED_ANGLE: f64 = 2e-3;

//! Rotations in a recording whose quaternions do not have length 1.

use super::transforms::{Parts, Rigid};
use crate::recorded_poses::has_unit_length;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// Maximum number of sources that are counted.
const MAX_SOURCES: usize = 64;

/// Counts of one source of rotations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    /// Those of length 0, which are left out.
    zero: usize,
    /// Those of other lengths, which are normalised.
    other: usize,
    /// The first of the other lengths.
    first: f64,
}

/// Numbers of rotations whose quaternions do not have length 1, by their source: two frames, or a topic.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct QuaternionCounts {
    /// By parent and child in `/tf`.
    transforms: BTreeMap<(String, String), Counts>,
    /// By the name of a topic of poses.
    poses: BTreeMap<String, Counts>,
}

impl QuaternionCounts {
    /// Makes a transform from `child` to `parent` of a translation and a quaternion; `None` if it is invalid.
    pub(crate) fn transform(&mut self, (parent, child): (&str, &str), parts: Parts) -> Option<Rigid> {
        count(&mut self.transforms, parts.1, || (parent.to_owned(), child.to_owned()));
        Rigid::new(parts.0, parts.1)
    }

    /// Makes a pose of a topic of a position and a quaternion; `None` if it is invalid.
    pub(crate) fn pose(&mut self, topic: &str, parts: Parts) -> Option<Rigid> {
        count(&mut self.poses, parts.1, || topic.to_owned());
        Rigid::new(parts.0, parts.1)
    }

    /// Returns warnings about all transforms, and about the poses of `topic`.
    pub(crate) fn warnings(&self, topic: Option<&str>) -> Vec<String> {
        let poses = topic.and_then(|topic| self.poses.get_key_value(topic));
        let poses = poses.into_iter().map(|(topic, counts)| (format!("poses of {topic}"), *counts));
        let transforms = self.transforms.iter();
        let transforms =
            transforms.map(|((parent, child), counts)| (format!("transforms from {child} to {parent}"), *counts));
        transforms.chain(poses).flat_map(|(what, counts)| texts(&what, counts)).collect()
    }
}

/// Counts a quaternion that does not have length 1. NaN means that tracking was lost.
fn count<K: Ord>(counts: &mut BTreeMap<K, Counts>, rotation: DQuat, key: impl FnOnce() -> K) {
    if !rotation.is_finite() || has_unit_length(rotation) {
        return;
    }
    let key = key();
    if counts.len() >= MAX_SOURCES && !counts.contains_key(&key) {
        return;
    }
    let counts = counts.entry(key).or_default();
    if Rigid::new(DVec3::ZERO, rotation).is_none() {
        counts.zero += 1;
        return;
    }
    if counts.other == 0 {
        counts.first = rotation.length();
    }
    counts.other += 1;
}

fn texts(what: &str, counts: Counts) -> Vec<String> {
    let Counts { zero, other, first } = counts;
    let zero = (zero > 0).then(|| format!("{what}: {zero} left out, as the quaternion has length 0"));
    let other = (other > 0).then(|| {
        format!(
            "{what}: {other} with a quaternion of another length than 1 (the first: {first:.3}), which may be no rotation: it \
             is scaled to length 1; --pose chooses another source of poses"
        )
    });
    zero.into_iter().chain(other).collect()
}

//! Recognises places that the camera returns to, and corrects the poses of all keyframes.
//!
//! Each new keyframe is compared twice, in the two frames after it, and the map is corrected in the next one, so that no
//! frame takes long:
//!
//! - with earlier keyframes that should show the same place, as far as the poses are right: it is aligned with them;
//! - with all keyframes that are a long way back, by appearance.
//!
//! A place that was recognised by appearance counts only if another keyframe confirms it, and if tracking can have drifted
//! that far: identical doors look alike, but are too far apart.

use crate::graph::{Edge, EdgeKind, information};
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{StoredKeyframe, apart, distance, hamming};
use crate::loops::{ClosedLoop, LoopCandidate, LoopCheck};
use crate::relocalisation::{MAX_DIFFERENCE, Query, Recognised};
use glam::DVec3;
use splatseg_geometry::{KeyframeId, MapCorrection, Pose};
use std::collections::BTreeMap;

/// Earlier keyframes are aligned with a new one if they are this close to it, as in [`distance`]...
const NEAR: f64 = 1.3;
/// ...and the path to them is this long, metres.
const MIN_PATH: f64 = 1.0;
/// Number of keyframes that a new one is aligned with.
const NEIGHBOURS: usize = 2;

/// Keyframes are recognised by appearance if the path to them is this long, metres.
const MIN_PATH_OF_APPEARANCE: f64 = 3.0;

/// Drift that tracking may have, metres: at once, and per metre of path.
const DRIFT: (f64, f64) = (0.04, 0.04);
/// The same for turns, radians.
const TURN_DRIFT: (f64, f64) = (0.03, 0.02);

/// Two loops agree if the corrections that they ask for differ by at most this, metres and radians.
const SAME_CORRECTION: (f64, f64) = (0.06, 0.05);

/// A loop waits for another one to confirm it for this many keyframes.
const MAX_WAIT: KeyframeId = 6;

/// Parts of the map are joined only by places with this many features that agree.
const MIN_INLIERS_OF_PARTS: usize = 18;

/// An alignment may have slid by this much, metres: similar features farther apart say nothing.
const LARGEST_SLIDE: f32 = 0.5;
/// Features are the same if they are this close, metres: at once, and per square metre of the squared depth.
const SAME_FEATURE: (f32, f32) = (0.035, 0.008);
/// At least this many features must be the same.
const MIN_SAME_FEATURES: usize = 8;

/// Loops that change a pose by less than this, metres and radians, do not correct the map.
const MIN_CHANGE: (f64, f64) = (0.01, 0.006);

impl KeyframeMap {
    /// Does one search for loops, if any is due, or corrects the map if the last one has closed a loop. Returns the
    /// correction.
    pub(crate) fn check_loops(&mut self) -> Option<MapCorrection> {
        if let Some(closed) = self.closed.take() {
            return self.corrected(closed);
        }
        let (check, edges) = (self.checks.pop_front()?, self.graph.edges.len());
        self.closed = match check {
            LoopCheck::Neighbours(id) => self.align_neighbours(id),
            LoopCheck::Appearance(id) => self.search(id),
        };
        if self.graph.edges.len() > edges {
            // Not only after a correction: a saved state does not contain which poses are uncertain.
            self.find_uncertain();
        }
        None
    }

    /// Aligns a keyframe with earlier ones nearby. Returns the pairs that fit but whose poses do not.
    fn align_neighbours(&mut self, id: KeyframeId) -> Option<ClosedLoop> {
        let new = self.store.get(id)?;
        let lengths = self.graph.path_lengths(id);
        let is_due = |other: &&StoredKeyframe| {
            let is_far = lengths.get(&other.id).is_some_and(|length| *length >= MIN_PATH);
            other.part == new.part && is_far && distance(&other.world_from_key, &new.world_from_key) <= NEAR
        };
        let mut near: Vec<(f64, &StoredKeyframe)> = self
            .store
            .iter()
            .filter(is_due)
            .map(|other| (distance(&other.world_from_key, &new.world_from_key), other))
            .collect();
        near.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.id.cmp(&other.1.id)));
        let query = Query::of_keyframe(new)?;
        let mut edges = Vec::new();
        for (_, other) in near.into_iter().take(NEIGHBOURS) {
            let found = query.align(other, &new.world_from_key).filter(Recognised::is_sure);
            let found = found.filter(|found| features_agree(new, other, &found.key_from_camera));
            edges.extend(
                found.filter(|found| is_possible(found, new, lengths[&other.id])).map(|found| edge(&found, id)),
            );
        }
        let misfit = |edge: &Edge| {
            let measured = self.store.get(edge.from)?.world_from_key * edge.measured;
            let (distance, angle) = apart(&measured, &self.store.get(id)?.world_from_key);
            (distance > MIN_CHANGE.0 || angle > MIN_CHANGE.1).then_some((edge.from, id))
        };
        let joined: Vec<(KeyframeId, KeyframeId)> = edges.iter().filter_map(misfit).collect();
        edges.into_iter().for_each(|edge| self.graph.add(edge));
        (!joined.is_empty()).then_some(ClosedLoop { joined, part_motion: None })
    }

    /// Searches for a keyframe's place by appearance. Returns the confirmed pairs.
    fn search(&mut self, id: KeyframeId) -> Option<ClosedLoop> {
        let new = self.store.get(id)?;
        let lengths = self.graph.path_lengths(id);
        let path = |other: KeyframeId| lengths.get(&other).copied().unwrap_or(f64::INFINITY);
        let query = Query::of_keyframe(new)?;
        let is_far = |other: &StoredKeyframe| path(other.id) >= MIN_PATH_OF_APPEARANCE;
        let found = query.recognise(&self.store, is_far, u64::from(id))?;
        let is_same_part = self.store.get(found.keyframe).is_some_and(|other| other.part == new.part);
        let is_possible = match is_same_part {
            true => is_possible(&found, new, path(found.keyframe)),
            false => found.inliers >= MIN_INLIERS_OF_PARTS,
        };
        if !is_possible {
            return None;
        }
        let correction = found.world_from_camera * new.world_from_key.inverse();
        let position = new.world_from_key;
        let edge = edge(&found, id);
        self.candidates.retain(|candidate| id.saturating_sub(candidate.edge.to) <= MAX_WAIT);
        let confirmed = self.candidates.iter().position(|candidate| {
            let (distance, angle) = apart(&(candidate.correction * position), &(correction * position));
            distance <= SAME_CORRECTION.0 && angle <= SAME_CORRECTION.1
        });
        let Some(first) = confirmed.and_then(|index| self.candidates.remove(index)) else {
            self.candidates.push_back(LoopCandidate { edge, correction });
            return None;
        };
        let joined = vec![(first.edge.from, first.edge.to), (edge.from, edge.to)];
        self.graph.add(first.edge);
        self.graph.add(edge);
        Some(ClosedLoop { joined, part_motion: (!is_same_part).then_some(correction) })
    }

    /// Moves the part of the map with keyframe `new` to that with `old`.
    fn join_parts(&mut self, new: KeyframeId, old: KeyframeId, motion: &Pose) {
        let (Some(from), Some(into)) = (self.store.part_of(new), self.store.part_of(old)) else { return };
        let moved: Vec<KeyframeId> =
            self.store.iter().filter(|keyframe| keyframe.part == from).map(|keyframe| keyframe.id).collect();
        for id in moved {
            if let Some(keyframe) = self.store.get_mut(id) {
                (keyframe.part, keyframe.world_from_key) = (into, *motion * keyframe.world_from_key);
            }
        }
        if self.part == from {
            self.part = into;
        }
    }

    /// Computes the poses of all keyframes anew. Returns how they have moved, unless they hardly have.
    fn corrected(&mut self, ClosedLoop { joined, part_motion }: ClosedLoop) -> Option<MapCorrection> {
        let (before, (old, newest)) = (self.store.poses(), *joined.last()?);
        if let Some(motion) = &part_motion {
            self.join_parts(newest, old, motion);
        }
        let optimised = self.graph.optimised(&self.store, self.store.kept(newest));
        let is_moved = |(id, pose): (&KeyframeId, &Pose)| {
            before.get(id).is_some_and(|before| {
                let (distance, angle) = apart(before, pose);
                distance > MIN_CHANGE.0 || angle > MIN_CHANGE.1
            })
        };
        if part_motion.is_none() && !optimised.iter().any(is_moved) {
            return None;
        }
        for (id, pose) in optimised {
            if let Some(keyframe) = self.store.get_mut(id) {
                keyframe.world_from_key = pose;
            }
        }
        let after = self.store.poses();
        let new_from_old: BTreeMap<KeyframeId, Pose> = after
            .into_iter()
            .filter_map(|(id, pose)| {
                let before = before.get(&id)?;
                (*before != pose).then(|| (id, pose * before.inverse()))
            })
            .collect();
        self.candidates.clear();
        Some(MapCorrection { new_from_old, joined })
    }
}

/// True if tracking can have drifted as far as a place says.
fn is_possible(found: &Recognised, new: &StoredKeyframe, path: f64) -> bool {
    let (distance, angle) = apart(&found.world_from_camera, &new.world_from_key);
    distance <= DRIFT.0 + DRIFT.1 * path && angle <= TURN_DRIFT.0 + TURN_DRIFT.1 * path
}

/// True if similar features of two keyframes are at the same places. An alignment that starts far off may slide along a
/// wall or a floor to a place where depth and image fit nearly as well.
pub(crate) fn features_agree(new: &StoredKeyframe, other: &StoredKeyframe, other_from_new: &Pose) -> bool {
    let local = other_from_new.relative_to(DVec3::ZERO);
    let (mut same, mut all) = (0, 0);
    for feature in &new.features {
        let similar = other.features.iter().map(|other| (hamming(&feature.descriptor, &other.descriptor), other));
        let Some((difference, most_similar)) = similar.min_by_key(|(difference, _)| *difference) else { continue };
        let apart = local.to_world(feature.place()).distance(most_similar.place());
        if difference <= MAX_DIFFERENCE && apart <= LARGEST_SLIDE {
            let depth = feature.place().z;
            (all, same) = (all + 1, same + usize::from(apart <= SAME_FEATURE.0 + SAME_FEATURE.1 * depth * depth));
        }
    }
    same >= MIN_SAME_FEATURES && 2 * same > all
}

/// The relative pose that a recognised place measures.
pub(crate) fn edge(found: &Recognised, to: KeyframeId) -> Edge {
    Edge {
        from: found.keyframe,
        to,
        measured: found.key_from_camera,
        information: information(found.fit.as_ref().map(|fit| &fit.hessian)),
        kind: EdgeKind::Loop,
    }
}

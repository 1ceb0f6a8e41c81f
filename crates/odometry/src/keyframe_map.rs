//! The keyframes of a map with their relative poses: what is attached to them moves when a loop is closed.

use crate::graph::{Edge, EdgeKind, PoseGraph, information};
use crate::keyframes::{KeyframeStore, StoredKeyframe, apart};
use crate::loops::{ClosedLoop, LoopCandidate, LoopCheck};
use crate::odometry::MadeKeyframe;
use crate::tracked_frame::TrackedFrame;
use splatseg_geometry::{FrameAnchor, KeyframeId, MapCorrection, Pose};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// A keyframe whose path to the camera is longer than this, metres, may have drifted by more than the map tolerates:
/// tracking drifts by up to two percent, and the map tolerates ten centimetres.
const MAX_CERTAIN_PATH: f64 = 5.0;

/// A frame with a given pose becomes a keyframe if the camera has moved this far since the last one, metres or radians.
const GIVEN_STEP: (f64, f64) = (0.1, 0.15);

/// The first frame of a new part of the map is put this far beside the others, metres.
const GAP_BETWEEN_PARTS: f64 = 50.0;

/// Beyond this number the oldest searches for loops are given up: a camera in a hurry makes a keyframe of each frame, which
/// asks for two searches.
const MAX_CHECKS: usize = 8;

/// Searches wait for a frame that does not become a keyframe, unless there are more than this: those of one keyframe.
const MAX_WAITING_CHECKS: usize = 2;

/// All keyframes, their relative poses, and the search for loops.
#[derive(Clone, Debug, Default)]
pub(crate) struct KeyframeMap {
    pub(crate) store: KeyframeStore,
    pub(crate) graph: PoseGraph,
    /// Part of the map in which the camera is, from 0. Parts whose relative pose is not known are far apart.
    pub(crate) part: u32,
    /// Number of this run, from 0: a loaded map has had others.
    pub(crate) session: u32,
    /// The latest keyframe.
    pub(crate) latest: Option<KeyframeId>,
    pub(crate) uncertain: Arc<BTreeSet<KeyframeId>>,
    /// Searches for loops that are yet to be done, at most one per frame.
    pub(crate) checks: VecDeque<LoopCheck>,
    /// Loops that wait for another one that confirms them.
    pub(crate) candidates: VecDeque<LoopCandidate>,
    /// A loop for which the map is yet to be corrected.
    pub(crate) closed: Option<ClosedLoop>,
}

impl KeyframeMap {
    /// Adds a keyframe that the camera has tracked. `keyframe` describes it.
    pub(crate) fn add_tracked(&mut self, keyframe: StoredKeyframe, link: Option<Edge>) {
        let id = keyframe.id;
        self.add(keyframe, link);
        self.ask_for_checks(id);
        self.find_uncertain();
    }

    /// Asks for the searches for loops of a new keyframe.
    fn ask_for_checks(&mut self, id: KeyframeId) {
        self.checks.extend([LoopCheck::Neighbours(id), LoopCheck::Appearance(id)]);
        self.checks.drain(..self.checks.len().saturating_sub(MAX_CHECKS));
    }

    /// True if searches for loops cannot wait for a frame that does not become a keyframe.
    pub(crate) fn is_behind(&self) -> bool {
        self.checks.len() > MAX_WAITING_CHECKS
    }

    /// Adds a keyframe, with its pose relative to another one if that is known.
    pub(crate) fn add(&mut self, keyframe: StoredKeyframe, link: Option<Edge>) {
        self.latest = Some(keyframe.id);
        let mut link = link;
        if let Some((dropped, kept)) = self.store.add(keyframe)
            && let Some((_, kept_from_dropped)) = self.store.replaced.get(&dropped)
        {
            self.graph.replace(dropped, kept, kept_from_dropped);
            let waiting = self.candidates.iter_mut().map(|candidate| &mut candidate.edge);
            waiting.chain(&mut link).for_each(|edge| edge.replace(dropped, kept, kept_from_dropped));
        }
        if let Some(edge) = link.filter(|edge| self.store.get(edge.from).is_some()) {
            self.graph.add(edge);
        }
    }

    /// Describes a keyframe that was made by tracking.
    pub(crate) fn described(&self, made: &MadeKeyframe, frame: &TrackedFrame<'_>) -> StoredKeyframe {
        StoredKeyframe::new(made.id, frame, made.world_from_key, self.part, self.session)
    }

    /// True if a frame with a given pose is far enough from the last keyframe to become one.
    pub(crate) fn wants_given(&self, pose: &Pose) -> bool {
        let latest = self.latest.and_then(|latest| self.store.get(latest));
        latest.filter(|latest| latest.session == self.session).is_none_or(|latest| {
            let (distance, angle) = apart(&latest.world_from_key, pose);
            distance > GIVEN_STEP.0 || angle > GIVEN_STEP.1
        })
    }

    /// Adds a keyframe with a given pose. `index` is that of the frame in its source.
    pub(crate) fn add_given(&mut self, frame: &TrackedFrame<'_>, pose: &Pose, index: usize) {
        let keyframe = StoredKeyframe::new(self.store.next, frame, *pose, self.part, self.session);
        let keyframe = StoredKeyframe { given_frame: Some(index), ..keyframe };
        let last = self.latest.and_then(|latest| self.store.get(latest));
        let edge = last.map(|last| Edge {
            from: last.id,
            to: keyframe.id,
            measured: last.world_from_key.inverse() * *pose,
            information: information(None),
            kind: EdgeKind::Given,
        });
        self.add(keyframe, edge);
    }

    /// Finds the keyframes whose pose relative to the latest one may have drifted.
    pub(crate) fn find_uncertain(&mut self) {
        let Some(latest) = self.latest else { return };
        let lengths = self.graph.path_lengths(latest);
        let is_certain = |id: &KeyframeId| lengths.get(id).is_some_and(|length| *length <= MAX_CERTAIN_PATH);
        let stored = self.store.iter().map(|keyframe| keyframe.id).filter(|id| !is_certain(id) && *id != latest);
        let dropped =
            self.store.replaced.iter().filter(|(_, (kept, _))| !is_certain(kept)).map(|(dropped, _)| *dropped);
        self.uncertain = Arc::new(stored.chain(dropped).collect());
    }

    /// Begins another run with a loaded map.
    pub(crate) fn begin_session(&mut self) {
        self.session = self.store.iter().map(|keyframe| keyframe.session).max().map_or(0, |session| session + 1);
        self.checks.clear();
        self.candidates.clear();
        // Indices of frames mean nothing in another run.
        let ids: Vec<KeyframeId> = self.store.iter().map(|keyframe| keyframe.id).collect();
        for id in ids {
            if let Some(keyframe) = self.store.get_mut(id) {
                keyframe.given_frame = None;
            }
        }
    }

    /// Moves keyframes with the corrected poses of their frames, by increasing index. A keyframe between two corrected
    /// frames moves like the earlier one. `None` if nothing moves.
    pub(crate) fn correct_given(&mut self, corrected: &[(usize, Pose)]) -> Option<MapCorrection> {
        let before = self.store.poses();
        let given: Vec<(usize, KeyframeId)> =
            self.store.iter().filter_map(|keyframe| Some((keyframe.given_frame?, keyframe.id))).collect();
        let exact: BTreeMap<usize, &Pose> = corrected.iter().map(|(frame, pose)| (*frame, pose)).collect();
        let mut motion: Option<Pose> = None;
        for (frame, id) in given {
            let Some(keyframe) = self.store.get_mut(id) else { continue };
            if let Some(pose) = exact.get(&frame) {
                motion = Some(**pose * keyframe.world_from_key.inverse());
                keyframe.world_from_key = **pose;
            } else if let Some(motion) = &motion {
                keyframe.world_from_key = *motion * keyframe.world_from_key;
            }
        }
        // The relative poses were those of the old path.
        for edge in self.graph.edges.iter_mut().filter(|edge| edge.kind == EdgeKind::Given) {
            if let (Some(from), Some(to)) = (self.store.get(edge.from), self.store.get(edge.to)) {
                edge.measured = from.world_from_key.inverse() * to.world_from_key;
            }
        }
        let moved = self.store.poses().into_iter().filter_map(|(id, pose)| {
            let old = before.get(&id)?;
            (*old != pose).then(|| (id, pose * old.inverse()))
        });
        let new_from_old: BTreeMap<KeyframeId, Pose> = moved.collect();
        let first = *new_from_old.keys().next()?;
        Some(MapCorrection { new_from_old, joined: self.latest.map(|latest| (first, latest)).into_iter().collect() })
    }

    /// The pose of the first frame of a new part: beside all others.
    pub(crate) fn start_of_part(&self) -> Pose {
        let farthest = self.store.iter().map(|keyframe| keyframe.world_from_key.translation().x);
        let farthest = farthest.fold(f64::NEG_INFINITY, f64::max);
        let x = if farthest.is_finite() { farthest + GAP_BETWEEN_PARTS } else { 0.0 };
        Pose::from_translation(glam::DVec3::new(x, 0.0, 0.0))
    }

    /// Begins a new part of the map, which no keyframe belongs to yet.
    pub(crate) fn begin_part(&mut self) {
        self.part = self.store.iter().map(|keyframe| keyframe.part).max().map_or(0, |part| part + 1);
        self.checks.clear();
        self.candidates.clear();
    }

    /// The anchor of frames: the given keyframe, or the latest.
    pub(crate) fn anchor(&self, keyframe: Option<KeyframeId>, is_tracked: bool) -> FrameAnchor {
        let id = keyframe.filter(|id| self.store.get(*id).is_some()).or(self.latest);
        let keyframe = id.and_then(|id| self.store.get(id));
        FrameAnchor {
            keyframe: keyframe.map_or(0, |keyframe| keyframe.id),
            world_from_keyframe: keyframe.map_or(Pose::IDENTITY, |keyframe| keyframe.world_from_key),
            is_tracked,
            uncertain: if is_tracked { Arc::clone(&self.uncertain) } else { Arc::default() },
        }
    }

    /// Number of parts.
    pub(crate) fn part_count(&self) -> usize {
        self.store.iter().map(|keyframe| keyframe.part).collect::<BTreeSet<u32>>().len()
    }
}

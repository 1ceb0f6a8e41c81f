//! The keyframes of two maps in one map, and the correction of their poses.

use super::links::{Link, links};
use super::recognition::Places;
use super::{JoinError, MapFit};
use crate::graph::{Edge, EdgeKind, PoseGraph};
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{MAX_STORED, StoredKeyframe, apart, distance};
use splatseg_geometry::{KeyframeId, MapCorrection, Pose};
use std::collections::{BTreeMap, BTreeSet};

/// Given poses do not drift: while the maps are joined, they hold together this many times as strongly as otherwise, so
/// that each map moves as a whole.
const GIVEN_STRENGTH: f64 = 400.0;

/// A keyframe of the earlier map is dropped if one of the later map is this close, as in [`distance`]: 4 cm or 3°.
const REDUNDANT: f64 = 0.15;

/// Parts that could not be joined are put this far beside the others, metres.
const GAP: f64 = 50.0;

/// The keyframes of two maps.
pub(super) struct JoinedMap {
    pub(super) map: KeyframeMap,
    /// Number of the later map's first keyframe.
    pub(super) first_later: KeyframeId,
    /// Measured relative poses between the maps.
    links: Vec<Link>,
    unjoined_parts: usize,
}

impl JoinedMap {
    /// Puts the later map's keyframes to where `places` say they are, and corrects all poses with the sights.
    pub(super) fn new(earlier: &KeyframeMap, later: &KeyframeMap, places: &Places) -> Result<Self, JoinError> {
        let first_later = earlier.store.next;
        let numbers = first_later.checked_add(later.store.next).filter(|next| *next < KeyframeId::MAX);
        let problem = || format!("there are no numbers left for keyframes after {first_later}");
        let next = numbers.ok_or_else(|| JoinError::Damaged { which: "earlier", problem: problem() })?;
        let mut map = earlier.clone();
        map.begin_session();
        map.graph.edges.extend(later.graph.edges.iter().map(|edge| renumbered(edge, first_later)));
        let session = map.session;
        let (parts, unjoined_parts) = part_motions(earlier, later, places);
        let moved = |keyframe: &StoredKeyframe| {
            let (part, motion) = parts.get(&keyframe.part).copied().unwrap_or((keyframe.part, Pose::IDENTITY));
            StoredKeyframe {
                id: keyframe.id + first_later,
                part,
                session: session.saturating_add(keyframe.session),
                given_frame: None,
                world_from_key: motion * keyframe.world_from_key,
                ..keyframe.clone()
            }
        };
        later.store.iter().map(moved).for_each(|keyframe| map.store.insert(keyframe));
        let dropped = later.store.replaced.iter();
        map.store.replaced.extend(dropped.map(|(id, (kept, pose))| (id + first_later, (kept + first_later, *pose))));
        map.store.next = next;
        map.latest = later.latest.map(|latest| latest + first_later).or(map.latest);
        map.part = map.latest.and_then(|latest| map.store.part_of(latest)).unwrap_or(map.part);
        map.session = map.store.iter().map(|keyframe| keyframe.session).max().unwrap_or(0);
        map.closed = None;
        let link = |sight: &super::recognition::Sight| {
            let mut edge = sight.edge.clone();
            let is_later_to = edge.to == sight.later && edge.from == sight.earlier;
            let later = if is_later_to { &mut edge.to } else { &mut edge.from };
            *later += first_later;
            Link { edge, agreement: sight.agreement }
        };
        let mut joined = Self { map, first_later, links: Vec::new(), unjoined_parts };
        joined.extend_links(places.sights.iter().map(link).collect());
        joined.correct();
        Ok(joined)
    }

    /// Aligns the keyframes of the two maps that should show the same, and corrects all poses again.
    pub(super) fn add_links(&mut self) {
        let found = links(&self.map.store, self.first_later);
        self.extend_links(found);
        self.correct();
        self.map.graph.edges.extend(self.links.iter().map(|link| link.edge.clone()));
    }

    /// Adds links of pairs that have none yet.
    fn extend_links(&mut self, found: Vec<Link>) {
        let pair = |edge: &Edge| (edge.from.min(edge.to), edge.from.max(edge.to));
        let mut known: BTreeSet<_> = self.links.iter().map(|link| pair(&link.edge)).collect();
        self.links.extend(found.into_iter().filter(|link| known.insert(pair(&link.edge))));
    }

    /// Computes the poses of all keyframes that are connected across the maps.
    fn correct(&mut self) {
        let firm = |edge: &Edge| match edge.kind {
            EdgeKind::Given => {
                Edge { information: edge.information.map(|row| row.map(|part| part * GIVEN_STRENGTH)), ..edge.clone() }
            }
            _ => edge.clone(),
        };
        let of_links = self.links.iter().map(|link| link.edge.clone());
        let graph = PoseGraph { edges: self.map.graph.edges.iter().map(firm).chain(of_links).collect() };
        let mut done = BTreeSet::new();
        let starts: Vec<KeyframeId> = self.links.iter().map(|link| link.edge.from.min(link.edge.to)).collect();
        for start in starts {
            if done.contains(&start) {
                continue;
            }
            for (id, pose) in graph.optimised(&self.map.store, start) {
                done.insert(id);
                if let Some(keyframe) = self.map.store.get_mut(id) {
                    keyframe.world_from_key = pose;
                }
            }
        }
    }

    /// How keyframes of one of the maps have moved. `first` is the number that its keyframe 0 has here.
    pub(super) fn motions(&self, before: &KeyframeMap, first: KeyframeId) -> MapCorrection {
        let after = self.map.store.poses();
        let motion = |(id, pose): (KeyframeId, Pose)| {
            let moved = after.get(&(id + first)).filter(|after| **after != pose)?;
            Some((id, *moved * pose.inverse()))
        };
        let new_from_old = before.store.poses().into_iter().filter_map(motion).collect();
        MapCorrection { new_from_old, joined: Vec::new() }
    }

    /// How well the maps fit.
    pub(super) fn fit(&self, later: &KeyframeMap, places: &Places) -> MapFit {
        let errors: Vec<(f64, f64)> = self.links.iter().filter_map(|link| self.error(&link.edge)).collect();
        let median = |of: fn(&(f64, f64)) -> f64| {
            let mut sorted: Vec<f64> = errors.iter().map(of).collect();
            sorted.sort_by(f64::total_cmp);
            sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
        };
        let agreements: f64 = self.links.iter().map(|link| f64::from(link.agreement)).sum();
        MapFit {
            earlier_from_later: self.motion(later, places),
            earlier: places.earlier,
            later: places.later,
            elsewhere: places.elsewhere,
            aligned: self.links.len(),
            residual_m: median(|error| error.0),
            residual_deg: median(|error| error.1).to_degrees(),
            agreement: agreements / self.links.len().max(1) as f64,
            unjoined_parts: self.unjoined_parts,
        }
    }

    /// The error of a measured relative pose, metres and radians.
    fn error(&self, edge: &Edge) -> Option<(f64, f64)> {
        let (from, to) = (self.map.store.get(edge.from)?, self.map.store.get(edge.to)?);
        Some(apart(&(from.world_from_key * edge.measured), &to.world_from_key))
    }

    /// The motion of the later map that is nearest to those of all its keyframes.
    fn motion(&self, later: &KeyframeMap, places: &Places) -> Pose {
        let joined = |keyframe: &&StoredKeyframe| places.parts.contains_key(&keyframe.part);
        let motions: Vec<Pose> = later
            .store
            .iter()
            .filter(joined)
            .filter_map(|keyframe| {
                Some(
                    self.map.store.get(keyframe.id + self.first_later)?.world_from_key
                        * keyframe.world_from_key.inverse(),
                )
            })
            .collect();
        let centre = later.store.iter().map(|keyframe| keyframe.world_from_key.translation()).sum::<glam::DVec3>()
            / later.store.len().max(1) as f64;
        let middle = Pose::from_translation(centre);
        let total = |one: &Pose| -> f64 {
            let away = |other: &Pose| {
                let (distance, angle) = apart(&(*one * middle), &(*other * middle));
                distance + angle
            };
            motions.iter().map(away).sum()
        };
        let nearest = motions.iter().min_by(|one, other| total(one).total_cmp(&total(other)));
        nearest.copied().unwrap_or(Pose::IDENTITY)
    }

    /// Drops keyframes of the earlier map that the later one has, too, and then the closest ones until a map may have as
    /// many.
    pub(super) fn drop_redundant(&mut self) {
        let (earlier, later): (Vec<&StoredKeyframe>, Vec<&StoredKeyframe>) =
            self.map.store.iter().partition(|keyframe| keyframe.id < self.first_later);
        let mut pairs = Vec::new();
        for keyframe in earlier {
            let same_part = later.iter().filter(|other| other.part == keyframe.part);
            let away = |other: &StoredKeyframe| distance(&other.world_from_key, &keyframe.world_from_key);
            let nearest = same_part.min_by(|one, other| away(one).total_cmp(&away(other)));
            pairs.extend(nearest.filter(|other| away(other) <= REDUNDANT).map(|other| (keyframe.id, other.id)));
        }
        for (dropped, kept) in pairs {
            self.map.store.drop_keyframe(dropped, kept);
            self.forget(dropped, kept);
        }
        while self.map.store.len() > MAX_STORED {
            let Some((dropped, kept)) = self.map.store.drop_redundant() else { break };
            self.forget(dropped, kept);
        }
        self.map.find_uncertain();
    }

    /// Attaches the relative poses of a dropped keyframe to the one that replaces it.
    fn forget(&mut self, dropped: KeyframeId, kept: KeyframeId) {
        if let Some((_, kept_from_dropped)) = self.map.store.replaced.get(&dropped) {
            let kept_from_dropped = *kept_from_dropped;
            self.map.graph.replace(dropped, kept, &kept_from_dropped);
        }
    }
}

fn renumbered(edge: &Edge, first: KeyframeId) -> Edge {
    Edge { from: edge.from + first, to: edge.to + first, ..edge.clone() }
}

/// The part and the motion of each part of the later map, and how many could not be joined.
fn part_motions(earlier: &KeyframeMap, later: &KeyframeMap, places: &Places) -> (BTreeMap<u32, (u32, Pose)>, usize) {
    let parts: BTreeSet<u32> = later.store.iter().map(|keyframe| keyframe.part).collect();
    let x = |pose: &Pose| pose.translation().x;
    let placed = later.store.iter().filter_map(|keyframe| {
        let (_, motion) = places.parts.get(&keyframe.part)?;
        Some(x(&(*motion * keyframe.world_from_key)))
    });
    let all = placed.chain(earlier.store.iter().map(|keyframe| x(&keyframe.world_from_key)));
    let mut right = all.fold(f64::NEG_INFINITY, f64::max);
    let mut next = earlier.store.iter().map(|keyframe| keyframe.part).max().map_or(0, |part| part.saturating_add(1));
    let mut motions = places.parts.clone();
    for part in parts.iter().filter(|part| !places.parts.contains_key(part)) {
        let of_part = later.store.iter().filter(|keyframe| keyframe.part == *part);
        let (left, end) = of_part.fold((f64::INFINITY, f64::NEG_INFINITY), |(left, end), keyframe| {
            (left.min(x(&keyframe.world_from_key)), end.max(x(&keyframe.world_from_key)))
        });
        let to = right + GAP;
        motions.insert(*part, (next, Pose::from_translation(glam::DVec3::new(to - left, 0.0, 0.0))));
        (right, next) = (to + end - left, next.saturating_add(1));
    }
    (motions, parts.len() - places.parts.len())
}

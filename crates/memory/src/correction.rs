//! Corrections of the map: Gaussians move with the keyframes that they are attached to, surfaces that are there twice
//! become one, and ids that turn out to be the same object are merged.
//!
//! When the camera comes back to a place after a long way, its pose has drifted, and the map grows a second copy of the
//! surfaces there. Once the loop is closed, the copies lie on each other.
//!
//! - **Surfaces**: a later Gaussian is merged into an earlier one that the correction has brought close to it.
//! - **Ids**: of the merged surface, two ids become one if they overlap by an IoU of at least [`SameObject::min_iou`] and have never
//!   been shown side by side in one frame. The older id stays.

use crate::co_visible::CoVisibleIds;
use crate::doubles::Double;
use crate::map::SplatMap;
use crate::origin::change_of_origin;
use crate::segment_store::SegmentStore;
use glam::DVec3;
use rayon::prelude::*;
use splatseg_geometry::{KeyframeId, LocalPose, MapCorrection, RemappedId, SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// Number of Gaussians that are moved at a time.
const BLOCK: usize = 2048;

/// When two ids of a surface that is there twice are one object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SameObject {
    /// Minimum overlap of the two ids, over the surface that is there twice.
    pub(crate) min_iou: f32,
    /// The overlap must be at least this share of the smaller object's area.
    pub(crate) min_share: f32,
}

/// After a loop. A wrong union is worse than none: the camera will come back.
pub(crate) const AFTER_LOOP: SameObject = SameObject { min_iou: 0.5, min_share: 0.3 };

/// Minimum overlap of two ids of one thing in consecutive frames: small things move by half their size in a fast turn.
const MIN_IOU_OF_FRAMES: f32 = 0.33;

/// How much two ids overlap, square metres.
struct Overlap {
    ids: RemappedId,
    area: f32,
}

/// How a correction moves the coordinates of a map with this origin, by keyframe.
pub(crate) fn motions(correction: &MapCorrection, origin: DVec3) -> BTreeMap<KeyframeId, LocalPose> {
    let motion = |(id, new_from_old): (&KeyframeId, _)| (*id, change_of_origin(new_from_old, origin, origin));
    correction.new_from_old.iter().map(motion).collect()
}

/// Moves the Gaussians with their keyframes.
pub(crate) fn move_anchored(map: &mut SplatMap, motions: &BTreeMap<KeyframeId, LocalPose>) {
    let means = map.balls.means.par_chunks_mut(BLOCK).zip(map.anchors.par_chunks(BLOCK));
    means.for_each(|(mut means, anchors)| {
        // Gaussians of a keyframe mostly follow each other.
        for run in anchors.chunk_by(|one, other| one == other) {
            let (of_run, rest) = means.split_at_mut(run.len());
            if let Some(motion) = motions.get(&run[0]) {
                of_run.iter_mut().for_each(|mean| *mean = motion.to_world(*mean));
            }
            means = rest;
        }
    });
}

/// The ids of a doubled surface that are the same object. `ids` and `radii` have one entry per Gaussian.
pub(crate) fn same_objects(
    doubles: &[Double],
    ids: &[SegmentId],
    radii: &[f32],
    co_visible: &CoVisibleIds,
    rule: SameObject,
) -> Vec<RemappedId> {
    let area = |index: usize| radii[index] * radii[index];
    let mut totals: BTreeMap<SegmentId, f32> = BTreeMap::new();
    for (index, id) in ids.iter().enumerate() {
        *totals.entry(*id).or_default() += area(index);
    }
    let mut of_later: BTreeMap<SegmentId, f32> = BTreeMap::new();
    let mut of_earlier: BTreeMap<SegmentId, f32> = BTreeMap::new();
    let mut overlaps: BTreeMap<(SegmentId, SegmentId), f32> = BTreeMap::new();
    for Double { later, earlier } in doubles {
        let weight = area(*later);
        *of_later.entry(ids[*later]).or_default() += weight;
        *of_earlier.entry(ids[*earlier]).or_default() += weight;
        *overlaps.entry((ids[*later], ids[*earlier])).or_default() += weight;
    }
    let is_same = |((later, earlier), area): ((SegmentId, SegmentId), f32)| {
        let union = of_later[&later] + of_earlier[&earlier] - area;
        let smaller = totals[&later].min(totals[&earlier]);
        let fits = area >= rule.min_iou * union && area >= rule.min_share * smaller;
        let is_candidate = later != earlier && later != 0 && earlier != 0 && fits;
        (is_candidate && !co_visible.contains(later, earlier))
            .then(|| Overlap { ids: RemappedId { from: later.max(earlier), into: later.min(earlier) }, area })
    };
    let mut found: Vec<Overlap> = overlaps.into_iter().filter_map(is_same).collect();
    found.sort_by(|one, other| other.area.total_cmp(&one.area).then(one.ids.cmp(&other.ids)));
    one_to_one(found.into_iter().map(|overlap| overlap.ids))
}

/// The pairs, best first, whose ids are in no better pair.
fn one_to_one(pairs: impl Iterator<Item = RemappedId>) -> Vec<RemappedId> {
    let mut used = BTreeSet::new();
    let is_free = |ids: &RemappedId| {
        let is_free = !used.contains(&ids.from) && !used.contains(&ids.into);
        if is_free {
            used.extend([ids.from, ids.into]);
        }
        is_free
    };
    pairs.filter(is_free).collect()
}

/// The ids of a frame whose pose was unknown that a later frame shows as other ids. `without_pose` and `shown` are
/// `[height, width]`, 0 for none; ids in `mapped` have Gaussians and stay, as do those that the later frame shows, too.
pub(crate) fn recognised(
    without_pose: &SegmentMap,
    shown: &SegmentMap,
    mapped: &BTreeSet<SegmentId>,
    co_visible: &CoVisibleIds,
) -> Vec<RemappedId> {
    let mut overlaps: BTreeMap<(SegmentId, SegmentId), usize> = BTreeMap::new();
    for (from, into) in without_pose.pixels().iter().zip(shown.pixels()) {
        *overlaps.entry((*from, *into)).or_default() += 1;
    }
    let (of_lost, of_shown) = (without_pose.areas(), shown.areas());
    let iou = |&((from, into), area): &((SegmentId, SegmentId), usize)| {
        area as f32 / (of_lost[&from] + of_shown[&into] - area) as f32
    };
    let mut same: Vec<_> = overlaps
        .into_iter()
        .filter(|((from, into), _)| *from != 0 && *into != 0 && !of_shown.contains_key(from) && !mapped.contains(from))
        .filter(|overlap| iou(overlap) >= MIN_IOU_OF_FRAMES)
        .filter(|((from, into), _)| !co_visible.contains(*from, *into))
        .collect();
    same.sort_by(|one, other| iou(other).total_cmp(&iou(one)).then(one.cmp(other)));
    one_to_one(same.into_iter().map(|((from, into), _)| RemappedId { from, into }))
}

/// Adds later Gaussians to the earlier ones on the same surface. Returns the Gaussians that remain.
pub(crate) fn merge_doubles(map: &mut SplatMap, store: &mut dyn SegmentStore, doubles: &[Double]) -> Vec<bool> {
    let mut keep = vec![true; map.len()];
    for Double { later, earlier } in doubles {
        // An earlier Gaussian may itself be merged: then this one stays.
        if keep[*earlier] {
            store.merge_gaussian(*later, *earlier);
            map.last_seen[*earlier] = map.last_seen[*earlier].max(map.last_seen[*later]);
            map.seen_through[*earlier] = 0;
            map.surfaces[*earlier] = map.surfaces[*earlier].min(map.surfaces[*later]);
            keep[*later] = false;
        }
    }
    keep
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_of_a_refused_pair_is_free_for_the_next_one() {
        let pair = |(from, into)| RemappedId { from, into };
        let pairs = [(11, 1), (12, 1), (12, 2), (13, 12), (14, 3)].map(pair);
        assert_eq!(one_to_one(pairs.into_iter()), [(11, 1), (12, 2), (14, 3)].map(pair));
    }
}

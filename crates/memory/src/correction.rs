//! Corrections of the map: Gaussians move with the keyframes that they are attached to, surfaces that are there twice
//! become one, and ids that turn out to be the same object are merged.
//!
//! When the camera comes back to a place after a long way, its pose has drifted, and the map grows a second copy of the
//! surfaces there. Once the loop is closed, the copies lie on each other.
//!
//! - **Surfaces**: a later Gaussian is absorbed by an earlier one that the correction has brought close to it.
//! - **Ids**: of the absorbed surface, two ids are merged if they overlap by an IoU of at least [`MIN_IOU`] and have never
//!   been shown side by side in one frame. The older id stays.

use crate::SplatMemory;
use crate::doubles::{Corrected, Double};
use crate::map::SplatMap;
use crate::origin::change_of_origin;
use rayon::prelude::*;
use splatseg_geometry::{FrameAnchor, KeyframeId, LocalPose, MapCorrection, RemappedId, SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// Number of Gaussians that are moved at a time.
const BLOCK: usize = 2048;

/// Minimum overlap of two ids that are merged, over the surface that is there twice.
const MIN_IOU: f32 = 0.5;

/// Minimum overlap of two ids of one thing in consecutive frames: small things move by half their size in a fast turn.
const MIN_IOU_OF_FRAMES: f32 = 0.33;

/// The overlap must be at least this share of the smaller segment's area.
const MIN_SHARE: f32 = 0.3;

/// How much two ids overlap, square metres.
struct Overlap {
    ids: RemappedId,
    area: f32,
}

impl SplatMemory {
    /// Sets the keyframe to which new Gaussians are attached.
    pub fn set_anchor(&mut self, anchor: &FrameAnchor) {
        self.anchor = anchor.clone();
    }

    /// Records the ids that a frame shows, `[height, width]`, 0 for none. Ids that were shown side by side are never
    /// merged.
    pub fn record_shown(&mut self, segments: &SegmentMap) {
        self.co_visible.record(segments);
    }

    /// Moves the Gaussians with their keyframes, and joins the surfaces and ids that are there twice. Returns the ids that
    /// turned out to be older ones' objects.
    pub fn correct(&mut self, correction: &MapCorrection) -> Vec<RemappedId> {
        let before = self.map.balls.means.clone();
        self.move_anchored(correction);
        if correction.joined.is_empty() || !self.store.can_remap() {
            return Vec::new();
        }
        let SplatMap { balls, anchors, .. } = &self.map;
        let corrected = Corrected { before: &before, means: &balls.means, radii: &balls.radii, anchors };
        let doubles = corrected.doubles();
        if doubles.is_empty() {
            return Vec::new();
        }
        let remapped = self.same_objects(&doubles);
        self.remap(&remapped);
        self.merge_doubles(&doubles);
        remapped
    }

    /// The ids that turned out to be older ones' objects, since the memory was created: merged id and remaining id.
    pub fn remapped_ids(&self) -> &BTreeMap<SegmentId, SegmentId> {
        &self.remapped
    }

    fn move_anchored(&mut self, correction: &MapCorrection) {
        let motions: BTreeMap<KeyframeId, LocalPose> = correction
            .new_from_old
            .iter()
            .map(|(id, motion)| (*id, change_of_origin(motion, self.origin, self.origin)))
            .collect();
        let means = self.map.balls.means.par_chunks_mut(BLOCK).zip(self.map.anchors.par_chunks(BLOCK));
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
        if let Some(motion) = motions.get(&self.anchor.keyframe) {
            self.recent.transform(motion);
        }
    }

    /// The ids of a doubled surface that are the same object.
    fn same_objects(&self, doubles: &[Double]) -> Vec<RemappedId> {
        let ids = self.store.segment_ids();
        let area = |index: usize| self.map.balls.radii[index] * self.map.balls.radii[index];
        let mut totals: BTreeMap<SegmentId, f32> = BTreeMap::new();
        for (index, id) in ids.iter().enumerate() {
            *totals.entry(*id).or_default() += area(index);
        }
        let (mut of_later, mut of_earlier) = (BTreeMap::<SegmentId, f32>::new(), BTreeMap::<SegmentId, f32>::new());
        let mut overlaps: BTreeMap<(SegmentId, SegmentId), f32> = BTreeMap::new();
        for Double { later, earlier } in doubles {
            let (weight, pair) = (area(*later), (ids[*later], ids[*earlier]));
            *of_later.entry(pair.0).or_default() += weight;
            *of_earlier.entry(pair.1).or_default() += weight;
            *overlaps.entry(pair).or_default() += weight;
        }
        let is_same = |((later, earlier), area): ((SegmentId, SegmentId), f32)| {
            let union = of_later[&later] + of_earlier[&earlier] - area;
            let smaller = totals[&later].min(totals[&earlier]);
            let fits = area >= MIN_IOU * union && area >= MIN_SHARE * smaller;
            let is_candidate = later != earlier && later != 0 && earlier != 0 && fits;
            (is_candidate && !self.co_visible.contains(later, earlier))
                .then(|| Overlap { ids: RemappedId { from: later.max(earlier), into: later.min(earlier) }, area })
        };
        let mut found: Vec<Overlap> = overlaps.into_iter().filter_map(is_same).collect();
        found.sort_by(|one, other| other.area.total_cmp(&one.area).then(one.ids.cmp(&other.ids)));
        // Each id takes part once; what is left over is found at the next correction.
        let mut used = BTreeSet::new();
        found.retain(|Overlap { ids, .. }| used.insert(ids.from) && used.insert(ids.into));
        found.into_iter().map(|overlap| overlap.ids).collect()
    }

    /// Merges the ids of the latest frame, if its pose was unknown, with those that a frame whose pose is known shows
    /// instead. `segments` contains its id of each pixel, `[height, width]`, 0 for none. Must be called before
    /// [`Self::update`]. Only ids without Gaussians change: the map knows nothing about them yet. Returns the changed ids.
    pub fn remap_recognised(&mut self, segments: &SegmentMap) -> Vec<RemappedId> {
        let remapped = self.recognised(segments);
        self.remap(&remapped);
        remapped
    }

    fn recognised(&self, segments: &SegmentMap) -> Vec<RemappedId> {
        let Some(without_pose) = self.recent.ids_without_pose().filter(|ids| ids.size() == segments.size()) else {
            return Vec::new();
        };
        let mut overlaps: BTreeMap<(SegmentId, SegmentId), usize> = BTreeMap::new();
        for (from, into) in without_pose.pixels().iter().zip(segments.pixels()) {
            *overlaps.entry((*from, *into)).or_default() += 1;
        }
        let (of_lost, of_shown) = (without_pose.areas(), segments.areas());
        let mapped: BTreeSet<SegmentId> = self.store.segment_ids().into_iter().collect();
        let iou = |&((from, into), area): &((SegmentId, SegmentId), usize)| {
            area as f32 / (of_lost[&from] + of_shown[&into] - area) as f32
        };
        let mut same: Vec<_> = overlaps
            .into_iter()
            .filter(|((from, into), _)| *from != 0 && *into != 0 && from != into && !mapped.contains(from))
            .filter(|overlap| iou(overlap) >= MIN_IOU_OF_FRAMES)
            .filter(|((from, into), _)| !self.co_visible.contains(*from, *into))
            .collect();
        same.sort_by(|one, other| iou(other).total_cmp(&iou(one)).then(one.cmp(other)));
        let (mut from_used, mut into_used) = (BTreeSet::new(), BTreeSet::new());
        same.retain(|((from, into), _)| {
            !from_used.contains(from) && into_used.insert(*into) && from_used.insert(*from)
        });
        same.into_iter().map(|((from, into), _)| RemappedId { from, into }).collect()
    }

    fn remap(&mut self, remapped: &[RemappedId]) {
        if remapped.is_empty() {
            return;
        }
        let names: BTreeMap<SegmentId, SegmentId> = remapped.iter().map(|ids| (ids.from, ids.into)).collect();
        self.store.remap(&names);
        self.recent.remap(&names);
        for ids in remapped {
            self.co_visible.remap(*ids);
            self.segments.remap(*ids);
            self.remapped.values_mut().filter(|into| **into == ids.from).for_each(|into| *into = ids.into);
            self.remapped.insert(ids.from, ids.into);
        }
    }

    /// Adds later Gaussians to the earlier ones on the same surface.
    fn merge_doubles(&mut self, doubles: &[Double]) {
        let mut keep = vec![true; self.map.len()];
        for Double { later, earlier } in doubles {
            // An earlier Gaussian may itself be absorbed: then this one stays.
            if keep[*earlier] {
                self.store.merge_gaussian(*later, *earlier);
                self.map.last_seen[*earlier] = self.map.last_seen[*earlier].max(self.map.last_seen[*later]);
                self.map.seen_through[*earlier] = 0;
                self.map.surfaces[*earlier] = self.map.surfaces[*earlier].min(self.map.surfaces[*later]);
                keep[*later] = false;
            }
        }
        self.map.retain(&keep);
        self.store.retain(&keep);
    }
}

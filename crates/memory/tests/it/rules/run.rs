//! A memory that learns views, as in a run of the method.

use super::scene::{Shot, Solid};
use glam::Vec3;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{FrameUpdate, MemoryKind, MemorySettings, SplatMemory};
use std::collections::{BTreeMap, BTreeSet};

/// The default settings.
pub fn evidence() -> MemorySettings {
    MemorySettings::default()
}

/// The paper's memory with a small codebook, which is generated quickly.
pub fn features() -> MemorySettings {
    MemorySettings::default().with(|settings| {
        settings.kind = MemoryKind::Features;
        settings.feature_dim = 8;
        settings.num_codes = 16;
    })
}

/// Settings of both kinds of memory.
pub fn kinds() -> [MemorySettings; 2] {
    [evidence(), features()]
}

pub struct Run {
    pub memory: SplatMemory,
}

/// The result of one frame.
pub struct Step {
    /// Segments expected before the frame was learnt.
    pub expected: SegmentMap,
    pub fused: SegmentMap,
    pub update: FrameUpdate,
}

impl Run {
    pub fn new(settings: MemorySettings) -> Self {
        Self { memory: SplatMemory::new(settings, 0, &mut |_| {}).unwrap() }
    }

    /// Learns a view whose predictions are the truth.
    pub fn show(&mut self, shot: &Shot) -> Step {
        self.show_as(shot, &shot.truth)
    }

    /// Learns the same view `count` times.
    pub fn show_times(&mut self, shot: &Shot, count: usize) -> Vec<Step> {
        (0..count).map(|_| self.show(shot)).collect()
    }

    /// Learns a view with the given predictions. Ids that do not exist yet are created.
    pub fn show_as(&mut self, shot: &Shot, predicted: &SegmentMap) -> Step {
        self.show_contradicted(shot, predicted, &BTreeSet::new())
    }

    /// As [`Self::show_as`], with predictions that the memory contradicts.
    pub fn show_contradicted(
        &mut self,
        shot: &Shot,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
    ) -> Step {
        let largest = predicted.pixels().iter().copied().max().unwrap_or(0);
        while self.memory.segment_count() < largest as usize {
            self.memory.new_segment().unwrap();
        }
        let frame = shot.frame();
        let recall = self.memory.recall(&frame);
        let expected = recall.expected().segments.clone();
        let fused = self.memory.fuse(&recall, predicted).unwrap();
        let update = self.memory.update(recall, predicted, contradicted).unwrap();
        Step { expected, fused, update }
    }

    /// Learns a view as the method does: each true mask gets the id of the expected segment that it overlaps most, or a
    /// new id if there is none. Returns the id of each true mask.
    pub fn show_matched(&mut self, shot: &Shot) -> BTreeMap<SegmentId, SegmentId> {
        let expected = self.expected(shot);
        let mut overlaps = BTreeMap::new();
        for pair in shot.truth.pixels().iter().copied().zip(expected.pixels().iter().copied()) {
            *overlaps.entry(pair).or_insert(0) += 1;
        }
        let mut ids = BTreeMap::new();
        for truth in shot.truth.areas().into_keys() {
            let found = overlaps.iter().filter(|((of, id), _)| *of == truth && *id != 0);
            let best = found.max_by_key(|(_, area)| **area).map(|((_, id), _)| *id);
            ids.insert(truth, best.unwrap_or_else(|| self.memory.new_segment().unwrap()));
        }
        self.show_as(shot, &shot.truth.map(|truth| ids.get(truth).copied().unwrap_or(0)));
        ids
    }

    pub fn expected(&self, shot: &Shot) -> SegmentMap {
        self.memory.recall(&shot.frame()).expected().segments.clone()
    }

    /// Positions of the Gaussians in the world.
    pub fn positions(&self) -> Vec<Vec3> {
        self.means().iter().map(|mean| (mean.as_dvec3() + self.memory.map().origin).as_vec3()).collect()
    }

    pub fn means(&self) -> &[Vec3] {
        self.memory.map().means
    }

    /// Number of Gaussians in a box or at most `slack` outside it.
    pub fn count_in(&self, solid: &Solid, slack: f32) -> usize {
        self.means().iter().filter(|mean| solid.contains(**mean, slack)).count()
    }
}

/// Returns the share of the pixels of `id` in `truth` that are correct in `found`.
pub fn recalled(found: &SegmentMap, truth: &SegmentMap, id: SegmentId) -> f32 {
    let of_id = || truth.pixels().iter().zip(found.pixels()).filter(|(truth, _)| **truth == id);
    of_id().filter(|(truth, found)| truth == found).count() as f32 / of_id().count() as f32
}

/// Returns the share of equal pixels.
pub fn agreement(one: &SegmentMap, other: &SegmentMap) -> f32 {
    let equal = one.pixels().iter().zip(other.pixels()).filter(|(one, other)| one == other).count();
    equal as f32 / one.pixels().len() as f32
}

//! A map as it was at one moment, for work beside the frames.

use crate::{MapSegments, MapView, PatchSize, SegmentId, SurfaceKind};
use glam::{DVec3, Vec3};
use std::collections::BTreeSet;

/// A copy of what a [`MapView`] shows, 36 bytes per Gaussian. [`Self::view`] reads it as the map.
#[derive(Clone, Debug)]
pub struct MapCopy {
    origin: DVec3,
    means: Vec<Vec3>,
    radii: Vec<f32>,
    colors: Vec<[u8; 3]>,
    surfaces: Vec<SurfaceKind>,
    patch: PatchSize,
    segments: CopiedSegments,
}

#[derive(Clone, Debug)]
struct CopiedSegments {
    ids: Vec<SegmentId>,
    shares: Option<Vec<f32>>,
    votes: Option<Vec<f32>>,
    confidences: Option<Vec<f32>>,
    carried: BTreeSet<SegmentId>,
    tentative: BTreeSet<SegmentId>,
    parameter_count: usize,
}

impl MapCopy {
    /// Copies a map.
    pub fn of(map: &MapView<'_>) -> Self {
        let (ids, carried) = (map.segment_ids(), map.carried_ids());
        let all: BTreeSet<SegmentId> = ids.chunk_by(|one, other| one == other).map(|run| run[0]).collect();
        let tentative = all.union(&carried).copied().filter(|id| map.is_tentative(*id)).collect();
        let segments = CopiedSegments {
            ids,
            shares: map.segments.segment_shares(),
            votes: map.segments.segment_votes(),
            confidences: map.segments.segment_confidences(),
            carried,
            tentative,
            parameter_count: map.parameter_count(),
        };
        Self {
            origin: map.origin,
            means: map.means.to_vec(),
            radii: map.radii.to_vec(),
            colors: map.colors.to_vec(),
            surfaces: map.surfaces.to_vec(),
            patch: map.patch,
            segments,
        }
    }

    /// The map.
    pub fn view(&self) -> MapView<'_> {
        MapView {
            origin: self.origin,
            means: &self.means,
            radii: &self.radii,
            colors: &self.colors,
            surfaces: &self.surfaces,
            patch: self.patch,
            segments: &self.segments,
        }
    }
}

impl MapSegments for CopiedSegments {
    fn segment_ids(&self) -> Vec<SegmentId> {
        self.ids.clone()
    }

    fn segment_shares(&self) -> Option<Vec<f32>> {
        self.shares.clone()
    }

    fn segment_votes(&self) -> Option<Vec<f32>> {
        self.votes.clone()
    }

    fn segment_confidences(&self) -> Option<Vec<f32>> {
        self.confidences.clone()
    }

    fn is_tentative(&self, id: SegmentId) -> bool {
        self.tentative.contains(&id)
    }

    fn is_carried(&self, id: SegmentId) -> bool {
        self.carried.contains(&id)
    }

    fn carried_ids(&self) -> BTreeSet<SegmentId> {
        self.carried.clone()
    }

    fn parameter_count(&self) -> usize {
        self.parameter_count
    }
}

//! Visibility of the solids from a series of poses, in coarse images.

use super::rays::Caster;
use super::scenery::Scenery;
use rayon::prelude::*;
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId};
use std::collections::BTreeMap;

/// Width and height of the images in which visibility is measured, pixels.
const GRID: (usize, usize) = (48, 36);

/// Number of rays that hit each solid, for each of a series of poses.
#[derive(Debug)]
pub(super) struct Visibility {
    views: Vec<BTreeMap<SegmentId, usize>>,
}

impl Visibility {
    pub(super) fn new(scenery: &Scenery, intrinsics: &Intrinsics, poses: &[LocalPose]) -> Self {
        let (width, height) = GRID;
        let coarse = intrinsics.resized(width, height);
        let seen_from = |pose: &LocalPose| {
            let mut counts = BTreeMap::<SegmentId, usize>::new();
            for sample in (Caster { scenery, intrinsics: coarse, pose: *pose }).image().pixels() {
                *counts.entry(sample.id).or_default() += 1;
            }
            counts
        };
        Self { views: poses.par_iter().map(seen_from).collect() }
    }

    /// Returns the fraction of all rays, over all poses, that hit each solid.
    pub(super) fn fractions(self) -> BTreeMap<SegmentId, f32> {
        let rays = (GRID.0 * GRID.1 * self.views.len()).max(1) as f32;
        let mut fractions = BTreeMap::<SegmentId, f32>::new();
        for (id, count) in self.views.into_iter().flatten() {
            *fractions.entry(id).or_default() += count as f32 / rays;
        }
        fractions
    }

    /// Returns the number of poses from which a solid covers at least this fraction of the image.
    pub(super) fn clear_views(&self, id: SegmentId, fraction: f32) -> usize {
        let least = fraction * (GRID.0 * GRID.1) as f32;
        self.views.iter().filter(|counts| counts.get(&id).is_some_and(|count| *count as f32 >= least)).count()
    }
}

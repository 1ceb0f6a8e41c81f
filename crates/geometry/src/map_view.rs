//! A read-only view of a map: its Gaussians, and the segments that they show.
//!
//! Objects, outputs and viewers read a map through [`MapView`], whatever kind of memory it comes from.

use crate::SegmentId;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// How the place of a Gaussian was determined. Depth is missing on screens, glass and black things, and beyond the
/// sensor's range; Gaussians are added there nevertheless, so that their segments are remembered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SurfaceKind {
    /// Depth was measured there.
    #[default]
    Observed,
    /// It continues the plane of a measured surface.
    Continued,
    /// Nothing was measured near it: it has a direction, but its distance is arbitrary. It belongs to no shape and is no
    /// point of a point cloud.
    Assumed,
}

impl SurfaceKind {
    /// True if the place means something: it was measured, or continues a measured surface.
    pub fn has_place(self) -> bool {
        self != Self::Assumed
    }
}

/// A Gaussian of a map, and the segment that it shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapGaussian {
    /// Centre, metres, relative to the origin of its map.
    pub mean: Vec3,
    /// Standard deviation in every direction, metres.
    pub radius: f32,
    /// sRGB.
    pub color: [u8; 3],
    /// Segment that the Gaussian shows by itself, 0 for none.
    pub segment_id: SegmentId,
    /// Confidence of the segment, 0 to 1. In a memory of evidence: the segment's votes divided by all votes of the
    /// Gaussian, or by 1 if there is less than one vote. In a memory of features: the length of the feature, at most 1.
    pub confidence: f32,
}

/// The surface that a Gaussian of a map stands for, in multiples of its radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchSize {
    /// Side of the square of surface that it was added for.
    pub side: f32,
    /// Radius around its centre in which the surface counts as known, so that no other Gaussian is added.
    pub cover: f32,
}

/// The segments that the Gaussians of a map show.
pub trait MapSegments: Sync {
    /// Returns the segment that each Gaussian shows by itself, 0 for none.
    fn segment_ids(&self) -> Vec<SegmentId>;

    /// Returns how undisputed each entry of [`segment_ids`](Self::segment_ids) is: the share, 0 to 1, of all that the
    /// Gaussian was seen as. `None` if the memory does not know.
    fn segment_shares(&self) -> Option<Vec<f32>> {
        None
    }

    /// Returns how often each Gaussian was seen as its entry of [`segment_ids`](Self::segment_ids), in frames, up to a
    /// maximum. `None` if the memory does not count.
    fn segment_votes(&self) -> Option<Vec<f32>> {
        None
    }

    /// Returns the confidence of each entry of [`segment_ids`](Self::segment_ids), see [`MapGaussian::confidence`]. `None`
    /// if the memory does not know.
    fn segment_confidences(&self) -> Option<Vec<f32>> {
        None
    }

    /// Returns true if an id is tentative: predicted in one frame at most.
    fn is_tentative(&self, id: SegmentId) -> bool;

    /// Returns true if an id was carried after the last frame; see [`Self::carried_ids`].
    fn is_carried(&self, id: SegmentId) -> bool;

    /// Returns those of some ids that are carried, in their order; see [`Self::carried_ids`].
    fn carried_of(&self, ids: Vec<SegmentId>) -> Vec<SegmentId> {
        ids.into_iter().filter(|id| self.is_carried(*id)).collect()
    }

    /// Returns the ids that a Gaussian shows, or that the previous frame holds for the next one. All other ids that were
    /// given out are forgotten.
    fn carried_ids(&self) -> BTreeSet<SegmentId>;

    /// Number of parameters of all Gaussians.
    fn parameter_count(&self) -> usize;
}

/// A map as the rest of the program reads it. It borrows the map and costs nothing to make; what has to be computed is
/// computed by its methods, in a time proportional to the map. The slices have one entry per Gaussian.
#[derive(Clone, Copy)]
pub struct MapView<'a> {
    /// Origin of the map's coordinates: world coordinates, metres.
    pub origin: DVec3,
    /// Centres, metres, relative to the origin.
    pub means: &'a [Vec3],
    /// Standard deviations in every direction, metres.
    pub radii: &'a [f32],
    /// Colours, sRGB.
    pub colors: &'a [[u8; 3]],
    /// How the place of each Gaussian was determined. Those without a place ([`SurfaceKind::has_place`]) belong to no
    /// shape and no point cloud.
    pub surfaces: &'a [SurfaceKind],
    /// The surface that a Gaussian stands for.
    pub patch: PatchSize,
    /// The segments that the Gaussians show.
    pub segments: &'a dyn MapSegments,
}

impl MapView<'_> {
    /// Number of Gaussians.
    pub fn gaussian_count(&self) -> usize {
        self.means.len()
    }

    /// Number of parameters of all Gaussians.
    pub fn parameter_count(&self) -> usize {
        self.segments.parameter_count()
    }

    /// Returns the segment that each Gaussian shows by itself, 0 for none.
    pub fn segment_ids(&self) -> Vec<SegmentId> {
        self.segments.segment_ids()
    }

    /// Returns the share, 0 to 1, of each Gaussian's observations that are of its segment in
    /// [`segment_ids`](Self::segment_ids); 1 where the memory does not know.
    pub fn segment_shares(&self) -> Vec<f32> {
        self.segments.segment_shares().unwrap_or_else(|| vec![1.0; self.gaussian_count()])
    }

    /// Returns how often each Gaussian was seen as its segment in [`segment_ids`](Self::segment_ids), in frames, up to a
    /// maximum; 1 in a memory that does not count.
    pub fn segment_votes(&self) -> Vec<f32> {
        self.segments.segment_votes().unwrap_or_else(|| vec![1.0; self.gaussian_count()])
    }

    /// Returns every Gaussian with the segment that it shows.
    pub fn gaussians(&self) -> Vec<MapGaussian> {
        let ids = self.segment_ids();
        let confidences = self.segments.segment_confidences().unwrap_or_else(|| vec![1.0; self.gaussian_count()]);
        let surfaces = self.means.iter().zip(self.radii).zip(self.colors);
        let gaussian = |(((mean, radius), color), (segment_id, confidence)): (((&Vec3, &f32), &[u8; 3]), _)| {
            MapGaussian { mean: *mean, radius: *radius, color: *color, segment_id, confidence }
        };
        surfaces.zip(ids.into_iter().zip(confidences)).map(gaussian).collect()
    }

    /// True if an id is tentative: predicted in one frame at most. From the second frame on it is permanent.
    pub fn is_tentative(&self, id: SegmentId) -> bool {
        self.segments.is_tentative(id)
    }

    /// True if an id was carried after the last frame; see [`Self::carried_ids`].
    pub fn is_carried(&self, id: SegmentId) -> bool {
        self.segments.is_carried(id)
    }

    /// Returns the ids that a Gaussian shows, or that the previous frame holds for the next one. All other ids that were
    /// given out are forgotten.
    pub fn carried_ids(&self) -> BTreeSet<SegmentId> {
        self.segments.carried_ids()
    }
}

impl std::fmt::Debug for MapView<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("MapView").field("gaussians", &self.gaussian_count()).finish_non_exhaustive()
    }
}

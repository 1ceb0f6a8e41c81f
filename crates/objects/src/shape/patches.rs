//! The surface patches represented by Gaussians.

use glam::Vec3;
use splatseg_geometry::SegmentId;
use splatseg_memory::{COVERED, GrowthRule, RADIUS_PER_SPACING, SplatMemory};
use std::collections::BTreeMap;

/// Minimum radius of a Gaussian, metres.
const MIN_RADIUS: f32 = 1e-4;

/// The piece of surface represented by a Gaussian: a square that faced the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Patch {
    /// Its centre, metres, relative to the origin of the memory.
    pub mean: Vec3,
    /// Its side, metres.
    pub side: f32,
    /// Radius around its centre in which the memory considers the surface covered and adds no other Gaussian, metres.
    pub cover: f32,
    /// Colour, sRGB.
    pub color: [u8; 3],
    /// The object's share, 0 to 1, of all that the Gaussian was seen as.
    pub share: f32,
}

impl Patch {
    /// Its area, square metres.
    pub fn area(&self) -> f32 {
        self.side * self.side
    }
}

/// The patches of every object with Gaussians, in the order of the map.
pub(super) fn patches_by_object(memory: &SplatMemory) -> BTreeMap<SegmentId, Vec<Patch>> {
    let settings = memory.settings();
    let (sides_per_radius, covering_alpha) = match settings.growth_rule() {
        GrowthRule::Paper => (1.0, settings.growth_silhouette),
        _ => (1.0 / RADIUS_PER_SPACING, COVERED),
    };
    // A Gaussian's alpha is exp(-d² / 2r²) at distance d.
    let covers_per_radius = (-2.0 * covering_alpha.clamp(0.1, 0.9).ln()).sqrt();
    let (balls, colors) = (memory.balls(), memory.colors());
    let mut objects: BTreeMap<SegmentId, Vec<Patch>> = BTreeMap::new();
    let segments = memory.segment_ids().into_iter().zip(memory.segment_shares());
    for ((((id, share), mean), radius), color) in segments.zip(&balls.means).zip(&balls.radii).zip(colors) {
        // A loaded map may contain any values.
        if id != 0 && mean.is_finite() && radius.is_finite() {
            let radius = radius.max(MIN_RADIUS);
            let (side, cover) = (sides_per_radius * radius, covers_per_radius * radius);
            objects.entry(id).or_default().push(Patch { mean: *mean, side, cover, color: *color, share });
        }
    }
    objects
}

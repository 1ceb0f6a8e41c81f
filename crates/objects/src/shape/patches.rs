//! The surface patches represented by Gaussians.

use glam::Vec3;
use splatseg_geometry::{MapView, SegmentId, SurfaceKind};
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
    /// How often the Gaussian was seen as the object, in frames, up to a maximum of the memory.
    pub votes: f32,
    /// True if no depth was measured there: it continues the surface beside it.
    pub is_completed: bool,
}

impl Patch {
    /// Its area, square metres.
    pub fn area(&self) -> f32 {
        self.side * self.side
    }

    /// Its weight among the observations of the object: how often it was seen, times its side. Not times its area: large
    /// Gaussians were added from afar, or lie behind the object, and the thin parts of an object have only small ones.
    pub fn weight(&self) -> f32 {
        self.votes * self.side
    }
}

#[cfg(test)]
impl Patch {
    /// A patch that two frames saw as the object, and as nothing else.
    pub fn seen(mean: Vec3, side: f32) -> Self {
        Self { mean, side, cover: side, color: [0; 3], share: 1.0, votes: 2.0, is_completed: false }
    }
}

/// The patches of every object with Gaussians that have a place, in the order of the map.
pub(super) fn patches_by_object(map: &MapView<'_>) -> BTreeMap<SegmentId, Vec<Patch>> {
    let mut objects: BTreeMap<SegmentId, Vec<Patch>> = BTreeMap::new();
    let seen = map.segment_shares().into_iter().zip(map.segment_votes());
    let segments = map.segment_ids().into_iter().zip(seen).zip(map.surfaces);
    let placed = map.means.iter().zip(map.radii).zip(map.colors);
    for (((id, (share, votes)), surface), ((mean, radius), color)) in segments.zip(placed) {
        // A loaded map may contain any values.
        if id != 0 && surface.has_place() && mean.is_finite() && radius.is_finite() {
            let radius = radius.max(MIN_RADIUS);
            let (side, cover) = (map.patch.side * radius, map.patch.cover * radius);
            objects.entry(id).or_default().push(Patch {
                mean: *mean,
                side,
                cover,
                color: *color,
                share,
                votes,
                is_completed: *surface != SurfaceKind::Observed,
            });
        }
    }
    objects
}

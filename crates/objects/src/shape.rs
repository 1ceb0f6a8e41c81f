//! The shape of an object in the world, from the Gaussians that show it.

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use splatseg_memory::SplatMemory;
use std::collections::BTreeMap;

/// Where an object is and how large, as far as it was seen. World coordinates, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectShape {
    /// Mean of the surface that was seen. It lies towards the side that the camera saw: the middle of a box is
    /// [`OrientedBox::center`].
    pub centroid: Vec3,
    /// The box along the world's axes.
    pub axis_aligned_box: AxisAlignedBox,
    /// The tightest box that may be turned.
    pub oriented_box: OrientedBox,
    /// Area of the surface that was seen, square metres.
    pub area_m2: f32,
    /// Mean sRGB colour of that surface.
    pub color: [u8; 3],
    /// Number of Gaussians that show the object.
    pub points: usize,
    /// How many of them are left out of all of the above because they lie apart from the rest.
    pub stray_points: usize,
}

/// A box along the world's axes, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisAlignedBox {
    /// Least x, y and z.
    pub min: Vec3,
    /// Largest x, y and z.
    pub max: Vec3,
}

/// A box in any direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrientedBox {
    /// Its middle, world coordinates, metres.
    pub center: Vec3,
    /// Whole lengths along its own axes, metres.
    pub size: Vec3,
    /// World from box: turns its axes into the world's. Quaternion x, y, z, w with w ≥ 0.
    pub rotation: Quat,
}

/// The shapes of all objects that Gaussians of the memory show.
pub fn object_shapes(_memory: &SplatMemory) -> BTreeMap<SegmentId, ObjectShape> {
    BTreeMap::new()
}

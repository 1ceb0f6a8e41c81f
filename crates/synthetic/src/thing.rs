//! Ground truth geometry of the things in the synthetic room, for tests.

use super::solids::{Shape, Solid};
use glam::Vec3;
use splatseg_geometry::SegmentId;

/// A thing of the synthetic room at its initial position. World coordinates, metres, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    /// Its id in the ground truth.
    pub id: SegmentId,
    /// Its shape.
    pub kind: ThingKind,
    /// Centre of its bounding box.
    pub center: Vec3,
    /// Size of its bounding box along the box's own axes. The third axis is vertical.
    pub size: Vec3,
    /// Rotation of the box about the vertical axis, radians, counter-clockwise from above.
    pub turn: f32,
}

/// The shape of a [`Thing`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThingKind {
    /// A box.
    Box,
    /// A sphere.
    Sphere,
    /// An upright cylinder.
    Cylinder,
}

impl From<&Solid> for Thing {
    fn from(solid: &Solid) -> Self {
        let kind = match solid.shape {
            Shape::Box(_) => ThingKind::Box,
            Shape::Sphere(_) => ThingKind::Sphere,
            Shape::Cylinder(..) => ThingKind::Cylinder,
        };
        Self { id: solid.id, kind, center: solid.center, size: solid.shape.size(), turn: solid.turn.to_angle() }
    }
}

//! Where the things of the synthetic room stand, for tests that need the truth.

use super::solids::{Shape, Solid};
use glam::Vec3;
use splatseg_geometry::SegmentId;

/// A thing of the synthetic room, where it stands before anything moves. World coordinates, metres, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thing {
    /// Its id in the ground truth.
    pub id: SegmentId,
    /// Its shape.
    pub kind: ThingKind,
    /// The middle of the smallest box around it.
    pub center: Vec3,
    /// The lengths of that box along its own axes, of which the third is upright.
    pub size: Vec3,
    /// The turn of that box about the vertical, radians, counter-clockwise from above.
    pub turn: f32,
}

/// The shape of a [`Thing`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThingKind {
    /// It fills its box.
    Box,
    /// A ball.
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

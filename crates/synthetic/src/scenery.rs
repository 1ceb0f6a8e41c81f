//! Solids of a synthetic scene, the camera's walk among them, and the free space between.

use super::furniture::{FloorArea, Lane, Site};
use super::motion::Mover;
use super::solids::Solid;
#[cfg(test)]
use super::solids::{Hit, Ray};
use super::walk::Walk;
use glam::{Vec2, Vec3};
use splatseg_geometry::SegmentId;
use std::collections::{BTreeMap, BTreeSet};

/// A scene at its start.
#[derive(Clone, Debug)]
pub(super) struct Scenery {
    /// Several solids may have the same id.
    pub(super) solids: Vec<Solid>,
    /// Largest id of floors, ceilings, walls and doors.
    pub(super) largest_fixed: SegmentId,
    /// For each thing that does not stand on the floor, the thing it stands on.
    pub(super) carriers: BTreeMap<SegmentId, SegmentId>,
    /// Groups of things of equal shape, size and texture, each by increasing id.
    pub(super) twins: Vec<Vec<SegmentId>>,
    /// Areas on which things stand.
    pub(super) areas: Vec<FloorArea>,
    /// Positions of the lamps. The horizontally nearest one lights a point.
    pub(super) lamps: Vec<Vec3>,
    pub(super) walk: Walk,
}

impl Scenery {
    /// Returns the scene in a frame, with the movers at their positions.
    pub(super) fn at(&self, frame: usize, movers: &[Mover]) -> Self {
        let mut scenery = self.clone();
        for mover in movers {
            match mover.motion.offset_at(frame) {
                None => scenery.solids.retain(|solid| solid.id != mover.id),
                Some(offset) => {
                    let solids = scenery.solids.iter_mut();
                    solids.filter(|solid| solid.id == mover.id).for_each(|solid| solid.center += offset);
                }
            }
        }
        scenery
    }

    /// Removes a thing.
    pub(super) fn remove_thing(&mut self, id: SegmentId) {
        self.solids.retain(|solid| solid.id != id);
        self.carriers.remove(&id);
        self.twins.iter_mut().for_each(|group| group.retain(|twin| *twin != id));
        self.twins.retain(|group| group.len() > 1);
    }

    /// Moves the centre of a thing.
    pub(super) fn move_thing(&mut self, id: SegmentId, center: Vec3) {
        self.solids.iter_mut().filter(|solid| solid.id == id).for_each(|solid| solid.center = center);
    }

    /// Returns the things, without walls, floors, ceilings and doors.
    pub(super) fn things(&self) -> impl Iterator<Item = &Solid> {
        self.solids.iter().filter(|solid| solid.id > self.largest_fixed)
    }

    /// Returns the ids of the things on which nothing else stands.
    pub(super) fn unloaded_things(&self) -> impl Iterator<Item = SegmentId> {
        let carrying: BTreeSet<SegmentId> = self.carriers.values().copied().collect();
        self.things().map(|solid| solid.id).filter(move |id| !carrying.contains(id))
    }

    /// Returns the lane of each thing at its initial position.
    pub(super) fn lanes(&self) -> BTreeMap<SegmentId, Lane> {
        self.things().map(|solid| (solid.id, Lane::of(solid))).collect()
    }

    /// Returns the area in which a thing stands.
    pub(super) fn site_of(&self, thing: &Solid) -> Option<Site<'_>> {
        let area = *self.areas.iter().find(|area| area.contains(thing.center.truncate()))?;
        Some(Site { area, walk: &self.walk })
    }

    /// Returns the number of steps, at most `most`, that a thing can slide from its position, clear of the walls, the
    /// camera's path and all other `lanes`, and not beyond the edge of its carrier.
    pub(super) fn free_steps(
        &self,
        id: SegmentId,
        step: Vec2,
        most: usize,
        lanes: &BTreeMap<SegmentId, Lane>,
    ) -> usize {
        let Some(thing) = self.things().find(|solid| solid.id == id) else { return 0 };
        let Some(site) = self.site_of(thing) else { return 0 };
        let carrier = self.carriers.get(&id).and_then(|below| self.things().find(|solid| solid.id == *below));
        let others: Vec<Lane> = lanes
            .iter()
            .filter(|(other, _)| **other != id && carrier.is_none_or(|below| below.id != **other))
            .map(|(_, lane)| *lane)
            .collect();
        let footprint = thing.shape.footprint();
        let is_free = |steps: &usize| {
            let spot = thing.center.truncate() + *steps as f32 * step;
            site.is_inside(spot, footprint)
                && site.is_clear(spot, footprint, &others)
                && carrier.is_none_or(|below| below.has_on_top(spot, footprint))
        };
        (1..=most).take_while(is_free).count()
    }

    /// Returns the first solid hit by a ray, and the hit. Rays from inside a room always hit one.
    #[cfg(test)]
    pub(super) fn first_hit(&self, ray: Ray) -> Option<(&Solid, Hit)> {
        let mut nearest: Option<(&Solid, Hit)> = None;
        for solid in &self.solids {
            if let Some(hit) = solid.hit(ray)
                && nearest.as_ref().is_none_or(|(_, before)| hit.t < before.t)
            {
                nearest = Some((solid, hit));
            }
        }
        nearest
    }

    /// Returns the brightness of a hit: light from the nearest lamp below the ceiling, and ambient light.
    pub(super) fn brightness(&self, point_world: Vec3, normal: Vec3) -> f32 {
        let apart = |lamp: &Vec3| lamp.truncate().distance_squared(point_world.truncate());
        let nearest = self.lamps.iter().copied().min_by(|one, other| apart(one).total_cmp(&apart(other)));
        let to_light = nearest.unwrap_or(Vec3::Z) - point_world;
        let facing = normal.dot(to_light.normalize_or_zero()).max(0.0);
        0.55 + 0.5 * facing / (1.0 + 0.05 * to_light.length_squared())
    }
}

//! Placement of things on the floor of a room, clear of each other and of the camera's path.

use super::solids::{Shape, Solid};
use super::texture::Texture;
use super::walk::Walk;
use glam::{Vec2, Vec3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Minimum distance of things from walls and from each other.
const GAP: f32 = 0.06;
/// Things keep this distance from the camera's path, so that it never passes through any.
const WALK_MARGIN: f32 = 0.45;
/// More things than this are made smaller, to keep the covered area constant.
const FULL_SIZE_THINGS: usize = 60;
/// Number of places tried for a thing.
const PLACES: usize = 600;

/// A horizontal rectangle on the floor.
#[derive(Clone, Copy, Debug)]
pub(super) struct FloorArea {
    pub(super) center: Vec2,
    /// Half the size along x and y.
    pub(super) half: Vec2,
}

/// An area on which things stand, and the camera's walk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Site<'a> {
    pub(super) area: FloorArea,
    pub(super) walk: &'a Walk,
}

/// Floor area occupied by a thing: its footprint circle, swept along the line it slides on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lane {
    pub(super) start: Vec2,
    /// Equal to `start` for a stationary thing.
    pub(super) end: Vec2,
    radius: f32,
}

/// Kind, size and texture of a thing. Things of the same model are twins.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub(super) shape: Shape,
    pub(super) texture: Texture,
}

/// The things of a room.
#[derive(Debug, Default)]
pub(super) struct Furniture {
    pub(super) things: Vec<Solid>,
    /// For each thing that does not stand on the floor, the thing it stands on.
    pub(super) carriers: BTreeMap<SegmentId, SegmentId>,
    /// Model of each twin, as an index in the list of models.
    pub(super) models: BTreeMap<SegmentId, usize>,
}

impl FloorArea {
    pub(super) fn contains(&self, spot: Vec2) -> bool {
        (spot - self.center).abs().cmple(self.half).all()
    }
}

impl Site<'_> {
    /// Returns the maximum distance of such a footprint from the area's centre, along x and y.
    fn reach(&self, footprint: f32) -> Vec2 {
        self.area.half - Vec2::splat(footprint + GAP)
    }

    /// Returns true if such a footprint at `spot` is clear of the walls.
    pub(super) fn is_inside(&self, spot: Vec2, footprint: f32) -> bool {
        (spot - self.area.center).abs().cmple(self.reach(footprint)).all()
    }

    /// Returns true if such a footprint at `spot` is clear of the camera's path and of the others.
    pub(super) fn is_clear(&self, spot: Vec2, footprint: f32, others: &[Lane]) -> bool {
        others.iter().all(|other| other.distance(spot) > other.radius + footprint + GAP)
            && self.walk.distance(spot) > WALK_MARGIN + footprint
    }

    /// Draws a place for such a footprint, clear of the walls.
    pub(super) fn random_spot(&self, random: &mut ChaCha8Rng, footprint: f32) -> Vec2 {
        let reach = self.reach(footprint).max(Vec2::splat(GAP));
        let along = Vec2::new(random.random_range(-reach.x..reach.x), random.random_range(-reach.y..reach.y));
        self.area.center + along
    }

    /// Places up to `objects` things, with ids from `first_id`: first one for each entry of `twins`, an index in
    /// `models`, then others of random shape and size. Contains fewer things if there is no space left.
    pub(super) fn furnish(
        &self,
        random: &mut ChaCha8Rng,
        (first_id, objects): (SegmentId, usize),
        (models, twins): (&[Model], &[usize]),
    ) -> Furniture {
        let mut furniture = Furniture::default();
        let mut tops: Vec<usize> = Vec::new();
        let size = (FULL_SIZE_THINGS as f32 / objects.max(FULL_SIZE_THINGS) as f32).sqrt();
        for number in 0..objects {
            let id = first_id + number as SegmentId;
            let on_top = number % 4 == 3;
            let things = &furniture.things;
            let model = twins.get(number).copied();
            let placed = match (model, tops.pop().filter(|_| on_top && model.is_none())) {
                (Some(model), _) => models.get(model).and_then(|model| self.stand_model(random, things, model, id)),
                (None, Some(carrier)) => {
                    furniture.carriers.insert(id, things[carrier].id);
                    Some(standing_on(random, &things[carrier], 0.3 * size, id))
                }
                (None, None) => self.stand_free(random, things, size, id),
            };
            let Some(solid) = placed else {
                tracing::warn!("the synthetic room is full: {number} objects instead of {objects}");
                break;
            };
            let is_table = matches!(solid.shape, Shape::Box(half) if half.truncate().min_element() > 0.14 * size);
            if let Some(model) = model {
                furniture.models.insert(id, model);
            } else if is_table && solid.center.z < 1.0 && !on_top {
                tops.push(furniture.things.len());
            }
            furniture.things.push(solid);
        }
        furniture
    }

    /// Places a thing of random size on the floor, clear of other things and the walk; `None` if no place is found. Its
    /// size decreases with each failed attempt.
    fn stand_free(&self, random: &mut ChaCha8Rng, others: &[Solid], largest: f32, id: SegmentId) -> Option<Solid> {
        let others: Vec<Lane> = others.iter().map(Lane::of).collect();
        let mut size = largest;
        for _ in 0..PLACES {
            let shape = random_shape(random, size);
            let spot = self.random_spot(random, shape.footprint());
            if self.is_clear(spot, shape.footprint(), &others) {
                return Some(solid_at(random, shape, spot.extend(shape.half_height()), id));
            }
            size = (size * 0.995_f32).max(0.25 * largest);
        }
        None
    }

    /// Places a thing of a model on the floor.
    pub(super) fn stand_model(
        &self,
        random: &mut ChaCha8Rng,
        others: &[Solid],
        model: &Model,
        id: SegmentId,
    ) -> Option<Solid> {
        let others: Vec<Lane> = others.iter().map(Lane::of).collect();
        let footprint = model.shape.footprint();
        let spot = (0..PLACES)
            .map(|_| self.random_spot(random, footprint))
            .find(|spot| self.is_clear(*spot, footprint, &others))?;
        let turn = random_turn(random);
        let center = spot.extend(model.shape.half_height());
        Some(Solid { id, shape: model.shape, center, turn, texture: model.texture.clone() })
    }
}

impl Lane {
    pub(super) fn of(solid: &Solid) -> Self {
        let center = solid.center.truncate();
        Self { start: center, end: center, radius: solid.shape.footprint() }
    }

    /// Returns the distance from the line along which the thing slides, metres.
    fn distance(&self, spot: Vec2) -> f32 {
        let path = self.end - self.start;
        let along = ((spot - self.start).dot(path) / path.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        spot.distance(self.start + along * path)
    }
}

impl Model {
    /// Draws a model that is large enough to be recognised, with a clear pattern.
    pub(super) fn random(random: &mut ChaCha8Rng) -> Self {
        let shape = random_shape(random, 0.75);
        Self { shape, texture: Texture::random_pattern(random, 0.14) }
    }
}

fn standing_on(random: &mut ChaCha8Rng, carrier: &Solid, size: f32, id: SegmentId) -> Solid {
    let shape = random_shape(random, size);
    let top = carrier.center.z + carrier.shape.half_height();
    solid_at(random, shape, carrier.center.truncate().extend(top + shape.half_height()), id)
}

fn solid_at(random: &mut ChaCha8Rng, shape: Shape, center: Vec3, id: SegmentId) -> Solid {
    let turn = random_turn(random);
    Solid { id, shape, center, turn, texture: Texture::random(random, 0.14) }
}

fn random_turn(random: &mut ChaCha8Rng) -> Vec2 {
    Vec2::from_angle(random.random_range(0.0..std::f32::consts::TAU))
}

fn random_shape(random: &mut ChaCha8Rng, size: f32) -> Shape {
    let mut between = |low: f32, high: f32| size * random.random_range(low..high);
    let (width, depth, height, radius) =
        (between(0.16, 0.5), between(0.16, 0.42), between(0.15, 0.6), between(0.13, 0.33));
    match random.random_range(0..5) {
        0 | 1 => Shape::Box(Vec3::new(width, depth, height)),
        2 => Shape::Sphere(radius),
        _ => Shape::Cylinder(radius, height),
    }
}

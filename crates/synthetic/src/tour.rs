//! Layout of a tour: one furnished room, or four in a ring, joined by open doorways. World coordinates, metres, z up,
//! origin at the height of the floor, where the four rooms meet or at the centre of the only room.

use super::furniture::{FloorArea, Furniture, Model, Site};
use super::scenery::Scenery;
use super::solids::{Shape, Solid};
use super::texture::Texture;
use super::walk::{Path, Walk};
use glam::{Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Half the side of a room in a ring of four, between its walls.
const RING_HALF: f32 = 2.25;
/// Half the side of the only room.
const HALL_HALF: f32 = 3.0;
const HEIGHT: f32 = 2.6;
/// Thickness of a wall. Neighbouring rooms have a wall each.
const WALL: f32 = 0.08;
const DOOR_WIDTH: f32 = 1.2;
const DOOR_HEIGHT: f32 = 2.1;
/// Floor, ceiling and walls of a room: ids per room.
const SHELL_IDS: SegmentId = 6;
/// Models of the twins in each of four rooms, and in the only room.
const RING_TWINS: [usize; 8] = [0, 0, 1, 1, 2, 3, 4, 5];
const HALL_TWINS: [usize; 8] = [0, 0, 1, 1, 2, 2, 3, 3];
const MODELS: usize = 6;
/// At most this part of a room's things, numerator and denominator, are twins.
const TWIN_PART: (usize, usize) = (2, 5);
/// Largest difference of a colour channel between the walls of two rooms, as a half.
const TINT: i16 = 22;

/// The four rooms' quadrants, counter-clockwise in the order of the walk.
const QUADRANTS: [Vec2; 4] = [Vec2::ONE, Vec2::new(-1.0, 1.0), Vec2::NEG_ONE, Vec2::new(1.0, -1.0)];

/// Patterns that all rooms share.
struct SharedTextures {
    floor: Texture,
    ceiling: Texture,
    wall: Texture,
}

/// A room's place and doorways.
struct RoomPlan {
    area: FloorArea,
    /// For the walls at -x, +x, -y and +y.
    has_doorway: [bool; 4],
}

/// Creates a tour of one room or four, each with up to `objects` things, determined by the seed. Room `k` has the ids
/// 6k + 1 (floor), 6k + 2 (ceiling) and 6k + 3 to 6k + 6 (walls at -x, +x, -y, +y); things follow.
pub(super) fn furnished(seed: u64, rooms: usize, objects: usize) -> Scenery {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let textures = SharedTextures {
        floor: Texture::random_tiles(&mut random, 0.35),
        ceiling: Texture::random(&mut random, 0.5),
        wall: Texture::random_spots(&mut random, 0.3),
    };
    let models: Vec<Model> = (0..MODELS).map(|_| Model::random(&mut random)).collect();
    let (plans, path, twins) = match rooms {
        1 => (vec![RoomPlan::hall()], Path::Hall, HALL_TWINS),
        _ => (QUADRANTS.map(RoomPlan::in_quadrant).into(), Path::Ring { doorway: RING_HALF + WALL }, RING_TWINS),
    };
    let twins = twins.get(..objects * TWIN_PART.0 / TWIN_PART.1).unwrap_or(&twins);
    let walk = Walk::new(path);
    let largest_fixed = SHELL_IDS * plans.len() as SegmentId;
    let (mut solids, mut all) = (Vec::new(), Furniture::default());
    for (plan, number) in plans.iter().zip(0..) {
        solids.extend(plan.shell(number * SHELL_IDS + 1, &textures.for_room(&mut random)));
        let first_id = largest_fixed + 1 + all.things.len() as SegmentId;
        let site = Site { area: plan.area, walk: &walk };
        let furniture = site.furnish(&mut random, (first_id, objects), (&models, twins));
        all.things.extend(furniture.things);
        all.carriers.extend(furniture.carriers);
        all.models.extend(furniture.models);
    }
    solids.extend(all.things);
    Scenery {
        solids,
        largest_fixed,
        carriers: all.carriers,
        twins: twin_groups(&all.models),
        areas: plans.iter().map(|plan| plan.area).collect(),
        lamps: plans.iter().map(|plan| plan.area.center.extend(HEIGHT - 0.3)).collect(),
        walk,
    }
}

/// Groups things by their model; models of a single thing are left out.
pub(super) fn twin_groups(models: &BTreeMap<SegmentId, usize>) -> Vec<Vec<SegmentId>> {
    let mut groups: BTreeMap<usize, Vec<SegmentId>> = BTreeMap::new();
    for (id, model) in models {
        groups.entry(*model).or_default().push(*id);
    }
    groups.into_values().filter(|group| group.len() > 1).collect()
}

impl SharedTextures {
    /// Returns the textures of a room: its walls are tinted.
    fn for_room(&self, random: &mut ChaCha8Rng) -> Self {
        let tint = std::array::from_fn(|_| random.random_range(-TINT..=TINT));
        Self { floor: self.floor.clone(), ceiling: self.ceiling.clone(), wall: self.wall.tinted(tint) }
    }
}

impl RoomPlan {
    fn hall() -> Self {
        Self { area: FloorArea { center: Vec2::ZERO, half: Vec2::splat(HALL_HALF) }, has_doorway: [false; 4] }
    }

    fn in_quadrant(signs: Vec2) -> Self {
        let area = FloorArea { center: signs * (RING_HALF + WALL), half: Vec2::splat(RING_HALF) };
        // The walls towards the origin.
        let has_doorway = [signs.x > 0.0, signs.x < 0.0, signs.y > 0.0, signs.y < 0.0];
        Self { area, has_doorway }
    }

    fn shell(&self, first_id: SegmentId, textures: &SharedTextures) -> Vec<Solid> {
        let half = self.area.half + WALL;
        let slab = |id: SegmentId, z: f32, texture: &Texture| {
            let center = self.area.center.extend(z);
            solid(first_id + id, Vec3::new(half.x, half.y, WALL), center, texture)
        };
        let mut solids = vec![slab(0, -WALL, &textures.floor), slab(1, HEIGHT + WALL, &textures.ceiling)];
        let outwards = [Vec2::NEG_X, Vec2::X, Vec2::NEG_Y, Vec2::Y];
        for ((outward, has_doorway), id) in outwards.into_iter().zip(self.has_doorway).zip(first_id + 2..) {
            for (from_middle, size) in wall_parts(half.x, has_doorway) {
                let along = outward.perp();
                let middle = self.area.center + outward * (self.area.half.x + WALL / 2.0) + along * from_middle.x;
                let flat = (outward * WALL + along * size.x).abs() / 2.0;
                solids.push(solid(id, flat.extend(size.y / 2.0), middle.extend(from_middle.y), &textures.wall));
            }
        }
        solids
    }
}

/// Returns the parts of a wall of half length `half`: for each the centre, along the wall from its middle and upwards
/// from the floor, and the size.
fn wall_parts(half: f32, has_doorway: bool) -> Vec<(Vec2, Vec2)> {
    if !has_doorway {
        return vec![(Vec2::new(0.0, HEIGHT / 2.0), Vec2::new(2.0 * half, HEIGHT))];
    }
    let beside = half - DOOR_WIDTH / 2.0;
    let middle = (half + DOOR_WIDTH / 2.0) / 2.0;
    let lintel = HEIGHT - DOOR_HEIGHT;
    vec![
        (Vec2::new(-middle, HEIGHT / 2.0), Vec2::new(beside, HEIGHT)),
        (Vec2::new(middle, HEIGHT / 2.0), Vec2::new(beside, HEIGHT)),
        (Vec2::new(0.0, HEIGHT - lintel / 2.0), Vec2::new(DOOR_WIDTH, lintel)),
    ]
}

fn solid(id: SegmentId, half: Vec3, center: Vec3, texture: &Texture) -> Solid {
    Solid { id, shape: Shape::Box(half), center, turn: Vec2::X, texture: texture.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::furniture::Lane;

    #[test]
    fn every_room_has_things_and_the_walk_passes_through_the_doorways() {
        for seed in 0..6 {
            for rooms in [1, 4] {
                let tour = furnished(seed, rooms, 20);
                assert!(tour.things().count() >= 18 * rooms, "seed {seed}: {} things", tour.things().count());
                for frame in (0..tour.walk.frames()).step_by(5) {
                    let position = tour.walk.pose(frame as f64).translation();
                    for solid in tour.things() {
                        let distance = solid.center.truncate().distance(position.truncate());
                        assert!(distance > solid.shape.footprint() + 0.4, "seed {seed}, frame {frame}");
                    }
                    let fixed = tour.solids.iter().filter(|solid| solid.id <= tour.largest_fixed);
                    for solid in fixed {
                        let Shape::Box(half) = solid.shape else { continue };
                        let apart = ((position - solid.center).abs() - half).max(Vec3::ZERO).length();
                        assert!(apart > 0.4, "seed {seed}, frame {frame}: {apart} m from {}", solid.id);
                    }
                }
            }
        }
    }

    #[test]
    fn rooms_have_twins_in_themselves_and_in_other_rooms() {
        let tour = furnished(2, 4, 20);
        let room_of = |id: SegmentId| {
            let thing = tour.things().find(|thing| thing.id == id).unwrap();
            tour.areas.iter().position(|area| area.contains(thing.center.truncate())).unwrap()
        };
        assert_eq!(tour.twins.len(), MODELS);
        for (group, per_room) in tour.twins.iter().zip([2, 2, 1, 1, 1, 1]) {
            let rooms: Vec<usize> = group.iter().map(|id| room_of(*id)).collect();
            assert!((0..4).all(|room| rooms.iter().filter(|other| **other == room).count() == per_room), "{rooms:?}");
        }
        let lanes: Vec<Lane> = tour.things().map(Lane::of).collect();
        assert!(lanes[0].start != lanes[20].start - tour.areas[1].center + tour.areas[0].center, "other arrangement");
    }
}

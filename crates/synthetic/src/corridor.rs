//! Layout of a corridor with identical doors along its left wall. World coordinates, metres, z up, x along the
//! corridor, origin in its middle at the height of the floor.

use super::scenery::Scenery;
use super::solids::{Shape, Solid};
use super::texture::Texture;
use super::walk::{Path, Walk};
use glam::{Vec2, Vec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::SegmentId;

/// Distance from door to door. Everything repeats at this distance.
const PERIOD: f32 = 1.5;
/// Number of periods without a door, at each end.
const END_PERIODS: usize = 1;
const WIDTH: f32 = 1.8;
const HEIGHT: f32 = 2.5;
const WALL: f32 = 0.1;
const LEAF_WIDTH: f32 = 0.82;
const LEAF_HEIGHT: f32 = 2.0;
const FRAME_WIDTH: f32 = 0.09;
/// Distance of the camera from the ends at the start and at the end.
const START_DISTANCE: f32 = 1.0;
const END_DISTANCE: f32 = 2.2;
/// Floor, ceiling, wall with doors, other wall, wall at the start, wall at the end.
const SHELL_IDS: SegmentId = 6;
/// Leaf with handle, frame and sign of a door.
const DOOR_IDS: SegmentId = 3;

/// Textures of everything that repeats.
struct Textures {
    floor: Texture,
    ceiling: Texture,
    wall: Texture,
    leaf: Texture,
    frame: Texture,
    handle: Texture,
    sign: Texture,
}

/// Creates a corridor with `doors` doors and a thing at each end, determined by the seed. Ids 1 to 6 are floor, ceiling,
/// the wall with the doors, the wall opposite, and the ends; door `k` has the ids 7 + 3k (leaf and handle), 8 + 3k
/// (frame) and 9 + 3k (sign); the things follow.
pub(super) fn furnished(seed: u64, doors: usize) -> Scenery {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let floor = Texture::random_tiles(&mut random, 0.3);
    let wall = Texture::random_spots(&mut random, 0.25);
    let mut pattern = |period: f32| Texture::random_pattern(&mut random, period);
    let textures = Textures {
        floor,
        ceiling: pattern(0.5),
        wall,
        leaf: pattern(0.25),
        frame: pattern(0.1),
        handle: pattern(0.05),
        sign: pattern(0.04),
    };
    let ends = [pattern(0.4), pattern(0.4)];
    let things = [pattern(0.12), pattern(0.12)];
    let periods = doors + 2 * END_PERIODS;
    let half_length = PERIOD * periods as f32 / 2.0;
    let middle_of = |period: usize| PERIOD * (period as f32 + 0.5) - half_length;
    let mut solids: Vec<Solid> = (0..periods).flat_map(|period| panels(middle_of(period), &textures)).collect();
    for (texture, sign, id) in ends.into_iter().zip([-1.0, 1.0]).zip(SHELL_IDS - 1..).map(|((a, b), c)| (a, b, c)) {
        let center = Vec3::new(sign * (half_length + WALL / 2.0), 0.0, HEIGHT / 2.0);
        solids.push(boxed(id, Vec3::new(WALL, WIDTH + 2.0 * WALL, HEIGHT), center, texture));
    }
    for door in 0..doors {
        let first_id = SHELL_IDS + 1 + DOOR_IDS * door as SegmentId;
        solids.extend(door_solids(first_id, middle_of(door + END_PERIODS), &textures));
    }
    let largest_fixed = SHELL_IDS + DOOR_IDS * doors as SegmentId;
    for ((texture, sign), id) in things.into_iter().zip([-1.0, 1.0]).zip(largest_fixed + 1..) {
        let center = Vec3::new(sign * (half_length - 0.3), WIDTH / 2.0 - 0.25, 0.45);
        solids.push(Solid { id, shape: Shape::Cylinder(0.18, 0.45), center, turn: Vec2::X, texture });
    }
    let walk = Walk::new(Path::Corridor { ends: (START_DISTANCE - half_length, half_length - END_DISTANCE) });
    let lamps = (0..periods).map(|period| Vec3::new(middle_of(period), 0.0, HEIGHT - 0.3)).collect();
    Scenery { solids, largest_fixed, carriers: Default::default(), twins: Vec::new(), areas: Vec::new(), lamps, walk }
}

/// Returns a period of the floor, the ceiling and both walls.
fn panels(x: f32, textures: &Textures) -> [Solid; 4] {
    let flat = Vec3::new(PERIOD, WIDTH + 2.0 * WALL, WALL);
    let upright = Vec3::new(PERIOD, WALL, HEIGHT + 2.0 * WALL);
    let side = (WIDTH + WALL) / 2.0;
    [
        boxed(1, flat, Vec3::new(x, 0.0, -WALL / 2.0), textures.floor.clone()),
        boxed(2, flat, Vec3::new(x, 0.0, HEIGHT + WALL / 2.0), textures.ceiling.clone()),
        boxed(3, upright, Vec3::new(x, side, HEIGHT / 2.0), textures.wall.clone()),
        boxed(4, upright, Vec3::new(x, -side, HEIGHT / 2.0), textures.wall.clone()),
    ]
}

/// Returns a door: leaf, handle, frame and a sign beside it.
fn door_solids(first_id: SegmentId, x: f32, textures: &Textures) -> Vec<Solid> {
    let wall = WIDTH / 2.0;
    // Centre of something of this thickness on the wall.
    let at = |along: f32, thick: f32, z: f32| Vec3::new(x + along, wall - thick / 2.0, z);
    let beside = (LEAF_WIDTH + FRAME_WIDTH) / 2.0;
    let post = Vec3::new(FRAME_WIDTH, 0.05, LEAF_HEIGHT);
    let beam = Vec3::new(LEAF_WIDTH + 2.0 * FRAME_WIDTH, 0.05, FRAME_WIDTH);
    let mut solids = vec![
        boxed(
            first_id,
            Vec3::new(LEAF_WIDTH, 0.02, LEAF_HEIGHT),
            at(0.0, 0.02, LEAF_HEIGHT / 2.0),
            textures.leaf.clone(),
        ),
        boxed(first_id, Vec3::new(0.14, 0.03, 0.03), at(0.3, 0.12, 1.02), textures.handle.clone()),
    ];
    solids.push(Solid {
        id: first_id,
        shape: Shape::Cylinder(0.035, 0.035),
        center: at(0.35, 0.09, 1.02),
        turn: Vec2::X,
        texture: textures.handle.clone(),
    });
    for along in [-beside, beside] {
        solids.push(boxed(first_id + 1, post, at(along, 0.05, LEAF_HEIGHT / 2.0), textures.frame.clone()));
    }
    solids.push(boxed(first_id + 1, beam, at(0.0, 0.05, LEAF_HEIGHT + FRAME_WIDTH / 2.0), textures.frame.clone()));
    solids.push(boxed(first_id + 2, Vec3::new(0.2, 0.02, 0.2), at(0.63, 0.02, 1.6), textures.sign.clone()));
    solids
}

fn boxed(id: SegmentId, size: Vec3, center: Vec3, texture: Texture) -> Solid {
    Solid { id, shape: Shape::Box(size / 2.0), center, turn: Vec2::X, texture }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Sample;
    use crate::rays::Caster;
    use glam::{DMat4, DVec3};
    use splatseg_geometry::{Intrinsics, LocalPose, Pose};

    fn moved(pose: &LocalPose, along: f32) -> LocalPose {
        let shift = DMat4::from_translation(DVec3::new(f64::from(along), 0.0, 0.0));
        let matrix = shift * pose.at(DVec3::ZERO).to_matrix();
        Pose::from_matrix(matrix).unwrap().relative_to(DVec3::ZERO)
    }

    #[test]
    fn every_door_looks_like_every_other() {
        let corridor = furnished(2, 20);
        let intrinsics = Intrinsics { fx: 80.0, fy: 80.0, cx: 44.5, cy: 34.5, width: 90, height: 70 };
        let image = |pose| Caster { scenery: &corridor, intrinsics, pose }.image();
        for frame in [600, 777] {
            let pose = corridor.walk.pose(f64::from(frame));
            let first = image(pose);
            for doors in [1, 5, 8] {
                let later = image(moved(&pose, doors as f32 * PERIOD));
                let is_equal = |(one, other): (&Sample, &Sample)| {
                    let same_part =
                        if one.id > SHELL_IDS { one.id + 3 * doors == other.id } else { one.id == other.id };
                    // A part of the far end may be in view.
                    same_part && (one.depth - other.depth).abs() < 1e-3 && one.color.distance(other.color) < 2.0
                };
                let equal = first.pixels().iter().zip(later.pixels()).filter(|pair| is_equal(*pair)).count();
                assert!(equal * 1000 > first.pixels().len() * 985, "{equal} of {}", first.pixels().len());
            }
        }
    }
}

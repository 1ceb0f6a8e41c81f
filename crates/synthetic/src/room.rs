//! Layout of the synthetic room. World coordinates, metres, z up, origin at the centre of the floor.

use super::furniture::{FloorArea, Model, Site};
use super::scenery::Scenery;
use super::solids::{Shape, Solid};
use super::texture::Texture;
use super::tour::twin_groups;
use super::walk::{Path, Walk};
use glam::{Vec2, Vec3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::SegmentId;

/// Size of the room along x, y and z.
const ROOM: Vec3 = Vec3::new(6.0, 5.2, 2.7);
/// Thickness of walls, floor and ceiling. Only their inner faces are visible.
const WALL: f32 = 0.2;
const LAMP: Vec3 = Vec3::new(0.6, -0.8, 2.3);

/// Creates a room with floor (id 1), ceiling (2), four walls (3 to 6) and `objects` things (ids from 7), determined
/// by the seed. Contains fewer things if there is no space left. The first things are twins: of each of the first
/// `twin_pairs` models two.
pub(super) fn furnished(seed: u64, objects: usize, twin_pairs: usize) -> Scenery {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut solids = shell(&mut random);
    let largest_fixed = solids.len() as SegmentId;
    let walk = Walk::new(Path::Room { seed });
    let area = FloorArea { center: Vec2::ZERO, half: ROOM.truncate() / 2.0 };
    let models: Vec<Model> = (0..twin_pairs).map(|_| Model::random(&mut random)).collect();
    let twins: Vec<usize> = (0..twin_pairs).flat_map(|model| [model; 2]).collect();
    let site = Site { area, walk: &walk };
    let furniture = site.furnish(&mut random, (largest_fixed + 1, objects), (&models, &twins));
    solids.extend(furniture.things);
    let twins = twin_groups(&furniture.models);
    Scenery { solids, largest_fixed, carriers: furniture.carriers, twins, areas: vec![area], lamps: vec![LAMP], walk }
}

fn shell(random: &mut ChaCha8Rng) -> Vec<Solid> {
    let half = ROOM / 2.0;
    let thin = WALL / 2.0;
    let places = [
        (Vec3::new(0.0, 0.0, -thin), Vec3::new(half.x, half.y, thin)),
        (Vec3::new(0.0, 0.0, ROOM.z + thin), Vec3::new(half.x, half.y, thin)),
        (Vec3::new(-half.x - thin, 0.0, half.z), Vec3::new(thin, half.y, half.z)),
        (Vec3::new(half.x + thin, 0.0, half.z), Vec3::new(thin, half.y, half.z)),
        (Vec3::new(0.0, -half.y - thin, half.z), Vec3::new(half.x, thin, half.z)),
        (Vec3::new(0.0, half.y + thin, half.z), Vec3::new(half.x, thin, half.z)),
    ];
    let solid = |(index, (center, half_size)): (usize, (Vec3, Vec3))| Solid {
        id: index as SegmentId + 1,
        shape: Shape::Box(half_size + Vec3::splat(WALL) * overlap(half_size, thin)),
        center,
        turn: Vec2::X,
        texture: Texture::random(random, 0.5),
    };
    places.into_iter().enumerate().map(solid).collect()
}

/// Returns 1 along a wall and 0 across it. Walls extend past the room's edges, so that no ray slips through a corner.
fn overlap(half_size: Vec3, thin: f32) -> Vec3 {
    Vec3::select(half_size.cmpgt(Vec3::splat(thin)), Vec3::ONE, Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::furniture::Lane;
    use crate::motion::{Motion, Mover};
    use crate::solids::Ray;
    use crate::{SyntheticSettings, movers};
    use splatseg_geometry::Intrinsics;

    #[test]
    fn rooms_contain_the_requested_things_and_the_walk_is_free() {
        for seed in 0..20 {
            let room = furnished(seed, 40, 0);
            assert_eq!(room.solids.len(), 46, "seed {seed}");
            for frame in 0..100 {
                let position = room.walk.pose(f64::from(frame)).translation();
                for solid in &room.solids[6..] {
                    let distance = solid.center.truncate().distance(position.truncate());
                    assert!(distance > solid.shape.footprint() + 0.4, "seed {seed}, frame {frame}");
                }
            }
        }
    }

    #[test]
    fn hundreds_of_things_fit() {
        for seed in 0..4 {
            assert_eq!(furnished(seed, 400, 0).things().count(), 400, "seed {seed}");
            assert_eq!(furnished(seed, 300, 0).things().count(), 300, "seed {seed}");
        }
    }

    #[test]
    fn movers_keep_clear_of_the_walls_the_walk_and_each_other() {
        let mut slides_on_top = 0;
        for seed in 0..20 {
            let room = furnished(seed, 40, 0);
            let camera = Intrinsics { fx: 288.0, fy: 288.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
            let count = room.unloaded_things().count();
            let settings = SyntheticSettings { seed, moving: count, ..SyntheticSettings::default() };
            let pose_at = |frame| room.walk.pose(settings.speed.time_at(frame));
            let movers = movers::choose(&room, &camera, &settings, pose_at).unwrap();
            slides_on_top +=
                movers.iter().filter(|mover| is_slide(mover) && room.carriers.contains_key(&mover.id)).count();
            for frame in [1, 5, 10, 15, 20, 29, 30, 31, 40] {
                let now = room.at(frame, &movers);
                assert!(now.things().all(|thing| is_in_place(&now, thing)), "seed {seed}, frame {frame}");
            }
        }
        assert!(slides_on_top > 0);
    }

    fn is_slide(mover: &Mover) -> bool {
        matches!(mover.motion, Motion::Slide { .. })
    }

    /// Returns true if a thing is clear of all others except its carrier and the things it carries.
    fn is_in_place(room: &Scenery, thing: &Solid) -> bool {
        let (spot, footprint) = (thing.center.truncate(), thing.shape.footprint());
        let unrelated = |other: &&Solid| {
            let related =
                room.carriers.get(&thing.id) == Some(&other.id) || room.carriers.get(&other.id) == Some(&thing.id);
            other.id != thing.id && !related
        };
        let site = room.site_of(thing).unwrap();
        let others: Vec<Lane> = room.things().filter(unrelated).map(Lane::of).collect();
        site.is_inside(spot, footprint) && site.is_clear(spot, footprint, &others)
    }

    #[test]
    fn every_ray_from_the_walk_meets_something() {
        let room = furnished(1, 0, 0);
        let origin = room.walk.pose(7.0).translation();
        for index in 0..2000 {
            let (height, angle) = (index as f32 / 1000.0 - 1.0, index as f32 * 2.4);
            let direction = (Vec2::from_angle(angle) * (1.0 - height * height).sqrt()).extend(height);
            let (_, hit) = room.first_hit(Ray { origin, direction }).unwrap();
            let point = origin + hit.t * direction;
            let inside = point.cmpge(Vec3::new(-3.01, -2.61, -0.01)) & point.cmple(Vec3::new(3.01, 2.61, 2.71));
            assert!(inside.all(), "{point}");
        }
    }
}

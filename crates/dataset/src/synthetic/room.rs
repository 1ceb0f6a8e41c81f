//! Layout of the synthetic room and the camera's path through it. World coordinates, metres, z up, origin at the centre
//! of the floor.

use super::motion::Mover;
use super::solids::{Hit, Ray, Shape, Solid};
use super::texture::Texture;
use glam::{DVec3, Mat4, Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::{LocalPose, Pose, SegmentId};
use std::collections::{BTreeMap, BTreeSet};

/// Size of the room along x, y and z.
const ROOM: Vec3 = Vec3::new(6.0, 5.2, 2.7);
/// Thickness of walls, floor and ceiling. Only their inner faces are visible.
const WALL: f32 = 0.2;
/// Minimum distance of things from walls and from each other.
const GAP: f32 = 0.06;
/// The camera walks on a circle of this radius...
const WALK_RADIUS: f32 = 1.0;
/// ...and objects keep this distance from its path, so that it never passes through any.
const WALK_MARGIN: f32 = 0.45;
/// Frames per round. The step per frame is fixed, so a longer video continues the walk, and things that left the view
/// return.
const FRAMES_PER_ROUND: f64 = 48.0;
/// Largest id of floor, ceiling and walls.
const SHELL: SegmentId = 6;
/// More things than this are made smaller, to keep the covered area constant.
const FULL_SIZE_THINGS: usize = 60;
const LIGHT: Vec3 = Vec3::new(0.6, -0.8, 2.3);

/// The room's solids.
#[derive(Clone, Debug)]
pub(super) struct Room {
    solids: Vec<Solid>,
    /// For each thing that does not stand on the floor, the thing it stands on.
    carriers: BTreeMap<SegmentId, SegmentId>,
    seed: u64,
}

/// Floor area occupied by a thing: its footprint circle, swept along the line it slides on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lane {
    pub(super) start: Vec2,
    /// Equal to `start` for a stationary thing.
    pub(super) end: Vec2,
    radius: f32,
}

impl Room {
    /// Creates a room with floor (id 1), ceiling (2), four walls (3 to 6) and `objects` things (ids from 7), determined
    /// by the seed. Contains fewer things if there is no space left.
    pub(super) fn furnished(seed: u64, objects: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut solids = shell(&mut random);
        let shell_count = solids.len();
        let mut tops: Vec<usize> = Vec::new();
        let mut carriers = BTreeMap::new();
        let size = (FULL_SIZE_THINGS as f32 / objects.max(FULL_SIZE_THINGS) as f32).sqrt();
        for number in 0..objects {
            let id = (shell_count + number + 1) as SegmentId;
            let on_top = number % 4 == 3;
            let placed = match tops.pop().filter(|_| on_top) {
                Some(carrier) => {
                    carriers.insert(id, solids[carrier].id);
                    Some(standing_on(&mut random, &solids[carrier], 0.3 * size, id))
                }
                None => standing_free(&mut random, &solids[shell_count..], size, id),
            };
            let Some(solid) = placed else {
                tracing::warn!("the synthetic room is full: {number} objects instead of {objects}");
                break;
            };
            let is_table = matches!(solid.shape, Shape::Box(half) if half.truncate().min_element() > 0.14 * size);
            if is_table && solid.center.z < 1.0 && !on_top {
                tops.push(solids.len());
            }
            solids.push(solid);
        }
        Self { solids, carriers, seed }
    }

    /// Returns the room in a frame, with the movers at their positions.
    pub(super) fn at(&self, frame: usize, movers: &[Mover]) -> Self {
        let mut room = self.clone();
        for mover in movers {
            match mover.motion.offset_at(frame) {
                None => room.solids.retain(|solid| solid.id != mover.id),
                Some(offset) => {
                    room.solids.iter_mut().filter(|solid| solid.id == mover.id).for_each(|solid| solid.center += offset)
                }
            }
        }
        room
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
        let carrier = self.carriers.get(&id).and_then(|below| self.things().find(|solid| solid.id == *below));
        let others: Vec<Lane> = lanes
            .iter()
            .filter(|(other, _)| **other != id && carrier.is_none_or(|below| below.id != **other))
            .map(|(_, lane)| *lane)
            .collect();
        let footprint = thing.shape.footprint();
        let reach = reach_of(footprint);
        let is_free = |steps: &usize| {
            let spot = thing.center.truncate() + *steps as f32 * step;
            spot.abs().cmple(reach).all()
                && is_clear(spot, footprint, &others)
                && carrier.is_none_or(|below| below.has_on_top(spot, footprint))
        };
        (1..=most).take_while(is_free).count()
    }

    pub(super) fn things(&self) -> impl Iterator<Item = &Solid> {
        self.solids.iter().filter(|solid| solid.id > SHELL)
    }

    /// Returns the first solid hit by a ray, and the hit. Rays from inside the room always hit one.
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

    /// Returns the camera pose at a time, in frames at speed 1. It walks around the centre, looking across it, swaying
    /// from side to side and up and down.
    pub(super) fn camera_pose(&self, time: f64) -> LocalPose {
        let start = (self.seed % 997) as f32 * 0.631;
        // Whole rounds are removed before the angle is rounded, so that long videos stay exact.
        let round = (time % FRAMES_PER_ROUND) as f32 / FRAMES_PER_ROUND as f32;
        let angle = start + round * std::f32::consts::TAU;
        let sway = time as f32;
        let outward = Vec2::from_angle(angle);
        let position = (outward * WALK_RADIUS).extend(1.45 + 0.1 * (sway * 0.29).sin());
        let heading = Vec2::from_angle(angle + std::f32::consts::PI + 0.45 * (sway * 0.21).sin());
        let forward = heading.extend(-0.28 + 0.25 * (sway * 0.17).sin()).normalize();
        let right = forward.cross(Vec3::Z).normalize();
        let down = forward.cross(right);
        let matrix = Mat4::from_cols(right.extend(0.0), down.extend(0.0), forward.extend(0.0), position.extend(1.0));
        // Three orthonormal right-handed axes form a rotation.
        Pose::from_matrix(matrix.as_dmat4()).map_or(LocalPose::IDENTITY, |pose| pose.relative_to(DVec3::ZERO))
    }
}

/// Returns the brightness of a hit: light from a lamp below the ceiling, and ambient light.
pub(super) fn brightness(point_world: Vec3, normal: Vec3) -> f32 {
    let to_light = LIGHT - point_world;
    let facing = normal.dot(to_light.normalize_or_zero()).max(0.0);
    0.55 + 0.5 * facing / (1.0 + 0.05 * to_light.length_squared())
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

/// Places a thing of random size on the floor, clear of other things and the walk; `None` if no place is found. Its
/// size decreases with each failed attempt.
fn standing_free(random: &mut ChaCha8Rng, others: &[Solid], largest: f32, id: SegmentId) -> Option<Solid> {
    let others: Vec<Lane> = others.iter().map(Lane::of).collect();
    let mut size = largest;
    for _ in 0..600 {
        let shape = random_shape(random, size);
        let reach = reach_of(shape.footprint());
        let spot = Vec2::new(random.random_range(-reach.x..reach.x), random.random_range(-reach.y..reach.y));
        if is_clear(spot, shape.footprint(), &others) {
            return Some(solid_at(random, shape, spot.extend(shape.half_height()), id));
        }
        size = (size * 0.995_f32).max(0.25 * largest);
    }
    None
}

/// Returns the maximum distance of such a footprint from the room's centre, along x and y.
fn reach_of(footprint: f32) -> Vec2 {
    ROOM.truncate() / 2.0 - Vec2::splat(footprint + GAP)
}

/// Returns true if such a footprint at `spot` is clear of the camera's path and of the others.
fn is_clear(spot: Vec2, footprint: f32, others: &[Lane]) -> bool {
    let clear_of_walk = (spot.length() - WALK_RADIUS).abs() > WALK_MARGIN + footprint;
    clear_of_walk && others.iter().all(|other| other.distance(spot) > other.radius + footprint + GAP)
}

impl Lane {
    fn of(solid: &Solid) -> Self {
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

fn standing_on(random: &mut ChaCha8Rng, carrier: &Solid, size: f32, id: SegmentId) -> Solid {
    let shape = random_shape(random, size);
    let top = carrier.center.z + carrier.shape.half_height();
    solid_at(random, shape, carrier.center.truncate().extend(top + shape.half_height()), id)
}

fn solid_at(random: &mut ChaCha8Rng, shape: Shape, center: Vec3, id: SegmentId) -> Solid {
    let turn = Vec2::from_angle(random.random_range(0.0..std::f32::consts::TAU));
    Solid { id, shape, center, turn, texture: Texture::random(random, 0.14) }
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

#[cfg(test)]
mod tests {
    use super::super::motion::Motion;
    use super::super::{SyntheticSettings, movers};
    use super::*;
    use splatseg_geometry::Intrinsics;

    #[test]
    fn rooms_contain_the_requested_things_and_the_walk_is_free() {
        for seed in 0..20 {
            let room = Room::furnished(seed, 40);
            assert_eq!(room.solids.len(), 46, "seed {seed}");
            for frame in 0..100 {
                let position = room.camera_pose(f64::from(frame)).translation();
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
            assert_eq!(Room::furnished(seed, 400).things().count(), 400, "seed {seed}");
            assert_eq!(Room::furnished(seed, 300).things().count(), 300, "seed {seed}");
        }
    }

    #[test]
    fn movers_keep_clear_of_the_walls_the_walk_and_each_other() {
        let mut slides_on_top = 0;
        for seed in 0..20 {
            let room = Room::furnished(seed, 40);
            let camera = Intrinsics { fx: 288.0, fy: 288.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
            let count = room.unloaded_things().count();
            let settings = SyntheticSettings { seed, moving: count, ..SyntheticSettings::default() };
            let pose_at = |frame| room.camera_pose(settings.speed.time_at(frame));
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
    fn is_in_place(room: &Room, thing: &Solid) -> bool {
        let (spot, footprint) = (thing.center.truncate(), thing.shape.footprint());
        let unrelated = |other: &&Solid| {
            let related =
                room.carriers.get(&thing.id) == Some(&other.id) || room.carriers.get(&other.id) == Some(&thing.id);
            other.id != thing.id && !related
        };
        let others: Vec<Lane> = room.things().filter(unrelated).map(Lane::of).collect();
        spot.abs().cmple(reach_of(footprint)).all() && is_clear(spot, footprint, &others)
    }

    #[test]
    fn every_ray_from_the_walk_meets_something() {
        let room = Room::furnished(1, 0);
        let origin = room.camera_pose(7.0).translation();
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

//! Paths of the camera through the synthetic scenes. World coordinates, metres, z up.

use glam::{DVec3, Mat4, Vec2, Vec3};
use splatseg_geometry::{LocalPose, Pose};
use std::f32::consts::{FRAC_PI_4, PI, TAU};

/// In the room, the camera walks on a circle of this radius...
const ROOM_RADIUS: f32 = 1.0;
/// ...in this number of frames.
const ROOM_FRAMES: usize = 48;
/// In a tour of one room, the radius of the circle...
const HALL_RADIUS: f32 = 1.2;
/// ...and the number of frames.
const HALL_FRAMES: usize = 600;
/// Frames of a round through four rooms.
const RING_FRAMES: usize = 1800;
/// Distance by which the path through a ring of rooms bulges outwards between the doorways.
const RING_BULGE: f32 = 0.7;
/// Number of points of a path among which the nearest is sought.
const PATH_POINTS: usize = 360;
/// Step per frame in the corridor.
const CORRIDOR_STEP: f32 = 0.012;
/// Distance in which the camera comes to rest at the end of the corridor.
const CORRIDOR_BRAKING: f32 = 0.6;
/// Distance of the camera from the middle of the corridor, away from the doors.
const CORRIDOR_ASIDE: f32 = 0.35;

/// Shape of the camera's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Path {
    /// A circle in the room, looking across it. The seed determines the start.
    Room {
        /// Seed of the room.
        seed: u64,
    },
    /// A circle in a tour's only room, looking outwards and ahead.
    Hall,
    /// A ring through four rooms around the origin, counter-clockwise, through the middles of the doorways.
    Ring {
        /// Distance of the doorways from the origin.
        doorway: f32,
    },
    /// A straight line along x, looking obliquely to the left, then standing.
    Corridor {
        /// x of the start and of the end.
        ends: (f32, f32),
    },
}

/// The walk of the camera along a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Walk {
    pub(super) path: Path,
    /// True for the other walk along the same path: from another start, in the other direction, and higher.
    pub(super) is_other: bool,
}

/// Position and viewing direction of the camera.
struct View {
    position: Vec3,
    /// Not normalised.
    forward: Vec3,
}

impl Walk {
    pub(super) fn new(path: Path) -> Self {
        Self { path, is_other: false }
    }

    /// Returns the camera pose at a time, in frames at speed 1.
    pub(super) fn pose(&self, time: f64) -> LocalPose {
        let view = match self.path {
            Path::Room { seed } => self.room_view(seed, time),
            Path::Hall => hall_view(self.round(time, HALL_FRAMES), self.direction()),
            Path::Ring { doorway } => ring_view(doorway, self.round(time, RING_FRAMES), self.direction()),
            Path::Corridor { ends } => corridor_view(ends, time),
        };
        let raise = if self.is_other { Vec3::Z * 0.25 } else { Vec3::ZERO };
        let forward = view.forward.normalize();
        let right = forward.cross(Vec3::Z).normalize();
        let down = forward.cross(right);
        let position = view.position + raise;
        let matrix = Mat4::from_cols(right.extend(0.0), down.extend(0.0), forward.extend(0.0), position.extend(1.0));
        // Three orthonormal right-handed axes form a rotation.
        Pose::from_matrix(matrix.as_dmat4()).map_or(LocalPose::IDENTITY, |pose| pose.relative_to(DVec3::ZERO))
    }

    /// Returns the number of frames of a round at speed 1, or of the whole walk if it does not return.
    pub(super) fn frames(&self) -> usize {
        match self.path {
            Path::Room { .. } => ROOM_FRAMES,
            Path::Hall => HALL_FRAMES,
            Path::Ring { .. } => RING_FRAMES,
            Path::Corridor { ends } => ((ends.1 - ends.0 + CORRIDOR_BRAKING) / CORRIDOR_STEP).ceil().max(0.0) as usize,
        }
    }

    /// Returns true if frames at speed 1 are as close together as in a video at 30 Hz.
    pub(super) fn is_video(&self) -> bool {
        !matches!(self.path, Path::Room { .. })
    }

    /// Returns the horizontal distance of a point from the path.
    pub(super) fn distance(&self, spot: Vec2) -> f32 {
        match self.path {
            Path::Room { .. } => (spot.length() - ROOM_RADIUS).abs(),
            Path::Hall => (spot.length() - HALL_RADIUS).abs(),
            Path::Ring { doorway } => {
                let points = (0..PATH_POINTS).map(|point| TAU * point as f32 / PATH_POINTS as f32);
                points.map(|angle| ring_point(doorway, angle).distance(spot)).fold(f32::INFINITY, f32::min)
            }
            Path::Corridor { ends } => {
                spot.distance(Vec2::new(spot.x.clamp(ends.0, ends.1.max(ends.0)), -CORRIDOR_ASIDE))
            }
        }
    }

    fn direction(&self) -> f32 {
        if self.is_other { -1.0 } else { 1.0 }
    }

    /// Returns the part of the round done at a time, in 0..1.
    fn round(&self, time: f64, frames: usize) -> f32 {
        let frames = frames as f64;
        // Whole rounds are removed before rounding, so that long videos stay exact.
        let part = (time % frames / frames) as f32;
        if self.is_other { (1.4 - part).rem_euclid(1.0) } else { part }
    }

    /// Around the centre, looking across it, swaying from side to side and up and down.
    fn room_view(&self, seed: u64, time: f64) -> View {
        let start = (seed % 997) as f32 * 0.631;
        let round = (time % ROOM_FRAMES as f64) as f32 / ROOM_FRAMES as f32;
        let (angle, sway) = if self.is_other {
            (start + 2.5 - round * TAU, time as f32 + 9.0)
        } else {
            (start + round * TAU, time as f32)
        };
        let position = (Vec2::from_angle(angle) * ROOM_RADIUS).extend(1.45 + 0.1 * (sway * 0.29).sin());
        let heading = Vec2::from_angle(angle + PI + 0.45 * (sway * 0.21).sin());
        View { position, forward: heading.extend(-0.28 + 0.25 * (sway * 0.17).sin()) }
    }
}

/// Returns a sine with `waves` periods per round.
fn wave(round: f32, waves: f32, phase: f32) -> f32 {
    (TAU * waves * round + phase).sin()
}

fn hall_view(round: f32, direction: f32) -> View {
    let angle = TAU * round;
    let position = (Vec2::from_angle(angle) * HALL_RADIUS).extend(1.4 + 0.07 * wave(round, 3.0, 0.0));
    let outwards = 0.2 + 0.3 * wave(round, 3.0, 0.4);
    let heading = Vec2::from_angle(angle + direction * (PI / 2.0 - outwards));
    View { position, forward: heading.extend(-0.3 + 0.1 * wave(round, 4.0, 1.0)) }
}

/// Returns the point of the ring at an angle. It crosses the walls perpendicularly.
fn ring_point(doorway: f32, angle: f32) -> Vec2 {
    (doorway + RING_BULGE * between_doorways(angle)) * Vec2::from_angle(angle)
}

/// Returns 0 in a doorway, increasing to 1 in the middle of a room.
fn between_doorways(angle: f32) -> f32 {
    (2.0 * angle).sin().powi(2)
}

fn ring_view(doorway: f32, round: f32, direction: f32) -> View {
    let angle = FRAC_PI_4 + TAU * round;
    let radius = doorway + RING_BULGE * between_doorways(angle);
    let slope = 2.0 * RING_BULGE * (4.0 * angle).sin();
    let outward = Vec2::from_angle(angle);
    let tangent = direction * (slope * outward + radius * outward.perp());
    // In a doorway it looks straight ahead, otherwise the wall would fill the view.
    let swing = 0.45 * wave(round, 6.0, 0.0) + 0.15 * wave(round, 13.0, 0.7);
    let aside = between_doorways(angle) * (-0.25 * direction + swing);
    let heading = Vec2::from_angle(aside).rotate(tangent.normalize());
    let height = 1.4 + 0.06 * wave(round, 5.0, 0.0) + 0.03 * wave(round, 11.0, 0.0);
    View { position: (radius * outward).extend(height), forward: heading.extend(-0.27 + 0.1 * wave(round, 7.0, 1.0)) }
}

fn corridor_view((start, end): (f32, f32), time: f64) -> View {
    let steady = (end - start - CORRIDOR_BRAKING).max(0.0);
    let time = time as f32;
    // A constant deceleration takes twice the time of the same distance at full speed.
    let braking = (CORRIDOR_STEP * time - steady).clamp(0.0, 2.0 * CORRIDOR_BRAKING);
    let done = (CORRIDOR_STEP * time).min(steady) + braking - braking * braking / (4.0 * CORRIDOR_BRAKING);
    let sway = |length: f32, phase: f32| (TAU * done / length + phase).sin();
    let position = Vec3::new(start + done, -CORRIDOR_ASIDE, 1.5 + 0.03 * sway(1.1, 0.0));
    let heading = Vec2::from_angle(0.85 + 0.14 * sway(2.6, 0.0));
    View { position, forward: heading.extend(-0.14 + 0.05 * sway(1.9, 1.0)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the largest step, metres, and the largest turn, degrees, from one frame to the next.
    fn largest_steps(walk: Walk) -> (f32, f32) {
        let poses: Vec<LocalPose> = (0..=walk.frames() + 10).map(|frame| walk.pose(frame as f64)).collect();
        poses.windows(2).fold((0.0, 0.0), |(step, turn), pair| {
            let moved = pair[0].translation().distance(pair[1].translation());
            let cosine = (pair[0].rotation().transpose() * pair[1].rotation()).to_cols_array();
            let angle = ((cosine[0] + cosine[4] + cosine[8] - 1.0) / 2.0).min(1.0).acos().to_degrees();
            (f32::max(step, moved), f32::max(turn, angle))
        })
    }

    #[test]
    fn tours_and_corridors_are_walked_like_a_video_at_30_hz() {
        let paths = [Path::Hall, Path::Ring { doorway: 2.33 }, Path::Corridor { ends: (-15.0, 15.0) }];
        for path in paths {
            for is_other in [false, true] {
                let (step, turn) = largest_steps(Walk { path, is_other });
                assert!((0.008..0.015).contains(&step), "{path:?}: {step} m");
                assert!((0.2..1.5).contains(&turn), "{path:?}: {turn} degrees");
            }
        }
    }

    #[test]
    fn the_second_round_is_the_first() {
        for path in [Path::Hall, Path::Ring { doorway: 2.33 }] {
            let walk = Walk::new(path);
            assert!(
                (0..50).all(|frame| walk.pose(f64::from(frame)) == walk.pose((frame as usize + walk.frames()) as f64))
            );
        }
    }

    #[test]
    fn the_corridor_is_left_at_its_end() {
        let walk = Walk::new(Path::Corridor { ends: (-3.0, 4.0) });
        let end = walk.pose(walk.frames() as f64);
        assert!((end.translation().x - 4.0).abs() < 1e-3, "{}", end.translation());
        assert_eq!(end, walk.pose(10_000.0));
    }
}

//! Where up is, from the floor and what is parallel to it; and by which turn the camera's images are upright.
//!
//! Every surface votes for the direction that it faces, in world axes. A floor is seen at a slant as long as the camera
//! is held level, whichever way the camera looks; a wall is seen face to face sooner or later, and then votes against
//! itself. So the floor wins once the camera has looked around. Before that, frames are taken to be upright as they are,
//! as nearly all are. Where the world of the given poses has a known up, as phones measure gravity, nothing is searched.

use glam::{DVec3, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use splatseg_files::StateBlock;
use splatseg_geometry::{CameraFrame, Pose, QuarterTurn};
use std::sync::LazyLock;

/// Directions are counted in an octahedron's unfolded square of this many cells per side, about 6° wide.
const SIDE: usize = 32;
const CELLS: usize = SIDE * SIDE;
/// Surfaces are seen at this resolution: the number of pixels of the reduced frame.
const PIXELS: f32 = 160.0 * 120.0;
/// Half the distance between the points that a normal is computed from, pixels of the reduced frame.
const REACH: usize = 2;
/// Points further apart in depth than this do not lie on one surface: metres, and share of the depth.
const MAX_STEP: (f32, f32) = (0.05, 0.05);
/// A surface seen at a smaller slant votes against itself: the square of the cosine.
const FACING: f32 = 0.6;
/// Votes for one direction come from within this angle: its cosine (12°).
const SAME: f32 = 0.978;
/// A direction is upright in an image if it is within 45° of one of its sides.
const ALIGNED: f32 = 0.707;
/// Another direction is up if it has this many times the votes of the one that is up in the images as they are. A wall had
/// up to 15 times as many, but never with [`MIN_SPAN`]: 46 stretches of 15 to 40 frames of six recordings.
const MIN_RATIO: f32 = 2.0;
/// The camera has looked around by at least this angle about the direction, degrees.
const MIN_SPAN: f32 = 40.0;
/// Smallest number of votes for a direction to be judged.
const MIN_VOTES: f32 = 300.0;
/// The turn changes if up is further than this from the image's top: the cosine (55°).
const KEPT: f32 = 0.57;
/// A camera that looks up or down more steeply than this has no upright image: length of up within the image.
const MIN_TILT: f32 = 0.4;

/// The middle of each cell of directions.
static DIRECTIONS: LazyLock<Vec<Vec3>> = LazyLock::new(|| (0..CELLS).map(direction).collect());

/// The search for up in one map.
#[derive(Clone, Debug)]
pub(crate) struct Upright {
    /// Votes of surfaces that face each direction.
    votes: Vec<f32>,
    /// Which directions the camera has looked in.
    looked: Vec<bool>,
    state: UprightState,
}

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
struct UprightState {
    /// Up in the world, once it is known.
    up: Option<DVec3>,
    /// True if gravity was measured, so that no surface has to vote.
    is_measured: bool,
    turn: QuarterTurn,
}

impl Default for Upright {
    fn default() -> Self {
        Self { votes: vec![0.0; CELLS], looked: vec![false; CELLS], state: UprightState::default() }
    }
}

impl Upright {
    /// Up is known from the first frame on. `up` is a unit vector in the world.
    pub(crate) fn measured(up: DVec3) -> Self {
        Self { state: UprightState { up: Some(up), is_measured: true, turn: QuarterTurn::None }, ..Self::default() }
    }

    /// The turn after which the camera's images are upright, as far as it is known.
    pub(crate) fn turn(&self) -> QuarterTurn {
        self.state.turn
    }

    /// Begins a map whose axes have nothing to do with those of the last one. The camera is held as before.
    pub(crate) fn start_map(&mut self) {
        *self = Self { state: UprightState { turn: self.state.turn, ..Default::default() }, ..Self::default() };
    }

    /// Adds a frame whose pose is known.
    pub(crate) fn add(&mut self, frame: &CameraFrame<'_>, world_from_camera: &Pose) {
        let rotation = world_from_camera.rotation().as_mat3();
        let to_camera = rotation.transpose();
        if !self.state.is_measured {
            self.looked[cell(rotation.z_axis)] = true;
            for normal in normals(frame) {
                self.votes[cell(rotation * normal)] += 1.0 - normal.z * normal.z / FACING;
            }
            self.decide(|world| to_camera * world);
        }
        if let Some(up) = self.state.up {
            self.state.turn = kept_turn(self.state.turn, to_camera * up.as_vec3());
        }
    }

    /// Decides anew which direction is up.
    fn decide(&mut self, to_camera: impl Fn(Vec3) -> Vec3) {
        let voted: Vec<usize> = (0..CELLS).filter(|cell| self.votes[*cell] != 0.0).collect();
        let total = |direction: Vec3| -> f32 {
            let near = voted.iter().filter(|cell| DIRECTIONS[**cell].dot(direction) > SAME);
            near.map(|cell| self.votes[*cell]).sum()
        };
        // For each turn, the direction with the most votes.
        let mut best = QuarterTurn::ALL.map(|turn| (turn, 0.0, Vec3::ZERO));
        for cell in voted.iter().filter(|cell| self.votes[**cell] > 0.0) {
            let in_camera = to_camera(DIRECTIONS[*cell]).truncate();
            if let Some(best) = best.iter_mut().find(|(turn, ..)| in_camera.dot(top(*turn)) > ALIGNED) {
                let votes = total(DIRECTIONS[*cell]);
                if votes > best.1 {
                    (best.1, best.2) = (votes, DIRECTIONS[*cell]);
                }
            }
        }
        let as_they_are = best[self.state.turn as usize].1;
        best.sort_by(|one, other| other.1.total_cmp(&one.1));
        let [(turn, votes, direction), (_, second, _), ..] = best;
        let rival = match self.state.up {
            Some(up) => total(up.as_vec3()),
            None if turn == self.state.turn => second,
            None => as_they_are,
        };
        if votes > MIN_VOTES && votes > MIN_RATIO * rival && self.span(direction) > MIN_SPAN {
            self.state.up = Some(direction.as_dvec3());
        }
    }

    /// The angle about `axis` within which the camera has looked, degrees.
    fn span(&self, axis: Vec3) -> f32 {
        let (right, ahead) = axis.any_orthonormal_pair();
        let looked = (0..CELLS).filter(|cell| self.looked[*cell]).map(|cell| DIRECTIONS[cell]);
        let across = looked.map(|direction| Vec2::new(direction.dot(right), direction.dot(ahead)));
        let level = across.filter(|across| across.length() > MIN_TILT);
        let mut angles: Vec<f32> = level.map(|across| libm::atan2f(across.y, across.x).to_degrees()).collect();
        angles.sort_by(f32::total_cmp);
        let (Some(first), Some(last)) = (angles.first(), angles.last()) else { return 0.0 };
        let gaps = angles.windows(2).map(|pair| pair[1] - pair[0]);
        360.0 - gaps.fold(first + 360.0 - last, f32::max)
    }

    /// The state, to be continued later.
    pub(crate) fn block(&self) -> StateBlock {
        let mut block = StateBlock::default();
        block.put_json("state.json", &self.state);
        block.put("votes", &[], self.votes.iter().copied());
        block.put("looked", &[], self.looked.iter().map(|looked| u8::from(*looked)));
        block
    }

    /// Reads [`Self::block`]. A state of an earlier version has none.
    pub(crate) fn of_block(block: &StateBlock) -> Result<Self, String> {
        if block.is_empty() {
            return Ok(Self::default());
        }
        let text = |error: splatseg_files::StateError| error.to_string();
        let state = block.get_json("state.json").map_err(text)?.unwrap_or_default();
        let votes = block.get_rows("votes", CELLS, &[]).map_err(text)?;
        let looked: Vec<u8> = block.get_rows("looked", CELLS, &[]).map_err(text)?;
        if votes.iter().any(|votes: &f32| !votes.is_finite()) {
            return Err("upright.votes: found a number that is not finite".to_owned());
        }
        Ok(Self { votes, looked: looked.into_iter().map(|looked| looked != 0).collect(), state })
    }
}

/// Where the top of an upright image is in the image before the turn: (right, down).
fn top(turn: QuarterTurn) -> Vec2 {
    let (right, down) = turn.inverse().vector((0, -1));
    Vec2::new(right as f32, down as f32)
}

/// The turn for a camera with this direction of up, in its axes. It stays as it is while that is not far off.
fn kept_turn(turn: QuarterTurn, up: Vec3) -> QuarterTurn {
    let up = up.truncate();
    if up.length() < MIN_TILT || up.normalize().dot(top(turn)) > KEPT {
        return turn;
    }
    let slant = |turn: &QuarterTurn| up.dot(top(*turn));
    QuarterTurn::ALL.into_iter().max_by(|one, other| slant(one).total_cmp(&slant(other))).unwrap_or(turn)
}

/// The cell of a direction in the unfolded octahedron.
fn cell(direction: Vec3) -> usize {
    let Vec3 { x, y, z } =
        direction / (direction.x.abs() + direction.y.abs() + direction.z.abs()).max(f32::MIN_POSITIVE);
    let folded = |one: f32, other: f32| if z >= 0.0 { one } else { (1.0 - other.abs()).copysign(one) };
    let place = |value: f32| (((value + 1.0) * 0.5 * SIDE as f32) as usize).min(SIDE - 1);
    place(folded(y, x)) * SIDE + place(folded(x, y))
}

/// The middle of a cell.
fn direction(cell: usize) -> Vec3 {
    let place = |index: usize| (index as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
    let (x, y) = (place(cell % SIDE), place(cell / SIDE));
    let z = 1.0 - x.abs() - y.abs();
    let folded = |one: f32, other: f32| if z >= 0.0 { one } else { (1.0 - other.abs()).copysign(one) };
    Vec3::new(folded(x, y), folded(y, x), z).normalize()
}

/// The normals of surfaces on a coarse grid of the frame, towards the camera.
fn normals(frame: &CameraFrame<'_>) -> Vec<Vec3> {
    let (width, height) = (frame.width(), frame.height());
    let step = (((width * height) as f32 / PIXELS).sqrt().round() as usize).max(1);
    let (reach, camera, depth) = (REACH * step, frame.intrinsics(), frame.depth());
    let point = |column: usize, row: usize| {
        let depth = depth[(column, row)];
        (depth > 0.0).then(|| camera.unproject(Vec2::new(column as f32, row as f32), depth))
    };
    let normal = |column: usize, row: usize| {
        let center = point(column, row)?;
        let right = point(column + reach, row)? - point(column - reach, row)?;
        let down = point(column, row + reach)? - point(column, row - reach)?;
        let most = MAX_STEP.0 + MAX_STEP.1 * center.z;
        let normal = down.cross(right).try_normalize().filter(|_| right.z.abs() < most && down.z.abs() < most)?;
        Some(if normal.dot(center) > 0.0 { -normal } else { normal })
    };
    let places = |size: usize| (reach..size.saturating_sub(reach)).step_by(2 * step);
    places(height).flat_map(|row| places(width).filter_map(move |column| normal(column, row))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DQuat};
    use splatseg_geometry::{Image, Intrinsics};

    const CAMERA: Intrinsics = Intrinsics { fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5, width: 160, height: 120 };

    /// Depth seen by a camera in the middle of an empty room of 6 × 6 m from 1.3 m above the floor, turned by `yaw` degrees
    /// and looking down by 25 degrees. World axes: z is up.
    fn view(yaw: f64, turn: QuarterTurn) -> (CameraFrame<'static>, Pose) {
        let level = DQuat::from_mat3(&glam::DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y));
        let looking = DQuat::from_rotation_z(yaw.to_radians()) * level * DQuat::from_rotation_x(-25f64.to_radians());
        let pose = Pose::from_matrix(DMat4::from_rotation_translation(looking, DVec3::new(0.0, 0.0, 1.3))).unwrap();
        let rotation = pose.rotation();
        let depth = Image::from_fn(160, 120, |column, row| {
            let ray = CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0).as_dvec3();
            let world = rotation * ray;
            let reach = |along: f64, low: f64, high: f64| if along > 0.0 { high / along } else { low / along };
            reach(world.x, -3.0, 3.0).min(reach(world.y, -3.0, 3.0)).min(reach(world.z, -1.3, 1.3)) as f32
        });
        let frame = CameraFrame::new("0", Image::filled(160, 120, [0; 3]), depth, CAMERA).unwrap();
        // The camera is turned about its axis, against its image.
        let held = DQuat::from_rotation_z(f64::from(turn.inverse().degrees()).to_radians());
        let pose = pose * Pose::from_matrix(DMat4::from_quat(held)).unwrap();
        (frame.turned(turn), pose)
    }

    #[test]
    fn measured_gravity_decides_at_once() {
        for turn in QuarterTurn::ALL {
            let mut upright = Upright::measured(DVec3::Z);
            let (frame, pose) = view(30.0, turn);
            upright.add(&frame, &pose);
            assert_eq!(upright.turn(), turn.inverse());
            // It is saved, and another map has other axes.
            let mut restored = Upright::of_block(&upright.block()).unwrap();
            assert!(restored.state.is_measured);
            restored.start_map();
            assert_eq!((restored.state.up, restored.state.is_measured), (None, false));
            assert_eq!(restored.turn(), turn.inverse());
        }
    }

    #[test]
    fn a_camera_that_is_held_sideways_is_noticed_once_it_has_looked_around() {
        for turn in QuarterTurn::ALL {
            let mut upright = Upright::default();
            let turns: Vec<QuarterTurn> = (0..12)
                .map(|index| {
                    let (frame, pose) = view(f64::from(10 * index), turn);
                    upright.add(&frame, &pose);
                    upright.turn()
                })
                .collect();
            assert_eq!((turns[0], turns[2], turns[11]), (QuarterTurn::None, QuarterTurn::None, turn.inverse()));
            let up = upright.state.up.unwrap();
            assert!(up.dot(DVec3::Z) > 0.98, "{turn:?}: {up}");
        }
    }

    #[test]
    fn a_camera_that_is_turned_on_the_way_is_followed() {
        let mut upright = Upright::default();
        for index in 0..20 {
            let turn = if index < 10 { QuarterTurn::None } else { QuarterTurn::Left };
            let (frame, pose) = view(f64::from(10 * index), turn);
            upright.add(&frame, &pose);
            assert_eq!(upright.turn(), turn.inverse(), "frame {index}");
        }
    }

    #[test]
    fn a_standing_camera_decides_nothing() {
        let mut upright = Upright::default();
        let (frame, pose) = view(20.0, QuarterTurn::Right);
        (0..50).for_each(|_| upright.add(&frame, &pose));
        assert_eq!((upright.turn(), upright.state.up), (QuarterTurn::None, None));
    }

    #[test]
    fn the_state_goes_on_where_it_was_saved() {
        let mut upright = Upright::default();
        for index in 0..7 {
            let (frame, pose) = view(f64::from(10 * index), QuarterTurn::Right);
            upright.add(&frame, &pose);
        }
        let mut restored = Upright::of_block(&upright.block()).unwrap();
        let (frame, pose) = view(70.0, QuarterTurn::Right);
        upright.add(&frame, &pose);
        restored.add(&frame, &pose);
        assert_eq!((&restored.votes, &restored.looked), (&upright.votes, &upright.looked));
        assert_eq!((restored.state.up, restored.turn()), (upright.state.up, QuarterTurn::Left));
        assert_eq!(Upright::of_block(&StateBlock::default()).unwrap().turn(), QuarterTurn::None);
    }

    #[test]
    fn every_direction_lies_in_its_cell() {
        for index in 0..CELLS {
            assert_eq!(cell(direction(index)), index);
        }
    }
}

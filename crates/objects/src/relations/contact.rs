//! Where the surface of one object is, seen from another.

use super::upright::{SECTORS, Upright, sector};
use glam::Vec2;

/// Surfaces at one height differ by no more than this, metres: noise of the depth.
const LEVEL: f32 = 0.025;
/// The surface that something stands on is looked for this far beyond its footprint, metres.
const BEYOND: f32 = 0.15;
/// Below a foot nothing is this close to it, metres, but the sides of a thing that is not much larger.
const RIGHT_BESIDE: f32 = 0.05;
/// Objects lower than this, metres, have no certain foot: they could be stains or sheets of paper.
const LOWEST: f32 = 0.04;
/// Directions, of eight, in which the surface must be seen around a foot...
const AROUND_FOOT: usize = 5;
/// ...or around the lower part of something that is in it.
const AROUND_LOWER_PART: usize = 8;
/// Larger things are furniture and walls with a recess rather than containers: their longest level side, metres.
const LARGEST_CONTAINER: f32 = 1.0;
/// A container is at most this far beyond what is in it, metres...
const IN_REACH: f32 = 0.25;
/// ...and has its walls this high above the bottom at least, as a share of the height of what is in it.
const IN_HEIGHT: f32 = 0.3;
/// Most and least distance of an object below the one that it is under, metres.
const UNDER: (f32, f32) = (0.03, 1.0);
/// Share of its footprint that is covered.
const COVERED: f32 = 0.9;
/// Side of the cells of a footprint, metres.
const CELL: f32 = 0.06;
/// Larger things are walls, floors, ceilings: nothing is under them, square metres.
const LARGEST_COVER: f32 = 3.0;
/// A cover is at least this much larger than the footprint below it, and not higher than wide.
const COVER_SHARE: f32 = 2.0;
/// Greatest distance of objects that are beside each other, metres.
const BESIDE: f32 = 0.2;
/// Things beside each other overlap in height by this share of the lower one.
const SHARED_HEIGHT: f32 = 0.5;
/// Points of each object that are compared for their distance.
const COMPARED: usize = 400;

/// In how many directions around an object another one's surface is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Surroundings {
    /// At the height of its foot, level, and nothing higher right beside it.
    pub(super) at_foot: usize,
    /// Beside its lower part.
    at_lower_part: usize,
    /// The object is high enough for its foot to be certain.
    has_foot: bool,
    /// Some of the other's surface is below the foot, in the footprint.
    is_below: bool,
    /// The other one is small enough to be a container.
    may_contain: bool,
}

impl Surroundings {
    pub(super) fn is_at_foot(&self) -> bool {
        self.has_foot && self.at_foot >= AROUND_FOOT
    }

    pub(super) fn is_around_lower_part(&self) -> bool {
        self.has_foot && self.is_below && self.may_contain && self.at_lower_part >= AROUND_LOWER_PART
    }
}

/// Looks for the surface of `other` around an object.
pub(super) fn surroundings(object: &Upright, other: &Upright) -> Surroundings {
    let (mut level, mut higher, mut lower) = ([0u32; SECTORS], [0u32; SECTORS], [0u32; SECTORS]);
    let mut beside = [false; SECTORS];
    let mut is_below = false;
    let low = object.bottom + IN_HEIGHT * object.height();
    for point in &other.points {
        let from_center = point.truncate() - object.center;
        let (direction, distance) = (sector(from_center), from_center.length());
        let beyond = distance - object.reach[direction];
        let above = point.z - object.bottom;
        if (-0.03..=BEYOND).contains(&beyond) {
            if above.abs() <= LEVEL {
                level[direction] += 1;
            } else if above > LEVEL && point.z < object.top {
                higher[direction] += 1;
            } else if beyond <= RIGHT_BESIDE && (-BEYOND..0.0).contains(&above) {
                lower[direction] += 1;
            }
        }
        let in_reach = (-0.03..=IN_REACH).contains(&beyond);
        beside[direction] |= in_reach && point.z > low && point.z < object.top + object.height();
        is_below |= beyond <= 0.0 && (-0.1..=LEVEL).contains(&above);
    }
    // A wall is as much above and below the foot as beside it.
    let is_level = |direction: &usize| {
        let count = level[*direction];
        count > 0 && count >= higher[*direction] && count >= lower[*direction]
    };
    let at_foot = (0..SECTORS).filter(is_level);
    Surroundings {
        at_foot: at_foot.count(),
        at_lower_part: beside.into_iter().filter(|is_there| *is_there).count(),
        has_foot: object.height() >= LOWEST,
        is_below,
        may_contain: (other.max - other.min).max_element() <= LARGEST_CONTAINER,
    }
}

/// True if `other` is above nearly all of an object's footprint, and none of it lower than the object's top there.
pub(super) fn is_under(object: &Upright, other: &Upright) -> bool {
    let apart = other.top - object.top;
    if object.height() < LOWEST || apart < UNDER.0 || other.footprint() > LARGEST_COVER {
        return false;
    }
    let is_tall = other.height() > (other.max - other.min).min_element();
    if is_tall || other.footprint() < COVER_SHARE * object.footprint() {
        return false;
    }
    if object.min.cmplt(other.min - CELL).any() || object.max.cmpgt(other.max + CELL).any() {
        return false;
    }
    let size = ((object.max - object.min) / CELL).ceil().max(Vec2::ONE);
    let (columns, rows) = (size.x as usize, size.y as usize);
    let mut covered = vec![false; columns * rows];
    for point in &other.points {
        let place = ((point.truncate() - object.min) / CELL).floor();
        if place.x < 0.0 || place.y < 0.0 || place.x >= size.x || place.y >= size.y {
            continue;
        }
        let above = point.z - object.top;
        if above < UNDER.0 {
            return false;
        }
        covered[place.y as usize * columns + place.x as usize] |= above <= UNDER.1;
    }
    let count = covered.iter().filter(|is_covered| **is_covered).count();
    count as f32 >= COVERED * covered.len() as f32
}

/// True if two objects on the same thing are close to each other.
pub(super) fn is_beside(object: &Upright, other: &Upright) -> bool {
    let shared = object.top.min(other.top) - object.bottom.max(other.bottom);
    if shared < SHARED_HEIGHT * object.height().min(other.height()) {
        return false;
    }
    let some = |one: &Upright| {
        let step = one.points.len().div_ceil(COMPARED).max(1);
        one.points.iter().step_by(step).map(|point| point.truncate()).collect::<Vec<Vec2>>()
    };
    let others = some(other);
    some(object).iter().any(|point| others.iter().any(|other| point.distance_squared(*other) <= BESIDE * BESIDE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// The sides and the top of a box, or only the sides, with a point every 2 cm.
    fn cuboid(id: u32, min: Vec3, max: Vec3, has_top: bool) -> Upright {
        let steps = ((max - min) / 0.02).round().as_ivec3();
        let mut points = Vec::new();
        for x in 0..=steps.x {
            for y in 0..=steps.y {
                for z in 0..=steps.z {
                    let is_side = x == 0 || y == 0 || x == steps.x || y == steps.y;
                    if is_side || (has_top && z == steps.z) {
                        points.push(min + 0.02 * Vec3::new(x as f32, y as f32, z as f32));
                    }
                }
            }
        }
        Upright::new(id, &points, Vec3::Z).unwrap()
    }

    /// A level board without the part that something hides.
    fn board(half: f32, height: f32, hidden: f32) -> Upright {
        let range = -(half / 0.02) as i32..=(half / 0.02) as i32;
        let all = range.clone().flat_map(|x| range.clone().map(move |y| 0.02 * Vec2::new(x as f32, y as f32)));
        let points: Vec<Vec3> =
            all.filter(|place| place.abs().max_element() > hidden).map(|place| place.extend(height)).collect();
        Upright::new(9, &points, Vec3::Z).unwrap()
    }

    #[test]
    fn a_box_on_a_table_is_on_it_and_one_above_is_not() {
        let table = board(0.4, 0.7, 0.1);
        let at = |height: f32| cuboid(1, Vec3::new(-0.1, -0.1, height), Vec3::new(0.1, 0.1, height + 0.2), true);
        assert!(surroundings(&at(0.7), &table).is_at_foot());
        assert!(!surroundings(&at(0.76), &table).is_at_foot() && !surroundings(&at(0.6), &table).is_at_foot());
        assert!(!surroundings(&at(0.7), &table).is_around_lower_part());
        let flat = cuboid(1, Vec3::new(-0.1, -0.1, 0.7), Vec3::new(0.1, 0.1, 0.72), true);
        assert!(!surroundings(&flat, &table).is_at_foot(), "perhaps a sheet of paper");
    }

    #[test]
    fn things_in_a_basket_are_in_it() {
        let sides = cuboid(2, Vec3::new(-0.2, -0.2, 0.0), Vec3::new(0.2, 0.2, 0.24), false);
        let floor = board(0.2, 0.02, 0.0);
        let points: Vec<Vec3> = sides.points.iter().chain(&floor.points).copied().collect();
        let basket = Upright::new(2, &points, Vec3::Z).unwrap();
        let ball = cuboid(1, Vec3::new(-0.08, -0.08, 0.04), Vec3::new(0.08, 0.08, 0.2), true);
        assert!(surroundings(&ball, &basket).is_around_lower_part());
        let beside = cuboid(1, Vec3::new(0.3, -0.08, 0.0), Vec3::new(0.5, 0.08, 0.2), true);
        assert!(!surroundings(&beside, &basket).is_around_lower_part());
    }

    #[test]
    fn what_a_board_covers_is_under_it() {
        let board = board(0.4, 0.7, 0.0);
        let low = cuboid(1, Vec3::new(-0.1, -0.1, 0.0), Vec3::new(0.1, 0.1, 0.3), true);
        let outside = cuboid(1, Vec3::new(0.3, -0.1, 0.0), Vec3::new(0.6, 0.1, 0.3), true);
        let above = cuboid(1, Vec3::new(-0.1, -0.1, 0.7), Vec3::new(0.1, 0.1, 0.9), true);
        assert!(is_under(&low, &board) && !is_under(&outside, &board) && !is_under(&above, &board));
    }

    #[test]
    fn near_things_are_beside_each_other() {
        let at = |x: f32| cuboid(1, Vec3::new(x, 0.0, 0.0), Vec3::new(x + 0.1, 0.1, 0.2), true);
        assert!(is_beside(&at(0.0), &at(0.28)) && !is_beside(&at(0.0), &at(0.32)));
    }
}

//! The points of an object in coordinates whose third axis points up.

use glam::{Mat3, Quat, Vec2, Vec3};
use splatseg_geometry::SegmentId;

/// Share of the points beyond the lowest and the highest that count.
const TAIL: f32 = 0.02;
/// An object needs this many points.
const MIN_POINTS: usize = 12;
/// Directions around an object.
pub(super) const SECTORS: usize = 8;

/// An object's points, upright.
pub(super) struct Upright {
    pub(super) id: SegmentId,
    /// x and y are level, z is the height; metres.
    pub(super) points: Vec<Vec3>,
    /// Height of the lowest and of the highest points.
    pub(super) bottom: f32,
    pub(super) top: f32,
    /// Middle of the footprint.
    pub(super) center: Vec2,
    /// Ends of the footprint along x and y.
    pub(super) min: Vec2,
    pub(super) max: Vec2,
    /// Distance of the farthest point from the middle in each direction. Where nothing was seen, that of the opposite one.
    pub(super) reach: [f32; SECTORS],
}

impl Upright {
    /// `None` for an object of too few points.
    pub(super) fn new(id: SegmentId, points: &[Vec3], up: Vec3) -> Option<Self> {
        if points.len() < MIN_POINTS {
            return None;
        }
        let turn = Mat3::from_quat(Quat::from_rotation_arc(up.normalize_or(Vec3::Z), Vec3::Z));
        let points: Vec<Vec3> = points.iter().map(|point| turn * *point).collect();
        let ends = |axis: usize, tail: f32| {
            let mut values: Vec<f32> = points.iter().map(|point| point[axis]).collect();
            values.sort_by(f32::total_cmp);
            let skipped = (tail * values.len() as f32) as usize;
            (values[skipped], values[values.len() - 1 - skipped])
        };
        let [x, y, (bottom, top)] = [0, 1, 2].map(|axis| ends(axis, TAIL));
        let (min, max) = (Vec2::new(x.0, y.0), Vec2::new(x.1, y.1));
        let center = 0.5 * (min + max);
        let mut reach = [0.0f32; SECTORS];
        for point in points.iter().map(|point| point.truncate()) {
            if point.cmpge(min).all() && point.cmple(max).all() {
                let sector = sector(point - center);
                reach[sector] = reach[sector].max(point.distance(center));
            }
        }
        let reach = std::array::from_fn(|sector| {
            let opposite = reach[(sector + SECTORS / 2) % SECTORS];
            if reach[sector] > 0.0 { reach[sector] } else { opposite }
        });
        Some(Self { id, points, bottom, top, center, min, max, reach })
    }

    pub(super) fn height(&self) -> f32 {
        self.top - self.bottom
    }

    /// Area of the rectangle around the footprint, square metres.
    pub(super) fn footprint(&self) -> f32 {
        (self.max - self.min).element_product()
    }

    /// True if an object's footprint is around the middle of this one, and it is not all above or below its foot.
    pub(super) fn may_be_on(&self, other: &Self) -> bool {
        let is_around = self.center.cmpge(other.min).all() && self.center.cmple(other.max).all();
        is_around && other.bottom < self.bottom + 0.05 && other.top > self.bottom - 0.05
    }
}

/// The direction of a vector, from 0.
pub(super) fn sector(vector: Vec2) -> usize {
    // Eight directions by comparisons alone: the same on every machine.
    let (x, y) = (vector.x, vector.y);
    let (is_left, is_below) = (x < 0.0, y < 0.0);
    let is_steep = y.abs() > x.abs();
    match (is_left, is_below, is_steep) {
        (false, false, false) => 0,
        (false, false, true) => 1,
        (true, false, true) => 2,
        (true, false, false) => 3,
        (true, true, false) => 4,
        (true, true, true) => 5,
        (false, true, true) => 6,
        (false, true, false) => 7,
    }
}

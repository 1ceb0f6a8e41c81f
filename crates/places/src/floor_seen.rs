//! The cells whose floor was seen.

use crate::columns::Columns;
use crate::depth_points::DepthPoints;
use glam::Vec3;

/// Points at most this far below the floor are floor, metres. What lies deeper is a hole, or the next storey.
const BELOW: f32 = 0.08;
/// Largest distance between two points of the floor that belong together, metres.
const APART: f32 = 0.5;

/// For each cell, how often its centre was seen as floor.
pub(crate) struct FloorSeen {
    width: usize,
    height: usize,
    resolution: f32,
    /// Row-major.
    pub seen: Vec<u16>,
}

impl FloorSeen {
    pub(crate) fn new((width, height): (usize, usize), resolution: f32) -> Self {
        Self { width, height, resolution, seen: vec![0; width * height] }
    }

    /// Adds the floor between the pixels of a view: far away, pixels are farther apart than cells.
    pub(crate) fn add(&mut self, points: &DepthPoints, columns: &Columns, min_height: f32) {
        let is_floor =
            |point: Vec3| columns.above_floor(point).is_some_and(|above| above >= -BELOW && above < min_height);
        let floor = |column: usize, row: usize| points.at(column, row).filter(|point| is_floor(*point));
        for row in 0..points.height.saturating_sub(1) {
            for column in 0..points.width.saturating_sub(1) {
                let corners =
                    [floor(column, row), floor(column + 1, row), floor(column + 1, row + 1), floor(column, row + 1)];
                if let [Some(first), Some(second), Some(third), Some(fourth)] = corners {
                    self.add_triangle([first, second, third]);
                    self.add_triangle([first, third, fourth]);
                }
            }
        }
    }

    /// Adds the cells whose centre is in a triangle.
    fn add_triangle(&mut self, corners: [Vec3; 3]) {
        let [a, b, c] = corners;
        if a.distance(b).max(b.distance(c)).max(c.distance(a)) > APART {
            return;
        }
        let [a, b, c] = corners.map(|corner| corner.truncate() / self.resolution - 0.5);
        let (low, high) = (a.min(b).min(c).ceil(), a.max(b).max(c).floor());
        if !(low.cmple(high).all() && high.cmpge(glam::Vec2::ZERO).all()) {
            return;
        }
        let last = |count: usize, high: f32| (high.min(count as f32 - 1.0)) as usize;
        let area = (b - a).perp_dot(c - a);
        let sign = if area < 0.0 { -1.0 } else { 1.0 };
        for row in low.y.max(0.0) as usize..=last(self.height, high.y) {
            for column in low.x.max(0.0) as usize..=last(self.width, high.x) {
                let center = glam::Vec2::new(column as f32, row as f32);
                let is_left = |from: glam::Vec2, to: glam::Vec2| sign * (to - from).perp_dot(center - from) >= 0.0;
                if is_left(a, b) && is_left(b, c) && is_left(c, a) {
                    let seen = &mut self.seen[row * self.width + column];
                    *seen = seen.saturating_add(1);
                }
            }
        }
    }
}

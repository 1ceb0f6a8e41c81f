//! Evidence of a map's keyframes about a place: they saw a surface, saw nothing, or did not look.

use glam::DVec3;
use rayon::prelude::*;
use splatseg_geometry::{Image, Intrinsics, Pose};

/// A measured surface is at a point if it is within this distance of it, metres, or within the share of the depth.
const MARGIN: (f32, f32) = (0.05, 0.025);

/// Evidence about a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaceSight {
    /// A surface is there.
    Seen,
    /// The camera looked through it.
    Empty,
    /// Out of view, or hidden.
    Unobserved,
}

/// A view of a camera with depth.
#[derive(Clone, Debug)]
pub struct DepthView {
    /// The pose, camera to world.
    pub world_from_camera: Pose,
    /// The camera.
    pub intrinsics: Intrinsics,
    /// z-depth, metres, 0 where missing, `[height, width]`.
    pub depth: Image<f32>,
}

impl DepthView {
    /// Returns the view's evidence about a point, world coordinates, metres. Its neighbours must agree that a place is empty.
    fn sight(&self, point: DVec3) -> PlaceSight {
        let point = self.world_from_camera.to_camera(point);
        let Some(pixel) = self.intrinsics.project(point) else { return PlaceSight::Unobserved };
        let (column, row) = (pixel.x.round(), pixel.y.round());
        let (width, height) = self.depth.size();
        let is_inside = column >= 1.0 && row >= 1.0 && column + 2.0 <= width as f32 && row + 2.0 <= height as f32;
        if !is_inside {
            return PlaceSight::Unobserved;
        }
        let margin = MARGIN.0.max(MARGIN.1 * point.z);
        let (column, row) = (column as usize, row as usize);
        let (mut all_beyond, mut any_near) = (true, false);
        for row in row - 1..=row + 1 {
            for depth in &self.depth.row(row)[column - 1..=column + 1] {
                all_beyond &= *depth > point.z + margin;
                any_near |= *depth > 0.0 && (depth - point.z).abs() <= margin;
            }
        }
        match (all_beyond, any_near) {
            (true, _) => PlaceSight::Empty,
            (_, true) => PlaceSight::Seen,
            _ => PlaceSight::Unobserved,
        }
    }
}

/// Returns the evidence of most views about a point, world coordinates, metres.
pub(super) fn sight(views: &[DepthView], point: DVec3) -> PlaceSight {
    let (mut seen, mut empty) = (0usize, 0usize);
    for view in views {
        match view.sight(point) {
            PlaceSight::Seen => seen += 1,
            PlaceSight::Empty => empty += 1,
            PlaceSight::Unobserved => {}
        }
    }
    match (seen, empty) {
        (0, 0) => PlaceSight::Unobserved,
        _ if empty > seen => PlaceSight::Empty,
        _ => PlaceSight::Seen,
    }
}

/// The same about many points, world coordinates, metres.
pub fn place_sights(views: &[DepthView], points: &[DVec3]) -> Vec<PlaceSight> {
    points.par_iter().with_min_len(256).map(|point| sight(views, *point)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_seen_what_is_before_it_is_empty_and_what_is_behind_it_is_hidden() {
        let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 19.5, cy: 14.5, width: 40, height: 30 };
        let depth = Image::filled(40, 30, 2.0);
        let wall = DepthView { world_from_camera: Pose::IDENTITY, intrinsics, depth };
        let views = [wall];
        let at = |x: f64, z: f64| sight(&views, DVec3::new(x, 0.0, z));
        assert_eq!(
            [at(0.0, 2.0), at(0.0, 1.96), at(0.0, 1.9), at(0.0, 2.1), at(3.0, 2.0), at(0.0, -1.0)],
            [
                PlaceSight::Seen,
                PlaceSight::Seen,
                PlaceSight::Empty,
                PlaceSight::Unobserved,
                PlaceSight::Unobserved,
                PlaceSight::Unobserved
            ]
        );
    }
}

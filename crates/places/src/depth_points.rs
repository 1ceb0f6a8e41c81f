//! The points that a view measured, without those at edges.

use glam::{DVec3, Vec2, Vec3};
use splatseg_geometry::{LocalPose, Pose};
use splatseg_objects::DepthView;

/// A pixel belongs to the surface of a neighbour if their depths differ by at most this, metres plus a share of the depth.
const SAME_SURFACE: (f32, f32) = (0.02, 0.05);

/// Points of a view, row-major, `[height, width]`, in coordinates with an origin near the camera.
pub(crate) struct DepthPoints {
    /// Pixels in a row.
    pub width: usize,
    /// Pixels in a column.
    pub height: usize,
    /// The camera's centre.
    pub camera: Vec3,
    points: Vec<Option<Vec3>>,
    /// Points at edges, which may lie between two surfaces.
    pub edges: Vec<Vec3>,
}

impl DepthPoints {
    /// The points of a view at most `max_range` away, metres, relative to `origin` (coordinates of the plan), with the
    /// plan's axes. Pixels without depth have none. Those whose depth differs from that of three
    /// neighbours or more are apart: they are at the edge of a thing, or between two.
    pub(crate) fn new(view: &DepthView, plan_from_world: &Pose, origin: DVec3, max_range: f32) -> Self {
        let local = (*plan_from_world * view.world_from_camera).relative_to(origin);
        let (width, height) = view.depth.size();
        let camera = local.translation();
        let mut points = Vec::with_capacity(width * height);
        let mut edges = Vec::new();
        for row in 0..height {
            for column in 0..width {
                let depth = view.depth[(column, row)];
                let is_measured = depth > 0.0 && depth <= max_range;
                let measured = is_measured.then(|| point(view, &local, column, row, depth));
                let is_kept = is_measured && is_on_a_surface(view, column, row, depth);
                edges.extend(measured.filter(|_| !is_kept));
                points.push(measured.filter(|_| is_kept));
            }
        }
        Self { width, height, camera, points, edges }
    }

    pub(crate) fn at(&self, column: usize, row: usize) -> Option<Vec3> {
        self.points[row * self.width + column]
    }
}

fn point(view: &DepthView, local: &LocalPose, column: usize, row: usize, depth: f32) -> Vec3 {
    local.to_world(view.intrinsics.unproject(Vec2::new(column as f32, row as f32), depth))
}

/// Returns true if at least two of the four neighbours have nearly the same depth.
fn is_on_a_surface(view: &DepthView, column: usize, row: usize, depth: f32) -> bool {
    let (width, height) = view.depth.size();
    let tolerance = SAME_SURFACE.0 + SAME_SURFACE.1 * depth;
    let is_same = |column: usize, row: usize| {
        let other = view.depth[(column, row)];
        other > 0.0 && (other - depth).abs() <= tolerance
    };
    let neighbours = [
        column > 0 && is_same(column - 1, row),
        column + 1 < width && is_same(column + 1, row),
        row > 0 && is_same(column, row - 1),
        row + 1 < height && is_same(column, row + 1),
    ];
    neighbours.into_iter().filter(|is_same| *is_same).count() >= 2
}

/// Small pieces of surface of a view: for each a point, its unit normal towards the camera, and its area, square metres.
/// Every `step`-th pixel of both directions has one.
pub(crate) fn surface_pieces(points: &DepthPoints, step: usize) -> Vec<(Vec3, Vec3, f32)> {
    let mut pieces = Vec::new();
    for row in (0..points.height.saturating_sub(step)).step_by(step) {
        for column in (0..points.width.saturating_sub(step)).step_by(step) {
            let corner = (points.at(column, row), points.at(column + step, row), points.at(column, row + step));
            let (Some(point), Some(right), Some(below)) = corner else { continue };
            let across = (right - point).cross(below - point);
            let area = across.length();
            // The depth of a continuous surface cannot change much from pixel to pixel.
            let is_continuous = (right - point).length().max((below - point).length()) < 0.25;
            if area > 1e-9 && is_continuous {
                let normal = across / area;
                let facing = if normal.dot(points.camera - point) < 0.0 { -normal } else { normal };
                pieces.push((point, facing, area));
            }
        }
    }
    pieces
}

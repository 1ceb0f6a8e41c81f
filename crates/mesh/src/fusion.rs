//! Adds depth images to the field.

use crate::block_grid::{BlockGrid, SIDE, VOXELS, Voxel};
use crate::depth_planes::DepthPlane;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::{Image, Intrinsics, LocalPose};
use splatseg_odometry::KeyframeView;

/// Distances are known up to this many voxels, or this many metres if that is more.
const BAND_VOXELS: f32 = 4.0;
const LEAST_BAND: f32 = 0.05;
/// Space that is seen to be free counts this much, relative to a measured surface.
const FREE_WEIGHT: f32 = 0.3;
/// A voxel's measurements count at most this much together, so that the last ones are not outweighed by all before.
const MAX_WEIGHT: f32 = 30.0;
/// Views farther from the map's origin are left out, metres.
const FARTHEST_VIEW: f32 = 1e5;

/// A keyframe's depth image and its pose, relative to the origin of the map.
pub(crate) struct DepthView<'a> {
    /// Position among the keyframes.
    pub(crate) number: usize,
    pub(crate) depth: &'a Image<f32>,
    pub(crate) intrinsics: Intrinsics,
    pub(crate) world_from_camera: LocalPose,
}

impl<'a> DepthView<'a> {
    /// Views of all keyframes that can be used.
    pub(crate) fn of(keyframes: &'a [KeyframeView], origin: DVec3) -> Vec<Self> {
        let view = |(number, keyframe): (usize, &'a KeyframeView)| {
            let world_from_camera = keyframe.world_from_camera.relative_to(origin);
            let is_near = world_from_camera.translation().abs().max_element() < FARTHEST_VIEW;
            let view = Self { number, depth: &keyframe.depth, intrinsics: keyframe.intrinsics, world_from_camera };
            is_near.then_some(view)
        };
        keyframes.iter().enumerate().filter_map(view).collect()
    }

    /// Direction of a pixel's ray in the camera's coordinates, with z = 1.
    pub(crate) fn ray(&self, column: usize, row: usize) -> Vec3 {
        self.intrinsics.unproject(Vec2::new(column as f32, row as f32), 1.0)
    }

    /// True if part of a ball may be in the image. `centre` is in the camera's coordinates.
    pub(crate) fn may_show(&self, centre: Vec3, radius: f32) -> bool {
        let camera = &self.intrinsics;
        if centre.z + radius <= 0.0 {
            return false;
        }
        let depth = (centre.z - radius).max(0.05);
        let (width, height) = self.depth.size();
        let reach = radius / depth * camera.fx.max(camera.fy) + 1.0;
        let place = |along: f32, focal: f32, middle: f32| focal * along / centre.z.max(depth) + middle;
        let (column, row) = (place(centre.x, camera.fx, camera.cx), place(centre.y, camera.fy, camera.cy));
        let is_close = centre.z < 2.0 * radius;
        is_close || (column > -reach && row > -reach && column < width as f32 + reach && row < height as f32 + reach)
    }
}

/// The distance from surfaces up to which the field is known, metres.
pub(crate) fn truncation(voxel: f32) -> f32 {
    (BAND_VOXELS * voxel).max(LEAST_BAND)
}

/// Adds a view to the field.
pub(crate) fn add_view(grid: &mut BlockGrid, view: &DepthView, planes: &Image<DepthPlane>) {
    let (voxel, band) = (grid.voxel, truncation(grid.voxel));
    let block_side = SIDE as f32 * voxel;
    let radius = 0.5 * 3f32.sqrt() * block_side;
    let used = planes.pixels().iter().filter(|plane| plane.weight > 0.0);
    let farthest = used.map(|plane| plane.inverse.recip()).fold(0.0, f32::max) + band;
    let places = &grid.places;
    let blocks = grid.blocks.par_iter_mut().enumerate().with_min_len(64);
    blocks.for_each(|(number, block)| {
        let corner = places[number].as_vec3() * block_side;
        let centre = view.world_from_camera.to_camera(corner + 0.5 * block_side);
        if centre.z - radius < farthest && view.may_show(centre, radius) {
            add_to_block(block, view, planes, (corner, voxel, band));
        }
    });
}

fn add_to_block(
    block: &mut [Voxel; VOXELS],
    view: &DepthView,
    planes: &Image<DepthPlane>,
    (corner, voxel, band): (Vec3, f32, f32),
) {
    let camera = &view.intrinsics;
    let camera_from_world = view.world_from_camera.rotation().transpose();
    let start = view.world_from_camera.to_camera(corner);
    let [across, along, up] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| camera_from_world * axis * voxel);
    let (width, height) = planes.size();
    let pixels = planes.pixels();
    for (index, voxel) in block.iter_mut().enumerate() {
        let (x, y, z) = (index % SIDE, index / SIDE % SIDE, index / (SIDE * SIDE));
        let point = start + across * x as f32 + along * y as f32 + up * z as f32;
        if point.z < 0.05 {
            continue;
        }
        let per_depth = point.z.recip();
        let place = Vec2::new(camera.fx * point.x * per_depth + camera.cx, camera.fy * point.y * per_depth + camera.cy);
        let pixel = (place + 0.5).floor();
        if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width as f32 && pixel.y < height as f32) {
            continue;
        }
        let plane = pixels[pixel.y as usize * width + pixel.x as usize];
        if plane.weight <= 0.0 {
            continue;
        }
        let inverse = plane.inverse_at(place - pixel).max(0.5 * plane.inverse);
        let distance = (inverse.recip() - point.z) * plane.distance_per_depth;
        // Behind the edge of something nearer, space is perhaps not free.
        let is_doubtful = distance >= band && point.z > plane.nearest - band;
        if distance <= -band || is_doubtful {
            continue;
        }
        let weight = if distance >= band {
            FREE_WEIGHT * plane.weight
        } else if distance < 0.0 {
            // Behind a surface, the less certain the deeper.
            plane.weight * (1.0 + distance / band)
        } else {
            plane.weight
        };
        let total = voxel.weight + weight;
        voxel.distance += (distance.min(band) - voxel.distance) * (weight / total);
        voxel.weight = total.min(MAX_WEIGHT);
    }
}

//! The colour of each vertex, from the colour images of the keyframes that see it.

use crate::depth_planes::{DepthPlane, depth_planes};
use crate::fusion::DepthView;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::Image;
use splatseg_odometry::KeyframeView;

/// Vertices that are looked for in an image together: they are close to each other.
const GROUP: usize = 256;
/// A vertex is seen if its depth differs by no more than this from the image's: a distance, metres, and a fraction.
const SAME_SURFACE: (f32, f32) = (0.02, 0.02);

/// Weighted sum of colours, and the sum of their weights.
type Sum = [f32; 4];

/// The colour of each vertex, sRGB; `None` if no keyframe with a colour image sees it. Positions are relative to the
/// origin of the views.
pub(crate) fn vertex_colors(
    positions: &[Vec3],
    views: &[DepthView],
    keyframes: &[KeyframeView],
) -> Vec<Option<[u8; 3]>> {
    let balls: Vec<(Vec3, f32)> = positions.par_chunks(GROUP).map(ball_around).collect();
    let mut sums: Vec<Sum> = vec![[0.0; 4]; positions.len()];
    for view in views {
        let Some(color) = keyframes[view.number].color() else { continue };
        let planes = depth_planes(view.depth, &view.intrinsics);
        let groups = sums.par_chunks_mut(GROUP).zip(positions.par_chunks(GROUP)).zip(&balls);
        groups.for_each(|((sums, positions), (centre, radius))| {
            if view.may_show(view.world_from_camera.to_camera(*centre), *radius) {
                let both = sums.iter_mut().zip(positions);
                both.for_each(|(sum, position)| add_color(sum, *position, view, &planes, &color));
            }
        });
    }
    sums.into_par_iter().map(mean).collect()
}

/// A ball around points: not the smallest.
fn ball_around(points: &[Vec3]) -> (Vec3, f32) {
    let (min, max) = points
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), point| (min.min(*point), max.max(*point)));
    (0.5 * (min + max), 0.5 * min.distance(max))
}

fn add_color(sum: &mut Sum, position: Vec3, view: &DepthView, planes: &Image<DepthPlane>, color: &Image<[u8; 3]>) {
    let point = view.world_from_camera.to_camera(position);
    let Some(place) = view.intrinsics.project(point) else { return };
    let (width, height) = planes.size();
    let pixel = (place + 0.5).floor();
    if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width as f32 && pixel.y < height as f32) {
        return;
    }
    let plane = planes[(pixel.x as usize, pixel.y as usize)];
    if plane.weight <= 0.0 {
        return;
    }
    let depth = plane.inverse_at(place - pixel).max(0.5 * plane.inverse).recip();
    if (depth - point.z).abs() > SAME_SURFACE.0 + SAME_SURFACE.1 * point.z {
        return;
    }
    // The best view counts for most: means of many views are blurred.
    let sharpness = plane.weight / point.z;
    let weight = sharpness * sharpness;
    let scale = Vec2::new(color.width() as f32 / width as f32, color.height() as f32 / height as f32);
    let [red, green, blue] = color_at(color, (place + 0.5) * scale - 0.5);
    for (sum, value) in sum.iter_mut().zip([red, green, blue, 1.0]) {
        *sum += weight * value;
    }
}

/// The colour between pixels, interpolated.
fn color_at(color: &Image<[u8; 3]>, place: Vec2) -> [f32; 3] {
    let last = Vec2::new((color.width() - 1) as f32, (color.height() - 1) as f32);
    let place = place.clamp(Vec2::ZERO, last);
    let (left, top) = (place.x as usize, place.y as usize);
    let (right, bottom) = ((left + 1).min(color.width() - 1), (top + 1).min(color.height() - 1));
    let (across, down) = (place.x - left as f32, place.y - top as f32);
    let [a, b, c, d] = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|pixel| color[pixel]);
    std::array::from_fn(|channel| {
        let [a, b, c, d] = [a, b, c, d].map(|color| f32::from(color[channel]));
        let (upper, lower) = (a + (b - a) * across, c + (d - c) * across);
        upper + (lower - upper) * down
    })
}

fn mean([red, green, blue, weight]: Sum) -> Option<[u8; 3]> {
    (weight > 0.0).then(|| [red, green, blue].map(|sum| (sum / weight).round().clamp(0.0, 255.0) as u8))
}

//! Where a frame shows something the memory does not have: new Gaussians (METHOD, "Growth"; SplaTAM's rule).

use crate::{Expectation, MemorySettings};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::RgbdFrame;

/// A Gaussian to be added: the surface patch that one pixel sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NewGaussian {
    /// Row-major index of the pixel.
    pub pixel: usize,
    /// Back-projected point, world coordinates, metres.
    pub mean: Vec3,
    /// Standard deviation in every direction, metres: the size of the pixel at that depth.
    pub scale: f32,
    /// sRGB colour in [0, 1].
    pub color: [f32; 3],
}

/// The Gaussians that `frame` adds: one at every pixel with valid depth that nothing covers, or whose observed depth
/// disagrees with the expected one.
pub(crate) fn new_gaussians(
    frame: &RgbdFrame,
    expectation: &Expectation,
    settings: &MemorySettings,
) -> Vec<NewGaussian> {
    let intrinsics = frame.intrinsics();
    // One number for both axes: pixels are square but for rounding.
    let focal = 0.5 * (intrinsics.fx + intrinsics.fy);
    (0..frame.height())
        .into_par_iter()
        .flat_map_iter(|row| {
            (0..frame.width()).filter_map(move |column| {
                let depth = frame.depth()[(column, row)];
                let uncovered = expectation.silhouette[(column, row)] < settings.growth_silhouette;
                let disparity = (depth - expectation.depth[(column, row)]).abs();
                if depth <= 0.0 || !(uncovered || disparity > settings.depth_disparity) {
                    return None;
                }
                let point_camera = intrinsics.unproject(Vec2::new(column as f32, row as f32), depth);
                Some(NewGaussian {
                    pixel: row * frame.width() + column,
                    mean: frame.world_from_camera().to_world(point_camera),
                    scale: depth / focal,
                    color: frame.color()[(column, row)].map(|channel| f32::from(channel) / 255.0),
                })
            })
        })
        .collect()
}

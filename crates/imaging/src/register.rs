//! Warping of depth from one camera into another.

use splatseg_geometry::{Image, Intrinsics, LocalPose};

/// A depth camera, a colour camera and their relative pose.
#[derive(Clone, Copy, Debug)]
pub struct CameraPair {
    /// Camera that measured the depth.
    pub depth: Intrinsics,
    /// Camera to warp into.
    pub color: Intrinsics,
    /// Transform from depth camera to colour camera coordinates.
    pub color_from_depth: LocalPose,
}

/// Moves every measurement (z-depth, metres, `[height, width]` of the depth camera) to the pixel where the colour
/// camera sees it. If several fall on one pixel, the nearest is kept. Pixels without any are 0. Nothing is
/// interpolated.
pub fn register_depth(depth: &Image<f32>, cameras: &CameraPair) -> Image<f32> {
    let (width, height) = (cameras.color.width, cameras.color.height);
    let mut registered: Image<f32> = Image::filled(width, height, 0.0);
    for row in 0..depth.height() {
        for (column, z) in depth.row(row).iter().enumerate().filter(|(_, z)| **z > 0.0) {
            let point_depth = cameras.depth.unproject(glam::Vec2::new(column as f32, row as f32), *z);
            let point = cameras.color_from_depth.to_world(point_depth);
            let Some(pixel) = cameras.color.project(point).map(glam::Vec2::round) else { continue };
            let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width as f32 && pixel.y < height as f32;
            if inside {
                let nearest = &mut registered[(pixel.x as usize, pixel.y as usize)];
                if *nearest == 0.0 || point.z < *nearest {
                    *nearest = point.z;
                }
            }
        }
    }
    registered
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLOR: Intrinsics = Intrinsics { fx: 52.5, fy: 52.5, cx: 32.0, cy: 24.0, width: 64, height: 48 };

    fn beside(offset_m: f32) -> LocalPose {
        LocalPose::from_translation(glam::Vec3::X * -offset_m)
    }

    #[test]
    fn points_land_where_the_colour_camera_sees_them_and_the_nearest_wins() {
        let depth_camera = Intrinsics { fx: 58.5, fy: 58.5, ..COLOR };
        let mut depth = Image::filled(64, 48, 2.0);
        depth[(50, 10)] = 1.0;
        let cameras = CameraPair { depth: depth_camera, color: COLOR, color_from_depth: beside(0.025) };
        let registered = register_depth(&depth, &cameras);
        let point = depth_camera.unproject(glam::Vec2::new(50.0, 10.0), 1.0) - glam::Vec3::X * 0.025;
        let pixel = COLOR.project(point).unwrap().round();
        assert_eq!(registered[(pixel.x as usize, pixel.y as usize)], 1.0);
        assert_eq!(registered[(0, 0)], 0.0, "the depth camera sees less than the colour camera");
        assert!(registered.pixels().iter().all(|z| [0.0, 1.0, 2.0].contains(z)), "measured values only");
    }

    #[test]
    fn depth_is_measured_from_the_colour_camera() {
        let depth = Image::filled(64, 48, 2.0);
        let color_from_depth = LocalPose::from_translation(glam::Vec3::Z * 0.5);
        let registered = register_depth(&depth, &CameraPair { depth: COLOR, color: COLOR, color_from_depth });
        assert_eq!(registered[(32, 24)], 2.5);
    }

    #[test]
    fn the_same_camera_changes_nothing() {
        let depth = Image::from_fn(64, 48, |column, row| (column + row) as f32 * 0.01);
        let cameras = CameraPair { depth: COLOR, color: COLOR, color_from_depth: beside(0.0) };
        assert_eq!(register_depth(&depth, &cameras), depth);
    }
}

//! Rendering at the limits (near and far plane, image borders, minimum alpha), and the accessors of a view.

use glam::{Quat, Vec3};
use splatseg_geometry::{Intrinsics, LocalPose};
use splatseg_render::{Balls, Camera, Gaussians, Shape, Splats, View};

/// A point at depth z in metres appears at column 20 + 32 x / z, row 18 + 32 y / z of 40 × 36 pixels.
fn camera() -> Camera {
    let intrinsics = Intrinsics { fx: 32.0, fy: 32.0, cx: 20.0, cy: 18.0, width: 40, height: 36 };
    Camera::new(intrinsics, &LocalPose::IDENTITY)
}

fn one(mean: [f32; 3], opacity: f32) -> Gaussians {
    let mut gaussians = Gaussians::default();
    gaussians.push(Vec3::from(mean), Quat::IDENTITY, Vec3::splat(0.01), opacity);
    gaussians
}

fn is_projected(gaussians: &Gaussians) -> bool {
    !View::new(gaussians, &camera()).projected().is_empty()
}

#[test]
fn gaussians_on_the_near_and_the_far_plane_are_left_out() {
    let mut camera = camera();
    camera.limits.near_plane = 1.0;
    camera.limits.far_plane = 2.0;
    for (z, expected) in [(0.99, 0), (1.0, 0), (1.01, 1), (1.99, 1), (2.0, 0), (2.01, 0)] {
        assert_eq!(View::new(&one([0.0, 0.0, z], 1.0), &camera).projected().len(), expected, "{z} m");
    }
}

#[test]
fn a_gaussian_of_the_least_opacity_is_blended_where_it_is_densest() {
    let least = camera().limits.min_alpha;
    // At column 20, row 18, in the middle tile.
    let view = View::new(&one([0.0, 0.0, 1.0], least), &camera());
    let found: Vec<(usize, u8, f32)> = (0..9)
        .flat_map(|tile| {
            let weights = &view.weights().tiles()[tile];
            (0..weights.gaussians().len())
                .flat_map(move |column| weights.column(column).map(move |(pixel, weight)| (tile, pixel, weight)))
        })
        .collect();
    assert_eq!(found, [(4, 2 * 16 + 4, least)]);
    assert!(!is_projected(&one([0.5, 0.5, 1.0], least * 0.999)));
}

#[test]
fn gaussians_that_end_at_the_border_are_left_out() {
    // A Gaussian of minimum opacity has a box without extent. The border is half a pixel beyond the outer pixel
    // centres.
    let least = camera().limits.min_alpha;
    let at = |column: f32, row: f32| one([(column - 20.0) / 32.0, (row - 18.0) / 32.0, 1.0], least);
    for (column, row) in [(-0.5, 9.0), (39.5, 9.0), (39.75, 9.0), (9.0, -0.5), (9.0, 35.5), (9.0, 35.75)] {
        assert!(!is_projected(&at(column, row)), "({column}, {row})");
    }
    for (column, row) in [(-0.25, 9.0), (39.25, 9.0), (9.0, -0.25), (9.0, 35.25)] {
        assert!(is_projected(&at(column, row)), "({column}, {row})");
    }
}

#[test]
fn balls_are_opaque_gaussians_of_equal_scales() {
    let mut balls = Balls::default();
    let mut gaussians = Gaussians::default();
    assert!(balls.is_empty() && gaussians.is_empty());
    for (mean, radius) in [([0.1, 0.0, 1.0], 0.05), ([0.0, 0.2, 1.5], 0.1), ([-0.3, 0.1, 2.0], 0.2)] {
        balls.push(Vec3::from(mean), radius);
        gaussians.push(Vec3::from(mean), Quat::from_rotation_x(0.4), Vec3::splat(radius), 1.0);
    }
    assert!(!balls.is_empty() && !gaussians.is_empty());
    assert_eq!((balls.len(), balls.count(), gaussians.len()), (3, 3, 3));
    let (one, other) = (View::new(&balls, &camera()), View::new(&gaussians, &camera()));
    assert!(one.weights().non_zeros() > 300);
    assert_eq!(one.weights(), other.weights());
}

#[test]
fn only_equal_scales_make_a_ball() {
    let mut gaussians = Gaussians::default();
    let turned = Quat::from_rotation_x(0.4);
    for scale in [[1.0, 1.0, 2.0], [2.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 1.0]] {
        gaussians.push(Vec3::Z, turned, Vec3::from(scale), 1.0);
    }
    for index in 0..3 {
        assert_eq!(gaussians.shape(index), Shape::Ellipsoid(gaussians.scales[index], turned));
    }
    assert_eq!(gaussians.shape(3), Shape::Ball(1.0));
}

#[test]
fn a_view_tells_its_sizes_and_what_each_tile_sees() {
    // The last ball, at column 4, row 2, is hidden behind the opaque ones, so it has no weight anywhere.
    let mut balls = Balls::default();
    for z in [2.0, 1.0, 1.5, 3.0] {
        balls.push(Vec3::new(-0.5 * z, -0.5 * z, z), if z == 3.0 { 0.01 } else { 0.5 * z });
    }
    let view = View::new(&balls, &camera());
    let weights = view.weights();
    assert_eq!((weights.width(), weights.height(), weights.tile_columns(), weights.tiles().len()), (40, 36, 3, 9));
    let sizes: Vec<(usize, usize)> = weights.tiles().iter().map(|tile| tile.size()).collect();
    assert_eq!(&sizes[..3], [(16, 16), (16, 16), (8, 16)]);
    assert_eq!(&sizes[6..], [(16, 4), (16, 4), (8, 4)]);
    assert_eq!(weights.tiles()[0].gaussians(), [1, 2, 0]);
    assert_eq!(weights.tiles()[0].depths(), [1.0, 1.5, 2.0]);
    let counted: usize = weights
        .tiles()
        .iter()
        .map(|tile| (0..tile.gaussians().len()).map(|column| tile.column(column).count()).sum::<usize>())
        .sum();
    assert_eq!(weights.non_zeros(), counted);
}

#[test]
#[should_panic(expected = "the image gradient hold")]
fn an_image_gradient_of_another_size_is_refused() {
    let view = View::new(&one([0.0, 0.0, 1.0], 1.0), &camera());
    view.weights().gradient(&[1.0; 40 * 36 + 1], 1, 1);
}

//! Sets of pixels, the blend weights at chosen pixels, and the pixels that new Gaussians affect.

use glam::Vec3;
use splatseg_geometry::{Image, Intrinsics, LocalPose};
use splatseg_render::{Balls, Camera, PixelSet, View};

const SIZE: (usize, usize) = (40, 36);
const TILES: usize = 9;

/// A ball at depth z in metres appears at column 20 + 32 x / z, row 18 + 32 y / z.
fn camera() -> Camera {
    let intrinsics = Intrinsics { fx: 32.0, fy: 32.0, cx: 20.0, cy: 18.0, width: SIZE.0, height: SIZE.1 };
    Camera::new(intrinsics, &LocalPose::IDENTITY)
}

fn balls(entries: &[([f32; 3], f32)]) -> Balls {
    let mut balls = Balls::default();
    for (mean, radius) in entries {
        balls.push(Vec3::from(*mean), *radius);
    }
    balls
}

/// The tile of an image pixel and its number in the tile.
fn place(column: usize, row: usize) -> (usize, u8) {
    (row / 16 * 3 + column / 16, (row % 16 * 16 + column % 16) as u8)
}

#[test]
fn a_pixel_set_holds_what_was_inserted() {
    let (mut thirds, mut low) = (PixelSet::default(), PixelSet::default());
    assert!(thirds.is_empty());
    assert_eq!(thirds.len(), 0);
    for pixel in (0..=255u8).step_by(3) {
        thirds.insert(pixel);
    }
    (0..100).for_each(|pixel| low.insert(pixel));
    let both = thirds.without(&low);
    assert!(!thirds.is_empty());
    assert_eq!((thirds.len(), low.len(), both.len()), (86, 100, 52));
    for pixel in 0..=255u8 {
        assert_eq!(thirds.contains(pixel), pixel % 3 == 0);
        assert_eq!(both.contains(pixel), pixel % 3 == 0 && pixel >= 100);
    }
}

#[test]
fn active_weights_are_those_above_the_minimum_at_chosen_pixels() {
    let scene = balls(&[([0.0, 0.0, 1.0], 0.1), ([0.3, 0.2, 1.5], 0.2), ([-0.4, -0.3, 1.2], 0.05)]);
    let view = View::new(&scene, &camera());
    // A weight equal to the minimum is removed too.
    let minimum = view.weights().tiles()[4].column(0).nth(10).unwrap().1;
    let mut sets = vec![PixelSet::default(); TILES];
    for tile in [0, 4, 5] {
        (0..=255).filter(|pixel| pixel % 5 != 0).for_each(|pixel| sets[tile].insert(pixel));
    }
    let active = view.active_weights(&sets, minimum);
    assert_eq!(active.tiles().iter().map(|tile| tile.tile).collect::<Vec<_>>(), [0, 4, 5]);
    for tile in active.tiles() {
        let all = &view.weights().tiles()[tile.tile];
        let expected: Vec<(u32, u8, f32)> = (0..all.gaussians().len())
            .flat_map(|column| all.column(column).map(move |(pixel, weight)| (all.gaussians()[column], pixel, weight)))
            .filter(|(_, pixel, weight)| sets[tile.tile].contains(*pixel) && *weight > minimum)
            .collect();
        let found: Vec<(u32, u8, f32)> = (0..tile.weights.gaussians().len())
            .flat_map(|column| {
                let gaussian = active.gaussians()[tile.weights.gaussians()[column] as usize];
                tile.weights.column(column).map(move |(pixel, weight)| (gaussian, pixel, weight))
            })
            .collect();
        assert_eq!(found, expected, "tile {}", tile.tile);
        assert!(tile.tile != 4 || !expected.is_empty());
    }
}

/// The pixels that one more ball affects, in the row and the column of its centre.
fn reached(ball: ([f32; 3], f32), alpha: f32, surface: f32) -> (Vec<usize>, Vec<usize>) {
    let known = balls(&[([0.0, 0.0, 5.0], 0.1)]);
    let view = View::new(&known, &camera());
    let all = balls(&[([0.0, 0.0, 5.0], 0.1), ball]);
    let surface = Image::filled(SIZE.0, SIZE.1, surface);
    let sets = view.pixels_touched_since(&all, &surface, alpha);
    assert_eq!(sets.len(), TILES);
    let touched = |column: usize, row: usize| {
        let (tile, pixel) = place(column, row);
        sets[tile].contains(pixel)
    };
    let column = (20.0 + 32.0 * ball.0[0] / ball.0[2]) as usize;
    let row = (18.0 + 32.0 * ball.0[1] / ball.0[2]) as usize;
    (
        (0..SIZE.0).filter(|column| touched(*column, row)).collect(),
        (0..SIZE.1).filter(|row| touched(column, *row)).collect(),
    )
}

#[test]
fn a_new_ball_reaches_the_pixels_where_its_alpha_is_large_enough() {
    // Seen at (24, 14) with a deviation of sqrt(3.2² + 0.3) = 3.25 pixels. Its alpha falls to 0.3 at 1.55 deviations,
    // 5.04 pixels, and to 1/255 at 3.33 deviations, 10.8 pixels.
    let ball = ([0.25, -0.25, 2.0], 0.2);
    assert_eq!(reached(ball, 0.3, f32::INFINITY), ((19..=29).collect(), (9..=19).collect()));
    assert_eq!(reached(ball, 1.0, f32::INFINITY), (vec![24], vec![14]));
    assert_eq!(reached(ball, 1.0 / 255.0, f32::INFINITY), ((14..=34).collect(), (4..=24).collect()));
}

#[test]
fn a_new_ball_reaches_only_surfaces_behind_it() {
    let ball = ([0.25, -0.25, 2.0], 0.2);
    let nothing = (Vec::new(), Vec::new());
    assert_eq!(reached(ball, 0.3, 2.0), nothing);
    assert_eq!(reached(ball, 0.3, 1.9), nothing);
    assert_ne!(reached(ball, 0.3, 2.1), nothing);
}

#[test]
fn a_ball_that_is_cut_by_the_border_reaches_the_pixels_inside() {
    // Seen at (2, 18) and (38, 18).
    assert_eq!(reached(([-0.5625, 0.0, 1.0], 0.1), 0.3, f32::INFINITY).0, (0..=7).collect::<Vec<_>>());
    assert_eq!(reached(([0.5625, 0.0, 1.0], 0.1), 0.3, f32::INFINITY).0, (33..40).collect::<Vec<_>>());
}

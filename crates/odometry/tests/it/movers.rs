//! A board that slides through the view must not drag the camera along.

use crate::scene::{Board, corner, error, path, render_with};
use glam::{Vec2, Vec3};
use splatseg_geometry::{Image, Pose};
use splatseg_odometry::{Odometry, PoseState};

/// Largest error of the camera's position, metres, over 60 frames with a board that covers about 30 % of the view and
/// moves by `step` metres per frame until frame `stop`. `segments` makes the segments of a frame from the board's mask.
fn largest_error(step: Vec3, stop: usize, camera: fn(f64) -> Pose, segments: fn(&Image<u32>) -> Image<u32>) -> f64 {
    let mut odometry = Odometry::new();
    let mut largest = 0.0f64;
    for number in 0..60 {
        let center = Vec3::new(0.1, 0.1, 1.0) + step * number.min(stop) as f32;
        let truth = camera(number as f64);
        let (frame, board) = render_with(&corner(), &[Board { center, half: Vec2::new(0.3, 0.215) }], &truth);
        let found = odometry.track(&frame, &camera(0.0), None);
        // As in use: the method tells the segments once the frame has been tracked.
        odometry.set_segments(&segments(&board));
        assert_eq!(found.state, PoseState::Tracked, "frame {number}");
        largest = largest.max(error(&found.world_from_camera, &truth).0);
    }
    largest
}

/// The board and everything else.
fn two(board: &Image<u32>) -> Image<u32> {
    board.map(|board| 1 + board)
}

/// The board and nine parts of the rest.
fn ten(board: &Image<u32>) -> Image<u32> {
    let (width, height) = board.size();
    Image::from_fn(width, height, |column, row| match board[(column, row)] {
        0 => (1 + 3 * column / width + 3 * (3 * row / height)) as u32,
        _ => 20,
    })
}

fn still(_: f64) -> Pose {
    Pose::IDENTITY
}

/// Slow slides: without segments they drag the camera along by up to 39 cm.
const STEPS: [Vec3; 4] =
    [Vec3::new(0.002, 0.0, 0.0), Vec3::new(-0.004, 0.0, 0.0), Vec3::new(0.0, 0.002, 0.0), Vec3::new(0.0, 0.0, 0.002)];

#[test]
fn a_sliding_board_does_not_drag_a_moving_camera() {
    for step in STEPS {
        let error = largest_error(step, 60, path, ten);
        assert!(error < 0.008, "{step}: {error} m");
    }
}

#[test]
fn a_sliding_board_does_not_drag_a_resting_camera() {
    for step in STEPS {
        let error = largest_error(step, 60, still, ten);
        assert!(error < 0.008, "{step}: {error} m");
    }
}

#[test]
fn one_segment_for_all_that_stands_still_is_enough() {
    for step in STEPS {
        let error = largest_error(step, 60, path, two);
        assert!(error < 0.008, "{step}: {error} m");
    }
}

#[test]
fn a_board_that_stops_or_stands_still_does_no_harm() {
    for stop in [0, 20] {
        let error = largest_error(STEPS[0], stop, path, ten);
        assert!(error < 0.008, "stopped after {stop}: {error} m");
    }
}

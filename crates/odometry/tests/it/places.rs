//! Places where depth or image say little, and cameras that see nothing for a while.

use crate::scene::{CAMERA, Plane, Texture, corner, corridor, error, path, render, wall};
use glam::DVec3;
use splatseg_geometry::{CameraFrame, Image, Pose};
use splatseg_odometry::{CameraPose, Odometry, PoseState};

/// Tracks `frames` frames of a path and returns the poses.
fn track(planes: &[Plane], frames: usize, path: impl Fn(f64) -> Pose) -> Vec<CameraPose> {
    let mut odometry = Odometry::new();
    let frame = |number: usize| render(planes, &path(number as f64));
    (0..frames).map(|number| odometry.track(&frame(number), &path(0.0), None)).collect()
}

/// Largest errors of tracked poses: metres, radians.
fn worst(found: &[CameraPose], path: impl Fn(f64) -> Pose) -> (f64, f64) {
    found.iter().enumerate().fold((0.0f64, 0.0f64), |worst, (number, pose)| {
        assert_eq!(pose.state, PoseState::Tracked, "frame {number}");
        let error = error(&pose.world_from_camera, &path(number as f64));
        (worst.0.max(error.0), worst.1.max(error.1))
    })
}

/// Largest motion between consecutive poses, metres.
fn largest_step(found: &[CameraPose]) -> f64 {
    let step = |pair: &[CameraPose]| error(&pair[1].world_from_camera, &pair[0].world_from_camera).0;
    found.windows(2).map(step).fold(0.0, f64::max)
}

#[test]
fn a_textured_corner_is_followed() {
    let (metres, radians) = worst(&track(&corner(), 60, path), path);
    assert!(metres < 0.004 && radians < 0.002, "{metres} m, {radians} rad");
}

#[test]
fn the_image_follows_a_camera_along_a_textured_wall() {
    let (metres, radians) = worst(&track(&wall(Texture::Blotches), 60, path), path);
    assert!(metres < 0.006 && radians < 0.004, "{metres} m, {radians} rad");
}

#[test]
fn the_image_follows_a_camera_in_the_dark() {
    // Of 255 steps of brightness, these images have ten.
    let dark = |frame: CameraFrame<'static>| {
        let color = frame.color().map(|color| color.map(|value| (f32::from(value) * 0.05).round() as u8));
        frame_of(color, frame.depth().clone().into_owned())
    };
    let planes = wall(Texture::Blotches);
    let mut odometry = Odometry::new();
    let found: Vec<CameraPose> = (0..60)
        .map(|number| odometry.track(&dark(render(&planes, &path(f64::from(number)))), &path(0.0), None))
        .collect();
    assert!(found[1..].iter().all(|pose| pose.quality.unwrap().uses_image));
    let (metres, radians) = worst(&found, path);
    assert!(metres < 0.012 && radians < 0.008, "{metres} m, {radians} rad");
}

#[test]
fn along_a_wall_without_texture_the_camera_comes_to_rest() {
    let found = track(&wall(Texture::Flat), 60, path);
    // The distance from the wall and two rotations are measured; motion along the wall is not.
    let normal = wall(Texture::Flat)[0].normal.as_dvec3();
    for (number, pose) in found.iter().enumerate() {
        assert_eq!(pose.state, PoseState::Tracked, "frame {number}");
        let away = pose.world_from_camera.translation() - path(number as f64).translation();
        assert!(normal.dot(away).abs() < 0.004, "frame {number}: {away}");
    }
    assert!(largest_step(&found) < 0.02);
    assert!(found.last().unwrap().quality.unwrap().position_deviation > 0.01, "it is known that it is not known");
}

#[test]
fn a_corridor_without_texture_keeps_its_walls_in_place() {
    let forward = |time: f64| Pose::from_translation(DVec3::new(0.02 * (0.1 * time).sin(), 0.0, 0.01 * time));
    let found = track(&corridor(Texture::Flat), 60, forward);
    for (number, pose) in found.iter().enumerate() {
        let away = pose.world_from_camera.translation() - forward(number as f64).translation();
        // Walls, floor and ceiling come into view 2 m and more away, where the sensor's deviation is above 6 mm.
        assert!(away.x.abs() < 0.012 && away.y.abs() < 0.012, "frame {number}: {away}");
    }
    assert!(largest_step(&found) < 0.03);
}

#[test]
fn a_textured_corridor_is_followed() {
    let forward = |time: f64| Pose::from_translation(DVec3::new(0.02 * (0.1 * time).sin(), 0.0, 0.01 * time));
    let (metres, _) = worst(&track(&corridor(Texture::Blotches), 60, forward), forward);
    assert!(metres < 0.01, "{metres} m");
}

/// Tracks the corner; `change` damages frames 20 to 49. Returns the poses.
fn track_damaged(change: impl Fn(CameraFrame<'static>) -> CameraFrame<'static>) -> Vec<CameraPose> {
    // The camera stays about where it was while it sees nothing.
    let time = |number: usize| if number < 20 { number } else { 20 + number.saturating_sub(50) } as f64;
    let mut odometry = Odometry::new();
    let poses: Vec<CameraPose> = (0..80)
        .map(|number| {
            let frame = render(&corner(), &path(time(number)));
            let frame = if (20..50).contains(&number) { change(frame) } else { frame };
            odometry.track(&frame, &path(0.0), None)
        })
        .collect();
    for (number, pose) in poses.iter().enumerate().filter(|(_, pose)| pose.state == PoseState::Tracked) {
        let (metres, radians) = error(&pose.world_from_camera, &path(time(number)));
        assert!(metres < 0.01 && radians < 0.005, "frame {number}: {metres} m, {radians} rad");
    }
    assert!(poses[51..].iter().all(|pose| pose.state == PoseState::Tracked), "tracking did not resume");
    poses
}

fn frame_of(color: Image<[u8; 3]>, depth: Image<f32>) -> CameraFrame<'static> {
    CameraFrame::new("frame", color, depth, CAMERA).unwrap()
}

fn black() -> Image<[u8; 3]> {
    Image::filled(CAMERA.width, CAMERA.height, [0; 3])
}

#[test]
fn in_the_dark_depth_holds_the_camera() {
    let poses = track_damaged(|frame| frame_of(black(), frame.depth().clone().into_owned()));
    assert!(poses.iter().all(|pose| pose.state == PoseState::Tracked));
    let says_so = |pose: &CameraPose| !pose.quality.unwrap().uses_image;
    assert!(poses[20..50].iter().all(says_so) && !poses[1..20].iter().any(says_so));
}

#[test]
fn without_depth_the_image_holds_the_camera() {
    let none = Image::filled(CAMERA.width, CAMERA.height, 0.0);
    let poses = track_damaged(|frame| frame_of(frame.color().clone().into_owned(), none.clone()));
    assert!(poses.iter().all(|pose| pose.state == PoseState::Tracked));
}

#[test]
fn behind_a_covered_lens_tracking_is_lost_and_then_resumes() {
    let poses = track_damaged(|_| frame_of(black(), Image::filled(CAMERA.width, CAMERA.height, 0.0)));
    assert!(poses[20..50].iter().all(|pose| pose.state == PoseState::Lost), "{:?}", poses[30].quality);
    assert!(poses[..20].iter().all(|pose| pose.state == PoseState::Tracked));
}

#[test]
fn another_place_is_not_taken_for_the_last_one() {
    let mut odometry = Odometry::new();
    for number in 0..10 {
        odometry.track(&render(&corner(), &path(f64::from(number))), &path(0.0), None);
    }
    let elsewhere = render(&corridor(Texture::Blotches), &Pose::IDENTITY);
    for _ in 0..5 {
        assert_eq!(odometry.track(&elsewhere, &path(0.0), None).state, PoseState::Lost);
    }
    let back = odometry.track(&render(&corner(), &path(12.0)), &path(0.0), None);
    assert_eq!(back.state, PoseState::Tracked);
    assert!(error(&back.world_from_camera, &path(12.0)).0 < 0.005);
}

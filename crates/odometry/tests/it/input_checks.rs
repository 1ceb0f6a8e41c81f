//! Input that contradicts what the frames show is told, and right input is not.

use crate::scene::{corner, render};
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, Scene, open_scene};
use splatseg_geometry::{CameraAxes, CameraFrame, Image, Intrinsics, Pose, PoseFormat};
use splatseg_odometry::{DoubtKind, InputDoubt, PoseInput, PoseMode, PoseSource, TrackedPoses};
use splatseg_test_scenes::{room, shared};
use std::path::Path;

/// A frame with its true pose.
type Posed = (CameraFrame<'static>, Pose);

/// Frames of the synthetic room at the speed of a hand-held camera.
fn room_frames(frames: usize) -> Vec<Posed> {
    let scene = room(&format!("synthetic:frames={frames},seed=2,speed=0.15"));
    let frame = |index| {
        let frame = scene.read_frame(index).unwrap();
        let pose = *frame.world_from_camera();
        (frame.into_camera_frame(), pose)
    };
    (0..frames).map(frame).collect()
}

/// Frames of a camera that moves sideways before a corner.
fn sideways(frames: usize) -> Vec<Posed> {
    let frame = |index: usize| {
        let along = index as f64;
        let turn =
            glam::DQuat::from_rotation_y(0.004 * along) * glam::DQuat::from_rotation_x(0.1 * (0.3 * along).sin());
        let position = glam::DVec3::new(-0.4 + 0.03 * along, 0.1 * (0.2 * along).sin(), 0.0);
        let pose = Pose::from_quaternion(position, turn).unwrap();
        (render(&corner(), &pose), pose)
    };
    (0..frames).map(frame).collect()
}

/// All doubts about frames whose poses are read in a certain way.
fn doubts_with(frames: &[Posed], mut poses: TrackedPoses) -> Vec<InputDoubt> {
    let mut doubts = Vec::new();
    for (frame, pose) in frames {
        doubts.extend(poses.pose(frame, PoseInput::new(0, Some(pose))).unwrap().doubts);
    }
    doubts.extend(poses.finish());
    doubts
}

fn doubts(frames: &[Posed]) -> Vec<InputDoubt> {
    doubts_with(frames, TrackedPoses::new(PoseMode::Auto))
}

/// The only doubt about frames.
fn doubt(frames: &[Posed], kind: DoubtKind) -> String {
    let mut doubts = doubts(frames);
    assert_eq!(doubts.iter().map(|doubt| doubt.kind).collect::<Vec<_>>(), [kind], "{doubts:?}");
    doubts.remove(0).text
}

/// The same frames with poses as another program would state them.
fn stated(frames: &[Posed], format: PoseFormat) -> Vec<Posed> {
    frames.iter().map(|(frame, pose)| (frame.clone(), format.stated(pose))).collect()
}

fn with_depth(frame: &CameraFrame<'_>, depth: Image<f32>) -> CameraFrame<'static> {
    CameraFrame::new(frame.name(), frame.color().clone().into_owned(), depth, *frame.intrinsics()).unwrap()
}

fn with_depth_of(frames: &[Posed], change: impl Fn(usize, &Image<f32>) -> Image<f32>) -> Vec<Posed> {
    let depth = |index: usize| frames[index].0.depth().clone().into_owned();
    let changed = |(index, (frame, pose)): (usize, &Posed)| (with_depth(frame, change(index, &depth(index))), *pose);
    frames.iter().enumerate().map(changed).collect()
}

#[test]
fn right_input_is_not_doubted() {
    assert_eq!(doubts(&room_frames(80)), []);
}

#[test]
fn every_convention_is_recognised() {
    let frames = room_frames(60);
    for (is_inverse, axes, w_first) in [
        (true, CameraAxes::Optical, false),
        (false, CameraAxes::OpenGl, false),
        (true, CameraAxes::OpenGl, false),
        (false, CameraAxes::Forward, false),
        (true, CameraAxes::Forward, false),
        (false, CameraAxes::ForwardDown, false),
        (false, CameraAxes::Optical, true),
        (true, CameraAxes::OpenGl, true),
    ] {
        let format = PoseFormat { is_inverse, axes, w_first, ..PoseFormat::default() };
        let frames = stated(&frames, format);
        let text = doubt(&frames, DoubtKind::Poses);
        let convention = format!("dataset.pose_convention = {}", format.convention());
        let has_convention = text.contains(&convention) || format.convention() == "camera-to-world";
        assert!(has_convention && text.contains("quaternion_order = wxyz") == w_first, "{format:?}: {text}");
        // Read as the warning says, they are right.
        let read: Vec<Posed> = frames.iter().map(|(frame, pose)| (frame.clone(), format.pose(pose))).collect();
        assert_eq!(doubts_with(&read, TrackedPoses::new(PoseMode::Auto).with_pose_format(format)), []);
    }
}

#[test]
fn a_wrong_setting_is_told_like_a_wrong_recording() {
    let format = PoseFormat { axes: CameraAxes::OpenGl, ..PoseFormat::default() };
    let read: Vec<Posed> = room_frames(60).iter().map(|(frame, pose)| (frame.clone(), format.pose(pose))).collect();
    let doubts = doubts_with(&read, TrackedPoses::new(PoseMode::Auto).with_pose_format(format));
    assert!(doubts[0].text.contains("dataset.pose_convention = camera-to-world"), "{doubts:?}");
}

#[test]
fn units_of_positions_and_depth_are_told_apart() {
    let frames = sideways(26);
    assert_eq!(doubts(&frames), []);
    for (scale, name) in [(0.01, "centimetres"), (0.001, "millimetres")] {
        let text = doubt(&stated(&frames, PoseFormat { scale, ..PoseFormat::default() }), DoubtKind::Poses);
        assert!(text.contains(name) && text.contains(&format!("dataset.pose_scale = {scale}")), "{text}");
    }
    for (factor, remedy) in [(0.2, "1000 instead of 5000"), (5.0, "5000 instead of 1000")] {
        let frames = with_depth_of(&frames, |_, depth| depth.map(|depth| depth * factor));
        let text = doubt(&frames, DoubtKind::DepthUnit);
        assert!(text.contains("dataset.depth_scale") && text.contains(remedy), "{text}");
    }
    let millimetres = with_depth_of(&frames, |_, depth| depth.map(|depth| depth * 1000.0));
    let text = doubt(&millimetres, DoubtKind::DepthUnit);
    assert!(text.contains("1000 times its value, e.g. 1000 instead of 1"), "{text}");
}

#[test]
fn an_unusual_unit_may_be_a_wrong_focal_length() {
    let frames = with_depth_of(&sideways(26), |_, depth| depth.map(|depth| depth * 0.45));
    let text = doubt(&frames, DoubtKind::Poses);
    assert!(text.contains("a wrong focal length looks alike, and --fx gives another one"), "{text}");
}

#[test]
fn positions_that_never_change_are_told() {
    let without_positions = |frames: &[Posed]| -> Vec<Posed> {
        let still = |pose: &Pose| {
            let turn = glam::DQuat::from_mat3(&pose.rotation());
            Pose::from_quaternion(glam::DVec3::ZERO, turn).unwrap()
        };
        frames.iter().map(|(frame, pose)| (frame.clone(), still(pose))).collect()
    };
    let text = doubt(&without_positions(&sideways(40)), DoubtKind::Poses);
    assert!(
        text.starts_with("the positions of the given poses never change, but ") && text.contains("--poses track"),
        "{text}"
    );
    // A camera on a tripod.
    let turning = |index: usize| {
        let pose =
            Pose::from_quaternion(glam::DVec3::ZERO, glam::DQuat::from_rotation_y(0.03 * index as f64 - 0.4)).unwrap();
        (render(&corner(), &pose), pose)
    };
    assert_eq!(doubts(&(0..26).map(turning).collect::<Vec<_>>()), []);
}

#[test]
fn poses_that_stand_still_or_are_another_path_are_told() {
    let frames = room_frames(80);
    let still: Vec<Posed> = frames.iter().map(|(frame, _)| (frame.clone(), Pose::IDENTITY)).collect();
    assert!(doubt(&still, DoubtKind::Poses).contains("stand still"));
}

#[test]
fn a_camera_that_stands_still_says_nothing() {
    let (frame, pose) = room_frames(1).remove(0);
    let still: Vec<Posed> = (0..40).map(|_| (frame.clone(), pose)).collect();
    assert_eq!(doubts(&stated(&still, PoseFormat { is_inverse: true, ..PoseFormat::default() })), []);
}

#[test]
fn depth_in_another_place_is_told() {
    let frames = room_frames(30);
    let shifted = with_depth_of(&frames, |_, depth| {
        Image::from_fn(depth.width(), depth.height(), |column, row| {
            column.checked_sub(depth.width() / 40).map_or(0.0, |from| depth[(from, row)])
        })
    });
    let text = doubt(&shifted, DoubtKind::Registration);
    assert!(text.contains("2.5 % of the width farther left") && text.contains("dataset.register_depth"), "{text}");
    // The depth of a camera with a longer focal length.
    let larger = with_depth_of(&frames, |_, depth| {
        let (centre_x, centre_y) = (depth.width() as f32 * 0.5 - 0.5, depth.height() as f32 * 0.5 - 0.5);
        let from = |place: usize, centre: f32| ((place as f32 - centre) / 1.11 + centre).round() as usize;
        Image::from_fn(depth.width(), depth.height(), |column, row| {
            depth[(from(column, centre_x), from(row, centre_y))]
        })
    });
    assert!(doubt(&larger, DoubtKind::Registration).contains("times as large"));
}

#[test]
fn late_depth_is_told_with_its_delay() {
    let frames = room_frames(50);
    for late in [1, 2, 3] {
        let depths: Vec<Image<f32>> = frames.iter().map(|(frame, _)| frame.depth().clone().into_owned()).collect();
        let delayed = with_depth_of(&frames, |index, _| depths[index.saturating_sub(late)].clone());
        let text = doubt(&delayed[late..], DoubtKind::Delay);
        assert!(text.starts_with("depth seems to be older than colour by about"), "{text}");
        let found: f64 = text.split_whitespace().nth(9).unwrap().parse().unwrap();
        assert!((found - late as f64).abs() < 0.35, "{late}: {text}");
    }
}

#[test]
fn odd_frames_do_not_panic() {
    let camera = |width, height| Intrinsics { fx: 10.0, fy: 10.0, cx: 0.5, cy: 0.5, width, height };
    for (width, height, depth) in [(1, 1, 1.0), (3, 500, 2.0), (64, 48, 0.0), (64, 48, f32::MAX), (700, 2, 1e-30)] {
        let color = Image::from_fn(width, height, |column, row| [(column * 37 + row * 91) as u8; 3]);
        let frame = CameraFrame::new("odd", color, Image::filled(width, height, depth), camera(width, height)).unwrap();
        let far = Pose::from_translation(glam::DVec3::splat(1e30));
        let frames: Vec<Posed> =
            (0..12).map(|index| (frame.clone(), if index % 2 == 0 { Pose::IDENTITY } else { far })).collect();
        doubts(&frames);
    }
    // The size changes.
    let mut poses = TrackedPoses::new(PoseMode::Given);
    for side in [64, 32, 128, 31] {
        let color = Image::from_fn(side, side, |column, row| [(column * 37 + row * 91) as u8; 3]);
        let depth = Image::from_fn(side, side, |column, _| if column % 9 < 5 { 1.0 } else { 2.0 });
        let frame = CameraFrame::new("odd", color, depth, camera(side, side)).unwrap();
        let given = Pose::from_translation(glam::DVec3::X * side as f64);
        poses.pose(&frame, PoseInput::new(0, Some(&given))).unwrap();
    }
}

fn recorded(path: &Path, frames: usize, stride: usize) -> Vec<Posed> {
    let settings = DatasetSettings::default().with(|settings| {
        settings.max_frames = Some(frames);
        settings.stride = stride;
        settings.resize = Some("320x240".parse().unwrap());
    });
    let stream = FrameStream::open(open_scene(path, &settings).unwrap(), &settings, GroundTruth::Skip).unwrap();
    stream.map(|frame| frame.unwrap()).map(|frame| (frame.frame, frame.world_from_camera.unwrap())).collect()
}

#[test]
fn recordings_with_right_input_are_not_doubted() {
    for name in ["kitchen-dev", "redkitchen_dense", "rooms/dev-a", "rooms/dev-b", "hololens-dev", "tum-rpy-dev"] {
        let Some(path) = shared(&format!("data/{name}"), "recordings_with_right_input_are_not_doubted") else { return };
        assert_eq!(doubts(&recorded(&path, 40, 1)), [], "{name}");
    }
}

#[test]
fn conventions_of_a_recording_are_recognised() {
    let Some(path) = shared("data/redkitchen_dense", "conventions_of_a_recording_are_recognised") else { return };
    let frames = recorded(&path, 24, 6);
    for format in [
        PoseFormat { is_inverse: true, ..PoseFormat::default() },
        PoseFormat { axes: CameraAxes::OpenGl, ..PoseFormat::default() },
        PoseFormat { axes: CameraAxes::Forward, ..PoseFormat::default() },
    ] {
        let text = doubt(&stated(&frames, format), DoubtKind::Poses);
        assert!(text.contains(&format!("dataset.pose_convention = {}", format.convention())), "{text}");
    }
    let text = doubt(&stated(&frames, PoseFormat { w_first: true, ..PoseFormat::default() }), DoubtKind::Poses);
    assert!(text.contains("dataset.quaternion_order = wxyz"), "{text}");
}

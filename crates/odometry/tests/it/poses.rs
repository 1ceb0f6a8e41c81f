//! Poses that come with the frames, tracked ones, and both.

use crate::scene;
use crate::scene::{corner, error, path, render};
use glam::DVec3;
use splatseg_files::StateBlock;
use splatseg_geometry::{CameraFrame, Pose, SegmentMap};
use splatseg_odometry::{
    CameraPose, DoubtKind, GivenPoses, MethodFindings, Odometry, PoseInput, PoseMode, PoseSource, PoseState,
    StateScope, TrackedPoses,
};
use std::collections::{BTreeMap, BTreeSet};

fn pose(source: &mut dyn PoseSource, number: usize, given: Option<Pose>) -> CameraPose {
    source.pose(&render(&corner(), &path(number as f64)), PoseInput::new(number, given.as_ref())).unwrap().pose
}

#[test]
fn frames_without_a_pose_are_tracked_from_the_last_given_one() {
    let mut source = TrackedPoses::new(PoseMode::Auto);
    let world = Pose::from_translation(DVec3::new(100.0, 200.0, 3.0));
    for number in 0..30 {
        let truth = world * path(number as f64);
        let is_given = !(10..20).contains(&number);
        let found = pose(&mut source, number, is_given.then_some(truth));
        assert_eq!(found.state, if is_given { PoseState::Given } else { PoseState::Tracked });
        assert!(error(&found.world_from_camera, &truth).0 < 0.004, "frame {number}");
    }
}

#[test]
fn keyframes_of_frames_without_a_pose_are_linked_to_the_right_ones() {
    let mut source = TrackedPoses::new(PoseMode::Auto);
    // Two gaps, each longer than a keyframe lasts.
    for number in 0..150 {
        let is_given = !(40..80).contains(&number) && !(100..140).contains(&number);
        pose(&mut source, number, is_given.then_some(path(number as f64)));
    }
    let block = StateBlock::from_bytes(&source.save(StateScope::Map).unwrap()).unwrap();
    let poses: Vec<f64> = block.get("world_from_camera", &[4, 4]).unwrap();
    let poses: Vec<Pose> =
        poses.chunks_exact(16).map(|rows| Pose::from_row_major(rows.try_into().unwrap()).unwrap()).collect();
    let ids: Vec<u32> = block.get("id", &[]).unwrap();
    let world_from: BTreeMap<u32, Pose> = ids.into_iter().zip(poses).collect();
    let edges: Vec<[u32; 2]> = block.get_tuples("edges").unwrap();
    let measured: Vec<f64> = block.get("edge_pose", &[4, 4]).unwrap();
    for ([from, to], measured) in edges.iter().zip(measured.chunks_exact(16)) {
        let measured = Pose::from_row_major(measured.try_into().unwrap()).unwrap();
        let (metres, radians) = error(&measured, &(world_from[from].inverse() * world_from[to]));
        assert!(metres < 0.01 && radians < 0.01, "{from} to {to}: {metres} m, {radians} rad");
    }
    let linked: BTreeSet<u32> = edges.iter().map(|[_, to]| *to).collect();
    assert_eq!(linked.len() + 1, world_from.len(), "each keyframe but the first is linked to one before it");
}

#[test]
fn without_any_pose_the_first_frame_is_the_origin() {
    let mut source = TrackedPoses::new(PoseMode::Auto);
    for number in 0..10 {
        let found = pose(&mut source, number, None);
        let truth = path(0.0).inverse() * path(number as f64);
        assert_eq!(found.state, PoseState::Tracked);
        assert!(error(&found.world_from_camera, &truth).0 < 0.003, "frame {number}");
    }
}

#[test]
fn given_poses_only_refuse_frames_without_one() {
    let frame = render(&corner(), &path(0.0));
    let sources: [Box<dyn PoseSource>; 2] = [Box::new(GivenPoses), Box::new(TrackedPoses::new(PoseMode::Given))];
    for mut source in sources {
        let given = source.pose(&frame, PoseInput::new(0, Some(&path(3.0)))).unwrap();
        assert_eq!(given.pose, CameraPose::given(path(3.0)));
        assert_eq!(source.pose(&frame, PoseInput::new(1, None)).unwrap_err().to_string(), "frame frame has no pose");
    }
}

#[test]
fn drifting_poses_are_refined() {
    // The odometry turns 0.3° and slides 3 mm too much with every frame.
    let slip = Pose::from_quaternion(DVec3::new(0.003, 0.0, 0.0), glam::DQuat::from_rotation_y(0.005)).unwrap();
    let mut source = TrackedPoses::new(PoseMode::Refine);
    let mut odometry = path(0.0);
    for number in 0..40 {
        if number > 0 {
            odometry = odometry * (path(number as f64 - 1.0).inverse() * path(number as f64)) * slip;
        }
        let found = pose(&mut source, number, Some(odometry));
        let (metres, radians) = error(&found.world_from_camera, &path(number as f64));
        assert!(metres < 0.006 && radians < 0.004, "frame {number}: {metres} m, {radians} rad");
    }
    assert!(error(&odometry, &path(39.0)).0 > 0.05);
}

#[test]
fn where_tracking_fails_refined_poses_move_as_the_given_ones() {
    let mut source = TrackedPoses::new(PoseMode::Refine);
    for number in 0..30 {
        let frame = match number {
            10..20 => {
                let frame = render(&corner(), &path(0.0));
                let (color, depth) = (frame.color().map(|_| [0; 3]), frame.depth().map(|_| 0.0));
                CameraFrame::new("dark", color, depth, scene::CAMERA).unwrap()
            }
            _ => render(&corner(), &path(f64::from(number))),
        };
        let given = path(f64::from(number));
        let found = source.pose(&frame, PoseInput::new(0, Some(&given))).unwrap().pose;
        assert_ne!(found.state, PoseState::Lost, "frame {number}");
        assert!(error(&found.world_from_camera, &path(f64::from(number))).0 < 0.01, "frame {number}");
    }
}

/// Poses of frames 0 to 39; after frame `stop` the source is saved and restored.
fn poses_with_stop(mode: PoseMode, stop: Option<usize>) -> Vec<CameraPose> {
    let mut source = TrackedPoses::new(mode);
    let mut poses = Vec::new();
    for number in 0..40 {
        let given = (mode == PoseMode::Refine || number < 15).then(|| path(number as f64 * 1.1));
        poses.push(pose(&mut source, number, given));
        let segments = SegmentMap::from_fn(160, 120, |column, row| 1 + (column / 40 + row / 40) as u32);
        source.receive(MethodFindings { segments: Some(&segments), ..MethodFindings::default() });
        if stop == Some(number) {
            let state = source.save(StateScope::Run).unwrap();
            source = TrackedPoses::new(mode);
            source.restore(StateScope::Run, &state).unwrap();
        }
    }
    poses
}

#[test]
fn a_restored_source_continues_with_the_same_poses() {
    for mode in [PoseMode::Auto, PoseMode::Track, PoseMode::Refine] {
        let expected = poses_with_stop(mode, None);
        for stop in [0, 14, 20, 33] {
            assert_eq!(poses_with_stop(mode, Some(stop)), expected, "{mode:?}, stopped after {stop}");
        }
    }
}

#[test]
fn damaged_states_are_refused() {
    let mut source = TrackedPoses::new(PoseMode::Track);
    pose(&mut source, 0, None);
    let state = source.save(StateScope::Run).unwrap();
    // The arrays of a state have fixed places, so a value is replaced by one of the same length.
    let changes =
        [("\"active\":0", "\"active\":1"), ("\"fx\":150.0", "\"fx\":-50.0"), ("\"width\":160", "\"width\":161")];
    for (from, to) in changes {
        let place = state.windows(from.len()).position(|bytes| bytes == from.as_bytes()).expect(from);
        let mut damaged = state.clone();
        damaged[place..place + from.len()].copy_from_slice(to.as_bytes());
        let error = source.restore(StateScope::Run, &damaged).unwrap_err();
        assert!(error.to_string().starts_with("the saved state of the camera's poses cannot be used: "), "{error}");
    }
    assert!(source.restore(StateScope::Run, b"{}").is_err());
    assert!(GivenPoses.restore(StateScope::Run, &state).is_err());
    // Keyframes are of no use to poses that come with the frames.
    assert!(GivenPoses.restore(StateScope::Map, b"{}").is_ok() && GivenPoses.save(StateScope::Map).is_none());
}

#[test]
fn hints_about_the_images_are_told_at_the_end() {
    let mut source = TrackedPoses::new(PoseMode::Track);
    for number in 0..12 {
        let frame = render(&corner(), &path(number as f64));
        let color = frame.color().map(|_| [0; 3]);
        let dark = CameraFrame::new("dark", color, frame.depth().clone().into_owned(), scene::CAMERA).unwrap();
        let update = source.pose(&dark, PoseInput::new(number, None)).unwrap();
        assert_eq!((update.pose.state, update.doubts), (PoseState::Tracked, vec![]), "frame {number}");
    }
    let told = source.finish();
    assert_eq!(told.iter().map(|doubt| doubt.kind).collect::<Vec<_>>(), [DoubtKind::Exposure], "{told:?}");
    assert!(!told[0].kind.is_contradiction() && told[0].text.contains("in 11 of 11 tracked frames"), "{told:?}");
}

#[test]
fn poses_do_not_depend_on_the_number_of_threads() {
    let poses = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut odometry = Odometry::new();
            let frames = (0..12).map(|number| render(&corner(), &path(f64::from(number))));
            frames.map(|frame| odometry.track(&frame, &Pose::IDENTITY, None)).collect::<Vec<_>>()
        })
    };
    assert_eq!(poses(1), poses(3));
}

#[test]
fn segments_of_a_frame_that_became_no_keyframe_belong_to_none() {
    let states = [false, true].map(|is_told| {
        let mut source = TrackedPoses::new(PoseMode::Track);
        // The segmenter has failed in the first frame, which became a keyframe.
        pose(&mut source, 0, None);
        pose(&mut source, 1, None);
        let segments = SegmentMap::filled(scene::CAMERA.width, scene::CAMERA.height, 3);
        if is_told {
            source.receive(MethodFindings { remapped: &[], segments: Some(&segments) });
        }
        source.save(StateScope::Run).unwrap()
    });
    assert!(states[0] == states[1]);
}

//! Replica scenes in the layout of NICE-SLAM, whole and damaged.

use crate::support;
use crate::support::recording::*;
use crate::support::warnings::with_warnings;
use splatseg_dataset::{DatasetError, DatasetSettings, ReplicaScene, Scene, open_scene};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

fn room() -> &'static [(RgbdFrame<'static>, SegmentMap)] {
    static ROOM: OnceLock<Vec<(RgbdFrame<'static>, SegmentMap)>> = OnceLock::new();
    ROOM.get_or_init(|| recording("synthetic:frames=3,width=60,height=34,seed=2"))
}

/// Writes the room's frames with these numbers, and all the poses.
fn write_replica(folder: &Path, numbers: &[usize]) {
    fs::create_dir_all(folder.join("results")).unwrap();
    let mut trajectory = String::new();
    for (frame, _) in room() {
        let row: Vec<String> =
            frame.world_from_camera().to_row_major().iter().map(|entry| format!("{entry:.18e}")).collect();
        trajectory += &format!("{}\n", row.join(" "));
    }
    fs::write(folder.join("traj.txt"), trajectory).unwrap();
    for (number, (frame, _)) in numbers.iter().zip(room()) {
        fs::write(folder.join(format!("results/frame{number:06}.jpg")), jpeg_bytes(frame.color())).unwrap();
        let depth = png_depth_bytes(frame.depth(), 6553.5);
        fs::write(folder.join(format!("results/depth{number:06}.png")), depth).unwrap();
    }
}

fn open(folder: &Path) -> std::sync::Arc<dyn Scene> {
    open_scene(folder, &DatasetSettings::default()).unwrap()
}

#[test]
fn scenes_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[0, 1, 2]);
    let scene = open(folder.path());
    assert_eq!((scene.frame_count(), scene.frame_name(2)), (3, "frame000002".to_owned()));
    for (index, (written, _)) in room().iter().enumerate() {
        let read = scene.read_frame(index).unwrap();
        assert_same(&read, written, &Tolerance { depth: 0.000_08, color: 4.0 });
        // 600 for 1200 pixels; these images have 60.
        assert_eq!((read.intrinsics().fx, read.intrinsics().fy), (30.0, 30.0));
        assert!((read.intrinsics().cx - 29.5).abs() < 1e-5 && (read.intrinsics().cy - 16.5).abs() < 1e-5);
    }
    assert!(!scene.has_ground_truth() && scene.read_ground_truth(0).unwrap().is_none());
    assert!(matches!(scene.read_frame(3), Err(DatasetError::NoSuchFrame { .. })));
}

#[test]
fn the_cameras_file_counts_in_the_folder_and_above() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("office0");
    write_replica(&folder, &[0, 1, 2]);
    let camera = |fx: f32, scale: f32| {
        format!(r#"{{"camera": {{"w": 60, "h": 34, "fx": {fx}, "fy": 41, "cx": 28.5, "cy": 16, "scale": {scale}}}}}"#)
    };
    fs::write(parent.path().join("cam_params.json"), camera(40.0, 13107.0)).unwrap();
    let frame = open(&folder).read_frame(0).unwrap();
    assert_eq!((frame.intrinsics().fx, frame.intrinsics().fy, frame.intrinsics().cx), (40.0, 41.0, 28.5));
    let (read, written) = (frame.depth()[(20, 20)], room()[0].0.depth()[(20, 20)]);
    assert!((2.0 * read - written).abs() < 1e-3, "{read} {written}");
    fs::write(folder.join("cam_params.json"), camera(50.0, 6553.5)).unwrap();
    assert_eq!(open(&folder).read_frame(0).unwrap().intrinsics().fx, 50.0);
    for (text, message) in [
        ("{\"camera\": {\"w\": 60}}".to_owned(), "missing field"),
        ("{\"camera\": ".to_owned(), "EOF"),
        (camera(0.0, 1.0), "focal lengths must be positive"),
        (camera(50.0, 0.0), "camera.scale: found 0"),
    ] {
        fs::write(folder.join("cam_params.json"), text).unwrap();
        let error = ReplicaScene::open(&folder, &DatasetSettings::default()).unwrap_err().to_string();
        assert!(error.contains("cam_params.json: ") && error.contains(message), "{error}");
    }
}

#[test]
fn an_assumed_camera_is_said_and_must_have_the_images_shape() {
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[0, 1, 2]);
    let (_, warnings) = with_warnings(|| open(folder.path()));
    let [warning] = warnings.as_slice() else { panic!("{warnings:?}") };
    assert!(
        warning.contains("no cam_params.json: assuming the published Replica's camera (focal length 600"),
        "{warning}"
    );
    assert!(warning.contains("--fx) and unit of depth (6553.5 per metre: --depth-scale)"), "{warning}");
    let own = DatasetSettings::default().with(|settings| settings.fx = Some(30.0));
    let (_, warnings) = with_warnings(|| open_scene(folder.path(), &own).unwrap());
    assert!(warnings.len() == 1 && warnings[0].contains("Replica's unit of depth"), "{warnings:?}");

    let camera = |w: usize, h: usize| {
        format!(r#"{{"camera": {{"w": {w}, "h": {h}, "fx": 60, "fy": 60, "cx": 60, "cy": 34, "scale": 6553.5}}}}"#)
    };
    fs::write(folder.path().join("cam_params.json"), camera(64, 48)).unwrap();
    let error = open(folder.path()).read_frame(0).unwrap_err().to_string();
    assert!(
        error.contains("frame000000.jpg: colour image: found 60x34 pixels, expected the shape of 64x48, as ")
            && error.contains("cam_params.json says; --fx"),
        "{error}"
    );
    assert!(open_scene(folder.path(), &own).unwrap().read_frame(0).is_ok());
    fs::write(folder.path().join("cam_params.json"), camera(120, 68)).unwrap();
    let (scene, warnings) = with_warnings(|| open(folder.path()));
    assert_eq!((scene.read_frame(0).unwrap().intrinsics().fx, warnings), (30.0, vec![]));
}

#[test]
fn poses_go_by_place_or_by_number() {
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[10, 20, 30]);
    let translation = |index: usize| room()[index].0.world_from_camera().translation();
    assert_eq!(open(folder.path()).read_frame(1).unwrap().world_from_camera().translation(), translation(1));
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[0, 2]);
    assert_eq!(open(folder.path()).read_frame(1).unwrap().world_from_camera().translation(), translation(2));
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[2, 3]);
    let scene = open(folder.path());
    assert!(scene.read_frame(0).is_ok());
    let error = scene.read_frame(1).unwrap_err().to_string();
    assert!(error.contains("traj.txt: pose of frame000003: found 3 lines"), "{error}");
}

#[test]
fn damaged_scenes_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[0, 1, 2]);
    let trajectory = folder.path().join("traj.txt");
    let whole = fs::read_to_string(&trajectory).unwrap();
    for bad in ["1 2 3", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 5", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 one"] {
        fs::write(&trajectory, whole.replacen('\n', &format!("\n{bad}\n"), 1)).unwrap();
        let error = ReplicaScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
        assert!(error.contains("traj.txt: line 2: found ") && error.contains("16 numbers"), "{error}");
    }
    let scaled = "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1\n".repeat(3);
    fs::write(&trajectory, scaled).unwrap();
    let error = open(folder.path()).read_frame(2).unwrap_err().to_string();
    assert!(error.contains("traj.txt: line 3: the pose is not a rigid transform"), "{error}");
    fs::write(&trajectory, whole).unwrap();
    let scene = open(folder.path());
    support::truncate(&folder.path().join("results/frame000000.jpg"));
    assert!(matches!(scene.read_frame(0), Err(DatasetError::CutOff { .. })));
    fs::remove_file(folder.path().join("results/depth000001.png")).unwrap();
    let error = scene.read_frame(1).unwrap_err().to_string();
    assert!(error.ends_with("depth000001.png: the depth image is missing"), "{error}");
    support::write_png16(&folder.path().join("results/depth000002.png"), (30, 17), |_, _| 65_535);
    assert!(matches!(scene.read_frame(2), Err(DatasetError::SizesDiffer { .. })));
    fs::remove_dir_all(folder.path().join("results")).unwrap();
    fs::create_dir(folder.path().join("results")).unwrap();
    assert!(matches!(
        ReplicaScene::open(folder.path(), &DatasetSettings::default()),
        Err(DatasetError::NoFrames { .. })
    ));
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    write_replica(folder.path(), &[0, 1, 2]);
    let camera = r#"{"camera": {"w": 60, "h": 34, "fx": 54.0, "fy": 54.0, "cx": 29.5, "cy": 16.5, "scale": 6553.5}}"#;
    fs::write(folder.path().join("cam_params.json"), camera).unwrap();
    support::assert_special_files_are_refused(folder.path(), folder.path());
}

//! Recordings without poses, and with poses for some of their frames, in every format.

use crate::support;
use crate::support::mvpd::{FIRST, files, panoptic};
use crate::support::recording::{jpeg_bytes, png_color_bytes, png_depth_bytes};
use crate::support::sens::SensWriter;
use crate::support::*;
use splatseg_dataset::{DatasetSettings, Format, FrameSource, FrameStream, GroundTruth, Scene, open_scene};
use splatseg_geometry::RgbdFrame;
use std::fs;
use std::path::Path;
use std::sync::Arc;

const SAME: ScannetSizes = ScannetSizes { color: (40, 30), depth: (40, 30), labels: (40, 30) };

/// Writes a scene to a folder.
type WriteScene = fn(&Path);

fn frames() -> Vec<RgbdFrame<'static>> {
    support::recording::recording("synthetic:frames=3,width=64,height=48,seed=8")
        .into_iter()
        .map(|(frame, _)| frame)
        .collect()
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

fn write_replica(folder: &Path) {
    let camera = r#"{"camera": {"w": 64, "h": 48, "fx": 58, "fy": 58, "cx": 31.5, "cy": 23.5, "scale": 6553.5}}"#;
    write(folder, "cam_params.json", camera);
    for (index, frame) in frames().iter().enumerate() {
        write(folder, &format!("results/frame{index:06}.jpg"), jpeg_bytes(frame.color()));
        write(folder, &format!("results/depth{index:06}.png"), png_depth_bytes(frame.depth(), 6553.5));
    }
}

fn write_tum(folder: &Path) {
    for (index, frame) in frames().iter().enumerate() {
        write(folder, &format!("rgb/{index}.5.png"), png_color_bytes(frame.color()));
        write(folder, &format!("depth/{index}.5.png"), png_depth_bytes(frame.depth(), 5000.0));
    }
    for (list, part) in [("rgb.txt", "rgb"), ("depth.txt", "depth")] {
        let lines: String = (0..3).map(|index| format!("{index}.5 {part}/{index}.5.png\n")).collect();
        write(folder, list, lines);
    }
}

fn write_folder(folder: &Path) {
    for (index, frame) in frames().iter().enumerate() {
        write(folder, &format!("color/{index}.jpg"), jpeg_bytes(frame.color()));
        write(folder, &format!("depth/{index}.png"), png_depth_bytes(frame.depth(), 1000.0));
    }
    let camera = r#"{"width": 64, "height": 48, "fx": 58, "fy": 58, "cx": 31.5, "cy": 23.5, "depth_scale": 1000}"#;
    write(folder, "camera.json", camera);
}

fn write_sens(folder: &Path) {
    let writer = SensWriter::new(*frames()[0].intrinsics());
    let mut bytes = writer.header(3);
    for frame in frames() {
        bytes.extend(writer.frame([f32::NEG_INFINITY; 16], frame.color(), frame.depth()));
    }
    write(folder, "scene0000_00.sens", bytes);
}

fn write_mvpd(folder: &Path) {
    let mut content = panoptic(&[FIRST]);
    for image in content["videos"][0]["images"].as_array_mut().unwrap() {
        let image = image.as_object_mut().unwrap();
        image.remove("camera_position");
        image.remove("camera_rotation");
    }
    write(folder, "panoptic_val.json", content.to_string());
    for (name, bytes) in files(&[FIRST]) {
        write(folder, &name, bytes);
    }
}

fn write_scannet_frames(folder: &Path) {
    write_scannet(folder, 3, &SAME);
}

fn write_scannet_without_poses(folder: &Path) {
    write_scannet_frames(folder);
    fs::remove_dir_all(folder.join("pose")).unwrap();
}

fn write_sevenscenes_without_poses(folder: &Path) {
    write_sevenscenes(folder, 3);
    for frame in 0..3 {
        fs::remove_file(folder.join(format!("frame-{:06}.pose.txt", 10 * frame))).unwrap();
    }
}

fn open(folder: &Path) -> Arc<dyn Scene> {
    open_scene(folder, &DatasetSettings::default()).unwrap()
}

/// Returns true for each frame that has a pose. Every frame must be readable.
fn has_pose(scene: &dyn Scene) -> Vec<bool> {
    (0..scene.frame_count()).map(|index| scene.read_recorded(index).unwrap().world_from_camera.is_some()).collect()
}

fn described(scene: Arc<dyn Scene>) -> String {
    let stream = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    stream.description().to_string()
}

#[test]
fn every_format_is_read_without_poses() {
    let formats: [(Format, WriteScene); 7] = [
        (Format::SevenScenes, write_sevenscenes_without_poses),
        (Format::Scannet, write_scannet_without_poses),
        (Format::Sens, write_sens),
        (Format::Tum, write_tum),
        (Format::Replica, write_replica),
        (Format::Mvpd, write_mvpd),
        (Format::Folder, write_folder),
    ];
    for (format, write) in formats {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path());
        let scene = open(folder.path());
        assert_eq!((scene.format(), scene.has_poses()), (Some(format), false), "{format}");
        assert_eq!(has_pose(scene.as_ref()), vec![false; scene.frame_count()], "{format}");
        let error = scene.read_frame(1).unwrap_err().to_string();
        assert!(error.ends_with(" has no pose"), "{format}: {error}");
        let name = scene.name().to_owned();
        let stream = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Skip).unwrap();
        let description = stream.description().to_string();
        assert!(description.starts_with(&format!("{name}: format {format}, ")), "{description}");
        assert!(description.lines().next().unwrap().ends_with(" m; no poses"), "{description}");
        for streamed in stream {
            assert_eq!(streamed.unwrap().posed(), None, "{format}");
        }
    }
}

#[test]
fn a_missing_pose_file_leaves_its_frame_without_a_pose() {
    let formats: [(WriteScene, &str); 2] =
        [(|folder| write_sevenscenes(folder, 3), "frame-000010.pose.txt"), (write_scannet_frames, "pose/1.txt")];
    for (write, pose) in formats {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path());
        fs::remove_file(folder.path().join(pose)).unwrap();
        let scene = open(folder.path());
        assert_eq!((scene.has_poses(), has_pose(scene.as_ref())), (true, vec![true, false, true]), "{pose}");
        let description = described(scene);
        assert!(description.ends_with(" m\n  no pose: 1 frame without a pose file"), "{description}");
    }
}

#[test]
fn poses_of_other_frames_are_no_poses() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet_without_poses(folder.path());
    write(folder.path(), "pose/7.txt", pose_text(7));
    let scene = open(folder.path());
    assert_eq!((scene.has_poses(), scene.left_out().len()), (false, 1));
    assert_eq!(has_pose(scene.as_ref()), [false; 3]);
}

#[test]
fn a_pose_that_is_nan_leaves_its_frame_without_a_pose() {
    let identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n";
    let lines = format!("{identity}{}{identity}", "nan ".repeat(16).trim_end().to_owned() + "\n");
    let formats: [(WriteScene, &str); 2] = [(write_replica, "traj.txt"), (write_folder, "poses.txt")];
    for (write_images, name) in formats {
        let folder = tempfile::tempdir().unwrap();
        write_images(folder.path());
        write(folder.path(), name, &lines);
        let scene = open(folder.path());
        assert_eq!((scene.has_poses(), has_pose(scene.as_ref())), (true, vec![true, false, true]), "{name}");
        let description = described(scene);
        let expected = format!("\n  no pose: 1 frame whose pose in {name} is NaN or infinite: tracking was lost");
        assert!(description.ends_with(&expected), "{description}");
    }
}

#[test]
fn a_video_with_poses_for_some_of_its_images() {
    let folder = tempfile::tempdir().unwrap();
    write_mvpd(folder.path());
    let write_panoptic = |change: fn(&mut serde_json::Map<String, serde_json::Value>)| {
        let mut content = panoptic(&[FIRST]);
        change(content["videos"][0]["images"][1].as_object_mut().unwrap());
        write(folder.path(), "panoptic_val.json", content.to_string());
    };
    write_panoptic(|image| {
        image.remove("camera_position");
        image.insert("camera_rotation".to_owned(), serde_json::Value::Null);
    });
    let scene = open(folder.path());
    assert_eq!((scene.has_poses(), has_pose(scene.as_ref())), (true, vec![true, false]));
    assert_eq!(scene.without_pose()[0].what, "without a pose in the annotations");
    write_panoptic(|image| {
        image.remove("camera_position");
    });
    let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.ends_with("expected camera_position and camera_rotation, or neither"), "{error}");
}

#[test]
fn a_scene_with_all_poses_says_nothing_of_them() {
    let scene: Arc<dyn Scene> = Arc::new(splatseg_test_scenes::room("synthetic:frames=2,width=64,height=48"));
    assert!(scene.has_poses() && scene.without_pose().is_empty());
    assert!(!described(scene).contains("pose"));
}

#[test]
fn a_recording_is_preferred_to_its_files_without_poses() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet_without_poses(folder.path());
    write_sens(folder.path());
    assert_eq!(open(folder.path()).format(), Some(Format::Sens));
    write(folder.path(), "pose/0.txt", pose_text(0));
    assert_eq!(open(folder.path()).format(), Some(Format::Scannet), "the first of two that are whole");
    let folder = tempfile::tempdir().unwrap();
    write_folder(folder.path());
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mcap/room.mcap");
    write(folder.path(), "room.mcap", fs::read(recording).unwrap());
    assert_eq!(open(folder.path()).format(), Some(Format::Mcap));
    let settings = DatasetSettings::default().with(|settings| settings.format = Format::Folder);
    assert_eq!(open_scene(folder.path(), &settings).unwrap().format(), Some(Format::Folder));
}

#[cfg(unix)]
#[test]
fn a_list_of_poses_that_cannot_be_read_is_not_a_missing_one() {
    let formats: [(WriteScene, &str); 4] = [
        (write_tum, "groundtruth.txt"),
        (write_replica, "traj.txt"),
        (write_folder, "poses.txt"),
        (write_scannet_without_poses, "pose"),
    ];
    for (write_images, name) in formats {
        let folder = tempfile::tempdir().unwrap();
        write_images(folder.path());
        std::os::unix::fs::symlink("nowhere", folder.path().join(name)).unwrap();
        let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
        assert!(error.contains(&format!("/{name}: ")), "{error}");
    }
}

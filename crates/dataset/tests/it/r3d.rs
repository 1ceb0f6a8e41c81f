//! Record3D's `.r3d`.

use crate::support::phones::*;
use crate::support::recording::{jpeg_bytes, zip_bytes};
use crate::support::*;
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde_json::{Value, json};
use splatseg_dataset::{
    DatasetSettings, Format, FramePart, Framing, PoseConvention, QuaternionOrder, open_scene, read_color_image,
};
use splatseg_geometry::{CameraFrame, CowImage, Image, Intrinsics, Pose, RgbdFrame};
use splatseg_settings::Choice;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

fn camera(index: usize) -> Intrinsics {
    Intrinsics { fx: 60.0 + index as f32, fy: 61.0, cx: 30.0, cy: 24.5, width: 64, height: 48 }
}

fn lzfse(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    lzfse_rust::encode_bytes(bytes, &mut packed).unwrap();
    packed
}

/// An uncompressed block, as Apple's encoder writes what does not shrink.
fn lzfse_stored(bytes: &[u8]) -> Vec<u8> {
    [b"bvx-".as_slice(), &(bytes.len() as u32).to_le_bytes(), bytes, b"bvx$"].concat()
}

/// qx qy qz qw px py pz
fn pose_numbers(opengl: &DMat4) -> [f64; 7] {
    let [qx, qy, qz, qw] = DQuat::from_mat3(&DMat3::from_mat4(*opengl)).to_array();
    let position = opengl.w_axis;
    [qx, qy, qz, qw, position.x, position.y, position.z]
}

fn metadata() -> Value {
    let poses: Vec<_> = frames().iter().map(|frame| pose_numbers(&opengl_matrix(frame))).collect();
    let cameras: Vec<_> = (0..3).map(camera).map(|camera| [camera.fx, camera.fy, camera.cx, camera.cy]).collect();
    json!({
        "w": 64, "h": 48, "dw": DEPTH_SIZE.0, "dh": DEPTH_SIZE.1, "fps": 30, "cameraType": 1,
        "K": [59.0, 0, 0, 0, 61.0, 0, 30.0, 24.5, 1], "poses": poses, "perFrameIntrinsicCoeffs": cameras,
        "frameTimestamps": [0.0, 0.033, 0.067], "initPose": [0, 0, 0, 1, 0, 0, 0],
    })
}

fn depth_bytes(frame: &RgbdFrame) -> Vec<u8> {
    let depth = small_millimetres(frame);
    depth.pixels().iter().flat_map(|depth| (f32::from(*depth) / 1000.0).to_le_bytes()).collect()
}

/// The members of a recording.
fn members(metadata: &Value) -> Vec<(String, Vec<u8>)> {
    let mut members =
        vec![("metadata".to_owned(), metadata.to_string().into_bytes()), ("sound.m4a".to_owned(), vec![1])];
    let levels: Vec<u8> = (0..DEPTH_SIZE.0 * DEPTH_SIZE.1).map(|pixel| confidence(pixel % DEPTH_SIZE.0)).collect();
    for (index, frame) in frames().iter().enumerate() {
        let packed = if index == 1 { lzfse_stored(&depth_bytes(frame)) } else { lzfse(&depth_bytes(frame)) };
        members.push((format!("rgbd/{index}.jpg"), jpeg_bytes(frame.color())));
        members.push((format!("rgbd/{index}.depth"), packed));
        members.push((format!("rgbd/{index}.conf"), lzfse(&levels)));
    }
    members
}

fn write(path: &Path, metadata: &Value) {
    fs::write(path, zip_bytes(&members(metadata))).unwrap();
}

/// Returns a frame as it is after JPEG.
fn after_jpeg(frame: &RgbdFrame) -> RgbdFrame<'static> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    fs::write(&path, jpeg_bytes(frame.color())).unwrap();
    let depth = Image::from_pixels(64, 48, frame.depth().pixels().to_vec()).unwrap();
    RgbdFrame::new("0", read_color_image(&path).unwrap(), depth, *frame.intrinsics(), *frame.world_from_camera())
        .unwrap()
}

#[test]
fn frames_are_at_the_scale_of_depth_with_turned_axes_and_their_own_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (zip, unpacked) = (folder.path().join("room.r3d"), folder.path().join("room"));
    write(&zip, &metadata());
    for (name, bytes) in members(&metadata()) {
        fs::create_dir_all(unpacked.join(&name).parent().unwrap()).unwrap();
        fs::write(unpacked.join(name), bytes).unwrap();
    }
    for path in [zip, unpacked] {
        let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
        assert_eq!((scene.format(), scene.frame_count(), scene.name()), (Some(Format::R3d), 3, "room"));
        for (index, written) in frames().iter().enumerate() {
            let read = scene.read_recorded(index).unwrap();
            assert_images(&read.frame, &expected(&after_jpeg(written), camera(index)));
            assert_pose(read.world_from_camera, written.world_from_camera());
        }
        assert_eq!(scene.read_recorded(1).unwrap().frame.timestamp(), Some(Duration::from_millis(33)));
    }
}

#[test]
fn early_recordings_have_one_camera_and_no_size_of_depth() {
    let mut early = metadata();
    for key in ["dw", "dh", "perFrameIntrinsicCoeffs", "frameTimestamps", "poses"] {
        early.as_object_mut().unwrap().remove(key);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    write(&path, &early);
    let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
    assert!(!scene.has_poses() && scene.without_pose().is_empty());
    let read = scene.read_recorded(2).unwrap().frame;
    assert_images(&read, &expected(&after_jpeg(&frames()[2]), Intrinsics { fx: 59.0, ..camera(0) }));
    assert_eq!(read.timestamp(), Some(Duration::from_secs_f64(2.0 / 30.0)));
}

#[test]
fn portrait_images_keep_their_shape() {
    let metadata = json!({
        "w": 48, "h": 64, "dw": 12, "dh": 16, "fps": 30, "K": [60.0, 0, 0, 0, 61.0, 0, 23.0, 32.0, 1], "poses": [],
    });
    let color = Image::from_fn(48, 64, |column, row| [5 * column as u8, 3 * row as u8, 9]);
    let depth: Vec<u8> = (0..12 * 16).flat_map(|pixel| (1.0 + pixel as f32 / 100.0).to_le_bytes()).collect();
    let files = [
        ("metadata", metadata.to_string().into_bytes()),
        ("rgbd/0.jpg", jpeg_bytes(&color)),
        ("rgbd/0.depth", lzfse(&depth)),
    ];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("portrait.r3d");
    fs::write(&path, zip_bytes(&files.map(|(name, bytes)| (name.to_owned(), bytes)))).unwrap();
    let read = open_scene(&path, &DatasetSettings::default()).unwrap().read_recorded(0).unwrap().frame;
    assert_eq!((read.width(), read.height(), read.intrinsics().fx), (12, 16, 15.0));
    assert_eq!(read.depth()[(3, 5)], 1.0 + 63.0 / 100.0);
}

#[test]
fn settings_apply() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    let mut w_first = metadata();
    for pose in w_first["poses"].as_array_mut().unwrap() {
        let [x, y, z, w] = [0, 1, 2, 3].map(|index| pose[index].clone());
        (pose[0], pose[1], pose[2], pose[3]) = (w, x, y, z);
    }
    write(&path, &w_first);
    let settings = DatasetSettings::default().with(|settings| {
        (settings.fx, settings.depth_scale) = (Some(70.0), Some(2.0));
        settings.quaternion_order = QuaternionOrder::Wxyz;
    });
    let read = open_scene(&path, &settings).unwrap().read_recorded(1).unwrap();
    assert_pose(read.world_from_camera, frames()[1].world_from_camera());
    assert_eq!(read.frame.intrinsics().fx, 17.5);
    let plain = expected(&after_jpeg(&frames()[1]), camera(1)).depth;
    assert!(read.frame.depth().pixels().iter().zip(plain).all(|(read, plain)| (read - plain / 2.0).abs() < 1e-6));
}

#[test]
fn gravity_is_known_unless_poses_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    write(&path, &metadata());
    let up = |settings: &DatasetSettings| open_scene(&path, settings).unwrap().world_up();
    assert_eq!(up(&DatasetSettings::default()), Some(DVec3::Y));
    let inverse = PoseConvention::from_name("world-to-camera").unwrap();
    assert_eq!(up(&DatasetSettings::default().with(|settings| settings.pose_convention = inverse)), None);
}

#[test]
fn lists_may_be_null_and_messages_name_the_archive() {
    let mut file = metadata();
    for key in ["perFrameIntrinsicCoeffs", "frameTimestamps", "poses"] {
        file[key] = json!(null);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    write(&path, &file);
    let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
    assert!(!scene.has_poses() && scene.read_recorded(2).is_ok());
    assert_eq!(scene.file_of(1, FramePart::Depth), path.join("rgbd/1.depth"));
}

#[test]
fn lost_tracking_and_missing_members_are_counted() {
    let mut file = metadata();
    file["poses"] = json!([file["poses"][0]]);
    let mut members = members(&file);
    members.retain(|(name, _)| name != "rgbd/2.depth");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    fs::write(&path, zip_bytes(&members)).unwrap();
    let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.left_out()[0].what.as_str()), (2, "without depth"));
    assert_eq!(scene.without_pose()[0].count, 1);
    assert!(scene.read_recorded(1).unwrap().world_from_camera.is_none());
}

#[test]
fn poses_of_no_frame_are_told() {
    let mut file = metadata();
    file["poses"] = json!([file["poses"][0]]);
    let mut members = members(&file);
    members.retain(|(name, _)| name != "rgbd/0.depth");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    fs::write(&path, zip_bytes(&members)).unwrap();
    let told = refused(&path);
    assert!(told.contains("poses: found those of frames 0 to 0, expected those of the images, 1 to 2"), "{told}");
}

#[test]
fn wrong_values_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    let told = |members: &[(String, Vec<u8>)]| {
        fs::write(&path, zip_bytes(members)).unwrap();
        refused(&path)
    };
    let with = |change: fn(&mut Value)| {
        let mut file = metadata();
        change(&mut file);
        members(&file)
    };
    let size = told(&with(|file| file["dw"] = json!(17)));
    assert!(size.contains("rgbd/0.depth: depth image: found 768 bytes, expected 816 for 17x12 pixels"), "{size}");
    let huge = told(&with(|file| file["dw"] = json!(10_000_000)));
    assert!(huge.contains("metadata: dw, dh: found 10000000x12, expected 1 to 67108864 pixels"), "{huge}");
    let matrix = told(&with(|file| (file["K"], file["perFrameIntrinsicCoeffs"]) = (json!([1, 2]), json!([]))));
    assert!(matrix.contains("metadata: K: found 2 numbers, expected 9"), "{matrix}");
    let quaternion = told(&with(|file| file["poses"][1][3] = json!(3)));
    assert!(quaternion.contains("metadata: pose 1: found a quaternion of length 3."), "{quaternion}");
    for (value, key) in [(json!("16"), "dw"), (json!([[1, 2]]), "poses"), (json!(null), "K")] {
        let mut file = metadata();
        file[key] = value;
        let told = told(&members(&file));
        assert!(told.contains(&format!("metadata: at \"{key}\": invalid ")), "{told}");
    }
    let mut no_lzfse = members(&metadata());
    no_lzfse.iter_mut().filter(|(name, _)| name == "rgbd/0.depth").for_each(|(_, bytes)| *bytes = vec![7; 99]);
    let damaged = told(&no_lzfse);
    assert!(damaged.contains("rgbd/0.depth: depth image: found damaged LZFSE"), "{damaged}");
    let none = told(&members(&metadata())[..2]);
    assert!(none.contains("no frames: looked for rgbd/<number>.jpg and .depth"), "{none}");
}

/// A few bytes that unpack to gigabytes take no more memory than the image.
#[test]
fn more_than_the_image_is_not_unpacked() {
    let mut members = members(&metadata());
    let bomb = lzfse(&vec![0; 30 << 20]);
    members.iter_mut().filter(|(name, _)| name == "rgbd/0.depth").for_each(|(_, bytes)| bytes.clone_from(&bomb));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    fs::write(&path, zip_bytes(&members)).unwrap();
    let told = refused(&path);
    assert!(told.contains("depth image: found 769 bytes, expected 768"), "{told}");
}

#[test]
fn damage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.r3d");
    write(&path, &metadata());
    assert_damage_is_told(folder.path(), &path);
    let unpacked = tempfile::tempdir().unwrap();
    for (name, bytes) in members(&metadata()).into_iter().filter(|(name, _)| name != "sound.m4a") {
        fs::create_dir_all(unpacked.path().join(&name).parent().unwrap()).unwrap();
        fs::write(unpacked.path().join(name), bytes).unwrap();
    }
    assert_damage_is_told(unpacked.path(), unpacked.path());
}

/// Real images as `.r3d`, with depth of 256x192 pixels.
#[test]
fn a_real_recording_is_the_same_as_in_its_own_format() {
    let Some(source) = shared_data("r3d", "kitchen-dev") else { return };
    let original = open_scene(&source, &DatasetSettings::default()).unwrap();
    let (mut files, mut poses, mut expected) = (Vec::new(), Vec::new(), Vec::new());
    let framing = Framing { resize: "256x192".parse().ok(), ..Framing::default() };
    let mut camera = None;
    for index in 0..original.frame_count() {
        let frame = original.read_frame(index).unwrap();
        poses.push(pose_numbers(&opengl_matrix(&frame)));
        camera.get_or_insert(*frame.intrinsics());
        let small: CameraFrame = framing.apply(frame.clone().into_camera_frame()).unwrap();
        let depth: Vec<u8> = small.depth().pixels().iter().flat_map(|depth| depth.to_le_bytes()).collect();
        let jpeg = fs::read(source.join(format!("color/{}.jpg", original.frame_name(index)))).unwrap();
        files.push((format!("rgbd/{index}.jpg"), jpeg));
        files.push((format!("rgbd/{index}.depth"), lzfse(&depth)));
        expected.push((small, *frame.world_from_camera()));
    }
    let Intrinsics { fx, fy, cx, cy, width, height } = camera.unwrap();
    let metadata = json!({
        "w": width, "h": height, "dw": 256, "dh": 192, "fps": 30, "K": [fx, 0, 0, 0, fy, 0, cx, cy, 1], "poses": poses,
    });
    files.push(("metadata".to_owned(), metadata.to_string().into_bytes()));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kitchen.r3d");
    fs::write(&path, zip_bytes(&files)).unwrap();
    let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
    assert_eq!(scene.frame_count(), expected.len());
    let same = |one: &CowImage<'_, f32>, other: &CowImage<'_, f32>| one.pixels() == other.pixels();
    for (index, (frame, pose)) in expected.iter().enumerate() {
        let read = scene.read_recorded(index).unwrap();
        let pose: &Pose = pose;
        assert_eq!(read.frame.color().pixels(), frame.color().pixels());
        assert!(same(read.frame.depth(), frame.depth()), "{index}");
        assert_eq!(read.frame.intrinsics(), frame.intrinsics());
        assert_pose(read.world_from_camera, pose);
    }
}

/// Writes the members of a zip file again: all with sizes and places of 64 bits, and then with more members than 16 bits count.
const ZIP64: &str = r#"
import sys, zipfile
room, wide, many = sys.argv[1:]
members = [(name, zipfile.ZipFile(room).read(name)) for name in zipfile.ZipFile(room).namelist()]
def write(path, more):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            with archive.open(name, "w", force_zip64=True) as member:
                member.write(content)
        for number in range(more):
            archive.writestr(f"more/{number}", b"")
write(many, 70000)
zipfile.ZIP64_LIMIT = zipfile.ZIP_FILECOUNT_LIMIT = 1
write(wide, 0)
"#;

#[test]
fn large_zip_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let [room, wide, many] = ["room.r3d", "wide.r3d", "many.r3d"].map(|name| folder.path().join(name));
    write(&room, &metadata());
    let Ok(python) = Command::new("python3").args(["-c", ZIP64]).args([&room, &wide, &many]).output() else {
        splatseg_test_scenes::skipped("large_zip_files_are_read", "there is no python3");
        return;
    };
    assert!(python.status.success(), "{}", String::from_utf8_lossy(&python.stderr));
    let frames = |path: &Path| -> Vec<(Vec<[u8; 3]>, Vec<f32>)> {
        let scene = open_scene(path, &DatasetSettings::default()).unwrap();
        let read = |index| {
            let frame = scene.read_recorded(index).unwrap().frame;
            (frame.color().pixels().to_vec(), frame.depth().pixels().to_vec())
        };
        (0..scene.frame_count()).map(read).collect()
    };
    let expected = frames(&room);
    assert_eq!(expected.len(), 3);
    for path in [&wide, &many] {
        assert!(fs::read(path).unwrap().windows(4).any(|window| window == b"PK\x06\x06"), "no zip64 directory");
        assert!(frames(path) == expected, "{}", path.display());
    }
    // A directory that claims more members than the file has room for.
    let mut bytes = fs::read(&many).unwrap();
    let end = bytes.windows(4).position(|window| window == b"PK\x06\x06").unwrap();
    bytes[end + 24..end + 40].copy_from_slice(&[&[0, 0, 0, 0, 1, 0, 0, 0u8][..]; 2].concat());
    fs::write(&many, bytes).unwrap();
    let error = open_scene(&many, &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.contains("many.r3d: zip64 directory: found no number of members"), "{error}");
}

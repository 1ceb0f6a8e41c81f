//! The unit of stored depth: that of the settings replaces that of the file or the format, in all formats alike.

use crate::support::mvpd::{panoptic, write_split};
use crate::support::recording::*;
use crate::support::sens::SensWriter;
use crate::support::*;
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::RgbdFrame;
use std::fs;
use std::path::{Path, PathBuf};

fn scale(depth_scale: f64) -> DatasetSettings {
    DatasetSettings::default().with(|settings| settings.depth_scale = Some(depth_scale))
}

fn depth(path: &Path, settings: &DatasetSettings) -> Vec<f32> {
    let frame = open_scene(path, settings).unwrap().read_recorded(0).unwrap().frame;
    frame.depth().pixels().to_vec()
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Writes images listed by time, with all depth at 5000.
fn write_tum(folder: &Path) {
    write_color(&folder.join("1.png"), 64, 48);
    write_png16(&folder.join("2.png"), (64, 48), |_, _| 5000);
    fs::write(folder.join("rgb.txt"), "0.5 1.png\n").unwrap();
    fs::write(folder.join("depth.txt"), "0.5 2.png\n").unwrap();
}

fn write_replica(folder: &Path, frame: &RgbdFrame<'_>) {
    fs::create_dir(folder.join("results")).unwrap();
    let camera = r#"{"camera": {"w": 64, "h": 48, "fx": 58, "fy": 58, "cx": 31.5, "cy": 23.5, "scale": 6553.5}}"#;
    fs::write(folder.join("cam_params.json"), camera).unwrap();
    fs::write(folder.join("results/frame0.jpg"), jpeg_bytes(frame.color())).unwrap();
    fs::write(folder.join("results/depth0.png"), png_depth_bytes(frame.depth(), 6553.5)).unwrap();
}

/// Scenes in all formats that store depth, in folders in `root`, each with its own units per metre.
fn scenes(root: &Path) -> Vec<(PathBuf, f64)> {
    let folder = |name: &str| {
        let path = root.join(name);
        fs::create_dir(&path).unwrap();
        path
    };
    let room = recording("synthetic:frames=1,width=64,height=48,seed=5");
    let frame = &room[0].0;
    let (sevenscenes, scannet, sens) = (folder("7scenes"), folder("scannet"), root.join("a.sens"));
    let (tum, replica, mvpd) = (folder("tum"), folder("replica"), folder("mvpd"));
    write_sevenscenes(&sevenscenes, 1);
    write_scannet(&scannet, 1, &ScannetSizes { color: (64, 48), depth: (64, 48), labels: (64, 48) });
    let writer = SensWriter { depth_shift: 2000.0, ..SensWriter::new(*frame.intrinsics()) };
    fs::write(&sens, writer.recording(&[frame])).unwrap();
    write_tum(&tum);
    write_replica(&replica, frame);
    write_split(&mvpd, &["video"], &panoptic(&["video"]));
    let metres = [(sevenscenes, 1e3), (scannet, 1e3), (sens, 2e3), (tum, 5e3), (replica, 6553.5), (mvpd, 1e3)];
    let examples = [(data("folder/room"), 1e3), (data("mcap/room.mcap"), 1e3)];
    metres.into_iter().chain(examples).collect()
}

#[test]
fn the_setting_replaces_the_unit_of_every_format() {
    let root = tempfile::tempdir().unwrap();
    for (path, own) in scenes(root.path()) {
        let stored = depth(&path, &DatasetSettings::default());
        assert!(stored.iter().any(|depth| *depth > 0.3), "{}", path.display());
        assert_eq!(depth(&path, &scale(own)), stored, "{}", path.display());
        // Half of a number is exact.
        let half: Vec<f32> = stored.iter().map(|depth| depth / 2.0).collect();
        assert_eq!(depth(&path, &scale(2.0 * own)), half, "{}", path.display());
    }
}

#[test]
fn a_unit_that_leaves_no_depth_is_an_error_that_names_the_setting() {
    let root = tempfile::tempdir().unwrap();
    write_tum(root.path());
    let opened = |settings: &DatasetSettings| {
        let scene = open_scene(root.path(), settings).map_err(|error| error.to_string())?;
        FrameStream::open(scene, settings, GroundTruth::Skip).map(drop).map_err(|error| error.to_string())
    };
    opened(&scale(1e5)).unwrap();
    write_png16(&root.path().join("2.png"), (64, 48), |_, _| 7);
    for settings in [DatasetSettings::default(), scale(2500.0)] {
        let told = opened(&settings).unwrap_err();
        let place = root.path().join("2.png");
        assert!(told.starts_with(&format!("{}: all depth is below ", place.display())), "{told}");
        assert!(told.contains("dataset.depth_scale, --depth-scale"), "{told}");
    }
    // Noise of a covered lens in the first frame is no reason to refuse the recording.
    write_png16(&root.path().join("2.png"), (64, 48), |x, y| u16::from(x + y == 9));
    opened(&DatasetSettings::default()).unwrap();
    for wrong in [0.0, -1000.0, 1e38, f64::NAN] {
        let told = opened(&scale(wrong)).unwrap_err();
        assert_eq!(told, format!("dataset.depth_scale is {wrong}, expected 0.001 to 1000000"));
    }
    let told = open_scene("synthetic", &scale(1000.0)).unwrap_err().to_string();
    assert!(told.starts_with("dataset.depth_scale is 1000, expected no value for the format synthetic"), "{told}");
}

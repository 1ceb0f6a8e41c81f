//! Recordings of OrbbecViewer and Orbbec's SDK, written here as its version 2 writes them: there is no SDK without a camera.

use crate::support::orbbec::OrbbecWriter;
use splatseg_dataset::{DatasetError, DatasetSettings, DepthRegistration, Format, RecordingSummary, open_scene};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Returns the folder and the file.
fn write(recording: &OrbbecWriter) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.bag");
    fs::write(&path, recording.bytes()).unwrap();
    (folder, path)
}

fn read(path: &Path) -> Vec<(splatseg_geometry::CameraFrame<'static>, usize)> {
    let scene = open_scene(path, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.format(), scene.frame_count(), scene.has_poses()), (Some(Format::Bag), 3, false));
    (0..3).map(|index| (scene.read_recorded(index).unwrap().frame, index)).collect()
}

/// The file is for tests of other crates.
#[test]
fn the_file_with_test_data_is_what_is_written_here() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings/orbbec.bag");
    assert!(fs::read(file).unwrap() == OrbbecWriter::default().bytes());
}

#[test]
fn both_versions_and_both_kinds_of_colour_are_read() {
    for is_new in [true, false] {
        for color_encoding in ["mjpg", "rgb8"] {
            let (_folder, path) = write(&OrbbecWriter { is_new, color_encoding, ..OrbbecWriter::default() });
            for (frame, index) in read(&path) {
                let [red, green, _] = frame.color()[(20, 12)];
                let expected = 40 * index as i32;
                assert!(red.abs_diff(200) < 4 && (i32::from(green) - expected).abs() < 5, "{red} {green}");
                // Frames have the resolution of depth: 2 m away, 300 mm are 3 pixels at a focal length of 20.
                let nearest = frame.depth().pixels().iter().copied().fold(0.0, f32::max);
                assert!((nearest - (2.0 + 0.1 * index as f32)).abs() < 1e-4, "{nearest}");
                let seen: Vec<bool> = (0..frame.depth().size().0).map(|x| frame.depth()[(x, 12)] > 0.0).collect();
                assert_eq!(seen.iter().position(|seen| *seen), Some(3), "{seen:?}");
            }
        }
    }
}

#[test]
fn the_unit_of_depth_is_that_of_the_settings_in_the_bag() {
    // By level and, for the Gemini 330, as millimetres; the settings of the run go first.
    for property in [(75, 3u32.to_le_bytes().to_vec()), (176, 0.1f32.to_le_bytes().to_vec())] {
        let mut recording = OrbbecWriter { per_millimetre: 10, ..OrbbecWriter::default() };
        recording.properties.push(property);
        let (_folder, path) = write(&recording);
        let nearest = |settings: &DatasetSettings| {
            let frame = open_scene(&path, settings).unwrap().read_recorded(0).unwrap().frame;
            frame.depth().pixels().iter().copied().fold(0.0, f32::max)
        };
        assert!((nearest(&DatasetSettings::default()) - 2.0).abs() < 1e-4);
        let chosen = DatasetSettings::default().with(|settings| settings.depth_scale = Some(20_000.0));
        assert!((nearest(&chosen) - 1.0).abs() < 1e-4);
    }
}

#[test]
fn depth_that_the_camera_registers_is_left_where_it_is() {
    let mut recording = OrbbecWriter::default();
    recording.properties.push((42, vec![1]));
    let (_folder, path) = write(&recording);
    for (frame, _) in read(&path) {
        assert!(frame.depth().pixels().iter().all(|depth| *depth > 0.0), "nothing is moved aside");
    }
}

#[test]
fn lenses_are_undistorted() {
    let straight = write(&OrbbecWriter::default());
    for lens in [(4, 0.4), (5, 1.0)] {
        let (_folder, path) = write(&OrbbecWriter { lens, ..OrbbecWriter::default() });
        let settings = DatasetSettings::default().with(|settings| settings.register_depth = DepthRegistration::True);
        let corner = |path: &Path| {
            let frame = open_scene(path, &settings).unwrap().read_recorded(0).unwrap().frame;
            frame.color()[(0, 0)]
        };
        assert_ne!(corner(&straight.1), [0; 3]);
        // A lens that pushes the corners out leaves them black.
        assert_eq!(corner(&path), [0; 3], "{lens:?}");
    }
}

#[test]
fn disparities_are_told() {
    let mut recording = OrbbecWriter::default();
    recording.properties.push((85, vec![0]));
    let (_folder, path) = write(&recording);
    let error = open_scene(&path, &DatasetSettings::default()).unwrap_err();
    assert!(matches!(error, DatasetError::Field { .. }));
    assert!(error.to_string().contains("/cam/sensor_3/frameType_3 (disparity, which only Orbbec's SDK"), "{error}");
}

#[test]
fn inspection_lists_the_topics_and_damage_is_counted() {
    let recording = OrbbecWriter::default();
    let bytes = recording.bytes();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.bag");
    fs::write(&path, &bytes).unwrap();
    let summary = RecordingSummary::read(&path, &DatasetSettings::default()).unwrap();
    let names: Vec<&str> = summary.topics.iter().map(|topic| topic.name.as_str()).collect();
    assert!(names.contains(&"/cam/sensor_3/camera_info") && names.contains(&"/cam/tf_static"), "{names:?}");
    // Whatever is cut off, the file is an error or has fewer frames.
    for end in (0..bytes.len()).step_by(97) {
        fs::write(&path, &bytes[..end]).unwrap();
        if let Ok(scene) = open_scene(&path, &DatasetSettings::default()) {
            assert!(scene.frame_count() <= 3);
            for index in 0..scene.frame_count() {
                let _ = scene.read_recorded(index);
            }
        }
    }
}

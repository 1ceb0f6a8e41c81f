//! Recognising scenes.

mod support;

use splatseg_dataset::{DatasetError, DatasetSettings, Format, open_scene};
use support::*;

#[test]
fn missing_empty_and_unknown_paths_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let settings = DatasetSettings::default();
    let missing = open_scene(folder.path().join("nothing"), &settings);
    assert!(matches!(missing, Err(DatasetError::NotFound { .. })));
    assert!(matches!(open_scene(folder.path(), &settings), Err(DatasetError::EmptyFolder { .. })));
    std::fs::write(folder.path().join("notes.txt"), "hello").unwrap();
    let unknown = open_scene(folder.path(), &settings).unwrap_err();
    assert!(matches!(unknown, DatasetError::NotRecognised { .. }));
    let text = unknown.to_string();
    for part in
        ["7scenes: frame-000000.color.png", "scannet: color/0.jpg", "mvpd: panoptic_", "synthetic: the word synthetic"]
    {
        assert!(text.contains(part), "{text}");
    }
    let file = open_scene(folder.path().join("notes.txt"), &settings);
    assert!(matches!(file, Err(DatasetError::NotRecognised { .. })));
}

#[test]
fn a_stated_format_must_be_there() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 1);
    let settings = |format| DatasetSettings::default().with(|settings| settings.format = format);
    assert!(open_scene(folder.path(), &settings(Format::SevenScenes)).is_ok());
    use Format::{Mvpd, Replica, Scannet, Sens, Synthetic, Tum};
    for format in [Scannet, Sens, Tum, Replica, Mvpd, Synthetic] {
        let error = open_scene(folder.path(), &settings(format)).unwrap_err();
        assert!(error.to_string().contains(&format!("not a scene of format {format}")), "{error}");
    }
}

#[test]
fn the_synthetic_room_needs_no_files() {
    let scene = open_scene("synthetic:frames=3,width=32,height=24", &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.has_ground_truth()), (3, true));
    assert_eq!(scene.read_frame(2).unwrap().width(), 32);
    let error = open_scene("synthetic:frames=many", &DatasetSettings::default()).unwrap_err();
    assert!(matches!(error, DatasetError::Synthetic { .. }), "{error}");
}

#[test]
fn impossible_settings_are_refused_on_opening() {
    let settings = DatasetSettings::default().with(|settings| settings.stride = 0);
    assert!(matches!(open_scene("synthetic", &settings), Err(DatasetError::Setting(_))));
}

//! Corrected poses in plain folders.

use crate::support::{write_color, write_png16};
use splatseg_dataset::{DatasetSettings, FolderScene, Scene};
use std::fs;

const CAMERA: &str = r#"{"width": 24, "height": 16, "fx": 20, "fy": 21, "cx": 11.5, "cy": 7.5, "depth_scale": 5000}"#;

/// Opens a folder with the images 0 to 5, cameras at x = 0 to 5, no depth image 2, and these corrections.
fn opened(corrections: Option<&str>) -> Result<FolderScene, String> {
    let folder = tempfile::tempdir().unwrap();
    for part in ["color", "depth"] {
        fs::create_dir(folder.path().join(part)).unwrap();
    }
    for name in 0..6 {
        write_color(&folder.path().join(format!("color/{name}.jpg")), 24, 16);
        if name != 2 {
            write_png16(&folder.path().join(format!("depth/{name}.png")), (24, 16), |_, _| 10_000);
        }
    }
    fs::write(folder.path().join("camera.json"), CAMERA).unwrap();
    let poses: String = (0..6).map(|x| format!("{x} {x} 0 0 0 0 0 1\n")).collect();
    fs::write(folder.path().join("poses.txt"), poses).unwrap();
    if let Some(text) = corrections {
        fs::write(folder.path().join("corrections.txt"), text).unwrap();
    }
    FolderScene::open(folder.path(), &DatasetSettings::default())
        .map_err(|error| error.to_string().replace(&folder.path().display().to_string(), "SCENE"))
}

/// Returns the corrections that become known with each frame: frame and x of the camera.
fn found(scene: &FolderScene) -> Vec<Vec<(usize, f64)>> {
    let of = |index| {
        let corrections = scene.corrections(index..index + 1);
        corrections.iter().map(|found| (found.frame, found.world_from_camera.translation().x)).collect()
    };
    (0..scene.frame_count()).map(of).collect()
}

#[test]
fn the_next_frame_delivers_corrections() {
    assert!(found(&opened(None).unwrap()).iter().all(Vec::is_empty));
    let text = "# after_frame frame tx ty tz qx qy qz qw\n\
                3 0 0.5 0 0 0 0 0 1\n3 1 1.0005 0 0 0 0 0 1\n3,3,3.5,0,0,0,0,0,1\n\
                4 2 2.5 0 0 0 0 0 1\n\n\
                2 1 1.5 0 0 0 0 0 1\n\
                4 0 nan 0 0 0 0 0 1\n\
                5 0 9 0 0 0 0 0 1\n";
    // Frames are numbered without image 2, which has no depth. Image 1 was at 1.5 before it was corrected to 1.0005.
    let expected = vec![vec![], vec![], vec![(1, 1.5)], vec![(0, 0.5), (1, 1.0005), (2, 3.5)], vec![]];
    assert_eq!(found(&opened(Some(text)).unwrap()), expected);
}

#[test]
fn damaged_corrections_are_reported_with_their_line() {
    let refused = |line: &str| opened(Some(&format!("# corrections\n{line}\n"))).unwrap_err();
    for (line, expected) in [
        ("3 0 0 0 0 0 0 0", "two names of frames and 7 numbers (after_frame frame tx ty tz qx qy qz qw)"),
        ("3 0 0 0 0 0 0 0 1 1", "two names of frames and 7 numbers"),
        ("3 0 0 x 0 0 0 0 1", "two names of frames and 7 numbers"),
        ("7", "two names of frames and 7 numbers"),
        ("7 0 0 0 0 0 0 0 1", "no image is 7"),
        ("3 4 0 0 0 0 0 0 1", "4, the corrected frame, not to come after the other"),
        ("3 0 0 0 0 0 0 0 2", "a quaternion qx qy qz qw of length 1"),
    ] {
        let error = refused(line);
        assert!(error.starts_with("SCENE/corrections.txt: line 2: found") && error.contains(expected), "{error}");
    }
}

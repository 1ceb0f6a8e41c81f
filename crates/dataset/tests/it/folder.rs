//! Plain folders: the documented example, every variant of the layout, and errors about damaged ones.

use crate::support;
use crate::support::recording::{jpeg_bytes, png_color_bytes, png_depth_bytes};
use crate::support::*;
use glam::{DVec3, Mat4, Quat, Vec3};
use proptest::prelude::*;
use splatseg_dataset::{
    DatasetError, DatasetSettings, FolderScene, Format, FrameSource, FrameStream, GroundTruth, Scene, open_scene,
};
use splatseg_geometry::{Distortion, Image};
use splatseg_test_scenes::{file_names, shared};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/folder/room")
}

fn open(folder: &Path) -> Arc<dyn Scene> {
    open_scene(folder, &DatasetSettings::default()).unwrap()
}

/// Returns the error of opening a folder, without the path of the folder.
fn refused(folder: &Path) -> String {
    let error = FolderScene::open(folder, &DatasetSettings::default()).unwrap_err().to_string();
    error.replace(&folder.display().to_string(), "SCENE")
}

const CAMERA: &str = r#"{"width": 24, "height": 16, "fx": 20, "fy": 21, "cx": 11.5, "cy": 7.5, "depth_scale": 5000}"#;

/// Writes a folder with frames of these names and this `poses.txt`; depth is 2 m.
fn folder(names: &[&str], poses: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for part in ["color", "depth"] {
        fs::create_dir(folder.path().join(part)).unwrap();
    }
    for name in names {
        write_color(&folder.path().join(format!("color/{name}.jpg")), 24, 16);
        write_png16(&folder.path().join(format!("depth/{name}.png")), (24, 16), |_, _| 10_000);
    }
    fs::write(folder.path().join("camera.json"), CAMERA).unwrap();
    fs::write(folder.path().join("poses.txt"), poses).unwrap();
    folder
}

/// Returns TUM lines with cameras at x = 1, 2, 3... at these times.
fn tum_lines(times: &[&str]) -> String {
    times.iter().enumerate().map(|(index, time)| format!("{time} {} 0 0 0 0 0 1\n", index + 1)).collect()
}

/// Returns the names of the frames and the x coordinates of their cameras.
fn frames(scene: &dyn Scene) -> Vec<(String, f64)> {
    let frame = |index| {
        let frame = scene.read_frame(index).unwrap();
        (scene.frame_name(index), frame.world_from_camera().translation().x)
    };
    (0..scene.frame_count()).map(frame).collect()
}

fn named(expected: &[(&str, f64)]) -> Vec<(String, f64)> {
    expected.iter().map(|(name, x)| ((*name).to_owned(), *x)).collect()
}

/// Returns the names of the frames and the x coordinates of their cameras, if known.
fn recorded(scene: &dyn Scene) -> Vec<(String, Option<f64>)> {
    let x = |index| Some(scene.read_recorded(index).unwrap().world_from_camera?.translation().x);
    (0..scene.frame_count()).map(|index| (scene.frame_name(index), x(index))).collect()
}

fn left_out(scene: &dyn Scene) -> Vec<(usize, &str)> {
    scene.left_out().iter().map(|left_out| (left_out.count, left_out.what.as_str())).collect()
}

fn without_pose(scene: &dyn Scene) -> Vec<(usize, &str)> {
    scene.without_pose().iter().map(|frames| (frames.count, frames.what.as_str())).collect()
}

#[test]
fn the_documented_example_opens_as_documented() {
    let scene = open(&example());
    assert_eq!((scene.format(), scene.name()), (Some(Format::Folder), "room"));
    assert!(!scene.has_ground_truth() && scene.left_out().is_empty());
    let stream = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Read).unwrap();
    let description = stream.description().to_string();
    assert!(description.starts_with("room: format folder, 4 frames; colour 160x120; depth of the first frame"));
    let read: Vec<_> = stream.map(|frame| frame.unwrap().posed().unwrap()).collect();
    let names: Vec<&str> = read.iter().map(|frame| frame.name()).collect();
    assert_eq!(names, ["0000", "0001", "0002", "0003"]);
    assert_eq!(read[1].timestamp(), Some(Duration::from_secs_f64(0.666_667)));
    assert_eq!((read[0].intrinsics().fx, read[0].intrinsics().cx), (144.4675, 79.5));
    assert_eq!(read[3].world_from_camera().translation(), DVec3::new(1.865_856, 3.019_659, 1.277_984));
    // Wall and floor of a room: depth and poses are consistent if a point has the right depth in the next camera.
    let (first, second) = (&read[0], &read[1]);
    let mut distances = Vec::new();
    for (column, row) in (20..140).step_by(10).flat_map(|column| (20..100).step_by(10).map(move |row| (column, row))) {
        let (pixel, z) = (glam::Vec2::new(column as f32, row as f32), first.depth()[(column, row)]);
        let point = second
            .world_from_camera()
            .to_camera(first.world_from_camera().to_world(first.intrinsics().unproject(pixel, z)));
        let seen = second.intrinsics().project(point).map(glam::Vec2::round);
        if let Some(seen) =
            seen.filter(|seen| z > 0.0 && seen.cmpge(glam::Vec2::ZERO).all() && seen.x < 160.0 && seen.y < 120.0)
        {
            distances.push((second.depth()[(seen.x as usize, seen.y as usize)] - point.z).abs());
        }
    }
    distances.sort_by(f32::total_cmp);
    assert!(distances.len() > 50 && distances[distances.len() / 2] < 0.03, "{distances:?}");
}

#[test]
fn the_page_shows_the_examples_files() {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/FOLDER_FORMAT.md")).unwrap();
    let unindented: String = page.lines().map(|line| line.trim_start_matches("   ").to_owned() + "\n").collect();
    for (file, text) in [("camera.json", &page), ("poses.txt", &unindented)] {
        let content = fs::read_to_string(example().join(file)).unwrap();
        assert!(text.contains(&content), "{file}:\n{content}");
    }
}

#[test]
fn poses_belong_to_images_in_order_of_names_where_numbers_count() {
    let folder = folder(&["10", "9", "100"], &tum_lines(&["0.0", "0.1", "0.2"]));
    assert_eq!(frames(open(folder.path()).as_ref()), named(&[("9", 1.0), ("10", 2.0), ("100", 3.0)]));
    assert_eq!(open(folder.path()).read_frame(2).unwrap().timestamp(), Some(Duration::from_millis(200)));
}

#[test]
fn matrices_are_read_in_one_line_or_four() {
    let rotation = Mat4::from_rotation_translation(Quat::from_rotation_y(0.5), Vec3::new(7.0, 8.0, 9.0));
    let rows = |end: &str| {
        let row = |row: usize| rotation.row(row).to_array().map(|entry| entry.to_string()).join(" ") + end;
        (0..4).map(row).collect::<String>()
    };
    let in_four_lines = format!("# poses\n\n{}\n\n{}", rows("\n"), rows("\r\n"));
    let in_one_line = format!("{}\n{}\n", rows(" "), rows(", "));
    for text in [in_four_lines, in_one_line] {
        let folder = folder(&["a", "b"], &text);
        let pose = *open(folder.path()).read_frame(1).unwrap().world_from_camera();
        assert!(pose.to_matrix().abs_diff_eq(rotation.as_dmat4(), 1e-6));
    }
    let three_rows = folder(&["a"], "1 0 0 0\n0 1 0 0\n0 0 1 0\n");
    assert_eq!(refused(three_rows.path()), "SCENE/poses.txt: last matrix, from line 1: found 3 rows, expected 4");
}

#[test]
fn images_named_after_times_take_the_nearest_pose() {
    let poses = tum_lines(&["100.00", "100.31", "100.33", "100.66", "100.50"]);
    let folder = folder(&["100.333", "100.0", "100.67", "100.9"], &poses);
    let scene = open(folder.path());
    let expected = [("100.0", Some(1.0)), ("100.333", Some(3.0)), ("100.67", Some(4.0)), ("100.9", None)];
    assert_eq!(recorded(scene.as_ref()), expected.map(|(name, x)| (name.to_owned(), x)));
    assert!(scene.left_out().is_empty() && scene.has_poses());
    assert_eq!(without_pose(scene.as_ref()), [(1, "without a pose within 0.02 s of their time")]);
    assert_eq!(scene.read_frame(1).unwrap().timestamp(), Some(Duration::from_secs_f64(100.333)));
}

#[test]
fn names_in_nanoseconds_are_times_too() {
    let names = ["1700000000500000000", "1700000000000000000"];
    let poses = tum_lines(&["1700000000.0", "1700000000.2", "1700000000.505"]);
    let expected = named(&[(names[1], 1.0), (names[0], 3.0)]);
    assert_eq!(frames(open(folder(&names, &poses).path()).as_ref()), expected);
    let poses = tum_lines(&["1700000000000000000", "1700000000200000000", "1700000000505000000"]);
    assert_eq!(frames(open(folder(&names, &poses).path()).as_ref()), expected);
}

#[test]
fn frames_without_all_parts_are_counted() {
    let poses =
        "0 1 0 0 0 0 0 1\n1 nan nan nan nan nan nan nan\n2 3 0 0 0 0 0 1\n3 -inf 0 0 0 0 0 1\n4 5 0 0 0 0 0 1\n";
    let folder = folder(&["0", "1", "2", "3", "4"], poses);
    fs::remove_file(folder.path().join("depth/0.png")).unwrap();
    fs::rename(folder.path().join("depth/1.png"), folder.path().join("depth/extra.png")).unwrap();
    // Neither desktop metadata nor other files are images.
    for name in ["color/.DS_Store", "color/._2.jpg", "color/notes.txt", "depth/2.tiff"] {
        fs::write(folder.path().join(name), "x").unwrap();
    }
    fs::rename(folder.path().join("color/4.jpg"), folder.path().join("color/4.JPEG")).unwrap();
    let scene = open(folder.path());
    let expected = [("2", Some(3.0)), ("3", None), ("4", Some(5.0))];
    assert_eq!(recorded(scene.as_ref()), expected.map(|(name, x)| (name.to_owned(), x)));
    let expected = [(2, "without a depth image of the same name"), (1, "without a colour image of the same name")];
    assert_eq!(left_out(scene.as_ref()), expected);
    let expected = [(1, "whose pose in poses.txt is NaN or infinite: tracking was lost")];
    assert_eq!(without_pose(scene.as_ref()), expected);
}

#[test]
fn another_number_of_poses_is_refused() {
    let three = folder(&["0", "1", "2"], &tum_lines(&["0", "1"]));
    assert_eq!(refused(three.path()), "SCENE/poses.txt: number of poses: found 2, expected 3, as color/ has 3 images");
    let none = folder(&["0.0", "1.0"], "# nothing\n");
    assert!(refused(none.path()).contains("number of poses: found 0, expected 2"));
    let more = folder(&["0", "1"], &tum_lines(&["0", "1", "2"]));
    assert_eq!(refused(more.path()), "SCENE/poses.txt: number of poses: found 3, expected 2, as color/ has 2 images");
}

#[test]
fn poses_or_images_without_times_are_reported() {
    let matrices = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n".repeat(3);
    let no_times = folder(&["0.0", "1.0"], &matrices);
    assert_eq!(
        refused(no_times.path()),
        "SCENE/poses.txt: poses: found no times, expected a time, as in the names of other images (3 poses for 2 images \
         cannot be assigned in order)"
    );
    let cover = folder(&["0.0", "1.0", "cover"], &tum_lines(&["0.0", "1.0"]));
    assert_eq!(
        refused(cover.path()),
        "SCENE/color/cover.jpg: name: found \"cover\", expected a time, as in the names of other images (2 poses for 3 \
         images cannot be assigned in order)"
    );
    let elsewhere = folder(&["0.0", "1.0"], &tum_lines(&["100.0", "101.5"]));
    assert_eq!(
        refused(elsewhere.path()),
        "SCENE/poses.txt: times of the poses: found 100.000 to 101.500 s, expected those of the images, 0.000 to 1.000 s; \
         without this file, the scene has no poses"
    );
}

#[test]
fn invalid_poses_are_reported_with_their_line() {
    let told = |poses: &str| refused(folder(&["a", "b"], poses).path());
    let good = "0 0 0 0 0 0 0 1\n";
    assert_eq!(
        told("1 2 3\n"),
        "SCENE/poses.txt: line 1: found \"1 2 3\", expected 8 numbers (time tx ty tz qx qy qz qw), 16 (a 4x4 matrix) or 4 \
         (a row of a 4x4 matrix)"
    );
    assert!(
        told(&format!("# a\n{good}0 0 0 0 0 0 1\n")).contains("line 3: found \"0 0 0 0 0 0 1\", expected 8 numbers")
    );
    assert!(told(&format!("{good}0 0 0 x 0 0 0 1\n")).contains("line 2"));
    assert!(told(&format!("{good}nan 0 0 0 0 0 0 1\n")).contains("line 2: found"));
    // Position and quaternion swapped.
    let swapped = told(&format!("{good}0 0 0 0 1 4.5 2.5 1\n"));
    assert!(swapped.contains("line 2: found") && swapped.contains("(this one has length 5.339)"), "{swapped}");
    let not_rigid = told("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n");
    assert!(not_rigid.starts_with("SCENE/poses.txt: line 2: the pose is not a rigid transform"), "{not_rigid}");
    let transposed = told("1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n");
    assert!(transposed.contains("line 1: the pose's last row is 5 6 7 1, expected 0 0 0 1"), "{transposed}");
}

#[test]
fn invalid_cameras_are_reported() {
    let told = |from: &str, to: &str| {
        let folder = folder(&["a"], &tum_lines(&["0"]));
        assert!(CAMERA.contains(from));
        fs::write(folder.path().join("camera.json"), CAMERA.replace(from, to)).unwrap();
        refused(folder.path())
    };
    let unknown = told("\"fx\"", "\"f_x\"");
    assert!(
        unknown.starts_with("SCENE/camera.json: unknown key \"f_x\", did you mean fx: the keys are width, "),
        "{unknown}"
    );
    for similar in ["depth_scales", "DepthScale", "depth_unit_per_meter"] {
        assert!(told("depth_scale", similar).contains("did you mean depth_scale: "), "{similar}");
    }
    let twice = told("5000", r#"5000, "depth_units_per_metre": 5000"#);
    assert!(twice.contains("duplicate field `depth_scale`"), "{twice}");
    assert!(told("depth_scale", "zzz").contains("unknown key \"zzz\": the keys are"));
    assert!(told("\"fx\": 20, ", "").contains("missing field `fx`"));
    assert!(told("\"fx\": 20", "\"fx\": 20, \"fx\": 21").contains("duplicate field `fx`"));
    assert!(told("\"fx\": 20", "\"fx\": NaN").contains("SCENE/camera.json: "));
    assert!(told("\"fx\": 20", "\"fx\": -20").contains("focal lengths must be positive"));
    for (wrong, found) in [("0", "0.0"), ("1e38", "1e38"), ("-5000", "-5000.0")] {
        let expected = format!("depth_scale: found {found}, expected 0.001 to 1000000 stored units per metre");
        assert!(told("5000", wrong).contains(&expected), "{}", told("5000", wrong));
    }
    assert!(told("5000", "1e99").starts_with("SCENE/camera.json: "));
    let lens = |text: &str| told("5000", &format!("5000, {text}"));
    assert!(lens(r#""distortion_model": "brown""#).contains("distortion model: found \"brown\", expected plumb_bob"));
    assert!(lens(r#""distortion_coefficients": [1, 2, 3, 4]"#).contains("distortion_model: found nothing"));
    assert!(
        lens(r#""distortion_model": "equidistant", "distortion_coefficients": [1, 2, 3]"#).contains("found 3 of them")
    );
    assert!(told("}", "").contains("EOF"));
    let size = told("\"width\": 24", "\"width\": 32");
    assert_eq!(size, "SCENE/color/a.jpg: the colour image has 24x16 pixels, but camera.json has 32x16");
    // The undistortion map is only created once an image has confirmed its size.
    let huge = told(
        "\"width\": 24",
        r#""distortion_model": "plumb_bob", "distortion_coefficients": [1, 2, 3, 4],
        "width": 1000000000"#,
    );
    assert!(huge.contains("camera.json has 1000000000x16"), "{huge}");
}

#[test]
fn images_of_different_sizes_are_reported() {
    let folder = folder(&["a", "b"], &tum_lines(&["0", "1"]));
    write_color(&folder.path().join("color/b.jpg"), 12, 8);
    let error = open(folder.path()).read_frame(1).unwrap_err().to_string();
    assert!(error.ends_with("b.jpg: the colour image has 12x8 pixels, but camera.json has 24x16"), "{error}");
    write_png16(&folder.path().join("depth/a.png"), (12, 8), |_, _| 1);
    let error = open(folder.path()).read_frame(0).unwrap_err().to_string();
    assert!(error.ends_with("a.png: the depth image has 12x8 pixels, but its colour image has 24x16"), "{error}");
    write_color(&folder.path().join("color/a.png"), 24, 16);
    assert_eq!(refused(folder.path()), "SCENE/color: image a: found a.jpg and a.png, expected one file of this name");
}

#[test]
fn a_folder_without_any_complete_frame_is_reported() {
    let folder = folder(&["a"], &tum_lines(&["0"]));
    fs::rename(folder.path().join("depth/a.png"), folder.path().join("depth/a_depth.png")).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("frames: found none with colour and depth (the"), "{error}");
    assert!(error.contains("the first images are color/a.jpg and depth/a_depth.png"), "{error}");
    fs::remove_file(folder.path().join("depth/a_depth.png")).unwrap();
    assert_eq!(refused(folder.path()), "SCENE/depth: no frames: looked for <name>.png, .tiff, .npy, .exr or .pfm");
}

#[test]
fn it_is_not_mistaken_for_scannet_nor_scannet_for_it() {
    for part in ["color", "depth"] {
        let folder = folder(&["0"], &tum_lines(&["0"]));
        fs::remove_dir_all(folder.path().join(part)).unwrap();
        let told = || open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
        let expected = format!("looks like a scene of format folder, but this is missing: {part}/ (");
        assert!(told().contains(&expected), "{}", told());
        // Also without the optional parts.
        for part in ["camera.json", "poses.txt"] {
            fs::remove_file(folder.path().join(part)).unwrap();
        }
        assert!(told().contains(&expected), "{}", told());
    }
    let scannet = tempfile::tempdir().unwrap();
    write_scannet(scannet.path(), 1, &ScannetSizes { color: (24, 16), depth: (24, 16), labels: (24, 16) });
    assert_eq!(open(scannet.path()).format(), Some(Format::Scannet));
    let as_folder = DatasetSettings::default().with(|settings| settings.format = Format::Folder);
    let error = open_scene(scannet.path(), &as_folder).unwrap_err();
    assert!(matches!(error, DatasetError::NoCamera { file: "camera.json", .. }), "{error}");
    // Nor without its poses.
    fs::remove_dir_all(scannet.path().join("pose")).unwrap();
    assert_eq!(open(scannet.path()).format(), Some(Format::Scannet));
}

#[test]
fn images_of_a_lens_are_undistorted() {
    let folder = folder(&["a"], &tum_lines(&["0"]));
    let coefficients = [0.2, -0.1, 0.001, 0.002];
    let lens = Distortion::from_coefficients("plumb_bob", &coefficients).unwrap();
    // Depth and colour are ramps over the pixels of the pinhole camera.
    let ramp = |column: usize, row: usize| {
        let point = glam::dvec2((column as f64 - 11.5) / 20.0, (row as f64 - 7.5) / 21.0);
        let seen = lens.undistort(point).unwrap();
        DVec3::new(20.0 * seen.x + 11.5, 21.0 * seen.y + 7.5, 0.0)
    };
    let color = Image::from_fn(24, 16, |column, row| ramp(column, row).to_array().map(|at| (at * 10.0).round() as u8));
    let depth = Image::from_fn(24, 16, |column, row| ramp(column, row).x as f32 * 0.1 + 1.0);
    // PNG avoids JPEG losses. The decoder ignores the extension.
    fs::write(folder.path().join("color/a.jpg"), png_color_bytes(&color)).unwrap();
    fs::write(folder.path().join("depth/a.png"), png_depth_bytes(&depth, 5000.0)).unwrap();
    let camera = CAMERA.replace(
        "5000",
        r#"5000, "distortion_model": "plumb_bob", "distortion_coefficients": [0.2, -0.1, 0.001, 0.002]"#,
    );
    let distorted = open(folder.path()).read_frame(0).unwrap();
    fs::write(folder.path().join("camera.json"), camera).unwrap();
    let frame = open(folder.path()).read_frame(0).unwrap();
    for (column, row) in [(2, 3), (11, 8), (21, 13), (20, 2)] {
        let [r, g, _] = frame.color()[(column, row)].map(f32::from);
        assert!(
            (r - 10.0 * column as f32).abs() < 2.5 && (g - 10.0 * row as f32).abs() < 2.5,
            "{column} {row}: {r} {g}"
        );
        let z = frame.depth()[(column, row)];
        assert!((z - (1.0 + 0.1 * column as f32)).abs() < 0.08, "{column} {row}: {z}");
    }
    assert!(distorted.color()[(2, 3)][0].abs_diff(20) > 3, "the lens distorts");
    assert_eq!(frame.intrinsics(), distorted.intrinsics());
    let zeros =
        CAMERA.replace("5000", r#"5000, "distortion_model": "plumb_bob", "distortion_coefficients": [0, 0, 0, 0]"#);
    fs::write(folder.path().join("camera.json"), zeros).unwrap();
    assert_eq!(open(folder.path()).read_frame(0).unwrap(), distorted, "no distortion, the same bytes");
}

#[test]
#[cfg(unix)]
fn special_files_are_not_read() {
    let folder = folder(&["a"], &tum_lines(&["0"]));
    assert_special_files_are_refused(folder.path(), folder.path());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn damaged_folders_never_panic(
        part in prop::sample::select(vec!["camera.json", "poses.txt", "color/0001.jpg", "depth/0001.png"]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in any::<prop::sample::Index>(),
    ) {
        let place = tempfile::tempdir().unwrap();
        let room = support::recording::recording("synthetic:frames=2,width=24,height=16,seed=3");
        for name in ["color", "depth"] {
            fs::create_dir(place.path().join(name)).unwrap();
        }
        for (index, (frame, _)) in room.iter().enumerate() {
            fs::write(place.path().join(format!("color/{index:04}.jpg")), jpeg_bytes(frame.color())).unwrap();
            fs::write(place.path().join(format!("depth/{index:04}.png")), png_depth_bytes(frame.depth(), 5000.0)).unwrap();
        }
        let lens = r#"5000, "distortion_model": "plumb_bob", "distortion_coefficients": [0.1, -0.1, 0.0, 0.0]"#;
        fs::write(place.path().join("camera.json"), CAMERA.replace("5000", lens)).unwrap();
        fs::write(place.path().join("poses.txt"), tum_lines(&["0", "1"])).unwrap();
        let path = place.path().join(part);
        fs::write(&path, damaged(fs::read(&path).unwrap(), &changes, &keep)).unwrap();
        match FolderScene::open(place.path(), &DatasetSettings::default()) {
            Ok(scene) => for index in 0..scene.frame_count() {
                if let Err(error) = scene.read_frame(index) {
                    let error = error.to_string();
                    prop_assert!(error.contains(part) || part == "camera.json", "{}", error);
                }
            },
            Err(error) => prop_assert!(error.to_string().contains(&place.path().display().to_string()), "{}", error),
        }
    }

    #[test]
    fn any_text_as_poses_gives_frames_or_an_error(text in "[0-9eE.naif+\\-# \t,\n]{0,200}") {
        let folder = folder(&["a", "b"], &text);
        if let Ok(scene) = FolderScene::open(folder.path(), &DatasetSettings::default()) {
            prop_assert!(scene.frame_count() > 0);
        }
    }
}

#[test]
fn names_and_poses_may_have_times_in_any_unit() {
    let names =
        |factor: u64| [1_305_031_102_100u64, 1_305_031_102_133, 1_305_031_102_167].map(|ms| (ms * factor).to_string());
    for factor in [1, 1000, 1_000_000] {
        let names = names(factor);
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        for times in
            [["1305031102.1", "1305031102.133", "1305031102.167"], ["1305031102100", "1305031102133", "1305031102167"]]
        {
            let folder = folder(&names, &tum_lines(&times));
            let expected = [(names[0], 1.0), (names[1], 2.0), (names[2], 3.0)];
            assert_eq!(frames(open(folder.path()).as_ref()), named(&expected), "{names:?} {times:?}");
            let time = open(folder.path()).read_frame(1).unwrap().timestamp().unwrap();
            assert!((time.as_secs_f64() - 1_305_031_102.133).abs() < 1e-6, "{time:?}");
        }
    }
    let told = refused(folder(&["a"], &tum_lines(&["8e18"])).path());
    assert!(told.starts_with("SCENE/poses.txt: line 1: found the time 8e18, which is after 2038"), "{told}");
}

#[test]
fn files_of_other_systems_are_read_or_named() {
    let folder = folder(&["a"], &tum_lines(&["0"]));
    let write = |name: &str, bytes: Vec<u8>| fs::write(folder.path().join(name), bytes).unwrap();
    let utf16 = |text: &str| format!("\u{FEFF}{text}").encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
    let camera = *open(folder.path()).read_frame(0).unwrap().intrinsics();
    write("poses.txt", utf16("0 1 0 0 0 0 0 1\r\n"));
    for text in [utf16(CAMERA), format!("\u{FEFF}{CAMERA}").into_bytes()] {
        write("camera.json", text);
        assert_eq!(*open(folder.path()).read_frame(0).unwrap().intrinsics(), camera);
    }
    write("camera.json", CAMERA.replace("11.5", "11,5").into_bytes());
    let told = refused(folder.path());
    assert!(told.starts_with("SCENE/camera.json: line 1: found decimal commas in "), "{told}");
    write("camera.json", CAMERA.into());
    write("poses.txt", b"# time tx, ty\n0 1,5 0 0 0 0 0 1\n".to_vec());
    let told = refused(folder.path());
    assert!(told.starts_with("SCENE/poses.txt: line 2: found decimal commas in \"0 1,5 0"), "{told}");
}

#[test]
fn an_unknown_camera_is_an_error_that_suggests_its_focal_length() {
    const TEST: &str = "an_unknown_camera_is_an_error_that_suggests_its_focal_length";
    let Some(room) = shared("data/rooms/dev-a", TEST) else { return };
    let intrinsics = fs::read_to_string(room.join("intrinsic/intrinsic_depth.txt")).unwrap();
    let fx: f64 = intrinsics.split_whitespace().next().unwrap().parse().unwrap();
    let scene = tempfile::tempdir().unwrap();
    for part in ["color", "depth", "pose"] {
        fs::create_dir(scene.path().join(part)).unwrap();
        for name in file_names(&room.join(part)) {
            fs::copy(room.join(part).join(&name), scene.path().join(part).join(&name)).unwrap();
        }
    }
    for format in [Format::Scannet, Format::Folder] {
        let settings = DatasetSettings::default().with(|settings| settings.format = format);
        let error = open_scene(scene.path(), &settings).unwrap_err();
        assert!(error.to_string().contains("with --fx; the motion in the images suggests "), "{error}");
        let DatasetError::NoCamera { estimate: Some(estimate), .. } = error else { panic!("{error}") };
        assert!(estimate.estimated && (estimate.from..=estimate.to).contains(&fx), "{fx}: {estimate:?}");
    }
}

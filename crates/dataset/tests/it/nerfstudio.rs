//! nerfstudio's `transforms.json`.

use crate::support::phones::*;
use crate::support::recording::{png_color_bytes, png_depth_bytes};
use crate::support::*;
use serde_json::{Value, json};
use splatseg_dataset::{DatasetSettings, Format, PoseConvention, Undistortion, open_scene};
use splatseg_geometry::{Distortion, Intrinsics, RgbdFrame};
use std::fs;
use std::path::Path;

const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 61.0, cx: 30.0, cy: 24.5, width: 64, height: 48 };

fn matrix(frame: &RgbdFrame) -> Value {
    let rows = opengl_matrix(frame).transpose().to_cols_array_2d();
    json!(rows)
}

/// The camera as nerfstudio counts pixels: from the corner of the image.
fn camera_fields() -> Value {
    json!({"fl_x": 60.0, "fl_y": 61.0, "cx": 30.5, "cy": 25.0, "w": 64, "h": 48, "camera_model": "OPENCV"})
}

/// Writes a scene with one camera for all frames. They are listed backwards.
fn write(folder: &Path, change: impl Fn(&mut Value)) {
    fs::create_dir_all(folder.join("images")).unwrap();
    fs::create_dir_all(folder.join("depth")).unwrap();
    let mut list = Vec::new();
    for (index, frame) in frames().iter().enumerate().rev() {
        fs::write(folder.join(format!("images/frame_{index}.png")), png_color_bytes(frame.color())).unwrap();
        fs::write(folder.join(format!("depth/frame_{index}.png")), png_depth_bytes(frame.depth(), 1000.0)).unwrap();
        list.push(json!({
            "file_path": format!("./images/frame_{index}.png"),
            "depth_file_path": format!("depth/frame_{index}.png"),
            "transform_matrix": matrix(frame),
            "colmap_im_id": index,
        }));
    }
    let mut file = camera_fields();
    file["frames"] = json!(list);
    file["applied_transform"] = json!([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]);
    change(&mut file);
    fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
}

fn scene(change: impl Fn(&mut Value)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), change);
    folder
}

#[test]
fn frames_are_sorted_by_name_with_exact_pixels_and_turned_axes() {
    let folder = scene(|_| ());
    for path in [folder.path().to_owned(), folder.path().join("transforms.json")] {
        let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
        assert_eq!((scene.format(), scene.frame_count(), scene.has_poses()), (Some(Format::Nerfstudio), 3, true));
        for (index, written) in frames().iter().enumerate() {
            let read = scene.read_recorded(index).unwrap();
            assert_eq!((read.frame.name(), *read.frame.intrinsics()), (&*format!("frame_{index}"), CAMERA));
            assert_eq!(read.frame.color().pixels(), written.color().pixels());
            let depth = read.frame.depth().pixels().iter().zip(written.depth().pixels());
            assert!(depth.into_iter().all(|(read, written)| (read - written).abs() <= 0.000_501));
            assert_pose(read.world_from_camera, written.world_from_camera());
        }
    }
}

#[test]
fn each_value_of_the_camera_is_global_or_of_each_frame() {
    let folder = scene(|file| {
        for key in ["fl_x", "cx", "w", "h"] {
            file.as_object_mut().unwrap().remove(key);
        }
        for (index, frame) in file["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
            frame["fl_x"] = json!(50 + index);
            frame["cx"] = json!(20.5 + index as f64);
            // The global one counts.
            frame["fl_y"] = json!(1);
        }
    });
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    // The list is backwards.
    for (index, fx, cx) in [(0, 52.0, 22.0), (1, 51.0, 21.0), (2, 50.0, 20.0)] {
        let read = *scene.read_recorded(index).unwrap().frame.intrinsics();
        assert_eq!(read, Intrinsics { fx, cx, ..CAMERA }, "{index}");
    }
}

#[test]
fn a_field_of_view_is_enough() {
    let folder = scene(|file| {
        for key in ["fl_x", "fl_y", "cx", "cy", "w", "h", "camera_model"] {
            file.as_object_mut().unwrap().remove(key);
        }
        file["camera_angle_x"] = json!(2.0 * (32.0_f64 / 60.0).atan());
        for frame in file["frames"].as_array_mut().unwrap() {
            let path = frame["file_path"].as_str().unwrap().trim_end_matches(".png").to_owned();
            frame["file_path"] = json!(path);
        }
    });
    let read =
        *open_scene(folder.path(), &DatasetSettings::default()).unwrap().read_recorded(0).unwrap().frame.intrinsics();
    assert!((read.fx - 60.0).abs() < 1e-4 && read.fx == read.fy && (read.cx, read.cy) == (31.5, 23.5), "{read:?}");
}

#[test]
fn the_unit_of_depth_is_millimetres_unless_stated() {
    let depth = |folder: &tempfile::TempDir, settings: &DatasetSettings| {
        open_scene(folder.path(), settings).unwrap().read_recorded(0).unwrap().frame.depth()[(20, 20)]
    };
    let (plain, stated) = (scene(|_| ()), scene(|file| file["depth_unit_scale_factor"] = json!(0.0005)));
    let none = DatasetSettings::default();
    let own = none.clone().with(|settings| settings.depth_scale = Some(4000.0));
    let metres = depth(&plain, &none);
    assert!((depth(&stated, &none) - metres / 2.0).abs() < 1e-6);
    assert!((depth(&stated, &own) - metres / 4.0).abs() < 1e-6 && (depth(&plain, &own) - metres / 4.0).abs() < 1e-6);
    let absurd = scene(|file| file["depth_unit_scale_factor"] = json!(0));
    assert!(refused(absurd.path()).contains("transforms.json: depth_unit_scale_factor: found inf"));
}

#[test]
fn lenses_are_undistorted() {
    let coefficients = [0.1, -0.02, 0.001, -0.002, 0.01];
    let folder = scene(|file| {
        for (key, value) in ["k1", "k2", "p1", "p2", "k3"].iter().zip(coefficients) {
            file[*key] = json!(value);
        }
    });
    let lens = Distortion::from_coefficients("plumb_bob", &coefficients).unwrap();
    let map = Undistortion::new(&CAMERA, &lens, Path::new("a")).unwrap().unwrap();
    let read = open_scene(folder.path(), &DatasetSettings::default()).unwrap().read_recorded(1).unwrap().frame;
    assert_eq!(read.color().pixels(), map.color(frames()[1].color(), Path::new("a")).unwrap().pixels());
    let fisheye = scene(|file| {
        (file["camera_model"], file["k1"], file["k4"]) = (json!("OPENCV_FISHEYE"), json!(0.05), json!(0.001));
    });
    let lens = Distortion::from_coefficients("equidistant", &[0.05, 0.0, 0.0, 0.001]).unwrap();
    let map = Undistortion::new(&CAMERA, &lens, Path::new("a")).unwrap().unwrap();
    let read = open_scene(fisheye.path(), &DatasetSettings::default()).unwrap().read_recorded(1).unwrap().frame;
    assert_eq!(read.color().pixels(), map.color(frames()[1].color(), Path::new("a")).unwrap().pixels());
}

#[test]
fn colour_is_taken_at_the_scale_of_smaller_depth() {
    let folder = scene(|_| ());
    for (index, frame) in frames().iter().enumerate() {
        let depth = small_millimetres(frame);
        let size = (DEPTH_SIZE.0 as u32, DEPTH_SIZE.1 as u32);
        write_png16(&folder.path().join(format!("depth/frame_{index}.png")), size, |x, y| {
            depth[(x as usize, y as usize)]
        });
    }
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!(scene.stored_color_size(0), Some((64, 48)));
    let read = scene.read_recorded(2).unwrap().frame;
    let expected = expected(&frames()[2], CAMERA);
    assert_eq!((read.color().pixels(), *read.intrinsics()), (&*expected.color, expected.intrinsics));
}

#[test]
fn settings_apply() {
    let folder = scene(|_| ());
    let settings = DatasetSettings::default().with(|settings| {
        (settings.fx, settings.pose_scale) = (Some(70.0), 0.1);
        settings.pose_convention = PoseConvention::WorldToCamera;
    });
    let read = open_scene(folder.path(), &settings).unwrap().read_recorded(1).unwrap();
    assert_eq!(*read.frame.intrinsics(), Intrinsics { fx: 70.0, fy: 70.0, cx: 31.5, cy: 23.5, ..CAMERA });
    assert_pose(read.world_from_camera, &frames()[1].world_from_camera().scaled(0.1).inverse());
}

#[test]
fn frames_without_depth_are_left_out_and_lost_poses_are_none() {
    let folder = scene(|file| {
        file["frames"][0].as_object_mut().unwrap().remove("depth_file_path");
    });
    let scene_read = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene_read.frame_count(), scene_read.left_out()[0].count), (2, 1));
    assert_eq!(scene_read.left_out()[0].what, "without depth_file_path");
    let none = scene(|file| {
        for frame in file["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("depth_file_path");
        }
    });
    assert_eq!(
        refused(none.path()),
        "SCENE/transforms.json: frames: found 3, none of them with depth_file_path, expected frames with depth"
    );
}

#[test]
fn wrong_values_are_named() {
    let told = |change: fn(&mut Value)| refused(scene(change).path());
    let outside = told(|file| file["frames"][0]["file_path"] = json!("../frame_2.png"));
    assert!(outside.contains("file_path: found \"../frame_2.png\", expected a path inside the folder"), "{outside}");
    let rows = told(|file| file["frames"][0]["transform_matrix"] = json!([[1, 0, 0, 0], [0, 1, 0, 0]]));
    assert!(rows.contains("frame_2.png: transform_matrix: found 2 rows, expected a 4x4 or 3x4 matrix"), "{rows}");
    let scaled = told(|file| file["frames"][0]["transform_matrix"][0] = json!([2, 0, 0, 0]));
    assert!(scaled.contains("frame_2.png: the pose is not a rigid transform"), "{scaled}");
    let model = told(|file| file["camera_model"] = json!("EQUIRECTANGULAR"));
    assert!(model.contains("camera_model: found \"EQUIRECTANGULAR\", expected OPENCV"), "{model}");
    let size = told(|file| file["w"] = json!(640));
    assert!(size.contains("the colour image has 64x48 pixels, but its camera has 640x48"), "{size}");
    let focal = told(|file| file["fl_x"] = json!(null));
    assert!(focal.contains("fl_x: found nothing, here or at the top of the file"), "{focal}");
    let missing = told(|file| file["frames"][0]["depth_file_path"] = json!("depth/other.png"));
    assert!(missing.ends_with("depth/other.png: the depth image is missing"), "{missing}");
}

#[test]
fn damage_is_told() {
    let folder = scene(|_| ());
    assert_damage_is_told(folder.path(), folder.path());
}

/// Real images, written as `transforms.json`, give the frames of the folder they come from.
#[test]
fn a_real_recording_is_the_same_as_in_its_own_format() {
    let Some(source) = shared_data("nerfstudio", "kitchen-dev") else { return };
    let original = open_scene(&source, &DatasetSettings::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut list = Vec::new();
    let mut camera = None;
    for index in 0..original.frame_count() {
        let frame = original.read_frame(index).unwrap();
        let name = original.frame_name(index);
        for (from, to, ending) in [("color", "images", "jpg"), ("depth", "depths", "png")] {
            fs::create_dir_all(folder.path().join(to)).unwrap();
            let to = folder.path().join(format!("{to}/frame_{index:05}.{ending}"));
            fs::copy(source.join(format!("{from}/{name}.{ending}")), to).unwrap();
        }
        list.push(json!({
            "file_path": format!("images/frame_{index:05}.jpg"),
            "depth_file_path": format!("depths/frame_{index:05}.png"),
            "transform_matrix": matrix(&frame),
        }));
        camera.get_or_insert(*frame.intrinsics());
    }
    let Intrinsics { fx, fy, cx, cy, width, height } = camera.unwrap();
    let file = json!({
        "fl_x": fx, "fl_y": fy, "cx": f64::from(cx) + 0.5, "cy": f64::from(cy) + 0.5, "w": width, "h": height, "frames": list,
    });
    fs::write(folder.path().join("transforms.json"), file.to_string()).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!(scene.frame_count(), original.frame_count());
    for index in 0..scene.frame_count() {
        let (read, written) = (scene.read_recorded(index).unwrap(), original.read_recorded(index).unwrap());
        assert_eq!(read.frame.color(), written.frame.color());
        assert_eq!(read.frame.depth(), written.frame.depth());
        assert_eq!(read.frame.intrinsics(), written.frame.intrinsics());
        assert_pose(read.world_from_camera, &written.world_from_camera.unwrap());
    }
}

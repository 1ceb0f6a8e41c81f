//! Recordings whose camera infos are empty, broken or missing, and depth of 8 bits. The same from a file and as a stream.

use crate::support::mcap::{FRAME_NS, McapWriter, OPTICAL, START, camera_transform, depth_bytes, header, info, raw};
use crate::support::recording::{jpeg_bytes, png_depth_bytes, recording};
use crate::support::two_ways::{Found, read};
use crate::support::warnings::with_warnings;
use splatseg_dataset::{DatasetSettings, DepthRegistration, RecordingScene, Scene};
use splatseg_geometry::{Intrinsics, RgbdFrame};
use splatseg_ros::{CameraInfo, CompressedImage};
use std::sync::OnceLock;

fn frames() -> &'static [RgbdFrame<'static>] {
    static ROOM: OnceLock<Vec<RgbdFrame<'static>>> = OnceLock::new();
    ROOM.get_or_init(|| {
        recording("synthetic:frames=3,width=16,height=12,seed=3").into_iter().map(|(frame, _)| frame).collect()
    })
}

fn camera() -> Intrinsics {
    *frames()[0].intrinsics()
}

/// The messages that are recorded of a camera.
#[derive(Clone, Copy)]
struct Recorded<'a> {
    info: Option<&'a dyn Fn(i64) -> CameraInfo>,
    depth_info: Option<&'a dyn Fn(i64) -> CameraInfo>,
    depth_frame: &'a str,
    jpeg: bool,
}

const NOTHING: Recorded<'static> = Recorded { info: None, depth_info: None, depth_frame: OPTICAL, jpeg: true };

fn written(recorded: Recorded<'_>) -> Vec<u8> {
    let mut writer = McapWriter::new();
    for (frame, index) in frames().iter().zip(0..) {
        let stamp = START + index * FRAME_NS;
        writer.write("/tf", &camera_transform(stamp, "map", OPTICAL, frame), stamp);
        for (topic, info) in [("/color/camera_info", recorded.info), ("/depth/camera_info", recorded.depth_info)] {
            if let Some(info) = info {
                writer.write(topic, &info(stamp), stamp);
            }
        }
        if recorded.jpeg {
            let data = jpeg_bytes(frame.color());
            let image = CompressedImage { header: header(stamp, OPTICAL), format: "jpeg", data: &data };
            writer.write("/color/image_raw/compressed", &image, stamp);
        } else {
            let pixels = frame.color().pixels().as_flattened();
            writer.write("/color/image_raw", &raw(stamp, OPTICAL, "rgb8", (16, 12), pixels), stamp);
        }
        let data = depth_bytes(frame);
        writer.write("/depth/image_raw", &raw(stamp, recorded.depth_frame, "16UC1", (16, 12), &data), stamp);
    }
    writer.finish()
}

fn own() -> DatasetSettings {
    let Intrinsics { fx, fy, cx, cy, .. } = camera();
    DatasetSettings::default()
        .with(|s| (s.fx, s.fy, s.cx, s.cy) = (Some(fx.into()), Some(fy.into()), Some(cx.into()), Some(cy.into())))
}

fn error(bytes: &[u8]) -> String {
    read(bytes, &DatasetSettings::default()).map(|_| ()).unwrap_err()
}

fn has_camera(found: &Found) {
    assert_eq!(found.frames.len(), 3);
    for ((frame, _), expected) in found.frames.iter().zip(frames()) {
        assert_eq!(frame.intrinsics(), expected.intrinsics());
        let near = frame.depth().pixels().iter().zip(expected.depth().pixels()).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(near, "depth has the pixels of colour");
    }
}

/// Returns a camera info whose K and P are both `number`.
fn broken(number: f64) -> impl Fn(i64) -> CameraInfo {
    move |stamp| CameraInfo { k: [number; 9], p: [number; 12], ..info(stamp, OPTICAL, &camera()) }
}

fn whole(stamp: i64) -> CameraInfo {
    info(stamp, OPTICAL, &camera())
}

#[test]
fn the_settings_replace_a_broken_k() {
    for number in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for jpeg in [true, false] {
            let info = broken(number);
            let both = Recorded { info: Some(&info), depth_info: Some(&info), jpeg, ..NOTHING };
            let text = error(&written(both));
            assert!(
                text.starts_with("a.mcap: /color/camera_info: camera info: found K has fx ") && text.contains("--fx"),
                "{text}"
            );
            has_camera(&read(&written(both), &own()).unwrap());
            let only_color = Recorded { depth_info: Some(&whole), ..both };
            has_camera(&read(&written(only_color), &own()).unwrap());
            // Depth has the frame of colour, and so its camera.
            let only_depth = Recorded { info: Some(&whole), ..both };
            let found = read(&written(only_depth), &DatasetSettings::default()).unwrap();
            has_camera(&found);
            let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
            assert!(
                warning.starts_with("a.mcap: /depth/camera_info: K has fx ")
                    && warning.ends_with(": /color/camera_info is used instead"),
                "{warning}"
            );
        }
    }
    // The lens is broken, too, and the size is not stated.
    let info = |stamp| CameraInfo { d: vec![f64::NAN; 5], width: 0, height: 0, ..broken(f64::NAN)(stamp) };
    has_camera(&read(&written(Recorded { info: Some(&info), ..NOTHING }), &own()).unwrap());
    let unsized_info = |stamp| CameraInfo { width: 0, height: 0, ..whole(stamp) };
    let found = read(&written(Recorded { info: Some(&unsized_info), ..NOTHING }), &DatasetSettings::default());
    has_camera(&found.unwrap());
}

#[test]
fn the_settings_describe_a_camera_without_any_camera_info() {
    for (depth_frame, warnings) in [(OPTICAL, 0), ("depth_optical", 1)] {
        for jpeg in [true, false] {
            let bytes = written(Recorded { depth_frame, jpeg, ..NOTHING });
            let text = error(&bytes);
            assert!(text.ends_with("--camera-info chooses one, or --fx describes the camera"), "{text}");
            let found = read(&bytes, &own()).unwrap();
            has_camera(&found);
            assert_eq!(found.warnings.len(), warnings, "{:?}", found.warnings);
            assert!(found.sources[0].ends_with("camera dataset.fx, fy, cx and cy"), "{:?}", found.sources);
        }
    }
    // Of depth alone.
    let bytes = written(Recorded { info: Some(&whole), depth_frame: "depth_optical", ..NOTHING });
    let text = error(&bytes);
    assert!(text.ends_with("--register-depth false takes the pixels of depth for those of colour"), "{text}");
    let registered = DatasetSettings::default().with(|s| s.register_depth = DepthRegistration::False);
    has_camera(&read(&bytes, &registered).unwrap());
}

#[test]
fn p_is_used_where_k_is_empty() {
    for number in [0.0, f64::NAN] {
        let info = |stamp| CameraInfo { k: [number; 9], ..whole(stamp) };
        let bytes = written(Recorded { info: Some(&info), depth_info: Some(&whole), ..NOTHING });
        let found = read(&bytes, &DatasetSettings::default()).unwrap();
        has_camera(&found);
        let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
        assert!(
            warning.starts_with("a.mcap: /color/camera_info: K has fx ")
                && warning.contains("P is used as the camera's intrinsics; --fx"),
            "{warning}"
        );
        let found = read(&bytes, &own()).unwrap();
        has_camera(&found);
        assert_eq!(found.warnings, [""; 0]);
    }
}

/// Returns a camera info of images of another size, `(width, height)`, of the same view.
fn of_size((width, height): (usize, usize)) -> impl Fn(i64) -> CameraInfo {
    move |stamp| info(stamp, OPTICAL, &camera().resized(width, height))
}

fn only_warning(found: &Found) -> &str {
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    warning
}

#[test]
fn a_camera_info_of_another_resolution_is_scaled_and_of_another_shape_refused() {
    for jpeg in [true, false] {
        let twice = of_size((32, 24));
        let bytes = written(Recorded { info: Some(&twice), jpeg, ..NOTHING });
        let found = read(&bytes, &DatasetSettings::default()).unwrap();
        has_camera(&found);
        let warning = only_warning(&found);
        let start = "a.mcap: /color/camera_info: it is that of images of 32x24 pixels, but they have 16x12: K has fx ";
        let end = ", scaled to them; --fx (--fy, --cx, --cy) gives other ones";
        assert!(warning.starts_with(start) && warning.ends_with(end), "{warning}");
        let wide = of_size((16, 9));
        let bytes = written(Recorded { info: Some(&wide), jpeg, ..NOTHING });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        std::fs::write(&path, &bytes).unwrap();
        let scene = RecordingScene::open(&path, &DatasetSettings::default()).unwrap();
        let text = scene.read_recorded(0).unwrap_err().to_string();
        assert!(
            text.contains("colour image: found 16x12 pixels, expected 16x9, as its camera info says; --fx"),
            "{text}"
        );
        for info in [&twice as &dyn Fn(i64) -> CameraInfo, &wide] {
            let bytes = written(Recorded { info: Some(info), jpeg, ..NOTHING });
            let found = read(&bytes, &own()).unwrap();
            has_camera(&found);
            assert_eq!(found.warnings, [""; 0]);
        }
    }
    let (small, matching) = (of_size((8, 6)), whole);
    let bytes = written(Recorded { info: Some(&matching), depth_info: Some(&small), ..NOTHING });
    has_camera(&read(&bytes, &DatasetSettings::default()).unwrap());
}

#[test]
fn the_camera_info_of_depth_is_used_for_colour_with_a_warning() {
    let bytes = written(Recorded { depth_info: Some(&whole), jpeg: false, ..NOTHING });
    let found = read(&bytes, &DatasetSettings::default()).unwrap();
    has_camera(&found);
    let expected = "a.mcap: /color/image_raw has no camera info of its own: that of /depth/image_raw, /depth/camera_info, is \
                    used, as it has the same frame; --camera-info chooses one, or --fx describes the camera";
    assert_eq!(found.warnings, [expected]);
    assert_eq!(read(&bytes, &own()).unwrap().warnings, [""; 0]);
    let named = DatasetSettings::default().with(|s| s.camera_info = Some("/depth/camera_info".to_owned()));
    assert_eq!(read(&bytes, &named).unwrap().warnings, [""; 0]);
}

#[test]
fn the_settings_replace_an_unreadable_lens() {
    for (model, coefficients, expected) in [
        ("division", vec![0.1], "distortion model: found \"division\""),
        ("plumb_bob", vec![f64::NAN; 5], "number 1 is NaN"),
        ("plumb_bob", vec![0.1; 3], "found 3 of them"),
    ] {
        let info = |stamp| CameraInfo { d: coefficients.clone(), distortion_model: model.to_owned(), ..whole(stamp) };
        for depth_info in [None, Some(&info as &dyn Fn(i64) -> CameraInfo)] {
            let bytes = written(Recorded { info: Some(&info), depth_info, ..NOTHING });
            let text = error(&bytes);
            assert!(
                text.contains(expected) && text.contains("; --fx (--fy, --cx, --cy) describes the camera"),
                "{text}"
            );
            let found = read(&bytes, &own()).unwrap();
            has_camera(&found);
            let ending = ": the lens is ignored, as the settings describe the camera";
            assert!(
                found.warnings.iter().any(|text| text.contains(expected) && text.ends_with(ending)),
                "{found:?}",
                found = found.warnings
            );
        }
    }
}

#[test]
fn lenses_have_other_names_in_some_drivers() {
    let read_as = |model: &str, coefficients: &[f64]| {
        let info = |stamp| CameraInfo { d: coefficients.to_vec(), distortion_model: model.to_owned(), ..whole(stamp) };
        let found = read(&written(Recorded { info: Some(&info), ..NOTHING }), &DatasetSettings::default()).unwrap();
        assert_eq!(found.warnings, [""; 0], "{model}");
        found.frames
    };
    let rational = [0.1, 0.02, 0.0, 0.0, 0.0, 0.3, 0.01, 0.0];
    assert!(read_as("plumb_bob", &rational) == read_as("rational_polynomial", &rational));
    let angles = [0.1, 0.02, 0.0, 0.0];
    for name in ["fisheye", "kannala_brandt"] {
        assert!(read_as(name, &angles) == read_as("equidistant", &angles), "{name}");
    }
}

#[test]
fn an_empty_camera_info_among_others_is_left_out() {
    let info = |stamp| if stamp == START { broken(0.0)(stamp) } else { whole(stamp) };
    let bytes = written(Recorded { info: Some(&info), ..NOTHING });
    let found = read(&bytes, &DatasetSettings::default()).unwrap();
    has_camera(&found);
    assert!(
        found.warnings[0].starts_with("a.mcap: /color/camera_info: 1 camera infos are left out, as K has fx 0"),
        "{:?}",
        found.warnings
    );
}

#[test]
fn bytes_in_the_wrong_order_are_read_as_they_are_meant() {
    for (write, warnings) in [(u16::to_le_bytes as fn(u16) -> [u8; 2], 0), (u16::to_be_bytes, 1)] {
        let mut writer = McapWriter::new();
        for (frame, index) in frames().iter().zip(0..) {
            let stamp = START + index * FRAME_NS;
            writer.write("/color/camera_info", &whole(stamp), stamp);
            let pixels = frame.color().pixels().as_flattened();
            writer.write("/color/image_raw", &raw(stamp, OPTICAL, "rgb8", (16, 12), pixels), stamp);
            let data: Vec<u8> = (0..12 * 16).flat_map(|pixel| write(1000 + 2 * pixel)).collect();
            writer.write("/depth/image_raw", &raw(stamp, OPTICAL, "16UC1", (16, 12), &data), stamp);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        std::fs::write(&path, writer.finish()).unwrap();
        let scene = RecordingScene::open(&path, &DatasetSettings::default()).unwrap();
        let (frames, found) = with_warnings(|| [0, 1, 2].map(|index| scene.read_recorded(index).unwrap().frame));
        assert_eq!(frames.map(|frame| frame.depth()[(15, 11)]), [1.382; 3]);
        assert_eq!(found.len(), warnings, "{found:?}");
        assert!(
            found.iter().all(|text| text.contains("the bytes of the depth image have the other order")),
            "{found:?}"
        );
    }
}

/// Writes depth as these topics.
fn with_depth(topics: &[(&str, &str, bool)]) -> Vec<u8> {
    let mut writer = McapWriter::new();
    for (frame, index) in frames().iter().zip(0..) {
        let stamp = START + index * FRAME_NS;
        writer.write("/tf", &camera_transform(stamp, "map", OPTICAL, frame), stamp);
        writer.write("/color/camera_info", &whole(stamp), stamp);
        let pixels = frame.color().pixels().as_flattened();
        writer.write("/color/image_raw", &raw(stamp, OPTICAL, "rgb8", (16, 12), pixels), stamp);
        for (topic, format, is_deep) in topics {
            let mut data = if topic.ends_with("Depth") { vec![0; 12] } else { Vec::new() };
            if *is_deep {
                data.extend(png_depth_bytes(frame.depth(), 1000.0));
            } else {
                data.extend(jpeg_bytes(frame.color()));
            }
            writer.write(topic, &CompressedImage { header: header(stamp, OPTICAL), format, data: &data }, stamp);
        }
    }
    writer.finish()
}

#[test]
fn depth_of_sixteen_bits_is_preferred() {
    let jpeg = ("/depth/image_raw/compressed", "16UC1; jpeg compressed mono8", false);
    let unnamed = ("/depth/image_raw/compressed", "jpeg", false);
    let png = ("/depth/image_raw/compressedDepth", "16UC1; compressedDepth png", true);
    for topics in [[jpeg, png], [png, jpeg], [unnamed, png]] {
        let found = read(&with_depth(&topics), &DatasetSettings::default()).unwrap();
        has_camera(&found);
        let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
        assert!(
            warning.starts_with("a.mcap: /depth/image_raw/compressed has depth of 8 bits (")
                && warning.ends_with(": /depth/image_raw/compressedDepth is used"),
            "{warning}"
        );
    }
    assert_eq!(read(&with_depth(&[png]), &DatasetSettings::default()).unwrap().warnings, [""; 0]);
    let text = error(&with_depth(&[jpeg]));
    assert!(
        text.starts_with(
            "a.mcap: depth images: found none, but /color/image_raw (rgb8), /depth/image_raw/compressed (16UC1;"
        ) && text.contains("compressedDepth"),
        "{text}"
    );
    let named = DatasetSettings::default().with(|s| s.depth = Some(jpeg.0.to_owned()));
    let text = read(&with_depth(&[jpeg, png]), &named).map(|_| ()).unwrap_err();
    assert!(
        text.starts_with("a.mcap: dataset.depth: found \"/depth/image_raw/compressed\", whose images have 8 bits"),
        "{text}"
    );
}

/// Writes what the node of this project publishes, beside the images of a camera or alone.
fn with_results(camera: bool) -> Vec<u8> {
    let mut writer = McapWriter::new();
    for (frame, index) in frames().iter().zip(0..) {
        let stamp = START + index * FRAME_NS;
        writer.write("/tf", &camera_transform(stamp, "map", OPTICAL, frame), stamp);
        let pixels = frame.color().pixels().as_flattened();
        let depth = depth_bytes(frame);
        if camera {
            writer.write("/color/camera_info", &whole(stamp), stamp);
            writer.write("/color/image_raw", &raw(stamp, OPTICAL, "rgb8", (16, 12), pixels), stamp);
            writer.write("/depth/image_raw", &raw(stamp, OPTICAL, "16UC1", (16, 12), &depth), stamp);
        }
        writer.write("/splatseg/camera_info", &whole(stamp), stamp);
        let overlay = jpeg_bytes(frame.color());
        let overlay = CompressedImage { header: header(stamp, OPTICAL), format: "jpeg", data: &overlay };
        writer.write("/splatseg/overlay/compressed", &overlay, stamp);
        writer.write("/splatseg/segments", &raw(stamp, OPTICAL, "16UC1", (16, 12), &depth), stamp);
        writer.write("/robot1/splatseg/ids", &raw(stamp, OPTICAL, "16UC1", (16, 12), &depth), stamp);
    }
    writer.finish()
}

#[test]
fn results_are_not_taken_for_images_of_a_camera() {
    let found = read(&with_results(true), &DatasetSettings::default()).unwrap();
    has_camera(&found);
    let text = error(&with_results(false));
    assert!(text.starts_with("a.mcap: colour images: found none, but /splatseg/overlay/compressed (jpeg), "), "{text}");
    assert!(text.ends_with("; overlay and ids are results of splatseg, not images of a camera"), "{text}");
}

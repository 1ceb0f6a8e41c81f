//! Recordings of Azure Kinect and Orbbec Femto in Matroska: from mkvmerge, and made here where they differ.

use crate::support::mkv::{
    COLOR, COLOR_LENS, Camera, DEPTH, DEPTH_LENS, HeadPlace, MkvWriter, bitmap_header, color_from_depth, depth_bytes,
    jpeg, read, small, track, written,
};
use crate::support::two_ways;
use glam::{DVec2, DVec3, dvec2};
use splatseg_dataset::{DatasetSettings, Format, RecordingScene, RecordingSummary, has_depth, open_scene};
use splatseg_geometry::CameraFrame;
use std::fs;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings").join(name)
}

/// The most frequent depth of a frame, millimetres.
fn usual_depth(frame: &CameraFrame<'_>) -> i32 {
    let mut depths: Vec<i32> =
        frame.depth().pixels().iter().filter(|z| **z > 0.0).map(|z| (z * 1000.0).round() as i32).collect();
    depths.sort_unstable();
    depths[depths.len() / 2]
}

/// Distances along a ray from `origin` to the surfaces in the test data, of the wall and the nearest.
fn surfaces(origin: DVec3, ray: DVec3, number: usize) -> (f64, f64) {
    let wall = (2.2 + 0.3 * origin.x - origin.z) / (ray.z - 0.3 * ray.x);
    let between = origin - DVec3::new(0.15 + 0.05 * number as f64, 0.1, 1.3);
    let half = ray.dot(between);
    let root = half * half - ray.length_squared() * (between.length_squared() - 0.09);
    let ball = (-half - root.max(0.0).sqrt()) / ray.length_squared();
    (wall, if root > 0.0 { ball.min(wall) } else { wall })
}

fn color_of(place: DVec3) -> [f64; 3] {
    [3.0 * place.x, 3.0 * place.y + 1.0, 2.0 * place.z].map(|phase| 128.0 + 100.0 * phase.sin())
}

/// The difference between a frame and the scene that was rendered.
struct Difference {
    /// Mean and largest difference of colour, away from the edge of the ball.
    color: (f64, f64),
    /// Mean and largest difference of depth, metres.
    depth: (f64, f64),
    /// Part of the pixels with depth.
    covered: f64,
}

/// Width of the border at which colour may lie outside the lens's view, pixels.
const MARGIN: usize = 6;

fn difference(frame: &CameraFrame<'_>, number: usize) -> Difference {
    let (rotation, translation) = color_from_depth();
    let (to_depth, camera) = (rotation.transpose(), frame.intrinsics());
    let origin = -(to_depth * translation);
    let (mut color, mut depth) = (Vec::new(), Vec::new());
    for (row, column) in (0..frame.height()).flat_map(|row| (0..frame.width()).map(move |column| (row, column))) {
        let ray = |x: f64, y: f64| {
            let point =
                ((x - f64::from(camera.cx)) / f64::from(camera.fx), (y - f64::from(camera.cy)) / f64::from(camera.fy));
            DVec3::new(point.0, point.1, 1.0)
        };
        let (x, y) = (column as f64, row as f64);
        let seen = |x: f64, y: f64| surfaces(origin, to_depth * ray(x, y), number);
        let is_ball = |x: f64, y: f64| seen(x, y).0 != seen(x, y).1;
        let around = [(-2.0, 0.0), (2.0, 0.0), (0.0, -2.0), (0.0, 2.0)];
        if around.iter().any(|(dx, dy)| is_ball(x + dx, y + dy) != is_ball(x, y)) {
            continue;
        }
        let (_, distance) = seen(x, y);
        let pixel = frame.color()[(column, row)];
        // Black is outside the lens's view, and colour next to it is mixed with it.
        let is_inner = |at: usize, side: usize| (MARGIN..side - MARGIN).contains(&at);
        if is_inner(column, frame.width()) && is_inner(row, frame.height()) {
            let expected = color_of(origin + to_depth * ray(x, y) * distance);
            color.extend(pixel.iter().zip(expected).map(|(found, expected)| f64::from(*found) - expected));
        }
        let z = f64::from(frame.depth()[(column, row)]);
        // The ball hides parts of the wall from one of the cameras.
        if z > 0.0 && (z - distance).abs() < 0.4 {
            depth.push(z - distance);
        }
    }
    let mean = |list: &[f64]| list.iter().sum::<f64>() / list.len() as f64;
    let largest = |list: &[f64]| list.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let pixels = (frame.width() * frame.height()) as f64;
    Difference {
        color: (mean(&color), largest(&color)),
        depth: (mean(&depth), largest(&depth)),
        covered: frame.depth().pixels().iter().filter(|z| **z > 0.0).count() as f64 / pixels,
    }
}

#[test]
fn colour_and_depth_of_a_recording_are_where_they_were_rendered() {
    // Colour changes by up to 10 and 20 from pixel to pixel, and JPEG and NV12 blur that. A pixel is 3.5 and 7 cm of the wall.
    for (name, size, coverage, largest) in
        [("kinect_nfov.mkv", (160, 90), 0.55, (16.0, 0.05)), ("kinect_wfov.mkv", (80, 60), 0.9, (24.0, 0.1))]
    {
        let found = two_ways::read_path(&data(name), &DatasetSettings::default()).unwrap();
        assert_eq!(found.warnings, [""; 0], "{name}");
        assert_eq!(found.frames.len(), 3, "{name}");
        assert!(
            found.sources[1].ends_with("camera /DEPTH/camera_info, registered to colour here"),
            "{:?}",
            found.sources
        );
        let scene = open_scene(data(name), &DatasetSettings::default()).unwrap();
        assert_eq!((scene.format(), scene.has_poses()), (Some(Format::Mkv), false), "{name}");
        assert_eq!(scene.stored_color_size(0), Some(size), "{name}");
        for (number, (frame, pose)) in found.frames.iter().enumerate() {
            assert!(pose.is_none() && frame.width() < size.0, "{name}: {}", frame.width());
            let Difference { color, depth, covered } = difference(frame, number);
            assert!(color.0.abs() < 1.0 && color.1 < largest.0, "{name}: colour differs by {color:?}");
            assert!(depth.0.abs() < 0.002 && depth.1 < largest.1, "{name}: depth differs by {depth:?}");
            assert!(covered > coverage, "{name}: {covered}");
        }
    }
}

#[test]
fn a_summary_names_the_camera_and_all_tracks() {
    let summary = RecordingSummary::read(&data("kinect_nfov.mkv"), &DatasetSettings::default()).unwrap();
    assert_eq!((summary.format, summary.title), (Format::Mkv, "Matroska of Azure Kinect or Orbbec Femto"));
    let camera = "serial number 000123456789, colour MJPG_720P, depth NFOV_UNBINNED, depth 0.160 ms after colour";
    assert_eq!(summary.camera.as_deref(), Some(camera));
    assert!(summary.damage.is_empty(), "{:?}", summary.damage);
    let topics: Vec<(&str, u64)> = summary.topics.iter().map(|topic| (topic.name.as_str(), topic.messages)).collect();
    let infos = [("/COLOR/camera_info", 1), ("/DEPTH/camera_info", 1), ("/tf_static", 1)];
    assert_eq!(topics, [&[("/COLOR", 3), ("/DEPTH", 3), ("/IR", 3)][..], &infos].concat());
    let (first, last) = summary.topics[0].recorded.unwrap();
    assert_eq!((first.as_micros(), last.as_micros()), (1000, 1000 + 2 * 33_333));
}

/// Single points of depth in all modes: each is found where the colour camera sees it.
#[test]
fn points_land_where_the_colour_camera_sees_them_in_every_mode() {
    let narrow = |share: f64| Camera::new(DEPTH_LENS, (1024.0 * share, 1024.0 * share), (192.0 * share, 180.0 * share));
    let wide = |share: f64| Camera::new(DEPTH_LENS, (1024.0 * share, 1024.0 * share), (0.0, 0.0));
    for (depth_size, depth, color_size) in [
        ((640, 576), narrow(1.0), (1280, 720)),
        ((320, 288), narrow(0.5), (2048, 1536)),
        ((512, 512), wide(0.5), (1920, 1080)),
        ((1024, 1024), wide(1.0), (4096, 3072)),
    ] {
        let mut stored = vec![0u16; (depth_size.0 * depth_size.1) as usize];
        let mut points = Vec::new();
        for (row, column) in
            (10..depth_size.1).step_by(37).flat_map(|row| (10..depth_size.0).step_by(37).map(move |c| (row, c)))
        {
            let millimetres = 1000 + ((row * 7 + column * 13) % 2000) as u16;
            stored[(row * depth_size.0 + column) as usize] = millimetres;
            points.push((dvec2(column as f64, row as f64), f64::from(millimetres) / 1000.0));
        }
        let mut writer = MkvWriter::new(color_size, depth_size);
        writer.blocks = vec![(COLOR, 0, jpeg(color_size, 90)), (DEPTH, 0, depth_bytes(stored))];
        let (_folder, path) = written(&writer.bytes());
        let frame = open_scene(&path, &DatasetSettings::default()).unwrap().read_recorded(0).unwrap().frame;
        let (rotation, translation) = color_from_depth();
        let camera = *frame.intrinsics();
        let (mut expected, mut found, mut offset) = (0, 0, DVec2::ZERO);
        for (pixel, z) in points {
            let ray = depth.unproject(pixel);
            let point = rotation * (ray.extend(1.0) * z) + translation;
            let seen = DVec2::new(
                point.x / point.z * f64::from(camera.fx) + f64::from(camera.cx),
                point.y / point.z * f64::from(camera.fy) + f64::from(camera.cy),
            );
            let is_inside = seen.cmpge(dvec2(2.0, 2.0)).all()
                && seen.cmple(dvec2(camera.width as f64 - 3.0, camera.height as f64 - 3.0)).all();
            if !is_inside || !seen.is_finite() {
                continue;
            }
            expected += 1;
            // The lens enlarges pixels at the edges.
            let around = |at: f64| (at.round() as usize - 2)..=(at.round() as usize + 2);
            let is_it = |column: usize, row: usize| {
                let z = f64::from(frame.depth()[(column, row)]);
                z > 0.0 && (z - point.z).abs() < 0.01
            };
            let places: Vec<DVec2> = around(seen.y)
                .flat_map(|row| around(seen.x).map(move |column| (column, row)))
                .filter(|(column, row)| is_it(*column, *row))
                .map(|(column, row)| dvec2(column as f64, row as f64))
                .collect();
            if !places.is_empty() {
                found += 1;
                offset += places.iter().sum::<DVec2>() / places.len() as f64 - seen;
            }
        }
        let offset = offset / f64::from(found);
        // Where pixels are smaller than those of the frame, one of two neighbours is taken.
        assert!(expected > 50 && found * 10 > expected * 8, "{depth_size:?}: {found} of {expected}");
        assert!(offset.abs().max_element() < 0.2, "{depth_size:?}: {offset}");
    }
}

#[test]
fn the_test_camera_is_its_own_inverse() {
    let camera = Camera::new(COLOR_LENS, (1280.0, 960.0), (0.0, 120.0));
    for pixel in [dvec2(10.0, 20.0), dvec2(640.0, 360.0), dvec2(1270.0, 700.0)] {
        assert!((camera.project(camera.unproject(pixel)) - pixel).length() < 1e-6);
    }
}

#[test]
fn depth_is_paired_after_its_delay() {
    // Without the tag, depth of the frame before is closer by 5 ms, and the first colour image has none.
    for (tag, expected) in [(Some("19000000"), &[1000, 1100, 1200, 1300][..]), (None, &[1000, 1100, 1200])] {
        let mut writer = small(4, 19_000);
        writer.tags.extend(tag.map(|delay| ("K4A_DEPTH_DELAY_NS".to_owned(), delay.to_owned())));
        let frames = read(&writer.bytes()).1.unwrap();
        // Depth is measured along the axis of the colour camera, which is turned.
        let depths: Vec<i32> = frames.iter().map(|frame| (usual_depth(frame) + 50) / 100 * 100).collect();
        assert_eq!(depths, expected);
        let gray: Vec<u8> = frames.iter().map(|frame| frame.color()[(13, 7)][0] / 10).collect();
        assert_eq!(gray, if tag.is_some() { vec![0, 1, 2, 3] } else { vec![1, 2, 3] });
    }
}

#[test]
fn frames_do_not_depend_on_how_a_file_was_written() {
    let (warnings, expected) = read(&small(3, 0).bytes());
    let expected = expected.unwrap();
    assert_eq!((expected.len(), warnings.len()), (3, 0), "{warnings:?}");
    for change in [
        |writer: &mut MkvWriter| writer.head = HeadPlace::Last,
        |writer: &mut MkvWriter| writer.is_streamed = true,
        |writer: &mut MkvWriter| writer.is_grouped = true,
        // Later versions of libmatroska sort tracks by other numbers.
        |writer: &mut MkvWriter| writer.tracks.reverse(),
        |writer: &mut MkvWriter| writer.tracks.push(track(9, "IMU", "S_K4A/IMU", &[], (0, 0))),
        |writer: &mut MkvWriter| writer.calibration.as_mut().unwrap().push(0),
    ] {
        let mut writer = small(3, 0);
        change(&mut writer);
        let (warnings, frames) = read(&writer.bytes());
        assert_eq!(warnings, [""; 0]);
        assert!(frames.unwrap() == expected, "the frames differ");
    }
}

#[test]
fn depth_that_is_registered_to_colour_needs_no_calibration() {
    let mut writer = MkvWriter::new((40, 30), (40, 40));
    writer.tracks[1] = track(2, "DEPTH", "V_MS/VFW/FOURCC", &bitmap_header(b"b16g"), (40, 30));
    writer.calibration = None;
    writer.blocks = vec![(COLOR, 0, jpeg((40, 30), 9)), (DEPTH, 0, depth_bytes([1500; 1200]))];
    let (_folder, path) = written(&writer.bytes());
    let settings = DatasetSettings::default().with(|settings| settings.fx = Some(30.0));
    let frame = open_scene(&path, &settings).unwrap().read_recorded(0).unwrap().frame;
    assert!(frame.depth().pixels().iter().all(|z| *z == 1.5) && frame.intrinsics().fx == 30.0);
}

#[test]
fn other_videos_are_not_taken_for_recordings() {
    let mut writer = small(1, 0);
    writer.tracks.truncate(1);
    writer.tags.clear();
    let (folder, path) = written(&writer.bytes());
    assert!(!has_depth(&path, &DatasetSettings::default()));
    assert!(!RecordingScene::is_recording(&path) && !RecordingScene::is_recording(folder.path()));
    // The name does not matter.
    let named = folder.path().join("b.video");
    fs::write(&named, small(1, 0).bytes()).unwrap();
    assert_eq!(open_scene(&named, &DatasetSettings::default()).unwrap().format(), Some(Format::Mkv));
    fs::rename(&named, folder.path().join("c.mkv")).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.format(), scene.name()), (Some(Format::Mkv), "c"));
}

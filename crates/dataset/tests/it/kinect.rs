//! Recordings of Azure Kinect and Orbbec Femto in Matroska: from mkvmerge, and made here where they differ.

use crate::support::mkv::{
    COLOR, COLOR_LENS, Camera, DEPTH, DEPTH_LENS, HeadPlace, MkvWriter, bitmap_header, color_from_depth, element, track,
};
use crate::support::recording::jpeg_bytes;
use crate::support::warnings::with_warnings;
use crate::support::{damaged, two_ways};
use glam::{DVec2, DVec3, dvec2};
use proptest::prelude::*;
use splatseg_dataset::{DatasetError, DatasetSettings, Format, RecordingScene, RecordingSummary, Scene, open_scene};
use splatseg_geometry::{CameraFrame, Image};
use std::fs;
use std::path::{Path, PathBuf};

/// Sizes of small images of the shapes of NFOV and of 16:9.
const SMALL_DEPTH: (u64, u64) = (20, 18);
const SMALL_COLOR: (u64, u64) = (32, 18);
/// The tracks, the calibration and the tags of a recording made here, and its first blocks.
const HEAD_BYTES: usize = 2800;
/// Microseconds between frames.
const PERIOD: u64 = 33_333;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings").join(name)
}

fn jpeg((width, height): (u64, u64), value: u8) -> Vec<u8> {
    jpeg_bytes(&Image::filled(width as usize, height as usize, [value; 3]))
}

fn depth_bytes(millimetres: impl IntoIterator<Item = u16>) -> Vec<u8> {
    millimetres.into_iter().flat_map(u16::to_be_bytes).collect()
}

/// A recording of some frames: depth has 1000 millimetres and more by 100 for each frame, and comes later by a time.
fn small(frames: u64, delay: u64) -> MkvWriter {
    let mut writer = MkvWriter::new(SMALL_COLOR, SMALL_DEPTH);
    let pixels = (SMALL_DEPTH.0 * SMALL_DEPTH.1) as usize;
    for number in 0..frames {
        writer.blocks.push((COLOR, number * PERIOD, jpeg(SMALL_COLOR, 10 * number as u8)));
        let depth = depth_bytes(std::iter::repeat_n(1000 + 100 * number as u16, pixels));
        writer.blocks.push((DEPTH, number * PERIOD + delay, depth));
    }
    writer
}

/// Writes a recording, and returns its folder and path.
fn written(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mkv");
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// Returns the damage to a recording of these bytes, and its frames or the error.
fn read(bytes: &[u8]) -> (Vec<String>, Result<Vec<CameraFrame<'static>>, String>) {
    let (_folder, path) = written(bytes);
    let without = |text: String| text.replace(&path.display().to_string(), "a.mkv");
    let settings = DatasetSettings::default();
    let (scene, warnings) = with_warnings(|| open_scene(&path, &settings));
    let frames = scene.map_err(|error| without(error.to_string())).map(|scene| {
        let frame = |index| scene.read_recorded(index).map(|read| read.frame).ok();
        (0..scene.frame_count()).filter_map(frame).collect()
    });
    (warnings.into_iter().map(without).collect(), frames)
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

/// What a frame differs from the scene that was rendered.
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
    // Without the tag, depth of the frame before is closer by 5 ms; with it, the times are equal.
    for (tag, expected) in [(Some("19000000"), [1000, 1100, 1200, 1300]), (None, [1000, 1000, 1100, 1200])] {
        let mut writer = small(4, 19_000);
        writer.tags.extend(tag.map(|delay| ("K4A_DEPTH_DELAY_NS".to_owned(), delay.to_owned())));
        let (_, frames) = read(&writer.bytes());
        let depths: Vec<i32> = frames.unwrap().iter().map(usual_depth).collect();
        match tag {
            Some(_) => assert_eq!(depths.iter().map(|z| (z + 50) / 100 * 100).collect::<Vec<_>>(), expected),
            None => assert_ne!(depths.len(), 4, "{depths:?}"),
        }
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
fn a_recording_that_was_cut_off_is_read_up_to_there() {
    let whole = small(4, 0).bytes();
    let mut last = 5;
    for end in (100..whole.len()).rev().step_by(41) {
        let (warnings, frames) = read(&whole[..end]);
        let count = frames.map_or(0, |frames| frames.len());
        assert!(count <= last, "{count} frames of {end} bytes");
        if count > 0 {
            let told =
                warnings.iter().any(|line| line.contains("was not finished, or is damaged: it is read up to byte"));
            assert!(told, "{end}: {warnings:?}");
        }
        last = count;
    }
    assert_eq!(last, 0);
}

#[test]
fn reading_goes_on_after_damage() {
    let whole = small(4, 0).bytes();
    let clusters: Vec<usize> =
        (0..whole.len() - 4).filter(|at| whole[*at..].starts_with(&[0x1F, 0x43, 0xB6, 0x75])).collect();
    assert_eq!(clusters.len(), 8);
    // The size of a block beyond its cluster, and the id of a cluster.
    for (at, value) in [(clusters[2] + 12 + 17 + 3, 200), (clusters[2], 0)] {
        let mut bytes = whole.clone();
        bytes[at] = value;
        let (warnings, frames) = read(&bytes);
        assert_eq!(frames.unwrap().len(), 3);
        assert!(warnings.iter().any(|line| line.contains("reading goes on with")), "{warnings:?}");
    }
}

#[test]
fn what_is_missing_is_told_in_one_line() {
    let error = |change: fn(&mut MkvWriter)| {
        let mut writer = small(2, 0);
        change(&mut writer);
        let error = read(&writer.bytes()).1.map(|frames| frames.len()).unwrap_err();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    assert_eq!(
        error(|writer| _ = writer.tracks.pop()),
        "a.mkv: tracks: found COLOR (jpeg), expected DEPTH with 16 bits (b16g): PASSIVE_IR and OFF are no modes with depth"
    );
    let text = error(|writer| {
        writer.tracks[0] = track(1, "COLOR", "V_MS/VFW/FOURCC", &bitmap_header(b"H264"), SMALL_COLOR);
    });
    assert_eq!(
        text,
        "a.mkv: tracks: found COLOR (V_MS/VFW/FOURCC H264), DEPTH (16UC1), expected COLOR as MJPG, NV12, YUY2 or BGRA"
    );
    assert!(
        error(|writer| writer.calibration = None)
            .starts_with("a.mkv: attachment calibration.json: found none, expected")
    );
    let text = error(|writer| writer.calibration = Some(b"{}".to_vec()));
    assert!(
        text.starts_with("a.mkv: attachment calibration.json: found one that cannot be used: missing field"),
        "{text}"
    );
    let (warnings, frames) = read(&MkvWriter { flags: 2, ..small(2, 0) }.bytes());
    assert!(frames.is_err() && warnings.is_empty(), "{warnings:?}");
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
    let error = open_scene(&path, &DatasetSettings::default()).unwrap_err();
    assert!(matches!(error, DatasetError::PlainVideo { .. }), "{error}");
    assert!(!RecordingScene::is_recording(&path) && !RecordingScene::is_recording(folder.path()));
    // The name does not matter.
    let named = folder.path().join("b.video");
    fs::write(&named, small(1, 0).bytes()).unwrap();
    assert_eq!(open_scene(&named, &DatasetSettings::default()).unwrap().format(), Some(Format::Mkv));
    fs::rename(&named, folder.path().join("c.mkv")).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.format(), scene.name()), (Some(Format::Mkv), "c"));
}

#[test]
fn what_says_that_it_is_large_is_not_believed() {
    for size in [(1u64 << 40, 9 << 37), (u64::MAX, u64::MAX), (0, 0)] {
        let mut writer = small(1, 0);
        writer.tracks[1] = track(2, "DEPTH", "V_MS/VFW/FOURCC", &bitmap_header(b"b16g"), size);
        assert!(read(&writer.bytes()).1.is_ok_and(|frames| frames.is_empty()) || read(&writer.bytes()).1.is_err());
    }
    // A part of the head, and lists of parts that point to each other.
    let mut bytes = small(1, 0).bytes();
    let tags = bytes.windows(4).position(|id| id == [0x12, 0x54, 0xC3, 0x67]).unwrap();
    bytes[tags + 5] = 0x7F;
    assert!(read(&bytes).0.iter().any(|line| line.contains("damaged")));
    let list = element(
        0x114D_9B74,
        &element(0x4DBB, &[element(0x53AB, &[0x11, 0x4D, 0x9B, 0x74]), element(0x53AC, &[0])].concat()),
    );
    let bytes = [element(0x1A45_DFA3, &[]), element(0x1853_8067, &list.repeat(500))].concat();
    assert!(read(&bytes).1.is_err());
}

/// Number of damaged recordings: 400, or as many as the variable says.
fn cases() -> u32 {
    std::env::var("SPLATSEG_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(400)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    /// Damaged recordings are read or refused in one line that names them, without a panic.
    #[test]
    fn damaged_recordings_are_read_or_refused(
        kind in 0usize..4,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        // Most of the file is images: as often, only the rest is changed.
        head in any::<bool>(),
        keep in any::<prop::sample::Index>(),
    ) {
        let mut writer = small(2, 0);
        match kind {
            0 => {}
            1 => writer.head = HeadPlace::Last,
            2 => writer.is_streamed = true,
            _ => writer.is_grouped = true,
        }
        let mut bytes = writer.bytes();
        if head {
            let start = bytes.len().min(HEAD_BYTES);
            changes.iter().for_each(|(at, value)| bytes[at.index(start)] = *value);
        } else {
            bytes = damaged(bytes, &changes, &keep);
        }
        let (_folder, path) = written(&bytes);
        let place = path.display().to_string();
        let settings = DatasetSettings::default();
        let told = match RecordingScene::open(&path, &settings) {
            Ok(scene) => {
                let read = |index| scene.read_recorded(index).err();
                (0..scene.frame_count()).filter_map(read).map(|error| error.to_string()).collect()
            }
            Err(error) => vec![error.to_string()],
        };
        for line in told {
            prop_assert!(!line.contains('\n') && line.contains(&place), "{line}");
        }
    }
}

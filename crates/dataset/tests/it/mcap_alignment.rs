//! Colour and depth whose camera infos and frames say that they belong together, or contradict themselves. The same from a
//! file and as a stream.

use crate::support::mcap::{FRAME_NS, McapWriter, START, info, raw, transform};
use crate::support::two_ways::{Found, read};
use glam::{DQuat, DVec3};
use splatseg_dataset::{DatasetSettings, DepthRegistration};
use splatseg_geometry::{CameraFrame, Intrinsics};

const WIDTH: usize = 96;
const HEIGHT: usize = 72;
const K: [f32; 4] = [86.0, 86.0, 47.5, 35.5];
/// Moves the corners by several pixels.
const LENS: [f64; 5] = [-0.25, 0.08, 0.001, -0.001, 0.0];

/// A camera as its driver describes it.
#[derive(Clone)]
struct Camera<'a> {
    topic: &'a str,
    frame: &'a str,
    k: [f32; 4],
    /// The size of its images is that of colour divided by this.
    reduction: usize,
    model: &'a str,
    lens: Vec<f64>,
}

impl Camera<'_> {
    fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }
}

fn color() -> Camera<'static> {
    let (topic, frame) = ("/cam/color/image_raw", "color_optical");
    Camera { topic, frame, k: K, reduction: 1, model: "plumb_bob", lens: vec![0.0; 5] }
}

fn depth() -> Camera<'static> {
    Camera { topic: "/cam/aligned_depth_to_color/image_raw", ..color() }
}

fn is_box(column: usize, row: usize) -> bool {
    [(4, 4), (76, 4), (4, 52), (76, 52), (40, 28)]
        .iter()
        .any(|(x, y)| (*x..x + 16).contains(&column) && (*y..y + 16).contains(&row))
}

/// Records bright boxes at 0.6 m before a dark wall at 1 m, whose depth was measured at the stored pixels of colour.
/// `offset` is the position of the depth camera in the frame of colour, in /tf_static.
fn boxes(color: &Camera<'_>, depth: &Camera<'_>, offset: Option<DVec3>) -> Vec<u8> {
    let mut writer = McapWriter::new();
    writer.write("/tf_static", &transform(START, "map", color.frame, DVec3::ZERO, DQuat::IDENTITY), START);
    if let Some(offset) = offset {
        writer.write("/tf_static", &transform(START, color.frame, depth.frame, offset, DQuat::IDENTITY), START);
    }
    for index in 0..2 {
        let stamp = START + index * FRAME_NS;
        for camera in [color, depth] {
            let (width, height) = (WIDTH / camera.reduction, HEIGHT / camera.reduction);
            let [fx, fy, cx, cy] = camera.k;
            let mut message = info(stamp, camera.frame, &Intrinsics { fx, fy, cx, cy, width, height });
            (message.distortion_model, message.d) = (camera.model.to_owned(), camera.lens.clone());
            let folder = camera.topic.rsplit_once('/').unwrap().0;
            writer.write(&format!("{folder}/camera_info"), &message, stamp);
            let places = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
            let boxes = places.map(|(column, row)| is_box(column * camera.reduction, row * camera.reduction));
            if std::ptr::eq(camera, color) {
                let pixels: Vec<u8> = boxes.flat_map(|is_box| [if is_box { 235 } else { 20 }; 3]).collect();
                writer.write(camera.topic, &raw(stamp, camera.frame, "rgb8", (width, height), &pixels), stamp);
            } else {
                let units: Vec<u8> =
                    boxes.flat_map(|is_box| if is_box { 600u16 } else { 1000 }.to_le_bytes()).collect();
                writer.write(camera.topic, &raw(stamp, camera.frame, "16UC1", (width, height), &units), stamp);
            }
        }
    }
    writer.finish()
}

fn settings(register: DepthRegistration) -> DatasetSettings {
    DatasetSettings::default().with(|s| (s.register_depth, s.pose) = (register, Some("/tf_static".to_owned())))
}

/// Returns the part of the pixels with depth whose colour is that of the other surface.
fn wrong(frame: &CameraFrame<'_>) -> f64 {
    let pixels = || frame.depth().pixels().iter().zip(frame.color().pixels()).filter(|(depth, _)| **depth > 0.0);
    let is_wrong = |(depth, color): &(&f32, &[u8; 3])| if **depth < 0.8 { color[0] < 80 } else { color[0] > 170 };
    pixels().filter(is_wrong).count() as f64 / pixels().count() as f64
}

fn read_boxes(
    cameras: (&Camera<'_>, &Camera<'_>),
    offset: Option<DVec3>,
    register: DepthRegistration,
) -> Result<Found, String> {
    read(&boxes(cameras.0, cameras.1, offset), &settings(register))
}

/// Reads boxes in which colour and depth belong together as stored, and checks that they still do.
fn fits(cameras: (&Camera<'_>, &Camera<'_>), offset: Option<DVec3>, register: DepthRegistration) -> Found {
    let found = read_boxes(cameras, offset, register).unwrap();
    let wrong = wrong(&found.frames[0].0);
    assert!(wrong < 0.01, "{:.1} % of the pixels have the colour of another surface", 100.0 * wrong);
    found
}

/// Reads boxes, and checks that the header was followed although colour and depth belong together as stored.
fn follows_headers(cameras: (&Camera<'_>, &Camera<'_>), offset: Option<DVec3>, register: DepthRegistration) -> Found {
    let found = read_boxes(cameras, offset, register).unwrap();
    let wrong = wrong(&found.frames[0].0);
    assert!(wrong > 0.02, "only {:.1} % of the pixels have the colour of another surface", 100.0 * wrong);
    found
}

use DepthRegistration::{Auto, False, True};

#[test]
fn images_of_one_camera_need_no_words() {
    let plain = fits((&color(), &depth()), None, Auto);
    assert_eq!((plain.warnings.as_slice(), plain.sources[1].ends_with("camera_info")), (&[][..], true));
    let bent = |camera: Camera<'static>| camera.with(|camera| camera.lens = LENS.to_vec());
    let alike = fits((&bent(color()), &bent(depth())), None, Auto);
    assert_eq!((alike.warnings.as_slice(), alike.sources[1].ends_with("camera_info")), (&[][..], true));
    assert_ne!(alike.frames[0].0.depth(), plain.frames[0].0.depth(), "both are undistorted");
    // The same lens in other words, and K printed with fewer digits.
    for (model, count) in [("plumb_bob", 4), ("rational_polynomial", 8), ("rational_polynomial", 14)] {
        let depth = bent(depth()).with(|camera| {
            camera.model = model;
            camera.lens.resize(count, 0.0);
            camera.k = [86.001, 85.999, 47.5004, 35.4996];
        });
        let found = fits((&bent(color()), &depth), None, Auto);
        assert_eq!(found.warnings, [""; 0], "{model} {count}");
        assert_eq!(found.frames[0].0.depth(), alike.frames[0].0.depth());
    }
    let fisheye = |camera: Camera<'static>| {
        camera.with(|camera| (camera.model, camera.lens) = ("equidistant", vec![0.01, 0.002, 0.0, 0.0]))
    };
    assert_eq!(fits((&fisheye(color()), &fisheye(depth())), None, Auto).warnings, [""; 0]);
}

#[test]
fn one_of_two_images_of_a_camera_is_not_undistorted_alone() {
    let bent = |camera: Camera<'static>| camera.with(|camera| camera.lens = LENS.to_vec());
    // A RealSense D405.
    let rectified = bent(color()).with(|camera| camera.topic = "/cam/color/image_rect_raw");
    let found = fits((&rectified, &bent(depth())), None, Auto);
    assert_eq!(found.warnings, [""; 0]);
    assert!(found.sources[1].ends_with("taken as registered to colour"), "{:?}", found.sources);
    follows_headers((&rectified, &bent(depth())), None, True);
    for (color, depth) in [
        (bent(color()).with(|camera| camera.topic = "/cam/color/image_rect_color"), bent(depth())),
        (bent(color()), bent(depth()).with(|camera| camera.topic = "/cam/depth_registered/image_rect")),
    ] {
        let found = fits((&color, &depth), None, Auto);
        let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
        let start = format!("a.mcap: {} and {} have one frame, size, K and D, but only one", color.topic, depth.topic);
        assert!(warning.starts_with(&start) && warning.contains("--register-depth true"), "{warning}");
        follows_headers((&color, &depth), None, True);
    }
    // Both are rectified.
    let depth = bent(depth()).with(|camera| camera.topic = "/cam/aligned_depth_to_color/image_rect");
    assert_eq!(fits((&rectified, &depth), None, Auto).warnings, [""; 0]);
}

#[test]
fn another_lens_of_the_same_camera_is_ambiguous() {
    let bent = color().with(|camera| camera.lens = LENS.to_vec());
    for (color, depth) in [(bent.clone(), depth()), (color(), depth().with(|camera| camera.lens = LENS.to_vec()))] {
        let found = fits((&color, &depth), None, Auto);
        let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
        let start = "a.mcap: /cam/color/image_raw and /cam/aligned_depth_to_color/image_raw have one frame, size and K, but \
                     other lens distortion (D), up to ";
        assert!(warning.starts_with(start) && warning.contains("--register-depth true"), "{warning}");
        assert_eq!(fits((&color, &depth), None, False).warnings, [""; 0]);
        let forced = follows_headers((&color, &depth), None, True);
        assert_eq!(forced.warnings, [""; 0]);
        assert!(forced.sources[1].ends_with("registered to colour here"), "{:?}", forced.sources);
    }
    // Less than a pixel.
    let nearly = depth().with(|camera| camera.lens = vec![1e-3, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(fits((&color(), &nearly), None, Auto).warnings, [""; 0]);
}

#[test]
fn another_k_in_the_same_frame_is_told() {
    let depth = depth().with(|camera| camera.k = [80.0, 80.0, 45.0, 36.0]);
    let found = follows_headers((&color(), &depth), None, Auto);
    assert_eq!(
        found.warnings,
        [
            "a.mcap: /cam/color/image_raw and /cam/aligned_depth_to_color/image_raw have one frame and size, but other K (fx, \
             fy, cx, cy: 86, 86, 47.5, 35.5; 80, 80, 45, 36), so depth is registered to colour here; if it is registered \
             already, --register-depth false takes it as it is"
        ]
    );
    assert_eq!(fits((&color(), &depth), None, False).warnings, [""; 0]);
    assert_eq!(follows_headers((&color(), &depth), None, True).warnings, [""; 0]);
}

#[test]
fn the_k_of_colour_in_another_frame_is_told() {
    let depth = depth().with(|camera| camera.frame = "depth_optical");
    let apart = Some(DVec3::X * -0.03);
    let found = fits((&color(), &depth), apart, Auto);
    assert_eq!(
        found.warnings,
        ["a.mcap: /cam/aligned_depth_to_color/image_raw has the size and K of /cam/color/image_raw, but its frame, \
             depth_optical, is 3.0 cm and 0.0 degrees from color_optical in /tf_static: depth is taken as registered to \
             colour; if it is not, --register-depth true registers it"]
    );
    assert_eq!(follows_headers((&color(), &depth), apart, True).warnings, [""; 0]);
    assert_eq!(fits((&color(), &depth), apart, False).warnings, [""; 0]);
    let found = fits((&color(), &depth), None, Auto);
    assert!(
        found.warnings[0].contains("its frame, depth_optical, is not connected to color_optical"),
        "{:?}",
        found.warnings
    );
    let error = read_boxes((&color(), &depth), None, True).map(|_| ()).unwrap_err();
    assert!(
        error.starts_with("a.mcap: frames of the cameras: found depth in frame \"depth_optical\"")
            && error.ends_with("--register-depth false"),
        "{error}"
    );
    // Two names of one place, and K of another camera.
    assert_eq!(fits((&color(), &depth), Some(DVec3::ZERO), Auto).warnings, [""; 0]);
    let other = depth.with(|camera| camera.k = [80.0, 80.0, 45.0, 36.0]);
    assert_eq!(follows_headers((&color(), &other), apart, Auto).warnings, [""; 0]);
}

#[test]
fn depth_of_half_the_size_is_that_of_the_same_camera() {
    let half =
        |camera: Camera<'static>| camera.with(|camera| (camera.reduction, camera.k) = (2, [43.0, 43.0, 23.5, 17.5]));
    // K halved, or with the centres of pixels in mind.
    for k in [[43.0, 43.0, 23.75, 17.75], [43.0, 43.0, 23.5, 17.5]] {
        for lens in [vec![0.0; 5], LENS.to_vec()] {
            let color = color().with(|camera| camera.lens.clone_from(&lens));
            let depth = half(depth()).with(|camera| (camera.k, camera.lens) = (k, lens));
            let found = read_boxes((&color, &depth), None, Auto).unwrap();
            assert_eq!(found.warnings, [""; 0]);
            assert_eq!((found.frames[0].0.width(), found.frames[0].0.height()), (48, 36));
            assert!(wrong(&found.frames[0].0) < 0.03, "{}", wrong(&found.frames[0].0));
            assert!(read_boxes((&color, &depth), None, False).is_ok_and(|found| wrong(&found.frames[0].0) < 0.03));
        }
    }
    let bent = color().with(|camera| camera.lens = LENS.to_vec());
    let found = read_boxes((&bent, &half(depth())), None, Auto).unwrap();
    assert!(found.warnings[0].contains("other lens distortion (D)") && wrong(&found.frames[0].0) < 0.03);
    let elsewhere = half(depth()).with(|camera| camera.frame = "depth_optical");
    let found = read_boxes((&color(), &elsewhere), Some(DVec3::X * 0.03), Auto).unwrap();
    assert!(found.sources[1].ends_with("registered to colour here"));
    assert!(found.warnings[0].contains("K, at another size, of /cam/color/image_raw"), "{:?}", found.warnings);
}

#[test]
fn p_is_used_for_rectified_images() {
    // A calibration whose rectified images have another focal length than K.
    let mut writer = McapWriter::new();
    let camera = Intrinsics { fx: 20.0, fy: 20.0, cx: 7.5, cy: 5.5, width: 16, height: 12 };
    let mut message = info(START, "camera", &camera);
    message.d = LENS.to_vec();
    (message.p[0], message.p[5], message.p[2], message.p[6]) = (17.0, 18.0, 7.0, 5.0);
    writer.write("/cam/camera_info", &message, START);
    for topic in ["/cam/image_rect_color", "/cam/image_raw"] {
        writer.write(topic, &raw(START, "camera", "rgb8", (16, 12), &[9; 3 * 16 * 12]), START);
    }
    writer.write("/cam/depth/image_rect", &raw(START, "camera", "16UC1", (16, 12), &[3; 2 * 16 * 12]), START);
    writer.write("/cam/depth/camera_info", &message, START);
    let bytes = writer.finish();
    let of = |topic: &str| {
        let settings = DatasetSettings::default().with(|s| s.color = Some(topic.to_owned()));
        let found = read(&bytes, &settings).unwrap();
        let Intrinsics { fx, fy, cx, cy, .. } = *found.frames[0].0.intrinsics();
        ([fx, fy, cx, cy], found.warnings.len())
    };
    assert_eq!(of("/cam/image_rect_color"), ([17.0, 18.0, 7.0, 5.0], 0));
    assert_eq!(of("/cam/image_raw"), ([20.0, 20.0, 7.5, 5.5], 1), "depth is named as rectified");
}

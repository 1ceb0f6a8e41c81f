//! The graph segmenter on rendered frames with known objects.

use glam::Vec3;
use proptest::prelude::*;
use splatseg_dataset::read_color_image;
use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, ScoredMask, SegmentMap};
use splatseg_segmenter::{GraphSegmenter, GraphSettings, Segmenter, SegmenterError};
use splatseg_test_scenes::shared;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;

fn camera(width: usize, height: usize) -> Intrinsics {
    splatseg_test_scenes::camera(width, height, 0.9 * width as f32)
}

fn frame(color: Image<[u8; 3]>, depth: Image<f32>) -> RgbdFrame<'static> {
    let (width, height) = color.size();
    RgbdFrame::new("0", color, depth, camera(width, height), Pose::IDENTITY).unwrap()
}

fn segment(frame: &RgbdFrame, settings: GraphSettings) -> Vec<ScoredMask> {
    GraphSegmenter::new(settings).unwrap().segment(frame).unwrap().masks
}

/// A small deterministic random number generator with values in [-1, 1].
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Depth at which `ray` enters the box between two corners.
fn enter(ray: Vec3, low: Vec3, high: Vec3) -> Option<f32> {
    let (near, far) = (low / ray, high / ray);
    let (entry, exit) = (near.min(far).max_element(), near.max(far).min_element());
    (entry > 0.0 && entry < exit).then_some(entry)
}

/// Two boxes on a floor seen from above, with the true segments: 1 is the floor, 2 and 3 are the boxes. Everything has
/// the same colour, so only geometry tells them apart. Depth has the noise of a Kinect.
fn two_boxes() -> (RgbdFrame<'static>, SegmentMap) {
    // The scene frame is tilted by 40° about the camera's x axis. Its y axis points down and the floor is y = 1.2.
    let tilt = glam::Quat::from_rotation_x(-40f32.to_radians());
    let boxes = [
        (Vec3::new(-0.65, 0.8, 1.1), Vec3::new(-0.2, 1.2, 1.5)),
        (Vec3::new(0.15, 0.85, 1.0), Vec3::new(0.5, 1.2, 1.6)),
    ];
    let view = camera(WIDTH, HEIGHT);
    let mut noise = Noise(7);
    let mut labels = Vec::new();
    let depth = Image::from_fn(WIDTH, HEIGHT, |column, row| {
        let ray_camera = view.unproject(glam::Vec2::new(column as f32, row as f32), 1.0);
        let ray = tilt * ray_camera;
        let floor = if ray.y > 0.0 { 1.2 / ray.y } else { f32::INFINITY };
        let mut hit = (floor, 1u32);
        for (index, (low, high)) in boxes.iter().enumerate() {
            match enter(ray, *low, *high) {
                Some(depth) if depth < hit.0 => hit = (depth, index as u32 + 2),
                _ => {}
            }
        }
        labels.push(if hit.0.is_finite() { hit.1 } else { 0 });
        if hit.0.is_finite() { 1.0 / (1.0 / hit.0 + 0.003 * noise.next()) } else { 0.0 }
    });
    let color = Image::filled(WIDTH, HEIGHT, [120, 130, 125]);
    (frame(color, depth), SegmentMap::from_pixels(WIDTH, HEIGHT, labels).unwrap())
}

#[test]
fn two_boxes_on_a_floor_are_three_segments() {
    let (frame, truth) = two_boxes();
    let masks = segment(&frame, GraphSettings::default());
    for (id, object) in Mask::of_segments(&truth) {
        assert!(object.area() > 400, "the scene shows too little of {id}");
        let best = masks.iter().map(|segment| segment.mask.iou(&object)).fold(0.0, f64::max);
        assert!(best > 0.9, "object {id} is found with IoU {best} among {} segments", masks.len());
    }
    assert!(masks.len() <= 5, "{} segments", masks.len());
}

#[test]
fn a_frame_without_depth_is_cut_by_color() {
    let color = Image::from_fn(WIDTH, HEIGHT, |column, row| match (column < 80, row < 60) {
        (true, true) => [200, 40, 40],
        (false, true) => [40, 160, 60],
        (true, false) => [230, 230, 230],
        (false, false) => [30, 40, 120],
    });
    let masks = segment(&frame(color, Image::filled(WIDTH, HEIGHT, 0.0)), GraphSettings::default());
    assert_eq!(masks.len(), 4);
    for segment in &masks {
        assert!(segment.mask.area().abs_diff(80 * 60) < 200, "area {}", segment.mask.area());
        assert!(segment.score > 0.5, "score {}", segment.score);
    }
}

#[test]
fn uniform_frames_are_one_segment() {
    for depth in [0.0, 1.5] {
        let uniform = frame(Image::filled(64, 48, [90; 3]), Image::filled(64, 48, depth));
        let masks = segment(&uniform, GraphSettings::default());
        assert_eq!(masks.len(), 1);
        assert_eq!(masks[0].mask.area(), 64 * 48);
    }
}

#[test]
fn tiny_frames_are_segmented() {
    for (width, height) in [(1, 1), (2, 1), (1, 2), (3, 3), (1, 40)] {
        for depth in [0.0, 1e-30, 2.0, 1e30] {
            let tiny = frame(Image::filled(width, height, [7, 200, 90]), Image::filled(width, height, depth));
            assert_eq!(segment(&tiny, GraphSettings::default()), [], "smaller than min_area");
            let settings = GraphSettings::default().with(|settings| {
                settings.min_area = 0;
                settings.max_pixels = 2;
            });
            let covered: usize = segment(&tiny, settings).iter().map(|segment| segment.mask.area()).sum();
            assert_eq!(covered, width * height);
        }
    }
}

#[test]
fn large_frames_are_segmented_at_half_resolution() {
    let (small, _) = two_boxes();
    let color = Image::filled(2 * WIDTH - 1, 2 * HEIGHT - 1, [120, 130, 125]);
    let depth = Image::from_fn(2 * WIDTH - 1, 2 * HEIGHT - 1, |column, row| small.depth()[(column / 2, row / 2)]);
    let settings = GraphSettings::default().with(|settings| settings.max_pixels = WIDTH * HEIGHT);
    let (large, small) = (segment(&frame(color, depth), settings), segment(&small, GraphSettings::default()));
    assert_eq!(large.len(), small.len());
    for (large, small) in large.iter().zip(&small) {
        let ratio = large.mask.area() as f64 / small.mask.area() as f64;
        assert!((3.8..=4.2).contains(&ratio), "{ratio}");
    }
}

#[test]
fn threads_do_not_change_the_result() {
    let (frame, _) = two_boxes();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| segment(&frame, GraphSettings::default()))
    };
    let (one, four) = (with(1), with(4));
    assert_eq!(one, four);
    assert!(one.iter().zip(&four).all(|(a, b)| a.score.to_bits() == b.score.to_bits()));
}

#[test]
fn impossible_settings_are_named() {
    let mut settings = GraphSettings::default();
    settings.surface.noise = 0.0;
    let error = GraphSegmenter::new(settings).unwrap_err();
    assert_eq!(error.to_string(), "graph.surface.noise is 0, expected 0.000001 to 1000");
    let mut settings = GraphSettings::default();
    settings.borders.bias = f32::NAN;
    assert!(
        matches!(GraphSegmenter::new(settings), Err(SegmenterError::Setting(error)) if error.key == "graph.borders.bias")
    );
}

#[test]
fn unknown_settings_are_refused() {
    let error = serde_json::from_str::<GraphSettings>(r#"{"surface": {"nois": 1}}"#).unwrap_err();
    assert!(error.to_string().contains("nois"), "{error}");
    let changed: GraphSettings = serde_json::from_str(r#"{"borders": {"bias": -1.0}}"#).unwrap();
    assert_eq!(changed.borders.bias, -1.0);
    assert_eq!(changed.patches, GraphSettings::default().patches);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn masks_part_any_frame(width in 1usize..40, height in 1usize..40, seed in any::<u32>(), smooth in any::<bool>()) {
        let mut noise = Noise(seed);
        let color = Image::from_fn(width, height, |column, _| {
            if smooth { [column as u8 * 3; 3] } else { [0; 3].map(|_: i32| (noise.next() * 127.0 + 127.0) as u8) }
        });
        let depth = Image::from_fn(width, height, |_, row| match noise.next() {
            hole if hole < -0.5 => 0.0,
            value if smooth => 1.0 + 0.05 * row as f32 + 0.01 * value,
            value => 10f32.powf(4.0 * value),
        });
        let settings = GraphSettings::default().with(|settings| settings.min_area = 1);
        let masks = segment(&frame(color, depth), settings);
        let mut union = Mask::empty(width, height);
        for ScoredMask { mask, score } in &masks {
            prop_assert!((0.0..=1.0).contains(score));
            prop_assert!(!mask.is_empty());
            prop_assert_eq!(union.intersection_area(mask), 0);
            union.unite(mask);
        }
        prop_assert_eq!(union.area(), width * height);
    }
}

/// Regression test of the quality, on the rendered room of the shared data.
#[test]
fn most_objects_of_a_rendered_room_are_found() {
    let test = "most_objects_of_a_rendered_room_are_found";
    let Some(scene) = shared("data/rooms/dev-a", test) else { return };
    let (mut best_sum, mut objects) = (0.0, 0.0);
    for index in (0..80).step_by(10) {
        let color = read_color_image(&scene.join(format!("color/{index}.jpg"))).unwrap();
        let depth = image::open(scene.join(format!("depth/{index}.png"))).unwrap().into_luma16();
        let truth = image::open(scene.join(format!("instance-filt/{index}.png"))).unwrap().into_luma16();
        let view = Intrinsics { fx: 288.935, fy: 288.935, cx: 159.5, cy: 119.5, width: 320, height: 240 };
        let depth = depth.pixels().map(|pixel| f32::from(pixel.0[0]) / 1000.0).collect();
        let depth = Image::from_pixels(320, 240, depth).unwrap();
        let truth = truth.pixels().map(|pixel| u32::from(pixel.0[0])).collect();
        let truth = SegmentMap::from_pixels(320, 240, truth).unwrap();
        let frame = RgbdFrame::new(index.to_string(), color, depth, view, Pose::IDENTITY).unwrap();
        let masks = segment(&frame, GraphSettings::default());
        assert!((5..60).contains(&masks.len()), "{} segments in frame {index}", masks.len());
        for (_, object) in Mask::of_segments(&truth).into_iter().filter(|(_, object)| object.area() > 400) {
            best_sum += masks.iter().map(|segment| segment.mask.iou(&object)).fold(0.0, f64::max);
            objects += 1.0;
        }
    }
    assert!(best_sum / objects > 0.62, "mean best IoU {}", best_sum / objects);
}

//! The affinity segmenter on synthetic frames.

use glam::Vec3;
use splatseg_geometry::{Image, Pose, RgbdFrame, ScoredMask};
use splatseg_segmenter::{
    AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeights, Segmenter, SegmenterError,
};
use splatseg_test_scenes::camera;

fn frame(color: Image<[u8; 3]>, depth: Image<f32>) -> RgbdFrame<'static> {
    let (width, height) = color.size();
    RgbdFrame::new("0", color, depth, camera(width, height, 0.9 * width as f32), Pose::IDENTITY).unwrap()
}

fn segment(frame: &RgbdFrame, settings: AffinitySettings) -> Vec<ScoredMask> {
    AffinitySegmenter::new(AffinityNetwork::load(&AffinityWeights::BuiltIn).unwrap(), settings)
        .unwrap()
        .segment(frame)
        .unwrap()
        .masks
}

/// A box in front of a wall, 320×240 times `scale`.
fn box_before_wall(scale: usize) -> RgbdFrame<'static> {
    let inside =
        |column: usize, row: usize| (120..200).contains(&(column / scale)) && (80..160).contains(&(row / scale));
    let (width, height) = (320 * scale, 240 * scale);
    let color =
        Image::from_fn(width, height, |column, row| if inside(column, row) { [180, 60, 40] } else { [150, 150, 140] });
    let depth = Image::from_fn(width, height, |column, row| if inside(column, row) { 1.2 } else { 2.0 });
    frame(color, depth)
}

#[test]
fn a_box_before_a_wall_is_found_at_every_resolution() {
    for scale in [1, 2, 3] {
        let frame = box_before_wall(scale);
        let masks = segment(&frame, AffinitySettings::default());
        let is_inside = |column: usize, row: usize| frame.depth()[(column, row)] < 1.5;
        let truth = splatseg_geometry::Mask::from_fn(frame.width(), frame.height(), is_inside);
        let best = masks.iter().max_by(|a, b| a.mask.iou(&truth).total_cmp(&b.mask.iou(&truth))).unwrap();
        assert!(best.mask.iou(&truth) > 0.9, "scale {scale}: IoU {}", best.mask.iou(&truth));
        assert!(best.score > 0.7, "scale {scale}: score {}", best.score);
        let covered: usize = masks.iter().map(|scored| scored.mask.area()).sum();
        assert!(covered <= frame.width() * frame.height(), "masks overlap");
        assert!(masks.iter().all(|scored| scored.mask.area() >= 100));
    }
}

#[test]
fn strange_frames_are_segmented() {
    let everything = AffinitySettings::default().with(|settings| settings.min_area = 0);
    for (width, height) in [(1, 1), (2, 1), (1, 2), (3, 3), (1, 40), (33, 17)] {
        for depth in [0.0, 1e-30, 2.0, 1e30] {
            let frame = frame(Image::filled(width, height, [7, 200, 90]), Image::filled(width, height, depth));
            let masks = segment(&frame, everything.clone());
            let area: usize = masks.iter().map(|scored| scored.mask.area()).sum();
            assert_eq!(area, width * height, "every pixel belongs to one segment");
            let tiny = everything.clone().with(|settings| settings.max_pixels = 2);
            let area: usize = segment(&frame, tiny).iter().map(|scored| scored.mask.area()).sum();
            assert_eq!(area, width * height);
        }
    }
}

#[test]
fn a_lower_threshold_makes_fewer_segments() {
    let ray = |column: usize, row: usize| Vec3::new(column as f32 / 160.0 - 1.0, row as f32 / 160.0 - 0.75, 1.0);
    let color = Image::from_fn(320, 240, |column, row| [(column * 7 % 256) as u8, (row * 5 % 256) as u8, 90]);
    let depth =
        Image::from_fn(320, 240, |column, row| 1.0 + ray(column, row).length() * ((column / 40 + row / 40) % 3) as f32);
    let frame = frame(color, depth);
    let count = |threshold| {
        segment(&frame, AffinitySettings::default().with(|settings| settings.threshold = Some(threshold))).len()
    };
    assert!(count(2.0) > count(-1.0) && count(-1.0) >= count(-100.0));
    assert_eq!(count(-100.0), 1);
}

#[test]
fn settings_are_checked() {
    let settings = AffinitySettings::default().with(|settings| settings.max_pixels = 0);
    let error =
        AffinitySegmenter::new(AffinityNetwork::load(&AffinityWeights::BuiltIn).unwrap(), settings).unwrap_err();
    assert!(matches!(error, SegmenterError::Setting(_)), "{error}");
}

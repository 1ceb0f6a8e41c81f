//! From an image to objects.

use super::golden::{Golden, image, shared};
use crate::sam2_golden::test_device::device;
use splatseg_models::fastsam::{Detection, FastSamPredictor, FastSamPredictorSettings};

/// Maximum difference of boxes in pixels; scores differ less.
const BOX_TOLERANCE: f32 = 0.1;

/// Maximum difference of a mask's area in pixels: the random network's masks are ragged.
const AREA_TOLERANCE: i32 = 4;

/// Returns the detections in an image with the weights of a checkpoint. All checkpoints contain the same weights.
fn predict(image_name: &str, image_size: usize, checkpoint: &str, test: &str) -> Option<Vec<Detection>> {
    let image = image(&shared(&format!("golden/fastsam/image_{image_name}.png"), test)?);
    let weights = shared(&format!("golden/fastsam/{checkpoint}"), test)?;
    let settings = FastSamPredictorSettings::default().with(|settings| settings.image_size = image_size);
    let predictor = FastSamPredictor::open(&weights, settings, &device()).unwrap();
    Some(predictor.predict(&image).unwrap())
}

/// Returns the indices of the `expected` boxes among the detections. Each is found once; nearly equal scores may be in
/// any order.
fn matched(found: &[Detection], expected: &[[f32; 4]], scores: &[f32]) -> Vec<usize> {
    assert_eq!(found.len(), expected.len());
    assert!(found.is_sorted_by(|a, b| a.score >= b.score));
    let mut used = vec![false; found.len()];
    let place = |(expected, score): (&[f32; 4], &f32)| {
        let agrees = |(index, detection): &(usize, &Detection)| {
            let close = |(a, b): (&f32, &f32)| (a - b).abs() <= BOX_TOLERANCE;
            !used[*index]
                && (detection.score - score).abs() <= 2e-4
                && detection.box_xyxy.iter().zip(expected).all(close)
        };
        let index = found.iter().enumerate().find(agrees).map(|(index, _)| index);
        let index = index.unwrap_or_else(|| panic!("no detection with box {expected:?}, score {score}"));
        used[index] = true;
        index
    };
    expected.iter().zip(scores).map(place).collect()
}

fn check(image_name: &str, image_size: usize, test: &str) {
    let file = format!("forward_{image_name}_{image_size}.safetensors");
    let Some(forward) = Golden::open(&file, test) else { return };
    let checkpoint = if image_size == 640 { "fastsam_mini_v80120.pt" } else { "fastsam_mini.pt" };
    let Some(found) = predict(image_name, image_size, checkpoint, test) else { return };
    compare(&found, &forward);
}

fn compare(found: &[Detection], forward: &Golden) {
    let boxes = forward.floats("det_xyxy");
    let places = matched(found, boxes.as_chunks::<4>().0, &forward.floats("det_conf"));
    for (place, area) in places.iter().zip(forward.ints("det_mask_area")) {
        let found = found[*place].mask.area() as i32;
        assert!((found - area).abs() <= AREA_TOLERANCE, "mask {place}: {found} pixels, expected {area}");
    }
    if forward.has("det_masks_rle") {
        for (place, mask) in places.iter().zip(forward.masks("det_masks")) {
            let iou = found[*place].mask.iou(&mask);
            assert!(iou >= 0.999, "mask {place}: IoU {iou}");
        }
    }
}

#[test]
fn objects_agree_by_a_state_dict() {
    let test = "objects_agree_by_a_state_dict";
    let Some(found) = predict("310x230", 640, "fastsam_mini_statedict.safetensors", test) else { return };
    compare(&found, &Golden::open("forward.safetensors", test).unwrap());
}

#[test]
fn objects_agree_310x230_at_640() {
    check("310x230", 640, "objects_agree_310x230_at_640");
}

#[test]
fn objects_agree_310x230_at_1024() {
    check("310x230", 1024, "objects_agree_310x230_at_1024");
}

#[test]
fn objects_agree_640x480_at_640() {
    check("640x480", 640, "objects_agree_640x480_at_640");
}

#[test]
fn objects_agree_640x480_at_1024() {
    check("640x480", 1024, "objects_agree_640x480_at_1024");
}

//! From crafted head outputs to masks and boxes.

use super::golden::{Golden, different_pixels, shared};
use serde::Deserialize;
use splatseg_geometry::Mask;
use splatseg_models::fastsam::{
    Candidates, FastSamPredictorSettings, Placement, Prototypes, detections, input_mask_in_image,
};
use std::collections::BTreeMap;

/// Maximum difference of boxes in pixels.
const BOX_TOLERANCE: f32 = 1e-4;

/// Maximum number of pixels in which a mask may differ.
const MASK_TOLERANCE: usize = 2;

#[derive(Deserialize)]
struct Case {
    orig_wh: [usize; 2],
    input_hw: [usize; 2],
    runs: Vec<Run>,
}

#[derive(Deserialize)]
struct Run {
    prefix: String,
    conf: f64,
    iou: f64,
    retina_masks: bool,
}

/// Reads all anchors of a file.
fn candidates(golden: &Golden) -> Candidates {
    let (preds, anchors) = (golden.floats("preds"), golden.shape("preds")[2]);
    let mut candidates = Candidates::new(32);
    for anchor in 0..anchors {
        let value = |row: usize| preds[row * anchors + anchor];
        candidates.push(anchor, [0, 1, 2, 3].map(value), value(4), (5..37).map(value));
    }
    candidates
}

fn prototypes(golden: &Golden) -> Prototypes {
    let shape = golden.shape("protos");
    Prototypes { count: shape[1], height: shape[2], width: shape[3], values: golden.floats("protos") }
}

fn assert_boxes(found: &[[f32; 4]], expected: &[f32], what: &str) {
    assert_eq!(found.len() * 4, expected.len(), "{what}");
    for (found, expected) in found.iter().flatten().zip(expected) {
        assert!((found - expected).abs() <= BOX_TOLERANCE, "{what}: {found} {expected}");
    }
}

fn assert_masks(found: &[Mask], expected: &[Mask], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let different = different_pixels(found, expected);
        assert!(different <= MASK_TOLERANCE, "{what}: mask {index}: {different} pixels differ");
    }
}

fn indices(golden: &Golden, name: &str) -> Vec<usize> {
    golden.ints(name).into_iter().map(|index| index as usize).collect()
}

fn check_run(golden: &Golden, case: &Case, run: &Run) {
    let name = |tensor: &str| format!("{}{tensor}", run.prefix);
    let settings = FastSamPredictorSettings::default().with(|settings| {
        settings.confidence = run.conf;
        settings.iou = run.iou;
        settings.retina_masks = run.retina_masks;
    });
    let placement = Placement { image: case.orig_wh.into(), input: (case.input_hw[1], case.input_hw[0]) };
    let candidates = candidates(golden);
    let kept = candidates.nms(run.conf, run.iou, settings.max_det);
    assert_eq!(kept, indices(golden, &name("nms_idx")), "{}", run.prefix);
    let boxes: Vec<[f32; 4]> = kept.iter().map(|index| candidates.box_xyxy(*index)).collect();
    assert_boxes(&boxes, &golden.floats(&name("nms_xyxy")), &name("nms_xyxy"));

    let found = detections(&candidates, &prototypes(golden), placement, &settings);
    let anchors: Vec<usize> = found.iter().map(|detection| detection.anchor).collect();
    assert_eq!(anchors, indices(golden, &name("keep_idx")), "{}", run.prefix);
    let scores: Vec<f32> = found.iter().map(|detection| detection.score).collect();
    assert_eq!(scores, golden.floats(&name("conf")), "{}", run.prefix);
    let scaled: Vec<[f32; 4]> =
        anchors.iter().map(|anchor| placement.box_in_image(candidates.box_xyxy(*anchor))).collect();
    assert_boxes(&scaled, &golden.floats(&name("xyxy_scaled")), &name("xyxy_scaled"));
    let boxes: Vec<[f32; 4]> = found.iter().map(|detection| detection.box_xyxy).collect();
    assert_boxes(&boxes, &golden.floats(&name("xyxy")), &name("xyxy"));
    let masks: Vec<Mask> = found.into_iter().map(|detection| detection.mask).collect();
    assert_masks(&masks, &golden.masks(&name("masks")), &name("masks"));
    if !run.retina_masks {
        let in_image: Vec<Mask> = masks.iter().map(|mask| input_mask_in_image(mask, placement)).collect();
        assert_masks(&in_image, &golden.masks(&name("masks_orig")), &name("masks_orig"));
    }
}

fn check_case(letter: &str, test: &str) {
    let Some(path) = shared("golden/fastsam/postproc.json", test) else { return };
    let cases: BTreeMap<String, Case> = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let Some(golden) = Golden::open(&format!("postproc_{letter}.safetensors"), test) else { return };
    let case = &cases[letter];
    assert_eq!(case.runs.len(), 4);
    case.runs.iter().for_each(|run| check_run(&golden, case, run));
}

#[test]
fn results_agree_where_prototypes_are_scaled_up_fourfold() {
    check_case("a", "results_agree_where_prototypes_are_scaled_up_fourfold");
}

#[test]
fn results_agree_where_prototypes_are_not_scaled_up() {
    check_case("b", "results_agree_where_prototypes_are_not_scaled_up");
}

#[test]
fn results_agree_on_a_square_canvas() {
    check_case("c", "results_agree_on_a_square_canvas");
}

#[test]
fn results_agree_for_an_upright_image() {
    check_case("d", "results_agree_for_an_upright_image");
}

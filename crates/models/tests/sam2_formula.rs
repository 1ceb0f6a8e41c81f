//! SAM 2.1 on a short video against the official code, with weights and frames given by formulas: no checkpoint is needed.
//! `tools/make_sam2_test_data.py` made the reference.

mod sam2_golden;

use burn::tensor::{Device, Tensor, TensorData};
use sam2_golden::{FormulaWeights, Golden, Within, assert_close, fnv1a64, uniform};
use splatseg_geometry::Mask;
use splatseg_models::sam2::{Click, ObjectMask, Prompt, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use std::path::Path;

const SIDE: usize = 128;
const FRAMES: usize = 5;
const OBJECTS: usize = 3;

/// The formula's frame t, normalised.
fn input(t: usize) -> Tensor<4> {
    let (coarse, fine) = (fnv1a64("input.coarse"), fnv1a64(&format!("input.fine.{t}")));
    let cells = SIDE / 16;
    let mut values = Vec::with_capacity(3 * SIDE * SIDE);
    for channel in 0..3 {
        for y in 0..SIDE {
            for x in 0..SIDE {
                let (row, column) = ((y + 2 * t) / 16 % cells, (x + 4 * t) / 16 % cells);
                let cell = uniform(coarse, (channel * cells + row) * cells + column);
                let noise = uniform(fine, (channel * SIDE + y) * SIDE + x);
                values.push((1.5 * cell + 0.5 * noise) as f32);
            }
        }
    }
    Tensor::from_data(TensorData::new(values, [1, 3, SIDE, SIDE]), &Device::flex())
}

fn network(folder: &Path) -> Sam2Network {
    let weights = FormulaWeights::of_manifest(folder, "mini");
    Sam2Network::load(&weights, Some(SIDE), &Device::flex()).unwrap()
}

fn clicks(points: &[(f32, f32, bool)]) -> Prompt {
    let clicks = points.iter().map(|(x, y, positive)| Click { x: *x, y: *y, positive: *positive }).collect();
    Prompt::Points { bounding_box: None, clicks }
}

/// Compares an object in frame `t` with the reference.
#[track_caller]
fn check(golden: &Golden, t: usize, object: usize, mask: &ObjectMask) {
    let part = |name: &str| {
        let values = golden.floats(name);
        let size = values.len() / (FRAMES * OBJECTS);
        values[(t * OBJECTS + object) * size..][..size].to_vec()
    };
    let what = |name: &str| format!("frame {t}, object {object}: {name}");
    let logits = mask.low_res_logits.pixels();
    assert_close(&what("logits"), logits, &part("low_res_logits"), Within::Absolute(2e-3));
    let score = part("object_score_logits");
    assert_close(&what("score"), &[mask.object_score], &score, Within::Absolute(2e-3));
    assert_close(&what("pointer"), &mask.pointer, &part("obj_ptr"), Within::Absolute(1e-3));
}

/// Follows three objects through the formula's video, with a correction of the first on a frame.
fn follow(golden: &Golden, network: Sam2Network, settings: Sam2PredictorSettings, corrected_frame: Option<usize>) {
    let square = Mask::from_fn(SIDE, SIDE, |x, y| (20..60).contains(&x) && (30..70).contains(&y));
    let prompts = [
        (1, Prompt::Mask(square)),
        (2, Prompt::bounding_box([70.0, 20.0, 118.0, 64.0])),
        (3, clicks(&[(40.0, 96.0, true), (90.0, 100.0, false)])),
    ];
    let mut predictor = Sam2Predictor::new(network, settings).unwrap();
    for t in 0..FRAMES {
        let mut found = predictor.track_input(input(t), (SIDE, SIDE)).unwrap();
        if t == 0 {
            found = predictor.prompt_all(&prompts).unwrap();
        } else if Some(t) == corrected_frame {
            let correction = clicks(&[(48.0, 60.0, true), (100.0, 30.0, false), (30.0, 50.0, true)]);
            found[0] = predictor.prompt(1, &correction).unwrap();
        }
        assert_eq!(found.len(), OBJECTS);
        found.iter().enumerate().for_each(|(object, mask)| check(golden, t, object, mask));
    }
}

#[test]
fn masks_boxes_and_clicks_are_followed_as_officially() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sam2");
    let golden = Golden::open(&folder, "formula_video");
    let network = network(&folder);

    let embedding = network.encode(input(0)).embedding.permute([0, 3, 1, 2]);
    let embedding: Vec<f32> = embedding.into_data().try_into_vec().unwrap();
    assert_close("embedding", &embedding, &golden.floats("embedding"), Within::OfMax(1e-5));
    let settings = Sam2PredictorSettings { fill_hole_area: 0, ..Sam2PredictorSettings::official(FRAMES) };
    follow(&golden, network, settings, None);
}

/// The official defaults: small holes are filled, and a correction is remembered without being a conditioning frame.
#[test]
fn corrections_in_a_stream_are_remembered_as_officially() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sam2");
    let golden = Golden::open(&folder, "formula_stream");
    assert!(golden.floats("low_res_logits").contains(&0.1), "no hole is filled in the reference");
    follow(&golden, network(&folder), Sam2PredictorSettings::official(FRAMES), Some(2));
}

/// The frame after one on which an object may have been corrected.
fn after_correction(network: &Sam2Network, settings: Sam2PredictorSettings, is_corrected: bool) -> ObjectMask {
    let mut predictor = Sam2Predictor::new(network.clone(), settings).unwrap();
    predictor.track_input(input(0), (SIDE, SIDE)).unwrap();
    predictor.prompt(1, &clicks(&[(40.0, 50.0, true)])).unwrap();
    predictor.track_input(input(1), (SIDE, SIDE)).unwrap();
    if is_corrected {
        predictor.prompt(1, &clicks(&[(48.0, 60.0, true), (100.0, 30.0, false), (30.0, 50.0, true)])).unwrap();
    }
    predictor.track_input(input(2), (SIDE, SIDE)).unwrap().remove(0)
}

#[test]
fn a_frame_that_is_tracked_again_loses_its_correction() {
    let network = network(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sam2"));
    let remembered = Sam2PredictorSettings::official(FRAMES);
    let lost = Sam2PredictorSettings { track_corrected_frames_again: true, ..remembered };
    let conditioning = Sam2PredictorSettings { add_all_frames_to_correct_as_cond: true, ..remembered };
    let without = after_correction(&network, remembered, false);
    assert_eq!(after_correction(&network, lost, true), without);
    let far = |a: &ObjectMask, b: &ObjectMask| {
        let pairs = a.low_res_logits.pixels().iter().zip(b.low_res_logits.pixels());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let [remembered, conditioning] = [remembered, conditioning].map(|way| after_correction(&network, way, true));
    // Well beyond the tolerance of the comparison with the official code.
    assert!(far(&remembered, &without) > 0.02 && far(&conditioning, &without) > 0.02);
    // The same memory in another place in time, whose encoding is small in these weights.
    assert_ne!(remembered, conditioning);
}

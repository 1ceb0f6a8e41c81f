//! SAM 2.1 on a short video against the official code, with weights and frames given by formulas: no checkpoint is needed.
//! `tools/make_sam2_test_data.py` made the reference.

mod sam2_golden;

use burn::tensor::{Device, Tensor, TensorData};
use sam2_golden::{FormulaWeights, Golden, Within, assert_close, fnv1a64, uniform};
use splatseg_geometry::Mask;
use splatseg_models::sam2::{Click, Prompt, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
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

#[test]
fn masks_boxes_and_clicks_are_followed_as_officially() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/sam2");
    let golden = Golden::open(&folder, "formula_video");
    let weights = FormulaWeights::of_manifest(&folder, "mini");
    let network = Sam2Network::load(&weights, Some(SIDE), &Device::flex()).unwrap();

    let embedding = network.encode(input(0)).embedding.permute([0, 3, 1, 2]);
    let embedding: Vec<f32> = embedding.into_data().try_into_vec().unwrap();
    assert_close("embedding", &embedding, &golden.floats("embedding"), Within::OfMax(1e-5));

    let square = Mask::from_fn(SIDE, SIDE, |x, y| (20..60).contains(&x) && (30..70).contains(&y));
    let clicks = vec![Click { x: 40.0, y: 96.0, positive: true }, Click { x: 90.0, y: 100.0, positive: false }];
    let prompts = [
        (1, Prompt::Mask(square)),
        (2, Prompt::bounding_box([70.0, 20.0, 118.0, 64.0])),
        (3, Prompt::Points { bounding_box: None, clicks }),
    ];
    let mut predictor = Sam2Predictor::new(network, Sam2PredictorSettings::parity(FRAMES)).unwrap();
    for t in 0..FRAMES {
        let mut found = predictor.track_input(input(t), (SIDE, SIDE)).unwrap();
        if t == 0 {
            found = predictor.prompt_all(&prompts).unwrap();
        }
        for (object, mask) in found.iter().enumerate() {
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
        assert_eq!(found.len(), OBJECTS);
    }
}

//! The formula's video with three prompted objects, and its comparison with a reference.

use crate::sam2_golden::test_device::{self, device};
use crate::sam2_golden::{FormulaWeights, Golden, VIDEO_SIDE, Within, assert_close, formula_video_frame};
use burn::tensor::{Tensor, TensorData};
use splatseg_geometry::{Click, Mask, Prompt};
use splatseg_models::sam2::{ObjectMask, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use std::path::{Path, PathBuf};

pub const FRAMES: usize = 5;

/// Folder of the reference of a network.
pub fn folder(network: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(network)
}

/// The official predictor's settings, without filling holes.
pub fn official() -> Sam2PredictorSettings {
    Sam2PredictorSettings { fill_hole_area: 0, ..Sam2PredictorSettings::official(FRAMES) }
}

/// Frame t of the video.
pub fn input(t: usize) -> Tensor<4> {
    Tensor::from_data(TensorData::new(formula_video_frame(t), [1, 3, VIDEO_SIDE, VIDEO_SIDE]), &device())
}

/// The miniature; `None`, reported on a line of its own, if the device is missing.
pub fn mini(network: &str, test: &str) -> Option<Sam2Network> {
    if let Some(reason) = test_device::missing() {
        splatseg_test_scenes::skipped(test, &reason);
        return None;
    }
    let weights = FormulaWeights::from_manifest(&folder(network), &format!("{network}_mini"));
    Some(Sam2Network::load(&weights, Some(VIDEO_SIDE), &device()).unwrap())
}

pub fn clicks(points: &[(f32, f32, bool)]) -> Prompt {
    let clicks = points.iter().map(|(x, y, positive)| Click { x: *x, y: *y, positive: *positive }).collect();
    Prompt::Points { bounding_box: None, clicks }
}

pub fn prompts() -> [(u64, Prompt); 3] {
    let square = Mask::from_fn(VIDEO_SIDE, VIDEO_SIDE, |x, y| (20..60).contains(&x) && (30..70).contains(&y));
    [
        (1, Prompt::Mask(square)),
        (2, Prompt::bounding_box([70.0, 20.0, 118.0, 64.0])),
        (3, clicks(&[(40.0, 96.0, true), (90.0, 100.0, false)])),
    ]
}

/// Compares an object in a frame with the reference of `objects` objects.
#[track_caller]
pub fn check(golden: &Golden, frame: usize, [object, objects]: [usize; 2], mask: &ObjectMask) {
    let part = |name: &str, size: usize| golden.floats(name)[(frame * objects + object) * size..][..size].to_vec();
    let what = |name: &str| format!("frame {frame}, object {object}: {name}");
    let logits = part("low_res_logits", VIDEO_SIDE * VIDEO_SIDE / 16);
    assert_close(&what("logits"), mask.low_res_logits.pixels(), &logits, Within::Absolute(2e-3));
    let score = part("object_score_logits", 1);
    assert_close(&what("score"), &[mask.object_score], &score, Within::Absolute(2e-3));
    assert_close(&what("pointer"), &mask.pointer, &part("obj_ptr", 64), Within::Absolute(1e-3));
}

/// Compares the features of the first frame.
#[track_caller]
pub fn check_embedding(golden: &Golden, network: &Sam2Network) {
    let embedding = network.encode(input(0)).embedding.permute([0, 3, 1, 2]);
    let embedding: Vec<f32> = embedding.into_data().try_into_vec().unwrap();
    assert_close("embedding", &embedding, &golden.floats("embedding"), Within::OfMax(1e-5));
}

/// Tracks the three objects with the official defaults, which fill small holes. The first is corrected on frame 2, which is
/// remembered but does not condition.
pub fn follow_corrected(network_name: &str, network: Sam2Network) {
    let golden = Golden::open(&folder(network_name), "stream");
    assert!(golden.floats("low_res_logits").contains(&0.1), "no hole is filled in the reference");
    follow(&golden, network, Sam2PredictorSettings::official(FRAMES), Some(2), |_, _| {});
}

/// Tracks the three objects, which are prompted on the first frame, and compares all masks. The first object is
/// corrected on `corrected_frame`. `after` is called after each frame.
pub fn follow(
    golden: &Golden,
    network: Sam2Network,
    settings: Sam2PredictorSettings,
    corrected_frame: Option<usize>,
    mut after: impl FnMut(usize, &mut Sam2Predictor),
) {
    let mut predictor = Sam2Predictor::new(network, settings).unwrap();
    for t in 0..FRAMES {
        let mut found = predictor.track_input(input(t), (VIDEO_SIDE, VIDEO_SIDE)).unwrap();
        if t == 0 {
            found = predictor.prompt_all(&prompts()).unwrap();
        } else if Some(t) == corrected_frame {
            let correction = clicks(&[(48.0, 60.0, true), (100.0, 30.0, false), (30.0, 50.0, true)]);
            found[0] = predictor.prompt(1, &correction).unwrap();
        }
        assert_eq!(found.len(), 3);
        found.iter().enumerate().for_each(|(object, mask)| check(golden, t, [object, 3], mask));
        after(t, &mut predictor);
    }
}

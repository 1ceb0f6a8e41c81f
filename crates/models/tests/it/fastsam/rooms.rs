//! The trained network on rendered rooms, from the JPEG files to masks.
//!
//! The reference was generated from these files as decoded by libjpeg. Differences of 4 grey levels in another decoder
//! are enough to change this network's scores by 0.03 and thus the detections, so this also tests the decoder.

use super::golden::{Golden, image, shared};
use crate::sam2_golden::test_device::device;
use splatseg_geometry::Mask;
use splatseg_models::fastsam::{FastSamError, FastSamPredictor, FastSamPredictorSettings};

/// Maximum difference of boxes in pixels, and of scores.
const TOLERANCES: [f32; 2] = [1e-2, 1e-4];

fn check(setting: &str, confidence: f64, iou: f64, test: &str) {
    let Some(weights) = shared("models/fastsam-rooms-n.pt", test) else { return };
    let Some(golden) = Golden::open("../fastsam_rooms/predictions.safetensors", test) else { return };
    let settings = FastSamPredictorSettings::default().with(|settings| {
        settings.image_size = 320;
        settings.confidence = confidence;
        settings.iou = iou;
    });
    let predictor = FastSamPredictor::open(&weights, settings, &device()).unwrap();
    let Some(frames) = shared("data/rooms/dev-a/color", test) else { return };
    for frame in [0, 20, 40, 60] {
        let found = predictor.predict(&image(&frames.join(format!("{frame}.jpg")))).unwrap();
        let tensor = |name: &str| format!("frame{frame}.{setting}.{name}");
        let boxes = golden.floats(&tensor("boxes_xyxy"));
        let scores = golden.floats(&tensor("scores"));
        assert_eq!(found.len(), scores.len(), "frame {frame}");
        let masks = golden.bytes(&tensor("masks"));
        let masks = masks.chunks_exact(320 * 240);
        for ((expected, score), mask) in boxes.as_chunks::<4>().0.iter().zip(&scores).zip(masks) {
            let mask = Mask::from_fn(320, 240, |column, row| mask[row * 320 + column] == 1);
            let agrees = found.iter().any(|detection| {
                let close = |(a, b): (&f32, &f32)| (a - b).abs() <= TOLERANCES[0];
                detection.box_xyxy.iter().zip(expected).all(close)
                    && (detection.score - score).abs() <= TOLERANCES[1]
                    && detection.mask.iou(&mask) >= 0.99
            });
            assert!(agrees, "frame {frame}: no detection {expected:?}, score {score}");
        }
    }
}

#[test]
fn rooms_agree_with_the_papers_setting() {
    check("paper", 0.4, 0.9, "rooms_agree_with_the_papers_setting");
}

#[test]
fn rooms_agree_with_the_loose_setting() {
    check("loose", 0.25, 0.7, "rooms_agree_with_the_loose_setting");
}

#[test]
fn other_models_and_settings_are_refused_in_one_line() {
    let test = "other_models_and_settings_are_refused_in_one_line";
    let open = |path: &str, settings: FastSamPredictorSettings| -> Option<FastSamError> {
        Some(FastSamPredictor::open(&shared(path, test)?, settings, &device()).unwrap_err())
    };
    let Some(error) = open("golden/sam2/sam2_mini.pt", FastSamPredictorSettings::default()) else { return };
    assert!(matches!(error, FastSamError::NotFastSam { .. }), "{error}");
    assert!(error.to_string().contains("expected FastSAM") && error.to_string().lines().count() == 1, "{error}");
    let Some(error) = open("golden/fastsam/image_310x230.png", FastSamPredictorSettings::default()) else { return };
    assert!(matches!(error, FastSamError::Checkpoint(_)) && error.to_string().lines().count() == 1, "{error}");
    let odd = FastSamPredictorSettings::default().with(|settings| settings.image_size = 1000);
    let Some(error) = open("models/fastsam-rooms-n.pt", odd) else { return };
    assert_eq!(error.to_string(), "fastsam.image_size is 1000, expected a multiple of 32 from 32 to 2048");
}

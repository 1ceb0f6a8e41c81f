//! Compares the published sizes, with weights given by a formula, with the official code. Each test takes minutes, so
//! they run on demand: `cargo test --release -p splatseg-models --test it sam2_full -- --ignored --test-threads 1`.

use crate::sam2_golden::test_device::device;
use crate::sam2_golden::{FormulaWeights, Golden, Within, assert_close, folder, formula_element, formula_frame};
use burn::tensor::{Tensor, TensorData};
use splatseg_geometry::{Mask, Prompt};
use splatseg_models::sam2::{Sam2Network, Sam2Predictor, Sam2PredictorSettings};

const SIDE: usize = 1024;

fn input(frame: usize) -> Tensor<4> {
    Tensor::from_data(TensorData::new(formula_frame(frame), [1, 3, SIDE, SIDE]), &device())
}

#[test]
fn the_formula_is_that_of_the_reference() {
    let check = |name: &str, shape: &[usize], index: usize, bits: u32| {
        assert_eq!(formula_element(name, shape, index).to_bits(), bits, "{name}[{index}]");
    };
    check("image_encoder.trunk.patch_embed.proj.weight", &[112, 3, 7, 7], 12345, 0xbd96_c624);
    check("image_encoder.trunk.blocks.0.norm1.weight", &[112], 7, 0x3f85_ab2f);
    check("maskmem_tpos_enc", &[7, 1, 1, 64], 100, 0x3ade_5922);
    check("sam_mask_decoder.output_upscaling.0.weight", &[256, 64, 2, 2], 65535, 0x3d0f_b51f);
    check("sam_mask_decoder.pred_obj_score_head.layers.2.bias", &[1], 0, 0x403e_9951);
    check("memory_encoder.fuser.layers.1.gamma", &[256], 255, 0x3f6d_502f);
    assert_eq!(formula_frame(0)[0], 0.798_499_46);
}

fn encoder(size: &str) {
    let Some(folder) = folder("encoder of a published size") else { return };
    let golden = Golden::open(&folder, &format!("full_{size}_encoder"));
    let network = Sam2Network::load(&FormulaWeights::from_manifest(&folder, size), None, &device()).unwrap();
    let maps = network.encode(input(0));
    let [s0, s1] = maps.fine.unwrap();
    for (name, map) in [("fpn2", maps.embedding), ("s0", s0), ("s1", s1)] {
        let values: Vec<f32> = map.permute([0, 3, 1, 2]).into_data().try_into_vec().unwrap();
        let stride = golden.ints(&format!("{name}.stride"))[0];
        let slice: Vec<f32> = values.iter().copied().step_by(stride).collect();
        let [l2, _, largest] = golden.doubles(&format!("{name}.l2_mean_absmax"))[..] else { panic!("three numbers") };
        let within = Within::Absolute(1e-4 * largest as f32);
        assert_close(&format!("{size} {name}"), &slice, &golden.floats(&format!("{name}.slice")), within);
        let found = values.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt();
        assert!((found - l2).abs() <= 1e-5 * l2, "{size} {name}: L2 norm {found} instead of {l2}");
    }
}

#[test]
#[ignore = "takes minutes: run with --release"]
fn tiny_encoder() {
    encoder("tiny");
}

#[test]
#[ignore = "takes minutes: run with --release"]
fn small_encoder() {
    encoder("small");
}

#[test]
#[ignore = "takes minutes: run with --release"]
fn base_plus_encoder() {
    encoder("base_plus");
}

#[test]
#[ignore = "takes minutes: run with --release"]
fn large_encoder() {
    encoder("large");
}

fn video(size: &str) {
    let Some(folder) = folder("video of a published size") else { return };
    let golden = Golden::open(&folder, &format!("full_{size}_video"));
    let network = Sam2Network::load(&FormulaWeights::from_manifest(&folder, size), None, &device()).unwrap();
    let settings = Sam2PredictorSettings { fill_hole_area: 0, ..Sam2PredictorSettings::official(3) };
    let mut predictor = Sam2Predictor::new(network, settings).unwrap();
    let square = Mask::from_fn(SIDE, SIDE, |x, y| (200..600).contains(&x) && (300..700).contains(&y));
    let disc = Mask::from_fn(SIDE, SIDE, |x, y| x.abs_diff(700).pow(2) + y.abs_diff(350).pow(2) < 160 * 160);
    for frame in 0..3 {
        let mut masks = predictor.track_input(input(frame), (SIDE, SIDE)).unwrap();
        if frame == 0 {
            let prompts = [(1, Prompt::Mask(square.clone())), (2, Prompt::Mask(disc.clone()))];
            masks = predictor.prompt_all(&prompts).unwrap();
        }
        predictor.remember_frame();
        for (object, mask) in masks.iter().enumerate() {
            let what = |name: &str| format!("{size} frame {frame} object {object} {name}");
            let part = |name: &str, size: usize| golden.floats(name)[(frame * 2 + object) * size..][..size].to_vec();
            let every =
                |map: &splatseg_geometry::Image<f32>, rows: (usize, usize), columns: (usize, usize)| -> Vec<f32> {
                    let rows = (rows.0..map.height()).step_by(rows.1);
                    rows.flat_map(|row| map.row(row)[columns.0..].iter().copied().step_by(columns.1)).collect()
                };
            let low = every(&mask.low_res_logits, (0, 4), (0, 4));
            assert_close(&what("low"), &low, &part("low_res_logits_slice", 4096), Within::Absolute(2e-3));
            let logits = mask.logits();
            let video = every(&logits, (5, 16), (3, 16));
            assert_close(&what("video"), &video, &part("video_logits_slice", 4096), Within::Absolute(2e-3));
            let (area, expected) = (mask.mask().area() as f32, part("video_mask_area", 1)[0]);
            assert!((area - expected).abs() <= 1e-4 * expected, "{}: {area} instead of {expected}", what("area"));
            let score = part("object_score_logits", 1);
            assert_close(&what("score"), &[mask.object_score], &score, Within::Absolute(1e-3));
            assert_close(&what("pointer"), &mask.pointer, &part("obj_ptr", 256), Within::Absolute(1e-3));
            let memory = predictor.state().memory(object as u64 + 1, frame).unwrap().unwrap();
            // Planes of 64 × 64 in the reference, tokens of 64 channels here.
            let planes = (0..64 * 4096).step_by(67).map(|index| memory[index % 4096 * 64 + index / 4096]);
            let planes: Vec<f32> = planes.collect();
            assert_close(&what("memory"), &planes, &part("maskmem_features_slice", 3913), Within::OfMax(0.01));
        }
    }
}

#[test]
#[ignore = "takes minutes: run with --release"]
fn tiny_video() {
    video("tiny");
}

#[test]
#[ignore = "takes minutes: run with --release"]
fn base_plus_video() {
    video("base_plus");
}

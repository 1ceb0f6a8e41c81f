use super::*;
use crate::sam2::encoder::{FineFeatures, ImageFeatures};
use crate::sam2::heads::{DecodedMasks, MaskChoice, fill_holes};

fn decoder_features(golden: &Golden) -> ImageFeatures {
    ImageFeatures {
        embedding: channels_last(golden, "image_embeddings").reshape([1, 256, 64]),
        fine: Some(FineFeatures { s0: channels_last(golden, "s0"), s1: channels_last(golden, "s1") }),
    }
}

#[test]
fn mask_decoder() {
    let Some(folder) = folder("mask_decoder") else { return };
    let golden = Golden::open(&folder, "mini_mask_decoder");
    let prompts = Golden::open(&folder, "mini_prompt_encoder");
    let network = mini(&folder);
    let features = decoder_features(&golden);
    let heads = &network.heads;
    for case in CASES {
        let (points, masked) = prompt(&prompts, case);
        let mask = masked.then(|| tensor::<4>(&golden, "mask_input").squeeze_dim::<3>(1));
        let decoded =
            heads.decode_all(features.embedding.clone(), &features, std::slice::from_ref(&points), mask.clone());
        let check = |name: &str, found: &[f32]| {
            let name = format!("{case}.{name}");
            assert_close(&name, found, &golden.floats(&name), CLOSE);
        };
        check("all_masks", &values(decoded.masks.clone()));
        check("all_iou", &values(decoded.ious.clone()));
        check("mask_tokens_out", &values(decoded.tokens.clone()));
        check("object_score_logits", &values(decoded.object_scores.clone()));
        check("stability", &values(decoded.stability()));
        let single = decoded.single();
        check("single.masks", &values(single.masks));
        check("single.iou", &values(single.ious));
        for (choice, name) in [(MaskChoice::BestOfThree, "multi"), (MaskChoice::Single, "single")] {
            let out = heads.forward(
                features.embedding.clone(),
                &features,
                std::slice::from_ref(&points),
                mask.clone(),
                choice,
            );
            check(&format!("{name}.heads_low_res_masks"), &values(out.masks));
            check(&format!("{name}.heads_obj_ptr"), &values(out.pointers));
            check(&format!("{name}.heads_object_score_logits"), &values(out.object_scores));
            let ious = golden.floats(&format!("{case}.{name}.heads_ious"));
            let best = ious.iter().copied().fold(f32::MIN, f32::max);
            assert_close(case, &values(out.ious), &[best], CLOSE);
        }
    }
}

#[test]
fn unstable_masks_give_way() {
    let Some(folder) = folder("unstable_masks_give_way") else { return };
    let golden = Golden::open(&folder, "mini_mask_decoder");
    let masks: Tensor<4> = tensor(&golden, "stability_rule.all_masks");
    let decoded = DecodedMasks {
        masks,
        ious: tensor(&golden, "stability_rule.all_iou"),
        tokens: Tensor::zeros([6, 4, 64], &device()),
        object_scores: Tensor::ones([6], &device()),
    };
    assert_close(
        "scores",
        &values(decoded.stability()),
        &golden.floats("stability_rule.scores"),
        Within::Absolute(1e-6),
    );
    let single = decoded.single();
    assert_close("masks", &values(single.masks), &golden.floats("stability_rule.masks"), Within::Absolute(0.0));
    assert_close("iou", &values(single.ious), &golden.floats("stability_rule.iou"), Within::Absolute(0.0));
}

#[test]
fn an_absent_object_has_no_mask() {
    let Some(folder) = folder("an_absent_object_has_no_mask") else { return };
    let golden = Golden::open(&folder, "mini_mask_decoder");
    let prompts = Golden::open(&folder, "mini_prompt_encoder");
    let mut weights = golden::mini_weights(&folder);
    let bias = weights.0.get_mut("sam_mask_decoder.pred_obj_score_head.layers.2.bias").unwrap();
    bias.1[0] -= 50.0;
    let network = Sam2Network::load(&weights, None, &device()).unwrap();
    let features = decoder_features(&golden);
    let points = [prompt(&prompts, "point1").0];
    let out = network.heads.forward(features.embedding.clone(), &features, &points, None, MaskChoice::BestOfThree);
    assert_close("masks", &values(out.masks), &golden.floats("absent.heads_low_res_masks"), Within::Absolute(0.0));
    assert_close("pointer", &values(out.pointers), &golden.floats("absent.heads_obj_ptr"), Within::Absolute(0.0));
    assert_close("score", &values(out.object_scores), &golden.floats("absent.heads_object_score_logits"), CLOSE);
}

#[test]
fn given_masks_are_taken_as_they_are() {
    let Some(folder) = folder("given_masks_are_taken_as_they_are") else { return };
    let golden = Golden::open(&folder, "mini_mask_decoder");
    let encoder = Golden::open(&folder, "mini_image_encoder");
    let network = mini(&folder);
    let features =
        ImageFeatures { embedding: channels_last(&encoder, "fpn2").reshape([1, 256, 64]), ..decoder_features(&golden) };
    for case in ["as_output", "as_output_empty"] {
        let mask = golden.floats(&format!("{case}.mask_u8"));
        let downsampled = Tensor::<1>::from_data(mask.as_slice(), &device()).reshape([1, SIDE, SIDE]);
        let downsampled = network.heads.downsample_masks(downsampled);
        let check = |name: &str, found: &[f32]| {
            let name = format!("{case}.{name}");
            assert_close(&name, found, &golden.floats(&name), CLOSE);
        };
        check("mask_downsample", &values(downsampled));
        let out = network.heads.use_masks_as_output(&features, &[mask], SIDE);
        check("low_res_masks", &values(out.masks));
        check("obj_ptr", &values(out.pointers));
        check("object_score_logits", &values(out.object_scores));
        check("ious", &values(out.ious));
    }
}

#[test]
fn hole_filling() {
    let Some(folder) = folder("hole_filling") else { return };
    let golden = Golden::open(&folder, "mini_fill_holes");
    let (mut logits, expected) = (golden.floats("input"), golden.floats("output"));
    let &[_, height, width] = golden.shape("input").as_slice() else { panic!("not a stack of maps") };
    let max_area = golden.ints("max_area")[0];
    assert_ne!(logits, expected);
    logits.chunks_exact_mut(height * width).for_each(|map| fill_holes(map, width, max_area));
    assert_eq!(logits, expected);
}

//! Every block against the official code's numbers.

use super::fpn_neck::FpnNeck;
use super::host::host;
use super::image_encoder::ImageFeatures;
use super::mask_decoder::DecodedMasks;
use super::memory_attention::{RememberedPointer, SpatialMemory};
use super::memory_encoder::MaskForMemory;
use super::prompt_encoder::InputPoint;
use super::resize::{Size, normalise, resize_antialiased, resize_bilinear, resize_frame};
use super::sam_heads::MaskChoice;
use super::weights::WeightReader;
use super::{PointLabel, Sam2};
use burn::tensor::{Device, Tensor, TensorData};
use splatseg_geometry::Image;
use std::path::Path;

#[path = "../../tests/sam2_golden/mod.rs"]
mod golden;

use golden::{Golden, Within, assert_close, folder};

const CLOSE: Within = Within::OfMax(1e-5);
const SIDE: usize = 256;

fn mini(folder: &Path) -> Sam2 {
    Sam2::load(&golden::mini_weights(folder), None, &Device::flex()).unwrap()
}

fn tensor<const D: usize>(golden: &Golden, name: &str) -> Tensor<D> {
    let shape: [usize; D] = golden.shape(name).try_into().unwrap();
    Tensor::from_data(TensorData::new(golden.floats(name), shape), &Device::flex())
}

/// `[objects, channels, height, width]` to channels-last.
fn channels_last(golden: &Golden, name: &str) -> Tensor<4> {
    tensor::<4>(golden, name).permute([0, 2, 3, 1])
}

/// A channels-last map against a reference that has channels first.
#[track_caller]
fn assert_planes(golden: &Golden, name: &str, found: Tensor<4>, within: Within) {
    assert_close(name, &host(found.permute([0, 3, 1, 2])), &golden.floats(name), within);
}

fn frame(folder: &Path, index: usize) -> Image<[u8; 3]> {
    let picture = image::open(folder.join(format!("mini_video/{index:05}.png"))).unwrap().to_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Image::from_pixels(width, height, picture.pixels().map(|pixel| pixel.0).collect()).unwrap()
}

#[test]
fn frames_and_masks_are_resized_as_officially() {
    let Some(folder) = folder("frames_and_masks_are_resized_as_officially") else { return };
    let golden = Golden::open(&folder, "mini_preprocess");
    let expected = golden.bytes("frames_resized_u8");
    for (index, expected) in expected.chunks_exact(SIDE * SIDE * 3).enumerate() {
        let resized = resize_frame(&frame(&folder, index), SIDE);
        assert!(resized.pixels().as_flattened() == expected, "frame {index}");
    }
    let video = Size { width: 288, height: 200 };
    let model = Size { width: SIDE, height: SIDE };
    let low = Size { width: 64, height: 64 };
    let masks = golden.floats("mask_video_u8");
    let soft: Vec<f32> =
        masks.chunks_exact(288 * 200).flat_map(|mask| resize_antialiased(mask, video, model)).collect();
    assert_close(
        "mask_resized_soft",
        &soft[..SIDE * SIDE],
        &golden.floats("mask_resized_soft"),
        Within::Absolute(1e-5),
    );
    let binary: Vec<f32> = soft.iter().map(|value| f32::from(*value >= 0.5)).collect();
    assert_close("mask_resized_binary", &binary, &golden.floats("mask_resized_binary_u8"), Within::Absolute(0.0));
    let logits: Vec<f32> = binary
        .chunks_exact(SIDE * SIDE)
        .flat_map(|mask| {
            let logits: Vec<f32> = mask.iter().map(|value| value * 20.0 - 10.0).collect();
            resize_antialiased(&logits, model, low)
        })
        .collect();
    assert_close("mask_low_res_logits", &logits, &golden.floats("mask_low_res_logits"), Within::Absolute(1e-5));
    let high = resize_bilinear(&logits[..4096], low, model);
    assert_close("high", &high, &golden.floats("mask_high_from_low_logits"), Within::Absolute(1e-5));
    let in_video = resize_bilinear(&logits[..4096], low, video);
    assert_close("video", &in_video, &golden.floats("mask_video_from_low_logits"), Within::Absolute(1e-5));
}

#[test]
fn image_encoder() {
    let Some(folder) = folder("image_encoder") else { return };
    let golden = Golden::open(&folder, "mini_image_encoder");
    let network = mini(&folder);
    let input = network.input(&frame(&folder, 0));
    assert_close("input", &host(input.clone()), &golden.floats("input"), Within::Absolute(1e-6));
    assert_eq!(normalise(&resize_frame(&frame(&folder, 0), SIDE)), host(input.clone()));
    let trunk = &network.image_encoder.trunk;
    assert_close("patch_embed", &host(trunk.embed_patches(input.clone())), &golden.floats("patch_embed"), CLOSE);
    assert_close("pos_embed", &host(trunk.pos_embed().clone()), &golden.floats("pos_embed_full"), CLOSE);
    let stages = trunk.forward(input, |block, map| {
        let name = format!("block{block}");
        assert_close(&name, &host(map.clone()), &golden.floats(&name), CLOSE);
    });
    let (weights, device) = (golden::mini_weights(&folder), Device::flex());
    let read = Default::default();
    let reader = WeightReader::new(&weights, &read, &device).child("image_encoder.neck");
    let channels = [0, 1, 2, 3].map(|stage| network.config().trunk.embed_dim << stage);
    let (_, finest) = FpnNeck::load(&reader, channels, network.config().hidden_dim).unwrap();
    for (level, weights) in finest.into_iter().enumerate() {
        let map = weights.on(&device).forward(stages[level].clone());
        assert_planes(&golden, &format!("fpn{level}"), map.unsqueeze(), CLOSE);
    }
    let ImageFeatures { embedding, s0, s1 } = network.image_encoder.features(stages);
    assert_planes(&golden, "fpn2", embedding.reshape([1, 16, 16, 64]), CLOSE);
    assert_planes(&golden, "s0", s0, CLOSE);
    assert_planes(&golden, "s1", s1, CLOSE);
    for (name, side) in [("pos1", 32), ("pos2", 16)] {
        let encoded = super::position_encoding::sine_2d(side, side, 64);
        let encoded = Tensor::<1>::from_data(encoded.as_slice(), &Device::flex()).reshape([1, side, side, 64]);
        assert_planes(&golden, name, encoded, CLOSE);
    }
}

/// The prompts of a case: points and whether there is a mask.
fn prompt(golden: &Golden, case: &str) -> (Vec<InputPoint>, bool) {
    let label = |label: f32| match label as i32 {
        0 => Some(PointLabel::Negative),
        1 => Some(PointLabel::Positive),
        2 => Some(PointLabel::BoxStart),
        3 => Some(PointLabel::BoxEnd),
        _ => None,
    };
    let coords = golden.floats(&format!("{case}.coords"));
    let labels = golden.floats(&format!("{case}.labels"));
    let points = coords.chunks_exact(2).zip(labels);
    let points = points.map(|(point, value)| InputPoint { x: point[0], y: point[1], label: label(value) });
    (points.filter(|point| point.label.is_some()).collect(), case.contains("mask"))
}

const CASES: [&str; 7] = ["point1", "points3", "box", "box_points", "mask", "points_mask", "none"];

#[test]
fn prompt_encoder() {
    let Some(folder) = folder("prompt_encoder") else { return };
    let golden = Golden::open(&folder, "mini_prompt_encoder");
    let network = mini(&folder);
    let encoder = &network.heads.prompt_encoder;
    for case in CASES {
        let (mut points, masked) = prompt(&golden, case);
        if points.is_empty() {
            points.push(InputPoint::NONE);
        }
        points.push(InputPoint::NONE);
        let sparse = encoder.embed_points(&[points]);
        assert_close(&format!("{case}.sparse"), &host(sparse), &golden.floats(&format!("{case}.sparse")), CLOSE);
        let dense = if masked {
            encoder.embed_masks(tensor::<4>(&golden, "mask_input").squeeze_dim(1)).reshape([1, 16, 16, 64])
        } else {
            encoder.no_mask().reshape([1, 1, 1, 64])
        };
        assert_planes(&golden, &format!("{case}.dense"), dense, CLOSE);
    }
    let dense_pe = encoder.dense_position_encoding(16).reshape([1, 16, 16, 64]);
    assert_planes(&golden, "dense_pe", dense_pe, CLOSE);
}

fn decoder_features(golden: &Golden) -> ImageFeatures {
    ImageFeatures {
        embedding: channels_last(golden, "image_embeddings").reshape([1, 256, 64]),
        s0: channels_last(golden, "s0"),
        s1: channels_last(golden, "s1"),
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
        check("all_masks", &host(decoded.masks.clone()));
        check("all_iou", &decoded.ious[0]);
        check("mask_tokens_out", &host(decoded.tokens.clone()));
        check("object_score_logits", &decoded.object_scores);
        check("stability", &decoded.stability());
        let single = decoded.single();
        check("single.masks", &host(single.masks));
        check("single.iou", &single.ious);
        for (choice, name) in [(MaskChoice::BestOfThree, "multi"), (MaskChoice::Single, "single")] {
            let out = heads.forward(
                features.embedding.clone(),
                &features,
                std::slice::from_ref(&points),
                mask.clone(),
                choice,
            );
            check(&format!("{name}.heads_low_res_masks"), &host(out.masks));
            check(&format!("{name}.heads_obj_ptr"), &host(out.pointers));
            check(&format!("{name}.heads_object_score_logits"), &out.object_scores);
            let ious = golden.floats(&format!("{case}.{name}.heads_ious"));
            let best = ious.iter().copied().fold(f32::MIN, f32::max);
            assert_close(case, &out.ious, &[best], CLOSE);
        }
    }
}

#[test]
fn unstable_masks_give_way() {
    let Some(folder) = folder("unstable_masks_give_way") else { return };
    let golden = Golden::open(&folder, "mini_mask_decoder");
    let masks: Tensor<4> = tensor(&golden, "stability_rule.all_masks");
    let ious = golden.floats("stability_rule.all_iou");
    let decoded = DecodedMasks {
        masks,
        ious: ious.as_chunks::<4>().0.to_vec(),
        tokens: Tensor::zeros([6, 4, 64], &Device::flex()),
        object_scores: vec![1.0; 6],
    };
    assert_close("scores", &decoded.stability(), &golden.floats("stability_rule.scores"), Within::Absolute(1e-6));
    let single = decoded.single();
    assert_close("masks", &host(single.masks), &golden.floats("stability_rule.masks"), Within::Absolute(0.0));
    assert_close("iou", &single.ious, &golden.floats("stability_rule.iou"), Within::Absolute(0.0));
}

#[test]
fn an_absent_object_has_no_mask() {
    let Some(folder) = folder("an_absent_object_has_no_mask") else { return };
    let golden = Golden::open(&folder, "mini_mask_decoder");
    let prompts = Golden::open(&folder, "mini_prompt_encoder");
    let mut weights = golden::mini_weights(&folder);
    let bias = weights.0.get_mut("sam_mask_decoder.pred_obj_score_head.layers.2.bias").unwrap();
    bias.1[0] -= 50.0;
    let network = Sam2::load(&weights, None, &Device::flex()).unwrap();
    let features = decoder_features(&golden);
    let points = [prompt(&prompts, "point1").0];
    let out = network.heads.forward(features.embedding.clone(), &features, &points, None, MaskChoice::BestOfThree);
    assert_close("masks", &host(out.masks), &golden.floats("absent.heads_low_res_masks"), Within::Absolute(0.0));
    assert_close("pointer", &host(out.pointers), &golden.floats("absent.heads_obj_ptr"), Within::Absolute(0.0));
    assert_close("score", &out.object_scores, &golden.floats("absent.heads_object_score_logits"), CLOSE);
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
        let downsampled = Tensor::<1>::from_data(mask.as_slice(), &Device::flex()).reshape([1, SIDE, SIDE]);
        let downsampled = network.heads.downsample_masks(downsampled);
        let check = |name: &str, found: &[f32]| {
            let name = format!("{case}.{name}");
            assert_close(&name, found, &golden.floats(&name), CLOSE);
        };
        check("mask_downsample", &host(downsampled));
        let out = network.heads.use_masks_as_output(&features, &[mask], SIDE);
        check("low_res_masks", &host(out.masks));
        check("obj_ptr", &host(out.pointers));
        check("object_score_logits", &out.object_scores);
        check("ious", &out.ious);
    }
}

#[test]
fn memory_encoder() {
    let Some(folder) = folder("memory_encoder") else { return };
    let golden = Golden::open(&folder, "mini_memory_encoder");
    let network = mini(&folder);
    let encoder = &network.memory_encoder;
    let features = encoder.project_features(channels_last(&golden, "pix_feat").reshape([1, 256, 64]));
    assert_planes(&golden, "sigmoid.present.pix_feat_proj", features.clone(), CLOSE);
    for (name, kind) in [("sigmoid", MaskForMemory::Soft), ("binarized", MaskForMemory::Binary)] {
        let masks: Vec<f32> = golden.floats("mask_logits").iter().map(|logit| kind.apply(*logit)).collect();
        let masks = Tensor::<1>::from_data(masks.as_slice(), &Device::flex()).reshape([1, SIDE, SIDE]);
        if kind == MaskForMemory::Soft {
            assert_planes(&golden, "sigmoid.present.mask_downsampler", encoder.downsample_masks(masks.clone()), CLOSE);
        }
        for (presence, score) in [("present", 1.0), ("absent", -1.0)] {
            let memory = encoder.forward(features.clone(), masks.clone(), &[score]).reshape([1, 16, 16, 16]);
            assert_planes(&golden, &format!("{name}.{presence}.features"), memory, CLOSE);
        }
    }
    let position = super::position_encoding::sine_2d(16, 16, 16);
    let position = Tensor::<1>::from_data(position.as_slice(), &Device::flex()).reshape([1, 16, 16, 16]);
    assert_planes(&golden, "pos", position, CLOSE);
}

type Memories = Vec<(String, usize, usize)>;
type Pointers = Vec<(String, usize, f32)>;

/// The frames and pointers of a bank in the order that the official code puts them.
fn bank_order(bank: &str, golden: &Golden) -> (Memories, Pointers) {
    let now: isize = bank.rsplit('f').next().unwrap().parse().unwrap();
    let (direction, length) =
        if bank.starts_with('D') { (-1, 10) } else { (1, if bank.starts_with('F') { 20 } else { 10 }) };
    let frames = |kind: &str| golden.floats(&format!("{bank}.{kind}_frames")).into_iter().map(|frame| frame as isize);
    let longest = (length.min(16) - 1) as f32;
    let (mut spatial, mut pointers) = (Vec::new(), Vec::new());
    for (index, frame) in frames("cond").enumerate() {
        spatial.push(("cond".to_owned(), index, 6));
        let distance = (now - frame) * direction;
        if distance >= 0 {
            pointers.push(("cond".to_owned(), index, distance as f32 / longest));
        }
    }
    let at = |distance: isize| frames("noncond").position(|frame| (now - frame) * direction == distance);
    for distance in (1..=6).rev() {
        spatial.extend(at(distance).map(|index| ("noncond".to_owned(), index, distance as usize - 1)));
    }
    for distance in 1..length.min(16) {
        pointers.extend(at(distance).map(|index| ("noncond".to_owned(), index, distance as f32 / longest)));
    }
    (spatial, pointers)
}

#[test]
fn memory_attention() {
    let Some(folder) = folder("memory_attention") else { return };
    let golden = Golden::open(&folder, "mini_memory_attention");
    let network = mini(&folder);
    let attention = &network.memory_attention;
    for bank in ["A_f2", "A_f9", "D_rev_f3", "E_f4", "F_f19"] {
        let (spatial, pointers) = bank_order(bank, &golden);
        let tokens = |kind: &str, index: usize| {
            let all = channels_last(&golden, &format!("{bank}.{kind}_maskmem_features"));
            host(all.narrow(0, index, 1))
        };
        let features: Vec<Vec<f32>> = spatial.iter().map(|(kind, index, _)| tokens(kind, *index)).collect();
        let pointer =
            |kind: &str, index: usize| golden.floats(&format!("{bank}.{kind}_obj_ptr"))[index * 64..][..64].to_vec();
        let values: Vec<Vec<f32>> = pointers.iter().map(|(kind, index, _)| pointer(kind, *index)).collect();
        let spatial: Vec<SpatialMemory> = spatial
            .iter()
            .zip(&features)
            .map(|((_, _, row), features)| SpatialMemory { features, temporal_row: *row })
            .collect();
        let pointers: Vec<RememberedPointer> = pointers
            .iter()
            .zip(&values)
            .map(|((_, _, distance), pointer)| RememberedPointer { pointer, distance: *distance })
            .collect();
        let memory = attention.assemble(&spatial, &pointers);
        assert_eq!(memory.pointer_tokens, golden.ints(&format!("{bank}.num_obj_ptr_tokens"))[0], "{bank}");
        let expected = golden.floats(&format!("{bank}.memory"));
        assert_close(&format!("{bank}.memory"), &memory.values, &expected, Within::Absolute(0.0));
        let position = golden.floats(&format!("{bank}.memory_pos"));
        let keys: Vec<f32> = expected.iter().zip(position).map(|(value, position)| value + position).collect();
        assert_close(&format!("{bank}.keys"), &memory.keys, &keys, CLOSE);

        let current = tensor::<2>(&golden, &format!("{bank}.curr")).unsqueeze();
        // Twice the same memory: objects must not disturb each other.
        let out = attention.forward(current, &[memory.clone(), memory], |layer, map| {
            let name = format!("{bank}.layer{layer}");
            if golden.has(&name) {
                assert_close(&name, &host(map.clone().narrow(0, 1, 1)), &golden.floats(&name), CLOSE);
            }
        });
        for object in [0, 1] {
            let out = host(out.clone().narrow(0, object, 1));
            assert_close(&format!("{bank}.out"), &out, &golden.floats(&format!("{bank}.out")), CLOSE);
        }
    }
}

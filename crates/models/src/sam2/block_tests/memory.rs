use super::*;
use crate::sam2::encoder::position_encoding;
use crate::sam2::memory::{
    AssembledMemory, DistantPointer, MaskForMemory, RememberedMap, RememberedPointer, SpatialMemory,
};

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
        let masks = Tensor::<1>::from_data(masks.as_slice(), &device()).reshape([1, SIDE, SIDE]);
        if kind == MaskForMemory::Soft {
            assert_planes(&golden, "sigmoid.present.mask_downsampler", encoder.downsample_masks(masks.clone()), CLOSE);
        }
        for (presence, score) in [("present", 1.0), ("absent", -1.0)] {
            let memory = encoder.forward(features.clone(), masks.clone(), &[score]).reshape([1, 16, 16, 16]);
            assert_planes(&golden, &format!("{name}.{presence}.features"), memory, CLOSE);
        }
    }
    let position = position_encoding::sine_2d(16, 16, 16);
    let position = Tensor::<1>::from_data(position.as_slice(), &device()).reshape([1, 16, 16, 16]);
    assert_planes(&golden, "pos", position, CLOSE);
}

type Memories = Vec<(String, usize, usize)>;
type Pointers = Vec<(String, usize, f32)>;

/// Frames and pointers of a bank in the official code's order.
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
        let map = |kind: &str, index: usize| {
            let all = channels_last(&golden, &format!("{bank}.{kind}_maskmem_features"));
            RememberedMap::new(all.narrow(0, index, 1).squeeze_dim::<3>(0).flatten(0, 1))
        };
        let features: Vec<RememberedMap> = spatial.iter().map(|(kind, index, _)| map(kind, *index)).collect();
        let pointer = |kind: &str, index: usize| {
            let all = golden.floats(&format!("{bank}.{kind}_obj_ptr"));
            let pointer = Tensor::<1>::from_data(&all[index * 64..][..64], &device());
            RememberedPointer::new(pointer.unsqueeze())
        };
        let kept: Vec<RememberedPointer> = pointers.iter().map(|(kind, index, _)| pointer(kind, *index)).collect();
        let spatial: Vec<SpatialMemory> = spatial
            .iter()
            .zip(&features)
            .map(|((_, _, row), features)| SpatialMemory { features, temporal_row: *row })
            .collect();
        let pointers: Vec<DistantPointer> = pointers
            .iter()
            .zip(&kept)
            .map(|((_, _, distance), pointer)| DistantPointer { pointer, distance: *distance })
            .collect();
        let assembled = network.assembly.assemble(&spatial, &pointers);
        let (memory_values, memory_keys, unplaced_tokens) = match &assembled {
            AssembledMemory::Host(memory) => (memory.values.clone(), memory.keys.clone(), memory.unplaced_tokens),
            AssembledMemory::Device(memory) => {
                (values(memory.values.clone()), values(memory.keys.clone()), memory.unplaced_tokens)
            }
        };
        assert_eq!(unplaced_tokens, golden.ints(&format!("{bank}.num_obj_ptr_tokens"))[0], "{bank}");
        let expected = golden.floats(&format!("{bank}.memory"));
        assert_close(&format!("{bank}.memory"), &memory_values, &expected, Within::Absolute(0.0));
        let position = golden.floats(&format!("{bank}.memory_pos"));
        let keys: Vec<f32> = expected.iter().zip(position).map(|(value, position)| value + position).collect();
        assert_close(&format!("{bank}.keys"), &memory_keys, &keys, CLOSE);

        let current = tensor::<2>(&golden, &format!("{bank}.curr")).unsqueeze();
        // The same memory twice: objects must not affect each other.
        let out = attention.forward(&attention.prepare(current), &[assembled.clone(), assembled], |layer, map| {
            let name = format!("{bank}.layer{layer}");
            if golden.has(&name) {
                assert_close(&name, &values(map.clone().narrow(0, 1, 1)), &golden.floats(&name), CLOSE);
            }
        });
        for object in [0, 1] {
            let out = values(out.clone().narrow(0, object, 1));
            assert_close(&format!("{bank}.out"), &out, &golden.floats(&format!("{bank}.out")), CLOSE);
        }
    }
}

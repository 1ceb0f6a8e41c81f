use super::*;
use crate::sam2::encoder::fpn_neck::FpnNeck;
use crate::sam2::encoder::position_encoding;
use crate::sam2::encoder::{FineFeatures, ImageEncoder, ImageFeatures, Trunk};
use crate::sam2::resize::{normalise, resize_frame};
use crate::sam2::weights::WeightReader;

#[test]
fn image_encoder() {
    let Some(folder) = folder("image_encoder") else { return };
    let golden = Golden::open(&folder, "mini_image_encoder");
    let network = mini(&folder);
    let input = network.input(&frame(&folder, 0));
    assert_close("input", &values(input.clone()), &golden.floats("input"), Within::Absolute(1e-6));
    assert_eq!(normalise(&resize_frame(&frame(&folder, 0), SIDE)), values(input.clone()));
    let ImageEncoder::Pyramid(encoder) = &network.image_encoder else { panic!("not a pyramid") };
    let Trunk::Hiera(trunk) = &encoder.trunk else { panic!("not Hiera") };
    assert_close("patch_embed", &values(trunk.embed_patches(input.clone())), &golden.floats("patch_embed"), CLOSE);
    assert_close("pos_embed", &values(trunk.pos_embed().clone()), &golden.floats("pos_embed_full"), CLOSE);
    let stages = trunk.forward(input, |block, map| {
        let name = format!("block{block}");
        assert_close(&name, &values(map.clone()), &golden.floats(&name), CLOSE);
    });
    let (weights, here) = (golden::mini_weights(&folder), device());
    let read = Default::default();
    let reader = WeightReader::new(&weights, &read, &here).child("image_encoder.neck");
    let channels = [16, 32, 64, 128];
    let (_, finest) = FpnNeck::load(&reader, channels, network.config().hidden_dim).unwrap();
    for (level, weights) in finest.into_iter().enumerate() {
        let map = weights.on(&here).forward(stages[level].clone());
        assert_planes(&golden, &format!("fpn{level}"), map.unsqueeze(), CLOSE);
    }
    let ImageFeatures { embedding, fine } = encoder.features(stages);
    let FineFeatures { s0, s1 } = fine.unwrap();
    assert_planes(&golden, "fpn2", embedding.reshape([1, 16, 16, 64]), CLOSE);
    assert_planes(&golden, "s0", s0, CLOSE);
    assert_planes(&golden, "s1", s1, CLOSE);
    for (name, side) in [("pos1", 32), ("pos2", 16)] {
        let encoded = position_encoding::sine_2d(side, side, 64);
        let encoded = Tensor::<1>::from_data(encoded.as_slice(), &device()).reshape([1, side, side, 64]);
        assert_planes(&golden, name, encoded, CLOSE);
    }
}

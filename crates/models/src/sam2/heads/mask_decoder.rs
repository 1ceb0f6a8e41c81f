//! The mask decoder: from image features and prompt embeddings to masks (official `mask_decoder.py`).

use super::two_way_transformer::TwoWayTransformer;
use crate::sam2::Sam2Error;
use crate::sam2::encoder::ImageFeatures;
use crate::sam2::layers::host::host;
use crate::sam2::layers::{Activation, LayerNorm, Mlp, Upscale, activate};
use crate::sam2::weights::WeightReader;
use burn::tensor::{Int, Tensor, TensorData};

/// Masks of one prompt: the single mask and three alternatives.
pub(crate) const MASKS: usize = 4;
const IOU_HIDDEN: usize = 256;
/// Logits between this and its negative count as unsure in the stability score.
const STABILITY_DELTA: f32 = 0.05;
/// A single mask below this stability gives way to the best of the three.
const STABILITY_THRESHOLD: f32 = 0.98;

/// Every mask that the decoder predicts.
#[derive(Clone, Debug)]
pub(crate) struct DecodedMasks {
    /// Logits, `[objects, 4, 4 side, 4 side]`: the single mask, then the three of an ambiguous prompt.
    pub masks: Tensor<4>,
    /// Predicted intersection over union, `[objects][4]`.
    pub ious: Vec<[f32; MASKS]>,
    /// The mask tokens after the transformer, `[objects, 4, hidden]`.
    pub tokens: Tensor<3>,
    /// Logits of "the object is in the image", `[objects]`.
    pub object_scores: Vec<f32>,
}

/// One mask per object.
#[derive(Clone, Debug)]
pub(crate) struct SelectedMasks {
    /// Logits, `[objects, 4 side, 4 side]`.
    pub masks: Tensor<3>,
    /// Predicted intersection over union.
    pub ious: Vec<f32>,
    /// The token that the object pointer is computed from, `[objects, hidden]`.
    pub tokens: Tensor<2>,
}

/// The mask decoder.
#[derive(Clone, Debug)]
pub(crate) struct MaskDecoder {
    transformer: TwoWayTransformer,
    /// Object score, IoU and mask tokens, `[1, 6, hidden]`.
    output_tokens: Tensor<3>,
    upscale1: Upscale,
    upscale_norm: LayerNorm,
    upscale2: Upscale,
    hypernetworks: Vec<Mlp>,
    iou_head: Mlp,
    object_score_head: Mlp,
}

impl MaskDecoder {
    pub fn load(reader: &WeightReader, dim: usize) -> Result<Self, Sam2Error> {
        let token = |name: &str, count| reader.tensor(&format!("{name}.weight"), [count, dim]);
        let tokens: [Tensor<2>; 3] =
            [token("obj_score_token", 1)?, token("iou_token", 1)?, token("mask_tokens", MASKS)?];
        let upscaling = reader.child("output_upscaling");
        let mlp = |name: String, widths: &[usize]| Mlp::load(&reader.child(name), widths, Activation::Relu);
        Ok(Self {
            transformer: TwoWayTransformer::load(&reader.child("transformer"), dim)?,
            output_tokens: Tensor::cat(tokens.to_vec(), 0).unsqueeze(),
            upscale1: Upscale::load(&upscaling.child("0"), dim, dim / 4)?,
            upscale_norm: LayerNorm::load(&upscaling.child("1"), dim / 4, 1e-6)?,
            upscale2: Upscale::load(&upscaling.child("3"), dim / 4, dim / 8)?,
            hypernetworks: (0..MASKS)
                .map(|mask| mlp(format!("output_hypernetworks_mlps.{mask}"), &[dim, dim, dim, dim / 8]))
                .collect::<Result<_, _>>()?,
            iou_head: mlp("iou_prediction_head".into(), &[dim, IOU_HIDDEN, IOU_HIDDEN, MASKS])?.with_sigmoid(),
            object_score_head: mlp("pred_obj_score_head".into(), &[dim, dim, dim, 1])?,
        })
    }

    /// Transformer output for image embeddings `[objects or 1, tokens, hidden]`, sparse prompts `[objects, n, hidden]`
    /// and dense prompts `[objects or 1, tokens or 1, hidden]`: tokens `[objects, 6 + n, hidden]`, and the image side.
    pub fn transform(
        &self,
        image: Tensor<3>,
        image_pe: &Tensor<3>,
        sparse: Tensor<3>,
        dense: Tensor<3>,
    ) -> [Tensor<3>; 2] {
        let [objects, _, hidden] = sparse.dims();
        let output_tokens = self.output_tokens.clone().expand([objects, 2 + MASKS, hidden]);
        let tokens = Tensor::cat(vec![output_tokens, sparse], 1);
        let image = image + dense;
        let pixels = image.dims()[1];
        self.transformer.forward(image.expand([objects, pixels, hidden]), image_pe, tokens)
    }

    /// All masks, from what [`Self::transform`] returns.
    pub fn decode(&self, [tokens, image]: [Tensor<3>; 2], features: &ImageFeatures) -> DecodedMasks {
        let [objects, pixels, hidden] = image.dims();
        let side = pixels.isqrt();
        let map = self.upscale1.forward(image.reshape([objects, side, side, hidden])) + features.s1.clone();
        let map = activate(Activation::Gelu, self.upscale_norm.forward(map));
        let map = activate(Activation::Gelu, self.upscale2.forward(map) + features.s0.clone());
        let map = map.reshape([objects, 16 * pixels, hidden / 8]);

        let mask_tokens = tokens.clone().narrow(1, 2, MASKS);
        let hyper = self.hypernetworks.iter().enumerate();
        let hyper = hyper.map(|(mask, mlp)| mlp.forward(mask_tokens.clone().narrow(1, mask, 1))).collect();
        let masks = Tensor::cat(hyper, 1).matmul(map.swap_dims(1, 2));
        let ious = host(self.iou_head.forward(tokens.clone().narrow(1, 1, 1)));
        DecodedMasks {
            masks: masks.reshape([objects, MASKS, 4 * side, 4 * side]),
            ious: ious.as_chunks::<MASKS>().0.to_vec(),
            tokens: mask_tokens,
            object_scores: host(self.object_score_head.forward(tokens.narrow(1, 0, 1))),
        }
    }
}

impl DecodedMasks {
    /// The best of the three masks of an ambiguous prompt by predicted IoU, with its own token.
    pub fn best_of_three(&self) -> SelectedMasks {
        let chosen: Vec<usize> = self.ious.iter().map(best_of_three).collect();
        self.select(&chosen, &chosen)
    }

    /// The single mask, or the best of the three where it is not stable; always with the single mask's token.
    pub fn single(&self) -> SelectedMasks {
        let chosen: Vec<usize> = self
            .stability()
            .iter()
            .zip(&self.ious)
            .map(|(stability, ious)| if *stability >= STABILITY_THRESHOLD { 0 } else { best_of_three(ious) })
            .collect();
        self.select(&chosen, &vec![0; chosen.len()])
    }

    /// Stability of the single masks: pixels surely inside divided by pixels possibly inside; 1 if there are none.
    pub fn stability(&self) -> Vec<f32> {
        let [objects, _, height, width] = self.masks.dims();
        let single = self.masks.clone().narrow(1, 0, 1).reshape([objects, height * width]);
        let values = host(single);
        let count = |mask: &[f32], threshold: f32| mask.iter().filter(|logit| **logit > threshold).count() as f32;
        let score = |mask: &[f32]| match (count(mask, STABILITY_DELTA), count(mask, -STABILITY_DELTA)) {
            (_, 0.0) => 1.0,
            (sure, possible) => sure / possible,
        };
        values.chunks_exact(height * width).map(score).collect()
    }

    fn select(&self, masks: &[usize], tokens: &[usize]) -> SelectedMasks {
        let [objects, _, height, width] = self.masks.dims();
        let hidden = self.tokens.dims()[2];
        let device = self.masks.device();
        let flat = |chosen: &[usize]| {
            let indices = chosen.iter().enumerate().map(|(object, chosen)| (object * MASKS + chosen) as i64).collect();
            Tensor::<1, Int>::from_data(TensorData::new::<i64, _>(indices, [objects]), &device)
        };
        SelectedMasks {
            masks: self.masks.clone().reshape([objects * MASKS, height, width]).select(0, flat(masks)),
            ious: self.ious.iter().zip(masks).map(|(ious, chosen)| ious[*chosen]).collect(),
            tokens: self.tokens.clone().reshape([objects * MASKS, hidden]).select(0, flat(tokens)),
        }
    }
}

fn best_of_three(ious: &[f32; MASKS]) -> usize {
    // The first of equals, as torch.argmax.
    (2..MASKS).fold(1, |best, mask| if ious[mask] > ious[best] { mask } else { best })
}

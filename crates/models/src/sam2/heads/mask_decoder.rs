//! The mask decoder: from image features and prompt embeddings to masks (official `mask_decoder.py`).

use super::two_way_transformer::TwoWayTransformer;
use crate::sam2::Sam2Error;
use crate::sam2::encoder::ImageFeatures;
use crate::sam2::layers::{Activation, LayerNorm, Mlp, Upscale, activate};
use crate::sam2::weights::WeightReader;
use burn::tensor::{Int, Tensor};

/// Number of masks per prompt: the single mask and three alternatives.
pub(crate) const MASKS: usize = 4;
const IOU_HIDDEN: usize = 256;
/// Logits between this and its negative count as uncertain in the stability score.
const STABILITY_DELTA: f32 = 0.05;
/// A single mask below this stability is replaced by the best of the three.
const STABILITY_THRESHOLD: f32 = 0.98;

/// All masks that the decoder predicts.
#[derive(Clone, Debug)]
pub(crate) struct DecodedMasks {
    /// Logits, `[objects, 4, 4 side, 4 side]`: the single mask, then the three of an ambiguous prompt.
    pub masks: Tensor<4>,
    /// Predicted intersection over union, `[objects, 4]`.
    pub ious: Tensor<2>,
    /// The mask tokens after the transformer, `[objects, 4, hidden]`.
    pub tokens: Tensor<3>,
    /// Logits of "the object is in the image", `[objects]`.
    pub object_scores: Tensor<1>,
}

/// One mask per object.
#[derive(Clone, Debug)]
pub(crate) struct SelectedMasks {
    /// Logits, `[objects, 4 side, 4 side]`.
    pub masks: Tensor<3>,
    /// Predicted intersection over union, `[objects]`.
    pub ious: Tensor<1>,
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

    /// Runs the transformer on image embeddings `[objects or 1, tokens, hidden]`, sparse prompts `[objects, n, hidden]`
    /// and dense prompts `[objects or 1, tokens or 1, hidden]`. Returns tokens `[objects, 6 + n, hidden]` and the image
    /// embeddings.
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

    /// Decodes all masks from the output of [`Self::transform`].
    pub fn decode(&self, [tokens, image]: [Tensor<3>; 2], features: &ImageFeatures) -> DecodedMasks {
        let [objects, pixels, hidden] = image.dims();
        let side = pixels.isqrt();
        let fine = features.fine.as_ref();
        let with = |map: Tensor<4>, fine: Option<&Tensor<4>>| match fine {
            Some(fine) => map + fine.clone(),
            None => map,
        };
        let map = self.upscale1.forward(image.reshape([objects, side, side, hidden]));
        let map = self.upscale_norm.forward(with(map, fine.map(|fine| &fine.s1)));
        let map = self.upscale2.forward(activate(Activation::Gelu, map));
        let map = activate(Activation::Gelu, with(map, fine.map(|fine| &fine.s0)));
        let map = map.reshape([objects, 16 * pixels, hidden / 8]);

        let mask_tokens = tokens.clone().narrow(1, 2, MASKS);
        let hyper = self.hypernetworks.iter().enumerate();
        let hyper = hyper.map(|(mask, mlp)| mlp.forward(mask_tokens.clone().narrow(1, mask, 1))).collect();
        let masks = Tensor::cat(hyper, 1).matmul(map.swap_dims(1, 2));
        DecodedMasks {
            masks: masks.reshape([objects, MASKS, 4 * side, 4 * side]),
            ious: self.iou_head.forward(tokens.clone().narrow(1, 1, 1)).squeeze_dim(1),
            tokens: mask_tokens,
            object_scores: self.object_score_head.forward(tokens.narrow(1, 0, 1)).flatten(0, 2),
        }
    }
}

impl DecodedMasks {
    /// Selects the best of the three masks of an ambiguous prompt by predicted IoU, with its own token.
    pub fn best_of_three(&self) -> SelectedMasks {
        let best = self.index_of_best();
        self.select(best.clone(), best)
    }

    /// Selects the single mask, or the best of the three if it is not stable; always with the single mask's token.
    pub fn single(&self) -> SelectedMasks {
        let is_stable = self.stability().greater_equal_elem(STABILITY_THRESHOLD);
        let best = self.index_of_best();
        self.select(best.clone().mask_fill(is_stable, 0), best.zeros_like())
    }

    /// Stability of the single masks, `[objects]`: the number of pixels certainly inside divided by the number possibly
    /// inside; 1 if there are none.
    pub fn stability(&self) -> Tensor<1> {
        let single = self.masks.clone().narrow(1, 0, 1).flatten::<2>(1, 3);
        let count = |threshold: f32| single.clone().greater_elem(threshold).float().sum_dim(1).squeeze_dim::<1>(1);
        let (sure, possible) = (count(STABILITY_DELTA), count(-STABILITY_DELTA));
        let has_none = possible.clone().equal_elem(0.0);
        (sure / possible).mask_fill(has_none, 1.0)
    }

    /// Index of the best of the three masks of each object, `[objects]`; the first one if equal, as in `torch.argmax`.
    fn index_of_best(&self) -> Tensor<1, Int> {
        let [first, second, third] = [1, 2, 3].map(|mask| self.ious.clone().narrow(1, mask, 1).squeeze_dim::<1>(1));
        let is_second = second.clone().greater(first.clone());
        let is_third = third.greater(first.mask_where(is_second.clone(), second));
        (is_second.int() + 1).mask_fill(is_third, 3)
    }

    /// Selects the masks and tokens with these indices, `[objects]` each.
    fn select(&self, masks: Tensor<1, Int>, tokens: Tensor<1, Int>) -> SelectedMasks {
        let [objects, _, height, width] = self.masks.dims();
        let hidden = self.tokens.dims()[2];
        let rows = Tensor::<1, Int>::arange(0..objects as i64, &self.masks.device()) * MASKS as i64;
        let (masks, tokens) = (rows.clone() + masks, rows + tokens);
        SelectedMasks {
            masks: self.masks.clone().reshape([objects * MASKS, height, width]).select(0, masks.clone()),
            ious: self.ious.clone().flatten::<1>(0, 1).select(0, masks),
            tokens: self.tokens.clone().reshape([objects * MASKS, hidden]).select(0, tokens),
        }
    }
}

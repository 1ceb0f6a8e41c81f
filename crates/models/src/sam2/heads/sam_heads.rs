//! Prompt encoder, mask decoder and object pointer together (official `sam2_base.py`, `_forward_sam_heads` and
//! `_use_mask_as_output`).

use super::mask_decoder::{DecodedMasks, MaskDecoder};
use crate::sam2::Sam2Error;
use crate::sam2::config::NO_OBJECT_LOGIT;
use crate::sam2::encoder::ImageFeatures;
use crate::sam2::layers::{Activation, Conv2d, ConvShape, Mlp};
use crate::sam2::prompt::{InputPoint, PromptEncoder};
use crate::sam2::resize::{Size, resize_antialiased};
use crate::sam2::weights::WeightReader;
use crate::transfer::upload;
use burn::tensor::{Bool, Tensor};

/// Logit of a given mask: positive inside, negative outside.
const GIVEN_LOGIT: f32 = 10.0;

/// The output of the heads for some objects in one frame.
#[derive(Clone, Debug)]
pub(crate) struct HeadOutputs {
    /// Mask logits, `[objects, side, side]` at a quarter of the network input's resolution.
    pub masks: Tensor<3>,
    /// Predicted intersection over union, `[objects]`.
    pub ious: Tensor<1>,
    /// Object pointers, `[objects, hidden]`.
    pub pointers: Tensor<2>,
    /// Logits of "the object is in the image", `[objects]`.
    pub object_scores: Tensor<1>,
}

/// Choice among the decoder's masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskChoice {
    /// The best of the three masks for an ambiguous prompt.
    BestOfThree,
    /// The single mask if it is stable, else the best of the three.
    Single,
}

/// The heads.
#[derive(Clone, Debug)]
pub(crate) struct SamHeads {
    pub prompt_encoder: PromptEncoder,
    pub mask_decoder: MaskDecoder,
    /// `[1, tokens, hidden]`.
    image_pe: Tensor<3>,
    pointer_projection: Mlp,
    /// `[1, hidden]`.
    no_object_pointer: Tensor<2>,
    mask_downsample: Conv2d,
}

impl SamHeads {
    /// Loads the heads for a feature map of `side` × `side` tokens.
    pub fn load(reader: &WeightReader, hidden: usize, image_size: usize, side: usize) -> Result<Self, Sam2Error> {
        let prompt_encoder = PromptEncoder::load(&reader.child("sam_prompt_encoder"), hidden, image_size)?;
        let quarter = ConvShape { inputs: 1, outputs: 1, kernel: 4, stride: 4, padding: 0, groups: 1 };
        Ok(Self {
            image_pe: prompt_encoder.dense_position_encoding(side),
            prompt_encoder,
            mask_decoder: MaskDecoder::load(&reader.child("sam_mask_decoder"), hidden)?,
            pointer_projection: Mlp::load(&reader.child("obj_ptr_proj"), &[hidden; 4], Activation::Relu)?,
            no_object_pointer: reader.tensor("no_obj_ptr", [1, hidden])?,
            mask_downsample: Conv2d::load(&reader.child("mask_downsample"), quarter)?,
        })
    }

    /// Computes masks of objects from image embeddings `[objects or 1, tokens, hidden]`, points (one list per object,
    /// all of equal length; empty lists for none) and, for all or none of the objects, mask logits
    /// `[objects, 4 side, 4 side]`.
    pub fn forward(
        &self,
        embeddings: Tensor<3>,
        features: &ImageFeatures,
        points: &[Vec<InputPoint>],
        masks: Option<Tensor<3>>,
        choice: MaskChoice,
    ) -> HeadOutputs {
        let decoded = self.decode_all(embeddings, features, points, masks);
        let selected = match choice {
            MaskChoice::BestOfThree => decoded.best_of_three(),
            MaskChoice::Single => decoded.single(),
        };
        let is_absent = decoded.object_scores.clone().greater_elem(0.0).bool_not();
        let shape = selected.masks.dims();
        let everywhere = is_absent.clone().reshape([shape[0], 1, 1]).expand(shape);
        HeadOutputs {
            masks: selected.masks.mask_fill(everywhere, NO_OBJECT_LOGIT),
            ious: selected.ious,
            pointers: self.replace_absent(self.pointer_projection.forward(selected.tokens), is_absent),
            object_scores: decoded.object_scores,
        }
    }

    /// Decodes all masks, for the same inputs as [`Self::forward`].
    pub fn decode_all(
        &self,
        embeddings: Tensor<3>,
        features: &ImageFeatures,
        points: &[Vec<InputPoint>],
        masks: Option<Tensor<3>>,
    ) -> DecodedMasks {
        let dense = masks.map_or_else(|| self.prompt_encoder.no_mask(), |masks| self.prompt_encoder.embed_masks(masks));
        let sparse = self.prompt_encoder.embed_points(&with_padding(points));
        let transformed = self.mask_decoder.transform(embeddings, &self.image_pe, sparse, dense);
        self.mask_decoder.decode(transformed, features)
    }

    /// Uses given masks (each `[side, side]` of the network input, 1 inside and 0 outside) unchanged; the decoder only
    /// computes their object pointers.
    pub fn use_masks_as_output(&self, features: &ImageFeatures, masks: &[Vec<f32>], image_size: usize) -> HeadOutputs {
        let device = features.embedding.device();
        let (objects, quarter) = (masks.len(), image_size / 4);
        let size = [objects, image_size, image_size];
        let prompts = self.downsample_masks(upload(masks.concat(), size, &device));
        let points = vec![Vec::new(); objects];
        let decoded = self.forward(features.embedding.clone(), features, &points, Some(prompts), MaskChoice::Single);

        let sign = |mask: &Vec<f32>| if mask.iter().any(|value| *value > 0.0) { GIVEN_LOGIT } else { -GIVEN_LOGIT };
        let object_scores = upload(masks.iter().map(sign).collect(), [objects], &device);
        let logits: Vec<f32> = masks.iter().flat_map(|mask| low_res_logits(mask, image_size)).collect();
        HeadOutputs {
            masks: upload(logits, [objects, quarter, quarter], &device),
            ious: Tensor::ones([objects], &device),
            pointers: self.replace_absent(decoded.pointers, object_scores.clone().greater_elem(0.0).bool_not()),
            object_scores,
        }
    }

    /// The learned reduction of 0/1 masks to prompts: `[objects, side, side]` to `[objects, side / 4, side / 4]`.
    pub fn downsample_masks(&self, masks: Tensor<3>) -> Tensor<3> {
        self.mask_downsample.forward_planes(masks.unsqueeze_dim(1)).squeeze_dim(1)
    }

    /// Replaces pointers `[objects, hidden]` by the "no object" pointer where `is_absent` `[objects]` is true.
    fn replace_absent(&self, pointers: Tensor<2>, is_absent: Tensor<1, Bool>) -> Tensor<2> {
        let shape = pointers.dims();
        pointers
            .mask_where(is_absent.reshape([shape[0], 1]).expand(shape), self.no_object_pointer.clone().expand(shape))
    }
}

/// Pads every list of points as the network expects: it ends with an unlabelled point, preceded by at least one more.
fn with_padding(points: &[Vec<InputPoint>]) -> Vec<Vec<InputPoint>> {
    let padded = |points: &Vec<InputPoint>| {
        let mut points = points.clone();
        if points.is_empty() {
            points.push(InputPoint::NONE);
        }
        points.push(InputPoint::NONE);
        points
    };
    points.iter().map(padded).collect()
}

/// Converts a given 0/1 mask to logits at a quarter of its resolution.
fn low_res_logits(mask: &[f32], image_size: usize) -> Vec<f32> {
    let logits: Vec<f32> = mask.iter().map(|value| value * 2.0 * GIVEN_LOGIT - GIVEN_LOGIT).collect();
    let size = Size { width: image_size, height: image_size };
    resize_antialiased(&logits, size, Size { width: image_size / 4, height: image_size / 4 })
}

//! Prompt encoder, mask decoder and object pointer together (official `sam2_base.py`, `_forward_sam_heads` and
//! `_use_mask_as_output`).

use super::mask_decoder::{DecodedMasks, MaskDecoder};
use crate::sam2::Sam2Error;
use crate::sam2::config::NO_OBJECT_LOGIT;
use crate::sam2::encoder::ImageFeatures;
use crate::sam2::layers::host::host;
use crate::sam2::layers::{Activation, Conv2d, ConvShape, Mlp};
use crate::sam2::prompt::{InputPoint, PromptEncoder};
use crate::sam2::resize::{Size, resize_antialiased};
use crate::sam2::weights::WeightReader;
use burn::tensor::{Tensor, TensorData};

/// Logit of a given mask inside; outside it is the negative.
const GIVEN_LOGIT: f32 = 10.0;

/// The output of the heads for some objects in one frame.
#[derive(Clone, Debug)]
pub(crate) struct HeadOutputs {
    /// Mask logits, `[objects, side, side]` at a quarter of the network input's resolution.
    pub masks: Tensor<3>,
    /// Predicted intersection over union.
    pub ious: Vec<f32>,
    /// Object pointers, `[objects, hidden]`.
    pub pointers: Tensor<2>,
    /// Logits of "the object is in the image".
    pub object_scores: Vec<f32>,
}

/// Which of the decoder's masks to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskChoice {
    /// The best of the three masks for an ambiguous prompt.
    BestOfThree,
    /// The single mask if it is stable.
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
    /// Reads the heads for a feature map of `side` × `side` tokens.
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

    /// Masks of objects from image embeddings `[objects or 1, tokens, hidden]`, points (one list per object, all equally
    /// long; empty lists for none) and, for all or none of them, mask logits `[objects, 4 side, 4 side]`.
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
        let present: Vec<bool> = decoded.object_scores.iter().map(|score| *score > 0.0).collect();
        HeadOutputs {
            masks: where_present(selected.masks, &present, NO_OBJECT_LOGIT),
            ious: selected.ious,
            pointers: self.pointers(selected.tokens, &present),
            object_scores: decoded.object_scores,
        }
    }

    /// All masks that the decoder has for the same input.
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

    /// Takes given masks (each `[side, side]` of the network input, 1 inside and 0 outside) as they are; the decoder only
    /// computes their object pointers.
    pub fn use_masks_as_output(&self, features: &ImageFeatures, masks: &[Vec<f32>], image_size: usize) -> HeadOutputs {
        let device = features.embedding.device();
        let (objects, quarter) = (masks.len(), image_size / 4);
        let prompts = self.downsample_masks(Tensor::from_data(
            TensorData::new(masks.concat(), [objects, image_size, image_size]),
            &device,
        ));
        let points = vec![Vec::new(); objects];
        let decoded = self.forward(features.embedding.clone(), features, &points, Some(prompts), MaskChoice::Single);

        let present: Vec<bool> = masks.iter().map(|mask| mask.iter().any(|value| *value > 0.0)).collect();
        let logits: Vec<f32> = masks.iter().flat_map(|mask| low_res_logits(mask, image_size)).collect();
        let sign = |present: &bool| if *present { GIVEN_LOGIT } else { -GIVEN_LOGIT };
        HeadOutputs {
            masks: Tensor::from_data(TensorData::new(logits, [objects, quarter, quarter]), &device),
            ious: vec![1.0; objects],
            pointers: self.replace_absent(decoded.pointers, &present),
            object_scores: present.iter().map(sign).collect(),
        }
    }

    /// The learned reduction of 0/1 masks to prompts: `[objects, side, side]` to `[objects, side / 4, side / 4]`.
    pub fn downsample_masks(&self, masks: Tensor<3>) -> Tensor<3> {
        self.mask_downsample.forward_planes(masks.unsqueeze_dim(1)).squeeze_dim(1)
    }

    fn pointers(&self, tokens: Tensor<2>, present: &[bool]) -> Tensor<2> {
        self.replace_absent(self.pointer_projection.forward(tokens), present)
    }

    fn replace_absent(&self, pointers: Tensor<2>, present: &[bool]) -> Tensor<2> {
        if present.iter().all(|present| *present) {
            return pointers;
        }
        let rows = present.iter().enumerate();
        let rows =
            rows.map(
                |(object, present)| {
                    if *present { pointers.clone().narrow(0, object, 1) } else { self.no_object_pointer.clone() }
                },
            );
        Tensor::cat(rows.collect(), 0)
    }
}

/// Pads every list of points as the network expects: it ends with a point without label, after at least one more.
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

/// Logits of a given 0/1 mask at a quarter of its resolution.
fn low_res_logits(mask: &[f32], image_size: usize) -> Vec<f32> {
    let logits: Vec<f32> = mask.iter().map(|value| value * 2.0 * GIVEN_LOGIT - GIVEN_LOGIT).collect();
    let size = Size { width: image_size, height: image_size };
    resize_antialiased(&logits, size, Size { width: image_size / 4, height: image_size / 4 })
}

/// Keeps the masks of present objects and fills those of absent ones with `other`.
fn where_present(masks: Tensor<3>, present: &[bool], other: f32) -> Tensor<3> {
    if present.iter().all(|present| *present) {
        return masks;
    }
    let (shape, device) = (masks.dims(), masks.device());
    let mut values = host(masks);
    for (mask, present) in values.chunks_exact_mut(shape[1] * shape[2]).zip(present) {
        if !present {
            mask.fill(other);
        }
    }
    Tensor::from_data(TensorData::new(values, shape), &device)
}

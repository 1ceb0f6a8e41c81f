//! The memory encoder: converts a frame's features and a mask to a memory (official `memory_encoder.py`).

use super::perceiver::Perceiver;
use crate::sam2::layers::host::from_host;
use crate::sam2::layers::{Activation, Conv2d, ConvShape, Halving, LayerNorm, Linear, LinearWeights, forward_chain};
use crate::sam2::resize::{Size, resize_bilinear};
use crate::sam2::weights::WeightReader;
use crate::sam2::{Sam2Config, Sam2Error};
use crate::transfer::upload;
use burn::tensor::activation::sigmoid;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Tensor};
use rayon::prelude::*;

/// ε of the channel normalisation of maps.
const EPSILON: f64 = 1e-6;
/// Channels of the mask after each halving.
const MASK_CHANNELS: [usize; 5] = [1, 4, 16, 64, 256];
const FUSER_BLOCKS: usize = 2;
/// Mask probabilities p enter the encoder as `MASK_SCALE · p + MASK_BIAS`.
const MASK_SCALE: f32 = 20.0;
const MASK_BIAS: f32 = -10.0;

/// Conversion of mask logits for the memory encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskForMemory {
    /// The sigmoid: for masks predicted without a prompt.
    Soft,
    /// 0 or 1: for masks from a prompt.
    Binary,
}

impl MaskForMemory {
    /// Converts logits at a quarter of the input's resolution to the encoder's input, `[objects, side, side]`, on the
    /// CPU.
    pub fn masks_on_host<'a>(self, logits: impl Iterator<Item = &'a [f32]>, side: usize) -> Tensor<3> {
        let (low, high) = (Size { width: side / 4, height: side / 4 }, Size { width: side, height: side });
        let logits: Vec<&[f32]> = logits.collect();
        let enlarged = |logits: &&[f32]| {
            let mut mask = resize_bilinear(logits, low, high);
            mask.iter_mut().for_each(|logit| *logit = self.apply(*logit));
            mask
        };
        let masks: Vec<Vec<f32>> = logits.par_iter().map(enlarged).collect();
        from_host(masks.concat(), [masks.len(), side, side], &Device::flex())
    }

    /// Like `masks_on_host`, on another device and for logits `[objects, side / 4, side / 4]`.
    pub fn masks_on_device(self, logits: Tensor<3>, side: usize) -> Tensor<3> {
        let bilinear = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false);
        let logits = interpolate(logits.unsqueeze_dim(1), bilinear.with_output_size([side, side])).squeeze_dim::<3>(1);
        let probabilities = match self {
            Self::Soft => sigmoid(logits),
            Self::Binary => logits.greater_elem(0.0).float(),
        };
        probabilities * MASK_SCALE + MASK_BIAS
    }

    /// Converts a logit to the encoder's input value.
    pub fn apply(self, logit: f32) -> f32 {
        let probability = match self {
            Self::Soft => 1.0 / (1.0 + (-logit).exp()),
            Self::Binary => f32::from(logit > 0.0),
        };
        probability * MASK_SCALE + MASK_BIAS
    }
}

/// A ConvNeXt block (official `CXBlock`).
#[derive(Clone, Debug)]
struct ConvNextBlock {
    depthwise: Conv2d,
    norm: LayerNorm,
    widen: Linear,
    /// Includes the layer scale.
    narrow: Linear,
}

impl ConvNextBlock {
    fn load(reader: &WeightReader, channels: usize) -> Result<Self, Sam2Error> {
        let shape =
            ConvShape { inputs: channels, outputs: channels, kernel: 7, stride: 1, padding: 3, groups: channels };
        let gamma = reader.floats("gamma", &[channels])?;
        let narrow = LinearWeights::load(&reader.child("pwconv2"), 4 * channels, channels)?;
        Ok(Self {
            depthwise: Conv2d::load(&reader.child("dwconv"), shape)?,
            norm: LayerNorm::load(&reader.child("norm"), channels, EPSILON)?,
            widen: Linear::load(&reader.child("pwconv1"), channels, 4 * channels)?,
            narrow: narrow.scaled(&gamma).on(reader.device()),
        })
    }

    fn forward(&self, map: Tensor<4>) -> Tensor<4> {
        let layers = [(&self.widen, Activation::Gelu), (&self.narrow, Activation::None)];
        forward_chain(Some(&self.norm), &layers, self.depthwise.forward(map.clone()), Some(map))
    }
}

/// The memory encoder.
#[derive(Clone, Debug)]
pub(crate) struct MemoryEncoder {
    /// Each layer halves the mask's size.
    halvings: Vec<Halving>,
    mask_projection: Linear,
    feature_projection: Linear,
    fuser: Vec<ConvNextBlock>,
    out_projection: Linear,
    /// Added to the memory of a frame without the object, `[1, 1, memory]`; only SAM 2.1 has it.
    no_object: Option<Tensor<3>>,
    /// Compresses memories.
    perceiver: Option<Perceiver>,
}

impl MemoryEncoder {
    /// Loads the encoder for a feature map of `side` × `side` tokens.
    pub fn load(reader: &WeightReader, config: &Sam2Config, side: usize) -> Result<Self, Sam2Error> {
        let (hidden, memory_dim) = (config.hidden_dim, config.memory_dim);
        let encoder = reader.child("memory_encoder");
        let mask = encoder.child("mask_downsampler.encoder");
        let halving = |index: usize| {
            let [inputs, outputs] = [MASK_CHANNELS[index], MASK_CHANNELS[index + 1]];
            let shape = ConvShape { inputs, outputs, kernel: 3, stride: 2, padding: 1, groups: 1 };
            // Indices 3i and 3i + 1: a convolution and a norm; 3i + 2 is an activation without weights.
            Halving::load(&mask, 3 * index, shape, EPSILON)
        };
        Ok(Self {
            halvings: (0..4).map(halving).collect::<Result<_, _>>()?,
            mask_projection: Linear::load_pointwise(&mask.child("12"), MASK_CHANNELS[4], hidden)?,
            feature_projection: Linear::load_pointwise(&encoder.child("pix_feat_proj"), hidden, hidden)?,
            fuser: (0..FUSER_BLOCKS)
                .map(|block| ConvNextBlock::load(&encoder.child(format!("fuser.layers.{block}")), hidden))
                .collect::<Result<_, _>>()?,
            out_projection: Linear::load_pointwise(&encoder.child("out_proj"), hidden, memory_dim)?,
            no_object: match config.has_memory_of_absence {
                true => Some(reader.tensor::<2>("no_obj_embed_spatial", [1, memory_dim])?.unsqueeze()),
                false => None,
            },
            perceiver: config
                .perceiver
                .map(|shape| Perceiver::load(&reader.child("spatial_perceiver"), shape, memory_dim, side))
                .transpose()?,
        })
    }

    /// Projects a frame's features, independently of the object: `[1, side · side, hidden]` to
    /// `[1, side, side, hidden]`.
    pub fn project_features(&self, embedding: Tensor<3>) -> Tensor<4> {
        let [_, tokens, hidden] = embedding.dims();
        let side = tokens.isqrt();
        self.feature_projection.forward(embedding).reshape([1, side, side, hidden])
    }

    /// Computes memories of objects, `[objects, tokens, memory]`, one token per token of the map unless it is
    /// compressed, from features from [`Self::project_features`]
    /// and masks `[objects, 16 side, 16 side]` after [`MaskForMemory::apply`].
    pub fn forward(&self, features: Tensor<4>, masks: Tensor<3>, object_scores: &[f32]) -> Tensor<3> {
        let mut map = features + self.downsample_masks(masks);
        for block in &self.fuser {
            map = block.forward(map);
        }
        let [objects, height, width, _] = map.dims();
        let map = self.out_projection.forward(map);
        let channels = map.dims()[3];
        let memories = map.reshape([objects, height * width, channels]);
        if let Some(perceiver) = &self.perceiver {
            return perceiver.forward(memories);
        }
        let Some(no_object) = &self.no_object else { return memories };
        let absent: Vec<f32> = object_scores.iter().map(|score| f32::from(*score <= 0.0)).collect();
        if absent.iter().all(|absent| *absent == 0.0) {
            return memories;
        }
        let absent = upload(absent, [objects, 1, 1], &memories.device());
        memories + absent * no_object.clone()
    }

    /// `[objects, 16 side, 16 side]` to `[objects, side, side, hidden]`.
    pub fn downsample_masks(&self, masks: Tensor<3>) -> Tensor<4> {
        let map = self.halvings.iter().fold(masks.unsqueeze_dim(3), |map, halving| halving.forward(map));
        self.mask_projection.forward(map)
    }
}

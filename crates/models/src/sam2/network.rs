//! The network: encoder, memory and heads.

use super::encoder::{ImageEncoder, ImageFeatures};
use super::heads::SamHeads;
use super::memory::{Assembly, MemoryAttention, MemoryEncoder};
use super::resize::{normalise, resize_frame};
use super::weights::WeightReader;
use super::{MemoryPooling, Sam2Config, Sam2Error, Sam2Size, Weights, config::FEATURE_STRIDE};
use crate::transfer::upload;
use burn::tensor::{Device, Tensor};
use splatseg_geometry::CowImage;
use std::cell::RefCell;
use std::collections::BTreeSet;

/// SAM 2.1, EdgeTAM or EfficientTAM with its weights. It has no state: one network serves any number of videos.
#[derive(Clone, Debug)]
pub struct Sam2Network {
    config: Sam2Config,
    image_size: usize,
    device: Device,
    pub(super) image_encoder: ImageEncoder,
    pub(super) heads: SamHeads,
    pub(super) memory_encoder: MemoryEncoder,
    pub(super) assembly: Assembly,
    pub(super) memory_attention: MemoryAttention,
    /// Added to a frame's features for an object without memory, `[1, 1, hidden]`.
    pub(super) no_memory: Tensor<3>,
}

/// The output of the image encoder, channels last.
#[derive(Clone, Debug)]
pub struct FeatureMaps {
    /// `[1, side / 16, side / 16, hidden]`.
    pub embedding: Tensor<4>,
    /// For the mask decoder, `[1, side / 4, side / 4, hidden / 8]` and `[1, side / 8, side / 8, hidden / 4]`; `None`
    /// for EfficientTAM.
    pub fine: Option<[Tensor<4>; 2]>,
}

impl Sam2Network {
    /// Loads the network of a checkpoint, whose size is recognised by names and shapes.
    ///
    /// `image_size` is the side of the square that frames are resized to; `None` for the published 1024. Smaller is
    /// faster, at the cost of thin structures. Position embeddings are interpolated as in the official code.
    ///
    /// # Errors
    /// If `image_size` is not a positive multiple of [`Sam2Config::image_size_unit`], or a tensor is missing, unexpected, or of another shape.
    pub fn load(weights: &dyn Weights, image_size: Option<usize>, device: &Device) -> Result<Self, Sam2Error> {
        let config = Sam2Config::from_weights(weights)?;
        let image_size = image_size.unwrap_or(config.image_size);
        let unit = config.image_size_unit();
        if image_size == 0 || !image_size.is_multiple_of(unit) || image_size > 4096 {
            return Err(Sam2Error::Setting {
                field: "image_size",
                found: image_size.to_string(),
                expected: format!("a multiple of {unit} up to 4096"),
            });
        }
        let side = image_size / FEATURE_STRIDE;
        let read = RefCell::new(BTreeSet::new());
        let reader = WeightReader::new(weights, &read, device);
        let network = Self {
            config,
            image_size,
            device: device.clone(),
            image_encoder: ImageEncoder::load(&reader, &config, image_size)?,
            heads: SamHeads::load(&reader, config.hidden_dim, image_size, side)?,
            memory_encoder: MemoryEncoder::load(&reader, &config, side)?,
            assembly: Assembly::load(&reader, &config, side)?,
            memory_attention: MemoryAttention::load(&reader, &config, side)?,
            no_memory: reader.tensor("no_mem_embed", [1, 1, config.hidden_dim])?,
        };
        // Part of every checkpoint, but unused in this configuration.
        reader.floats("no_mem_pos_enc", &[1, 1, config.hidden_dim])?;
        let read = read.into_inner();
        match weights.names().into_iter().find(|name| !read.contains(name)) {
            Some(name) => Err(Sam2Error::UnexpectedTensor { name }),
            None => Ok(network),
        }
    }

    /// Pools remembered maps as the network was trained to, which its checkpoint does not tell.
    ///
    /// # Errors
    /// If the network is not EfficientTAM and `pooling` is not [`MemoryPooling::None`].
    pub fn with_memory_pooling(mut self, pooling: MemoryPooling) -> Result<Self, Sam2Error> {
        if pooling != MemoryPooling::None && self.config.size != Sam2Size::EfficientTam {
            return Err(Sam2Error::Setting {
                field: "memory_pooling",
                found: pooling.to_string(),
                expected: "none, for only EfficientTAM is trained with another".into(),
            });
        }
        self.memory_attention.pooling = pooling;
        Ok(self)
    }

    /// The network's size and hyper-parameters.
    pub fn config(&self) -> &Sam2Config {
        &self.config
    }

    /// Side of the square that frames are resized to, in pixels.
    pub fn image_size(&self) -> usize {
        self.image_size
    }

    /// The device that the network runs on.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Resizes and normalises a frame to the network's input, `[1, 3, side, side]`.
    pub fn input(&self, frame: &CowImage<'_, [u8; 3]>) -> Tensor<4> {
        let resized = resize_frame(frame, self.image_size);
        upload(normalise(&resized), [1, 3, self.image_size, self.image_size], &self.device)
    }

    /// Computes the feature maps of an input, `[1, 3, side, side]`, for uses other than video.
    pub fn encode(&self, input: Tensor<4>) -> FeatureMaps {
        let ImageFeatures { embedding, fine } = self.encode_image(input);
        let [_, _, hidden] = embedding.dims();
        let side = self.image_size / FEATURE_STRIDE;
        let fine = fine.map(|fine| [fine.s0, fine.s1]);
        FeatureMaps { embedding: embedding.reshape([1, side, side, hidden]), fine }
    }

    /// Computes the features of an input, `[1, 3, side, side]`.
    pub(super) fn encode_image(&self, input: Tensor<4>) -> ImageFeatures {
        self.image_encoder.forward(input)
    }
}

//! The image encoder, once per frame.

use super::fpn_neck::FpnNeck;
use super::hiera::Hiera;
use super::repvit::RepVit;
use super::vit::VitEncoder;
use crate::sam2::layers::{Linear, LinearWeights};
use crate::sam2::weights::WeightReader;
use crate::sam2::{Sam2Config, Sam2Error, TrunkConfig};
use burn::tensor::Tensor;

/// Features of a frame, the input to the rest of the network.
#[derive(Clone, Debug)]
pub(crate) struct ImageFeatures {
    /// `[1, tokens, hidden]` at stride 16, row-major.
    pub embedding: Tensor<3>,
    /// For the mask decoder; EfficientTAM has none.
    pub fine: Option<FineFeatures>,
}

/// Features of a frame at high resolution.
#[derive(Clone, Debug)]
pub(crate) struct FineFeatures {
    /// `[1, side, side, hidden / 8]` at stride 4.
    pub s0: Tensor<4>,
    /// `[1, side, side, hidden / 4]` at stride 8.
    pub s1: Tensor<4>,
}

/// The image encoder.
#[derive(Clone, Debug)]
pub(crate) enum ImageEncoder {
    /// A trunk of four stages: SAM 2.1 and EdgeTAM.
    Pyramid(Box<PyramidEncoder>),
    /// EfficientTAM.
    Vit(Box<VitEncoder>),
}

/// A trunk with four stages, a neck, and the decoder's high-resolution projections.
#[derive(Clone, Debug)]
pub(crate) struct PyramidEncoder {
    pub trunk: Trunk,
    pub neck: FpnNeck,
    /// The neck's level 0 and the decoder's `conv_s0` combined: nothing else uses that level.
    s0: Linear,
    /// The neck's level 1 and the decoder's `conv_s1` combined.
    s1: Linear,
}

/// The trunk: from an image to four maps.
#[derive(Clone, Debug)]
pub(crate) enum Trunk {
    Hiera(Box<Hiera>),
    RepVit(Box<RepVit>),
}

impl ImageEncoder {
    /// Loads the encoder for a square input with a side of `image_size` pixels.
    pub fn load(reader: &WeightReader, config: &Sam2Config, image_size: usize) -> Result<Self, Sam2Error> {
        let trunk = reader.child("image_encoder.trunk");
        let (trunk, channels) = match &config.trunk {
            TrunkConfig::Hiera(config) => {
                let channels = [0, 1, 2, 3].map(|stage| config.embed_dim << stage);
                (Trunk::Hiera(Box::new(Hiera::load(&trunk, config, image_size)?)), channels)
            }
            TrunkConfig::RepVit(config) => (Trunk::RepVit(Box::new(RepVit::load(&trunk, config)?)), config.channels),
            TrunkConfig::Vit(vit) => {
                return Ok(Self::Vit(Box::new(VitEncoder::load(reader, vit, config.hidden_dim, image_size)?)));
            }
        };
        Ok(Self::Pyramid(Box::new(PyramidEncoder::load(reader, trunk, channels, config.hidden_dim)?)))
    }

    /// Computes the features of a normalised image, `[1, 3, side, side]`.
    pub fn forward(&self, image: Tensor<4>) -> ImageFeatures {
        match self {
            Self::Pyramid(encoder) => encoder.features(encoder.trunk.forward(image)),
            Self::Vit(encoder) => {
                ImageFeatures { embedding: encoder.forward(image).flatten::<2>(0, 1).unsqueeze(), fine: None }
            }
        }
    }
}

impl Trunk {
    /// Returns the four maps of a normalised image `[1, 3, side, side]`, finest first, `[side / 4, side / 4, channels]`
    /// to `[side / 32, side / 32, channels]`.
    pub fn forward(&self, image: Tensor<4>) -> [Tensor<3>; 4] {
        match self {
            Self::Hiera(trunk) => trunk.forward(image, |_, _| {}),
            Self::RepVit(trunk) => trunk.forward(image),
        }
    }
}

impl PyramidEncoder {
    fn load(reader: &WeightReader, trunk: Trunk, channels: [usize; 4], hidden: usize) -> Result<Self, Sam2Error> {
        let (neck, [level0, level1]) = FpnNeck::load(&reader.child("image_encoder.neck"), channels, hidden)?;
        let decoder = reader.child("sam_mask_decoder");
        let s0 = level0.then(&LinearWeights::load_pointwise(&decoder.child("conv_s0"), hidden, hidden / 8)?);
        let s1 = level1.then(&LinearWeights::load_pointwise(&decoder.child("conv_s1"), hidden, hidden / 4)?);
        Ok(Self { trunk, neck, s0: s0.on(reader.device()), s1: s1.on(reader.device()) })
    }

    /// Computes the features from the trunk's stages, finest first.
    pub fn features(&self, [stage0, stage1, stage2, stage3]: [Tensor<3>; 4]) -> ImageFeatures {
        let map = self.neck.fuse(stage2, stage3);
        let [height, width, hidden] = map.dims();
        ImageFeatures {
            embedding: map.reshape([1, height * width, hidden]),
            fine: Some(FineFeatures {
                s0: self.s0.forward(stage0).unsqueeze(),
                s1: self.s1.forward(stage1).unsqueeze(),
            }),
        }
    }
}

//! EfficientTAM's image encoder: a plain ViT whose blocks are those of Hiera without its reductions, and a neck of two
//! convolutions (Xiong et al. 2024; official `vitdet.py` and `ViTDetNeck`).

use super::hiera::{Block, BlockShape};
use super::position_encoding::enlarged_embedding;
use crate::convolution::{Convolution, ConvolutionShape};
use crate::sam2::layers::{Activation, LayerNorm, Linear, LinearWeights};
use crate::sam2::weights::WeightReader;
use crate::sam2::{Sam2Error, VitConfig};
use crate::transfer::upload;
use burn::tensor::Tensor;

/// Pixels of a patch's side.
const PATCH: usize = 16;
/// Side of the attention windows, in tokens.
const WINDOW: usize = 14;
/// ε of the channel normalisations.
const EPSILON: f64 = 1e-6;

/// The trunk with its neck.
#[derive(Clone, Debug)]
pub(crate) struct VitEncoder {
    patch_embed: Convolution,
    /// `[side, side, channels]`.
    pos_embed: Tensor<3>,
    blocks: Vec<Block>,
    neck: Neck,
}

#[derive(Clone, Debug)]
struct Neck {
    pointwise: Linear,
    norm0: LayerNorm,
    convolution: Convolution,
    norm1: LayerNorm,
}

impl VitEncoder {
    /// Loads the encoder for a square input with a side of `image_size` pixels.
    pub fn load(
        reader: &WeightReader,
        config: &VitConfig,
        hidden: usize,
        image_size: usize,
    ) -> Result<Self, Sam2Error> {
        let VitConfig { embed_dim: channels, num_heads: heads, blocks, pos_embed_size: size } = *config;
        let (trunk, device, side) = (reader.child("image_encoder.trunk"), reader.device(), image_size / PATCH);
        let patch = ConvolutionShape::new(3, channels, PATCH, PATCH, 0);
        let projection = trunk.child("patch_embed.proj");
        let weight = projection.floats("weight", &patch.weight_shape())?;
        let positions = trunk.floats("pos_embed", &[1, 1 + size * size, channels])?;
        let position = |index: usize| positions[(1 + index % (size * size)) * channels + index / (size * size)];
        let background: Vec<f32> = (0..channels * size * size).map(position).collect();
        let block = |block: usize| {
            let window = (block % 3 != 2).then_some(WINDOW);
            let shape = BlockShape { inputs: channels, outputs: channels, heads, window };
            Block::load(&trunk.child(format!("blocks.{block}")), shape)
        };
        let pos_embed = enlarged_embedding(&background, channels, side);
        Ok(Self {
            patch_embed: Convolution::new(
                weight,
                projection.floats("bias", &[channels])?,
                patch,
                Activation::None,
                device,
            ),
            pos_embed: upload(pos_embed, [side, side, channels], device),
            blocks: (0..blocks).map(block).collect::<Result<_, _>>()?,
            neck: Neck::load(&reader.child("image_encoder.neck.convs.0"), channels, hidden)?,
        })
    }

    /// Returns the features of a normalised image `[1, 3, side, side]`, `[side / 16, side / 16, hidden]`.
    pub fn forward(&self, image: Tensor<4>) -> Tensor<3> {
        let patches: Tensor<3> = self.patch_embed.forward(image).permute([0, 2, 3, 1]).squeeze_dim(0);
        let map = patches + self.pos_embed.clone();
        self.neck.forward(self.blocks.iter().fold(map, |map, block| block.forward(map)))
    }
}

impl Neck {
    fn load(reader: &WeightReader, channels: usize, hidden: usize) -> Result<Self, Sam2Error> {
        let pointwise = reader.floats("conv_1x1.weight", &[hidden, channels, 1, 1])?;
        let shape = ConvolutionShape::new(hidden, hidden, 3, 1, 1);
        let weight = reader.floats("conv_3x3.weight", &shape.weight_shape())?;
        Ok(Self {
            pointwise: LinearWeights::from_rows(&pointwise, vec![0.0; hidden]).on(reader.device()),
            norm0: LayerNorm::load(&reader.child("norm_0"), hidden, EPSILON)?,
            convolution: Convolution::new(weight, vec![0.0; hidden], shape, Activation::None, reader.device()),
            norm1: LayerNorm::load(&reader.child("norm_1"), hidden, EPSILON)?,
        })
    }

    fn forward(&self, map: Tensor<3>) -> Tensor<3> {
        let map = self.norm0.forward(self.pointwise.forward(map));
        let planes = self.convolution.forward(map.permute([2, 0, 1]).unsqueeze());
        self.norm1.forward(planes.permute([0, 2, 3, 1]).squeeze_dim(0))
    }
}

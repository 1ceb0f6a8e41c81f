//! EdgeTAM's trunk, RepViT (Wang et al. 2024; timm's `repvit.py`, in the form whose two branches both have a norm).
//!
//! Batch norms are folded into the convolutions before them, and the branches of a token mixer into one convolution.

use crate::convolution::{Convolution, ConvolutionShape};
use crate::device::is_cpu;
use crate::sam2::layers::host::{HostValues, from_host, host};
use crate::sam2::layers::{Activation, Conv2d, ConvShape, Linear, LinearWeights, activate, forward_chain};
use crate::sam2::weights::WeightReader;
use crate::sam2::{RepVitConfig, Sam2Error};
use burn::tensor::Tensor;
use burn::tensor::activation::sigmoid;
use splatseg_kernels::depthwise::{channel_means, scale_channels};

/// Official `eps` of batch norms.
const EPSILON: f32 = 1e-5;
/// Hidden channels of a channel mixer, per channel.
const MLP_RATIO: usize = 2;

/// A convolution without bias and the batch norm after it, folded.
struct Folded {
    /// `[outputs, inputs, kernel, kernel]`.
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Folded {
    /// Loads a convolution with `weight` `[outputs, inputs, kernel, kernel]` (timm's `ConvNorm`).
    fn load(reader: &WeightReader, outputs: usize, inputs: usize, kernel: usize) -> Result<Self, Sam2Error> {
        let mut weight = reader.floats("c.weight", &[outputs, inputs, kernel, kernel])?;
        let norm = reader.child("bn");
        let [scale, shift, mean, variance] = [
            norm.floats("weight", &[outputs])?,
            norm.floats("bias", &[outputs])?,
            norm.floats("running_mean", &[outputs])?,
            norm.floats("running_var", &[outputs])?,
        ];
        norm.ignore("num_batches_tracked");
        let factors: Vec<f32> =
            scale.iter().zip(&variance).map(|(scale, variance)| scale / (variance + EPSILON).sqrt()).collect();
        for (weights, factor) in weight.chunks_exact_mut(inputs * kernel * kernel).zip(&factors) {
            weights.iter_mut().for_each(|weight| *weight *= factor);
        }
        let bias = (0..outputs).map(|output| shift[output] - mean[output] * factors[output]).collect();
        Ok(Self { weight, bias })
    }

    /// A pointwise convolution as a linear layer.
    fn pointwise(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Linear, Sam2Error> {
        let Self { weight, bias } = Self::load(reader, outputs, inputs, 1)?;
        Ok(LinearWeights::from_rows(&weight, bias).on(reader.device()))
    }
}

fn depthwise(folded: Folded, channels: usize, stride: usize, reader: &WeightReader) -> Conv2d {
    let shape = ConvShape { inputs: channels, outputs: channels, kernel: 3, stride, padding: 1, groups: channels };
    Conv2d::new(folded.weight, folded.bias, shape, reader.device())
}

/// The trunk.
#[derive(Clone, Debug)]
pub(crate) struct RepVit {
    stem: [Convolution; 2],
    stages: Vec<Stage>,
}

#[derive(Clone, Debug)]
struct Stage {
    /// All stages but the first halve the map.
    downsample: Option<Downsample>,
    blocks: Vec<Block>,
}

/// Halves a map.
#[derive(Clone, Debug)]
struct Downsample {
    block: Block,
    spatial: Conv2d,
    channels: Linear,
    mixer: ChannelMixer,
}

/// A block: every channel by itself, then all channels of a pixel.
#[derive(Clone, Debug)]
struct Block {
    token_mixer: Conv2d,
    squeeze_excite: Option<SqueezeExcite>,
    channel_mixer: ChannelMixer,
}

/// Scales channels by factors that depend on the means of all of them.
#[derive(Clone, Debug)]
struct SqueezeExcite {
    squeeze: Linear,
    excite: Linear,
}

/// Two linear layers, whose result is added to the input.
#[derive(Clone, Debug)]
struct ChannelMixer {
    widen: Linear,
    narrow: Linear,
}

impl ChannelMixer {
    fn load(reader: &WeightReader, channels: usize) -> Result<Self, Sam2Error> {
        let hidden = MLP_RATIO * channels;
        Ok(Self {
            widen: Folded::pointwise(&reader.child("conv1"), channels, hidden)?,
            narrow: Folded::pointwise(&reader.child("conv2"), hidden, channels)?,
        })
    }

    fn forward(&self, map: Tensor<3>) -> Tensor<3> {
        let layers = [(&self.widen, Activation::Gelu), (&self.narrow, Activation::None)];
        forward_chain(None, &layers, map.clone(), Some(map))
    }
}

impl SqueezeExcite {
    fn load(reader: &WeightReader, channels: usize) -> Result<Self, Sam2Error> {
        let squeezed = reader.first_axis("fc1.bias")?;
        Ok(Self {
            squeeze: Linear::load_pointwise(&reader.child("fc1"), channels, squeezed)?,
            excite: Linear::load_pointwise(&reader.child("fc2"), squeezed, channels)?,
        })
    }

    fn forward(&self, map: Tensor<3>) -> Tensor<3> {
        let (shape, device) = (map.dims(), map.device());
        let [height, width, channels] = shape;
        let factors = |means: Tensor<2>| {
            let squeezed = activate(Activation::Relu, self.squeeze.forward(means));
            sigmoid(self.excite.forward(squeezed))
        };
        if !is_cpu(&device) {
            let means = map.clone().reshape([1, height * width, channels]).mean_dim(1).squeeze_dim::<2>(1);
            return map * factors(means).unsqueeze_dim(1);
        }
        let mut values = host(map);
        let means = from_host(channel_means(&values, channels), [1, channels], &device);
        scale_channels(&mut values, HostValues::from_tensor(factors(means)).as_slice());
        from_host(values, shape, &device)
    }
}

impl Block {
    fn load(reader: &WeightReader, channels: usize, has_squeeze: bool) -> Result<Self, Sam2Error> {
        let mixer = reader.child("token_mixer");
        let mut folded = Folded::load(&mixer.child("conv"), channels, 1, 3)?;
        let point = Folded::load(&mixer.child("conv1"), channels, 1, 1)?;
        for channel in 0..channels {
            // The branches are a convolution, a factor, and the input itself.
            folded.weight[9 * channel + 4] += point.weight[channel] + 1.0;
            folded.bias[channel] += point.bias[channel];
        }
        Ok(Self {
            token_mixer: depthwise(folded, channels, 1, reader),
            squeeze_excite: has_squeeze.then(|| SqueezeExcite::load(&reader.child("se"), channels)).transpose()?,
            channel_mixer: ChannelMixer::load(&reader.child("channel_mixer"), channels)?,
        })
    }

    fn forward(&self, map: Tensor<3>) -> Tensor<3> {
        let map = self.token_mixer.forward(map.unsqueeze()).squeeze_dim(0);
        let map = match &self.squeeze_excite {
            Some(squeeze_excite) => squeeze_excite.forward(map),
            None => map,
        };
        self.channel_mixer.forward(map)
    }
}

impl Downsample {
    fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let spatial = Folded::load(&reader.child("spatial_downsample"), inputs, 1, 3)?;
        Ok(Self {
            block: Block::load(&reader.child("pre_block"), inputs, false)?,
            spatial: depthwise(spatial, inputs, 2, reader),
            channels: Folded::pointwise(&reader.child("channel_downsample"), inputs, outputs)?,
            mixer: ChannelMixer::load(&reader.child("ffn"), outputs)?,
        })
    }

    fn forward(&self, map: Tensor<3>) -> Tensor<3> {
        let map = self.spatial.forward(self.block.forward(map).unsqueeze()).squeeze_dim(0);
        self.mixer.forward(self.channels.forward(map))
    }
}

impl RepVit {
    /// Loads the trunk.
    pub fn load(reader: &WeightReader, config: &RepVitConfig) -> Result<Self, Sam2Error> {
        let body = reader.child("body");
        let first = config.channels[0];
        let stem = |name: &str, inputs: usize, outputs: usize, activation| -> Result<Convolution, Sam2Error> {
            let Folded { weight, bias } = Folded::load(&body.child("stem").child(name), outputs, inputs, 3)?;
            let shape = ConvolutionShape::new(inputs, outputs, 3, 2, 1);
            Ok(Convolution::new(weight, bias, shape, activation, reader.device()))
        };
        let stage = |stage: usize| -> Result<Stage, Sam2Error> {
            let (reader, channels) = (body.child(format!("stages_{stage}")), config.channels[stage]);
            let downsample = stage
                .checked_sub(1)
                .map(|before| Downsample::load(&reader.child("downsample"), config.channels[before], channels));
            // Every second block scales channels.
            let block =
                |block: usize| Block::load(&reader.child(format!("blocks.{block}")), channels, block.is_multiple_of(2));
            Ok(Stage {
                downsample: downsample.transpose()?,
                blocks: (0..config.depths[stage]).map(block).collect::<Result<_, _>>()?,
            })
        };
        Ok(Self {
            stem: [stem("conv1", 3, first / 2, Activation::Gelu)?, stem("conv2", first / 2, first, Activation::None)?],
            stages: (0..4).map(stage).collect::<Result<_, _>>()?,
        })
    }

    /// Returns the outputs of the four stages of a normalised image `[1, 3, side, side]`, finest first: from
    /// `[side / 4, side / 4, channels]` to `[side / 32, side / 32, channels]`.
    pub fn forward(&self, image: Tensor<4>) -> [Tensor<3>; 4] {
        let stem = self.stem.iter().fold(image, |map, convolution| convolution.forward(map));
        let mut map: Tensor<3> = stem.permute([0, 2, 3, 1]).squeeze_dim(0);
        let mut stages = Vec::with_capacity(4);
        for stage in &self.stages {
            if let Some(downsample) = &stage.downsample {
                map = downsample.forward(map);
            }
            map = stage.blocks.iter().fold(map, |map, block| block.forward(map));
            stages.push(map.clone());
        }
        stages.try_into().unwrap_or_else(|_| unreachable!("there are four stages"))
    }
}

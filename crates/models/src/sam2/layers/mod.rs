//! The layer types of which all blocks are built. Activations are channels-last, so a layer over channels is a layer
//! over the last dimension.

mod attention;
mod convolution;
mod halving;
pub(crate) mod host;
mod linear;
mod rotation;

pub(crate) use attention::{multi_head, multi_head_boosted};
pub(crate) use convolution::{Conv2d, ConvShape};
pub(crate) use halving::Halving;
pub(crate) use linear::{Linear, LinearWeights, Mlp, activate, forward_chain};
pub(crate) use rotation::Rotation;
pub(crate) use splatseg_kernels::Activation;

use crate::device::is_cpu;
use crate::sam2::Sam2Error;
use crate::sam2::weights::WeightReader;
use burn::tensor::Tensor;
use burn::tensor::module::layer_norm as normalise;
use host::{HostValues, from_host, host};
use splatseg_kernels::layer_norm;

/// Layer normalisation over the last dimension.
#[derive(Clone, Debug)]
pub(crate) struct LayerNorm {
    weight: Tensor<1>,
    bias: Tensor<1>,
    epsilon: f64,
}

impl LayerNorm {
    /// Loads `weight` and `bias`. `epsilon` is 1e-6 in the trunk and for maps, and 1e-5 in the transformers, as in the
    /// official code.
    pub fn load(reader: &WeightReader, channels: usize, epsilon: f64) -> Result<Self, Sam2Error> {
        Ok(Self { weight: reader.tensor("weight", [channels])?, bias: reader.tensor("bias", [channels])?, epsilon })
    }

    /// `[.., channels]` to the same shape.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        let device = input.device();
        if !is_cpu(&device) {
            return normalise(input, self.weight.clone(), Some(self.bias.clone()), self.epsilon);
        }
        let (shape, mut values) = (input.dims(), host(input));
        self.host().as_kernel().apply_parallel(&mut values);
        from_host(values, shape, &device)
    }

    pub fn host(&self) -> HostNorm {
        let [weight, bias] = [&self.weight, &self.bias].map(|parameter| HostValues::from_tensor(parameter.clone()));
        HostNorm { weight, bias, epsilon: self.epsilon as f32 }
    }
}

/// The parameters of a [`LayerNorm`] as slices.
pub(crate) struct HostNorm {
    weight: HostValues,
    bias: HostValues,
    epsilon: f32,
}

impl HostNorm {
    pub fn as_kernel(&self) -> layer_norm::LayerNorm<'_> {
        layer_norm::LayerNorm { weight: self.weight.as_slice(), bias: self.bias.as_slice(), epsilon: self.epsilon }
    }
}

/// A transposed convolution with a 2×2 kernel and stride 2: every pixel becomes a 2×2 block.
#[derive(Clone, Debug)]
pub(crate) struct Upscale {
    /// Maps a pixel to the channels of its four output pixels, `[in, 2 · 2 · out]`.
    linear: Linear,
    outputs: usize,
}

impl Upscale {
    /// Loads `weight` (`[in, out, 2, 2]`) and `bias` of a `ConvTranspose2d`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let stored = reader.floats("weight", &[inputs, outputs, 2, 2])?;
        let element = |index: usize| {
            let (input, pixel, output) = (index / (4 * outputs), index / outputs % 4, index % outputs);
            stored[(input * outputs + output) * 4 + pixel]
        };
        let weights = LinearWeights {
            weight: (0..stored.len()).map(element).collect(),
            bias: reader.floats("bias", &[outputs])?.repeat(4),
        };
        Ok(Self { linear: weights.on(reader.device()), outputs })
    }

    /// `[objects, height, width, in]` to `[objects, 2 height, 2 width, out]`.
    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let [objects, height, width, _] = input.dims();
        self.linear
            .forward(input)
            .reshape([objects, height, width, 2, 2, self.outputs])
            .permute([0, 1, 3, 2, 4, 5])
            .reshape([objects, 2 * height, 2 * width, self.outputs])
    }
}

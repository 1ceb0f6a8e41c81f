//! The convolution that the whole network is built from.

use super::{FastSamError, Weights};
use crate::convolution::{Activation, Convolution, ConvolutionShape};
use burn::tensor::{Device, Tensor};

/// Shape of a convolution with a square kernel. With stride 1, padding preserves the image's size.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConvShape {
    pub inputs: usize,
    pub outputs: usize,
    pub kernel: usize,
    pub stride: usize,
}

impl ConvShape {
    /// A convolution that preserves the image's size.
    pub fn new(inputs: usize, outputs: usize, kernel: usize) -> Self {
        Self { inputs, outputs, kernel, stride: 1 }
    }

    /// A convolution that halves the image's size: 3×3, stride 2.
    pub fn halving(inputs: usize, outputs: usize) -> Self {
        Self { inputs, outputs, kernel: 3, stride: 2 }
    }

    fn weight_shape(&self) -> [usize; 4] {
        [self.outputs, self.inputs, self.kernel, self.kernel]
    }
}

/// A convolution with bias and activation; batch normalisation is folded into weight and bias.
#[derive(Clone, Debug)]
pub(super) struct FusedConv(Convolution);

impl FusedConv {
    /// Creates a convolution from `weight` `[outputs, inputs, kernel, kernel]` and `bias` `[outputs]`, row-major.
    pub fn new(weight: Vec<f32>, bias: Vec<f32>, shape: ConvShape, activation: Activation, device: &Device) -> Self {
        let ConvShape { inputs, outputs, kernel, stride } = shape;
        let shape = ConvolutionShape::new(inputs, outputs, kernel, stride, kernel / 2);
        Self(Convolution::new(weight, bias, shape, activation, device))
    }

    /// Ultralytics' `Conv`: convolution without bias, batch normalisation, SiLU.
    pub fn batch_normalised(
        weights: &dyn Weights,
        name: &str,
        shape: ConvShape,
        device: &Device,
    ) -> Result<Self, FastSamError> {
        let mut weight = weights.read_f32(&format!("{name}.conv.weight"), &shape.weight_shape())?;
        let channel_values = |part: &str| weights.read_f32(&format!("{name}.bn.{part}"), &[shape.outputs]);
        let (scale, shift) = (channel_values("weight")?, channel_values("bias")?);
        let (mean, variance) = (channel_values("running_mean")?, channel_values("running_var")?);
        let mut bias = vec![0.0; shape.outputs];
        let per_output = shape.inputs * shape.kernel * shape.kernel;
        for (output, kernel) in weight.chunks_exact_mut(per_output).enumerate() {
            let factor = f64::from(scale[output]) / (f64::from(variance[output]) + weights.batch_norm_epsilon()).sqrt();
            kernel.iter_mut().for_each(|value| *value = (f64::from(*value) * factor) as f32);
            bias[output] = (f64::from(shift[output]) - f64::from(mean[output]) * factor) as f32;
        }
        Ok(Self::new(weight, bias, shape, Activation::Silu, device))
    }

    /// A plain convolution with bias and no activation.
    pub fn plain(weights: &dyn Weights, name: &str, shape: ConvShape, device: &Device) -> Result<Self, FastSamError> {
        let weight = weights.read_f32(&format!("{name}.weight"), &shape.weight_shape())?;
        let bias = weights.read_f32(&format!("{name}.bias"), &[shape.outputs])?;
        Ok(Self::new(weight, bias, shape, Activation::None, device))
    }

    /// PyTorch's `ConvTranspose2d` with a 2×2 kernel and stride 2, with bias and no activation.
    pub fn doubling(weights: &dyn Weights, name: &str, channels: usize, device: &Device) -> Result<Self, FastSamError> {
        let weight = weights.read_f32(&format!("{name}.weight"), &[channels, channels, 2, 2])?;
        let bias = weights.read_f32(&format!("{name}.bias"), &[channels])?;
        let shape = ConvolutionShape::doubling(channels, channels);
        Ok(Self(Convolution::new(weight, bias, shape, Activation::None, device)))
    }

    /// `[batch, inputs, height, width]` → `[batch, outputs, height', width']`.
    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        self.0.forward(input)
    }

    /// Like `forward`, for inputs concatenated along their channels.
    pub fn forward_joined(&self, inputs: Vec<Tensor<4>>) -> Tensor<4> {
        self.0.forward_joined(inputs)
    }
}

//! The few layer types that all blocks are made of. Activations are kept channels-last, so that a layer over channels
//! is a layer over the last dimension.

use super::Sam2Error;
use super::weights::WeightReader;
use burn::tensor::Tensor;
use burn::tensor::activation::{gelu, relu, sigmoid};
use burn::tensor::module::{conv2d, layer_norm, linear};
use burn::tensor::ops::ConvOptions;

/// `x · weight + bias` over the last dimension.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    /// `[in, out]`.
    pub weight: Tensor<2>,
    /// `[out]`.
    pub bias: Tensor<1>,
}

impl Linear {
    /// Reads `weight` (`[out, in]`) and `bias`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.floats("weight", &[outputs, inputs])?;
        Ok(Self::from_rows(&weight, reader.tensor("bias", [outputs])?, inputs))
    }

    /// Reads a convolution of kernel size 1, which is the same thing.
    pub fn load_pointwise(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.floats("weight", &[outputs, inputs, 1, 1])?;
        Ok(Self::from_rows(&weight, reader.tensor("bias", [outputs])?, inputs))
    }

    /// From one row of `inputs` weights per output.
    fn from_rows(rows: &[f32], bias: Tensor<1>, inputs: usize) -> Self {
        let outputs = bias.dims()[0];
        let weight = Tensor::<1>::from_data(rows, &bias.device()).reshape([outputs, inputs]).transpose();
        Self { weight: contiguous(weight), bias }
    }

    /// `[.., in]` to `[.., out]`.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        linear(input, self.weight.clone(), Some(self.bias.clone()))
    }

    /// The layer that does what `self` and then `next` does.
    pub fn then(&self, next: &Self) -> Self {
        let weight = self.weight.clone().matmul(next.weight.clone());
        let bias = next.forward(self.bias.clone().unsqueeze::<2>()).squeeze_dim(0);
        Self { weight, bias }
    }
}

/// The same tensor with its elements in row-major order.
pub(super) fn contiguous<const D: usize>(tensor: Tensor<D>) -> Tensor<D> {
    let device = tensor.device();
    Tensor::from_data(tensor.into_data(), &device)
}

/// Layer normalisation over the last dimension.
#[derive(Clone, Debug)]
pub(super) struct LayerNorm {
    weight: Tensor<1>,
    bias: Tensor<1>,
    epsilon: f64,
}

impl LayerNorm {
    /// Reads `weight` and `bias`. `epsilon` is 1e-6 in the trunk and where the official code normalises maps, and 1e-5
    /// in the transformers.
    pub fn load(reader: &WeightReader, channels: usize, epsilon: f64) -> Result<Self, Sam2Error> {
        Ok(Self { weight: reader.tensor("weight", [channels])?, bias: reader.tensor("bias", [channels])?, epsilon })
    }

    /// `[.., channels]` to the same shape.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        layer_norm(input, self.weight.clone(), Some(self.bias.clone()), self.epsilon)
    }
}

/// What follows a hidden layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Activation {
    /// `max(x, 0)`.
    Relu,
    /// `x Φ(x)`, exact.
    Gelu,
}

impl Activation {
    pub fn apply<const D: usize>(self, input: Tensor<D>) -> Tensor<D> {
        match self {
            Self::Relu => relu(input),
            Self::Gelu => gelu(input),
        }
    }
}

/// Linear layers with an activation between them (official `MLP`).
#[derive(Clone, Debug)]
pub(super) struct Mlp {
    layers: Vec<Linear>,
    activation: Activation,
    sigmoid_output: bool,
}

impl Mlp {
    /// Reads `layers.0`, `layers.1`, …; `widths` are the channels before, between and after them.
    pub fn load(reader: &WeightReader, widths: &[usize], activation: Activation) -> Result<Self, Sam2Error> {
        let layers = (0..widths.len() - 1)
            .map(|layer| Linear::load(&reader.child(format!("layers.{layer}")), widths[layer], widths[layer + 1]))
            .collect::<Result<_, _>>()?;
        Ok(Self { layers, activation, sigmoid_output: false })
    }

    /// The same with a sigmoid at the end.
    pub fn with_sigmoid(self) -> Self {
        Self { sigmoid_output: true, ..self }
    }

    /// `[.., first width]` to `[.., last width]`.
    pub fn forward<const D: usize>(&self, mut input: Tensor<D>) -> Tensor<D> {
        for (index, layer) in self.layers.iter().enumerate() {
            input = layer.forward(input);
            if index + 1 < self.layers.len() {
                input = self.activation.apply(input);
            }
        }
        if self.sigmoid_output { sigmoid(input) } else { input }
    }
}

/// A convolution of channels-last maps.
#[derive(Clone, Debug)]
pub(super) struct Conv2d {
    /// `[out, in / groups, k, k]`.
    weight: Tensor<4>,
    bias: Tensor<1>,
    stride: usize,
    padding: usize,
    groups: usize,
}

/// The hyper-parameters of a [`Conv2d`].
#[derive(Clone, Copy, Debug)]
pub(super) struct ConvShape {
    pub inputs: usize,
    pub outputs: usize,
    pub kernel: usize,
    pub stride: usize,
    pub padding: usize,
    pub groups: usize,
}

impl Conv2d {
    pub fn load(reader: &WeightReader, shape: ConvShape) -> Result<Self, Sam2Error> {
        let ConvShape { inputs, outputs, kernel, stride, padding, groups } = shape;
        let weight = reader.tensor("weight", [outputs, inputs / groups, kernel, kernel])?;
        Ok(Self { weight, bias: reader.tensor("bias", [outputs])?, stride, padding, groups })
    }

    /// `[objects, height, width, in]` to `[objects, height / stride, width / stride, out]`.
    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        self.forward_planes(input.permute([0, 3, 1, 2])).permute([0, 2, 3, 1])
    }

    /// The same for `[objects, in, height, width]`.
    pub fn forward_planes(&self, input: Tensor<4>) -> Tensor<4> {
        let options = ConvOptions::new([self.stride; 2], [self.padding; 2], [1, 1], self.groups);
        conv2d(input, self.weight.clone(), Some(self.bias.clone()), options)
    }
}

/// A transposed convolution whose stride is its kernel size: every pixel becomes a 2×2 block.
#[derive(Clone, Debug)]
pub(super) struct Upscale {
    /// To the four output pixels' channels, `[in, 2 · 2 · out]`.
    linear: Linear,
    outputs: usize,
}

impl Upscale {
    /// Reads `weight` (`[in, out, 2, 2]`) and `bias` of a `ConvTranspose2d`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.tensor("weight", [inputs, outputs, 2, 2])?;
        let weight = contiguous(weight.permute([0, 2, 3, 1])).reshape([inputs, 4 * outputs]);
        let bias: Tensor<1> = reader.tensor("bias", [outputs])?;
        Ok(Self { linear: Linear { weight, bias: bias.repeat_dim(0, 4) }, outputs })
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

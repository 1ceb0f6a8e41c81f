//! The few layer types that all blocks are made of. Activations are kept channels-last, so that a layer over channels
//! is a layer over the last dimension.

use super::Sam2Error;
use super::host::{HostValues, from_host, host};
use super::kernels::{AxialKeys, apply_to_all};
use super::weights::WeightReader;
use crate::device::is_cpu;
pub(super) use crate::product::Activation;
use crate::product::{Chain, Instructions, Norm, PackedLinear};
use burn::tensor::Tensor;
use burn::tensor::activation::{gelu, relu, sigmoid, silu};
use burn::tensor::module::{conv2d, layer_norm, linear};
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, TensorData};

/// The parameters of a [`Linear`] before they are arranged for a device.
#[derive(Clone, Debug)]
pub(super) struct LinearWeights {
    /// `[in, out]`.
    weight: Vec<f32>,
    /// `[out]`.
    bias: Vec<f32>,
}

impl LinearWeights {
    /// Reads `weight` (`[out, in]`) and `bias`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.floats("weight", &[outputs, inputs])?;
        Ok(Self { weight: transposed(&weight, inputs), bias: reader.floats("bias", &[outputs])? })
    }

    /// Reads a convolution of kernel size 1, which is the same thing.
    pub fn load_pointwise(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.floats("weight", &[outputs, inputs, 1, 1])?;
        Ok(Self { weight: transposed(&weight, inputs), bias: reader.floats("bias", &[outputs])? })
    }

    /// The layer that does what `self` and then `next` does.
    pub fn then(&self, next: &Self) -> Self {
        let product = |bias: &[f32]| PackedLinear::new(&next.weight, bias, Instructions::best());
        let linear = product(&vec![0.0; next.bias.len()]);
        Self { weight: linear.forward(&self.weight), bias: product(&next.bias).forward(&self.bias) }
    }

    /// The layer whose outputs are multiplied by `factors` `[out]`.
    pub fn scaled(mut self, factors: &[f32]) -> Self {
        for row in self.weight.chunks_exact_mut(factors.len()).chain([self.bias.as_mut_slice()]) {
            row.iter_mut().zip(factors).for_each(|(value, factor)| *value *= factor);
        }
        self
    }

    /// The layer as what makes the keys of remembered maps.
    pub fn axial_keys(&self, angles: &[[f32; 2]], side: usize) -> AxialKeys {
        AxialKeys::new(&self.weight, &self.bias, angles, side, Instructions::best())
    }

    /// The layer on a device.
    pub fn on(self, device: &Device) -> Linear {
        let Self { weight, bias } = self;
        if is_cpu(device) {
            return Linear::Packed(PackedLinear::new(&weight, &bias, Instructions::best()));
        }
        let [inputs, outputs] = [weight.len() / bias.len(), bias.len()];
        Linear::Tensors(Box::new(LinearTensors {
            weight: Tensor::from_data(TensorData::new(weight, [inputs, outputs]), device),
            bias: Tensor::from_data(TensorData::new(bias, [outputs]), device),
        }))
    }
}

/// `[rows, columns]` to `[columns, rows]`.
fn transposed(matrix: &[f32], columns: usize) -> Vec<f32> {
    let column = |column: usize| matrix.iter().skip(column).step_by(columns).copied();
    (0..columns).flat_map(column).collect()
}

/// `x · weight + bias` over the last dimension.
#[derive(Clone, Debug)]
pub(super) enum Linear {
    /// On the CPU.
    Packed(PackedLinear),
    /// On other devices.
    Tensors(Box<LinearTensors>),
}

/// The parameters of a [`Linear`] on another device than the CPU.
#[derive(Clone, Debug)]
pub(super) struct LinearTensors {
    /// `[in, out]`.
    weight: Tensor<2>,
    /// `[out]`.
    bias: Tensor<1>,
}

impl Linear {
    /// Reads `weight` (`[out, in]`) and `bias`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        Ok(LinearWeights::load(reader, inputs, outputs)?.on(reader.device()))
    }

    /// Reads a convolution of kernel size 1, which is the same thing.
    pub fn load_pointwise(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        Ok(LinearWeights::load_pointwise(reader, inputs, outputs)?.on(reader.device()))
    }

    fn packed(&self) -> Option<&PackedLinear> {
        match self {
            Self::Packed(packed) => Some(packed),
            Self::Tensors(_) => None,
        }
    }

    /// `[.., in]` to `[.., out]`.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        forward_chain(None, &[(self, Activation::None)], input, None)
    }

    /// `residual`, `[.., out]`, plus what [`forward`](Self::forward) gives.
    pub fn forward_added<const D: usize>(&self, input: Tensor<D>, residual: Tensor<D>) -> Tensor<D> {
        forward_chain(None, &[(self, Activation::None)], input, Some(residual))
    }

    /// What [`forward`](Self::forward) gives for the normalised input.
    pub fn forward_normed<const D: usize>(&self, norm: &LayerNorm, input: Tensor<D>) -> Tensor<D> {
        forward_chain(Some(norm), &[(self, Activation::None)], input, None)
    }
}

/// `input`, `[.., in]`, through a norm and layers one after the other, each with what follows it; plus `residual`,
/// `[.., out]`.
pub(super) fn forward_chain<const D: usize>(
    norm: Option<&LayerNorm>,
    layers: &[(&Linear, Activation)],
    input: Tensor<D>,
    residual: Option<Tensor<D>>,
) -> Tensor<D> {
    let packed = layers.iter().map(|(layer, activation)| Some((layer.packed()?, *activation)));
    let Some(layers) = packed.collect::<Option<Vec<_>>>() else {
        let input = norm.map_or(input.clone(), |norm| norm.forward(input));
        let through = |input, (layer, activation): &(&Linear, Activation)| match layer {
            Linear::Tensors(layer) => {
                activate(*activation, linear(input, layer.weight.clone(), Some(layer.bias.clone())))
            }
            Linear::Packed(_) => unreachable!("all layers of a network are on one device"),
        };
        let output = layers.iter().fold(input, through);
        return match residual {
            Some(residual) => residual + output,
            None => output,
        };
    };
    let device = input.device();
    let mut shape = input.dims();
    shape[D - 1] = layers.last().map_or(shape[D - 1], |(last, _)| last.dims()[1]);
    if let Some(residual) = &residual {
        assert_eq!(residual.dims(), shape, "shape of what is added to a layer");
    }
    let (input, residual) = (HostValues::of(input), residual.map(HostValues::of));
    let norm = norm.map(LayerNorm::host);
    let chain = Chain { norm: norm.as_ref().map(HostNorm::norm), layers: &layers };
    from_host(chain.forward(input.as_slice(), residual.as_ref().map(HostValues::as_slice)), shape, &device)
}

/// An activation on its own.
pub(super) fn activate<const D: usize>(activation: Activation, input: Tensor<D>) -> Tensor<D> {
    let device = input.device();
    if !is_cpu(&device) {
        return match activation {
            Activation::None => input,
            Activation::Relu => relu(input),
            Activation::Silu => silu(input),
            Activation::Gelu => gelu(input),
        };
    }
    let shape = input.dims();
    let mut values = host(input);
    apply_to_all(activation, &mut values);
    from_host(values, shape, &device)
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
        let device = input.device();
        if !is_cpu(&device) {
            return layer_norm(input, self.weight.clone(), Some(self.bias.clone()), self.epsilon);
        }
        let (shape, mut values) = (input.dims(), host(input));
        self.host().norm().apply_to_all(&mut values);
        from_host(values, shape, &device)
    }

    fn host(&self) -> HostNorm {
        let [weight, bias] = [&self.weight, &self.bias].map(|parameter| HostValues::of(parameter.clone()));
        HostNorm { weight, bias, epsilon: self.epsilon as f32 }
    }
}

/// The parameters of a [`LayerNorm`] as slices.
struct HostNorm {
    weight: HostValues,
    bias: HostValues,
    epsilon: f32,
}

impl HostNorm {
    fn norm(&self) -> Norm<'_> {
        Norm { weight: self.weight.as_slice(), bias: self.bias.as_slice(), epsilon: self.epsilon }
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
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        let output = forward_chain(None, &self.chain(), input, None);
        if self.sigmoid_output { sigmoid(output) } else { output }
    }

    /// What [`forward`](Self::forward) gives for the input after `norm`, added to the input. Not for one with a sigmoid.
    pub fn forward_residual<const D: usize>(&self, norm: Option<&LayerNorm>, input: Tensor<D>) -> Tensor<D> {
        assert!(!self.sigmoid_output, "a residual branch without a sigmoid");
        forward_chain(norm, &self.chain(), input.clone(), Some(input))
    }

    fn chain(&self) -> Vec<(&Linear, Activation)> {
        let last = self.layers.len() - 1;
        let activation = |index: usize| if index == last { Activation::None } else { self.activation };
        self.layers.iter().enumerate().map(|(index, layer)| (layer, activation(index))).collect()
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

//! Linear layers, one by one and chained.

use super::host::{HostValues, from_host, host};
use super::{Activation, HostNorm, LayerNorm};
use crate::device::is_cpu;
use crate::sam2::Sam2Error;
use crate::sam2::weights::WeightReader;
use crate::transfer::upload;
use burn::tensor::activation::{gelu, relu, sigmoid, silu};
use burn::tensor::module::linear;
use burn::tensor::{Device, Tensor};
use splatseg_kernels::Instructions;
use splatseg_kernels::attention::AxialKeys;
use splatseg_kernels::gemm::{LinearChain, PackedLinear};

/// Parameters of a [`Linear`], before they are laid out for a device.
#[derive(Clone, Debug)]
pub(crate) struct LinearWeights {
    /// `[in, out]`.
    pub weight: Vec<f32>,
    /// `[out]`.
    pub bias: Vec<f32>,
}

impl LinearWeights {
    /// Loads `weight` (`[out, in]`) and `bias`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.floats("weight", &[outputs, inputs])?;
        Ok(Self::from_rows(&weight, reader.floats("bias", &[outputs])?))
    }

    /// Loads a convolution with kernel size 1, which is equivalent.
    pub fn load_pointwise(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        let weight = reader.floats("weight", &[outputs, inputs, 1, 1])?;
        Ok(Self::from_rows(&weight, reader.floats("bias", &[outputs])?))
    }

    /// Creates a layer from `weight` `[out, in]`, row-major.
    pub fn from_rows(weight: &[f32], bias: Vec<f32>) -> Self {
        Self { weight: transposed(weight, weight.len() / bias.len()), bias }
    }

    /// Loads `weight` (`[out, in]`) of a layer without bias.
    pub fn load_unbiased(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        Ok(Self::from_rows(&reader.floats("weight", &[outputs, inputs])?, vec![0.0; outputs]))
    }

    /// Splits the outputs into two halves.
    pub fn split(&self) -> [Self; 2] {
        let outputs = self.bias.len();
        [0, outputs / 2].map(|first| Self {
            weight: self.weight.chunks_exact(outputs).flat_map(|row| row[first..][..outputs / 2].to_vec()).collect(),
            bias: self.bias[first..][..outputs / 2].to_vec(),
        })
    }

    /// Combines `self` and then `next` into one layer.
    pub fn then(&self, next: &Self) -> Self {
        let product = |bias: &[f32]| PackedLinear::new(&next.weight, bias, Instructions::best());
        let linear = product(&vec![0.0; next.bias.len()]);
        Self { weight: linear.forward(&self.weight), bias: product(&next.bias).forward(&self.bias) }
    }

    /// Multiplies the layer's outputs by `factors` `[out]`.
    pub fn scaled(mut self, factors: &[f32]) -> Self {
        for row in self.weight.chunks_exact_mut(factors.len()).chain([self.bias.as_mut_slice()]) {
            row.iter_mut().zip(factors).for_each(|(value, factor)| *value *= factor);
        }
        self
    }

    /// Converts the layer to the key projection of remembered maps.
    pub fn axial_keys(&self, angles: &[[f32; 2]], side: usize) -> AxialKeys {
        AxialKeys::new(&self.weight, &self.bias, angles, side, Instructions::best())
    }

    /// Lays the parameters out for a device.
    pub fn on(self, device: &Device) -> Linear {
        let Self { weight, bias } = self;
        if is_cpu(device) {
            return Linear::Packed(PackedLinear::new(&weight, &bias, Instructions::best()));
        }
        let [inputs, outputs] = [weight.len() / bias.len(), bias.len()];
        Linear::Tensors(Box::new(LinearTensors {
            weight: upload(weight, [inputs, outputs], device),
            bias: upload(bias, [outputs], device),
        }))
    }
}

/// Transposes `[rows, columns]` to `[columns, rows]`.
fn transposed(matrix: &[f32], columns: usize) -> Vec<f32> {
    let column = |column: usize| matrix.iter().skip(column).step_by(columns).copied();
    (0..columns).flat_map(column).collect()
}

/// `x · weight + bias` over the last dimension.
#[derive(Clone, Debug)]
pub(crate) enum Linear {
    /// On the CPU.
    Packed(PackedLinear),
    /// On other devices.
    Tensors(Box<LinearTensors>),
}

/// Parameters of a [`Linear`] on devices other than the CPU.
#[derive(Clone, Debug)]
pub(crate) struct LinearTensors {
    /// `[in, out]`.
    weight: Tensor<2>,
    /// `[out]`.
    bias: Tensor<1>,
}

impl Linear {
    /// Loads `weight` (`[out, in]`) and `bias`.
    pub fn load(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        Ok(LinearWeights::load(reader, inputs, outputs)?.on(reader.device()))
    }

    /// Loads a convolution with kernel size 1, which is equivalent.
    pub fn load_pointwise(reader: &WeightReader, inputs: usize, outputs: usize) -> Result<Self, Sam2Error> {
        Ok(LinearWeights::load_pointwise(reader, inputs, outputs)?.on(reader.device()))
    }

    /// Number of input channels.
    pub fn inputs(&self) -> usize {
        match self {
            Self::Packed(packed) => packed.dims()[0],
            Self::Tensors(tensors) => tensors.weight.dims()[0],
        }
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

    /// Adds `residual` `[.., out]` to the result of [`forward`](Self::forward).
    pub fn forward_added<const D: usize>(&self, input: Tensor<D>, residual: Tensor<D>) -> Tensor<D> {
        forward_chain(None, &[(self, Activation::None)], input, Some(residual))
    }

    /// [`forward`](Self::forward) for the normalised input.
    pub fn forward_normed<const D: usize>(&self, norm: &LayerNorm, input: Tensor<D>) -> Tensor<D> {
        forward_chain(Some(norm), &[(self, Activation::None)], input, None)
    }
}

/// Passes `input` `[.., in]` through a norm and consecutive layers, each with its activation, and adds `residual`
/// `[.., out]`.
pub(crate) fn forward_chain<const D: usize>(
    norm: Option<&LayerNorm>,
    layers: &[(&Linear, Activation)],
    input: Tensor<D>,
    residual: Option<Tensor<D>>,
) -> Tensor<D> {
    let packed = layers.iter().map(|(layer, activation)| Some((layer.packed()?, *activation)));
    let Some(layers) = packed.collect::<Option<Vec<_>>>() else {
        let input = norm.map_or(input.clone(), |norm| norm.forward(input));
        let apply = |input, (layer, activation): &(&Linear, Activation)| match layer {
            Linear::Tensors(layer) => {
                activate(*activation, linear(input, layer.weight.clone(), Some(layer.bias.clone())))
            }
            Linear::Packed(_) => unreachable!("all layers of a network are on one device"),
        };
        let output = layers.iter().fold(input, apply);
        return match residual {
            Some(residual) => residual + output,
            None => output,
        };
    };
    let device = input.device();
    let mut shape = input.dims();
    shape[D - 1] = layers.last().map_or(shape[D - 1], |(last, _)| last.dims()[1]);
    if let Some(residual) = &residual {
        assert_eq!(residual.dims(), shape, "shape of a layer's residual");
    }
    let (input, residual) = (HostValues::from_tensor(input), residual.map(HostValues::from_tensor));
    let norm = norm.map(LayerNorm::host);
    let chain = LinearChain { norm: norm.as_ref().map(HostNorm::as_kernel), layers: &layers };
    from_host(chain.forward(input.as_slice(), residual.as_ref().map(HostValues::as_slice)), shape, &device)
}

/// Applies an activation on its own.
pub(crate) fn activate<const D: usize>(activation: Activation, input: Tensor<D>) -> Tensor<D> {
    let device = input.device();
    if !is_cpu(&device) {
        return match activation {
            Activation::None => input,
            Activation::Relu => relu(input),
            Activation::Silu => silu(input),
            Activation::Gelu => gelu(input),
            Activation::QuickGelu => burn::tensor::activation::sigmoid(input.clone() * 1.702) * input,
        };
    }
    let shape = input.dims();
    let mut values = host(input);
    activation.apply_parallel(&mut values);
    from_host(values, shape, &device)
}

/// Linear layers with an activation between them (official `MLP`).
#[derive(Clone, Debug)]
pub(crate) struct Mlp {
    layers: Vec<Linear>,
    activation: Activation,
    sigmoid_output: bool,
}

impl Mlp {
    /// Loads `layers.0`, `layers.1`, …; `widths` are the channels before, between and after them.
    pub fn load(reader: &WeightReader, widths: &[usize], activation: Activation) -> Result<Self, Sam2Error> {
        let layers = (0..widths.len() - 1)
            .map(|layer| Linear::load(&reader.child(format!("layers.{layer}")), widths[layer], widths[layer + 1]))
            .collect::<Result<_, _>>()?;
        Ok(Self { layers, activation, sigmoid_output: false })
    }

    /// Adds a sigmoid at the end.
    pub fn with_sigmoid(self) -> Self {
        Self { sigmoid_output: true, ..self }
    }

    /// `[.., first width]` to `[.., last width]`.
    pub fn forward<const D: usize>(&self, input: Tensor<D>) -> Tensor<D> {
        let output = forward_chain(None, &self.chain(), input, None);
        if self.sigmoid_output { sigmoid(output) } else { output }
    }

    /// Residual branch: applies `norm`, then the layers, and adds the input. Must not have a sigmoid.
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

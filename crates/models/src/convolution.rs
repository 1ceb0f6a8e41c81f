//! Convolution of tensors with bias and activation: our kernels on the CPU, Burn's operations on other devices.

use crate::device::is_cpu;
use burn::backend::Flex;
use burn::tensor::activation::{gelu, relu, silu};
use burn::tensor::module::{conv_transpose2d, conv2d};
use burn::tensor::ops::{ConvOptions, ConvTransposeOptions};
use burn::tensor::{Device, Tensor, TensorData};
use splatseg_kernels::Instructions;
use splatseg_kernels::convolution::PackedConvolution;
use std::fmt;

pub use splatseg_kernels::Activation;
pub use splatseg_kernels::convolution::ConvolutionShape;

/// A convolution with bias and activation.
#[derive(Clone)]
pub struct Convolution {
    shape: ConvolutionShape,
    activation: Activation,
    parameters: Parameters,
}

impl fmt::Debug for Convolution {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Convolution").field("shape", &self.shape).field("activation", &self.activation).finish()
    }
}

#[derive(Clone)]
enum Parameters {
    /// On the CPU.
    Packed(PackedConvolution),
    /// On other devices, and for shapes that [`PackedConvolution`] does not support.
    Tensors(Box<ConvolutionTensors>),
}

#[derive(Clone)]
struct ConvolutionTensors {
    weight: Tensor<4>,
    bias: Tensor<1>,
}

impl Convolution {
    /// Creates a convolution on `device` with `weight` `[outputs, inputs, kernel, kernel]` (for a doubling shape
    /// `[inputs, outputs, 2, 2]`, as PyTorch stores transposed convolutions) and `bias` `[outputs]`, row-major.
    ///
    /// # Panics
    /// If the lengths do not match `shape`.
    pub fn new(
        weight: Vec<f32>,
        bias: Vec<f32>,
        shape: ConvolutionShape,
        activation: Activation,
        device: &Device,
    ) -> Self {
        let parameters = if is_cpu(device) && PackedConvolution::supports(shape) {
            Parameters::Packed(PackedConvolution::new(&weight, &bias, shape, activation, Instructions::best()))
        } else {
            Parameters::Tensors(Box::new(ConvolutionTensors {
                weight: Tensor::from_data(TensorData::new(weight, shape.weight_shape()), device),
                bias: Tensor::from_data(TensorData::new(bias, [shape.outputs]), device),
            }))
        };
        Self { shape, activation, parameters }
    }

    /// `[batch, inputs, height, width]` → `[batch, outputs, height', width']`.
    ///
    /// # Panics
    /// If `input` is on a different device from the parameters, has the wrong number of channels, or is smaller than
    /// the kernel.
    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        self.forward_joined(vec![input])
    }

    /// [`forward`](Self::forward) of `inputs` concatenated along their channels. On the CPU they are never copied into
    /// one tensor.
    ///
    /// # Panics
    /// As `forward`, or if the inputs differ in batch, height, or width.
    pub fn forward_joined(&self, inputs: Vec<Tensor<4>>) -> Tensor<4> {
        let parameters = match &self.parameters {
            Parameters::Packed(packed) => return self.forward_packed(packed, inputs),
            Parameters::Tensors(parameters) => parameters,
        };
        let input = Tensor::cat(inputs, 1);
        let (weight, bias) = (parameters.weight.clone(), Some(parameters.bias.clone()));
        let output = if self.shape.doubling {
            conv_transpose2d(input, weight, bias, ConvTransposeOptions::new([2; 2], [0; 2], [0; 2], [1; 2], 1))
        } else {
            let options = ConvOptions::new([self.shape.stride; 2], [self.shape.padding; 2], [1; 2], 1);
            conv2d(input, weight, bias, options)
        };
        match self.activation {
            Activation::None => output,
            Activation::Relu => relu(output),
            Activation::Silu => silu(output),
            Activation::Gelu => gelu(output),
            Activation::QuickGelu => burn::tensor::activation::sigmoid(output.clone() * 1.702) * output,
        }
    }

    fn forward_packed(&self, packed: &PackedConvolution, inputs: Vec<Tensor<4>>) -> Tensor<4> {
        let device = inputs[0].device();
        let [batch, _, height, width] = inputs[0].dims();
        let channels: usize = inputs.iter().map(|input| input.dims()[1]).sum();
        assert_eq!(channels, self.shape.inputs, "channels of a convolution's input");
        let inputs: Vec<_> = inputs
            .into_iter()
            .map(|input| {
                let dims = input.dims();
                assert_eq!([dims[0], dims[2], dims[3]], [batch, height, width], "sizes of joined inputs");
                // Only layers whose parameters are on the CPU take this path, and inputs follow the parameters.
                let input = input.try_into_primitive::<Flex>().expect("the input is on the parameters' device");
                // Within an image, rows and channels must be contiguous; images need not be.
                let strides = input.layout().strides();
                let dense = [(height * width) as isize, width as isize, 1];
                if strides[1..] == dense { input } else { input.to_contiguous() }
            })
            .collect();
        let [out_height, out_width] = self.shape.output_size([height, width]);
        let image_len = self.shape.outputs * out_height * out_width;
        let mut output = vec![0.0; batch * image_len];
        for (index, output) in output.chunks_exact_mut(image_len).enumerate() {
            let parts: Vec<&[f32]> = inputs
                .iter()
                .map(|input| {
                    let layout = input.layout();
                    let start = layout.start_offset() + index * layout.strides()[0] as usize;
                    &input.storage::<f32>()[start..][..layout.shape()[1] * height * width]
                })
                .collect();
            packed.forward(&parts, [height, width], output);
        }
        Tensor::from_data(TensorData::new(output, [batch, self.shape.outputs, out_height, out_width]), &device)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic values in [-1, 1].
    fn noise(len: usize, seed: usize) -> Vec<f32> {
        (0..len).map(|index| ((index * 7919 + seed * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    /// Compares the packed convolution with Burn's: several inputs, views of larger tensors, more than one image.
    #[test]
    fn joined_views_equal_burns_own_convolution() {
        let device = Device::flex();
        let shape = ConvolutionShape::new(12, 9, 3, 2, 1);
        let (weight, bias) = (noise(9 * 12 * 9, 1), noise(9, 2));
        let image = Tensor::<4>::from_data(TensorData::new(noise(2 * 20 * 15 * 17, 3), [2, 20, 15, 17]), &device);
        let inputs = vec![
            image.clone().narrow(1, 3, 5),
            image.clone().narrow(1, 11, 4),
            image.narrow(1, 0, 3).swap_dims(2, 3).mul_scalar(0.5).swap_dims(2, 3),
        ];
        let ours = Convolution::new(weight.clone(), bias.clone(), shape, Activation::Silu, &device);
        assert!(matches!(ours.parameters, Parameters::Packed(_)));
        let burns = Convolution {
            parameters: Parameters::Tensors(Box::new(ConvolutionTensors {
                weight: Tensor::from_data(TensorData::new(weight, [9, 12, 3, 3]), &device),
                bias: Tensor::from_data(TensorData::new(bias, [9]), &device),
            })),
            ..ours.clone()
        };
        let ours = ours.forward_joined(inputs.clone());
        assert_eq!(ours.dims(), [2, 9, 8, 9]);
        let difference = (ours - burns.forward_joined(inputs)).abs().max().into_scalar::<f32>();
        assert!(difference < 1e-5, "{difference}");
    }

    /// Padding as large as the kernel does not fit the strip layout. A doubling convolution through Burn gives the same
    /// result too.
    #[test]
    fn other_shapes_go_through_burn() {
        let device = Device::flex();
        let wide =
            Convolution::new(noise(6, 1), noise(2, 2), ConvolutionShape::new(3, 2, 1, 1, 1), Activation::None, &device);
        assert!(matches!(wide.parameters, Parameters::Tensors(_)));
        let image = Tensor::<4>::from_data(TensorData::new(noise(3 * 4 * 5, 3), [1, 3, 4, 5]), &device);
        assert_eq!(wide.forward(image.clone()).dims(), [1, 2, 6, 7]);

        let shape = ConvolutionShape::doubling(3, 5);
        let (weight, bias) = (noise(60, 4), noise(5, 5));
        let ours = Convolution::new(weight.clone(), bias.clone(), shape, Activation::None, &device);
        let parameters = Parameters::Tensors(Box::new(ConvolutionTensors {
            weight: Tensor::from_data(TensorData::new(weight, [3, 5, 2, 2]), &device),
            bias: Tensor::from_data(TensorData::new(bias, [5]), &device),
        }));
        let burns = Convolution { parameters, ..ours.clone() };
        let difference = (ours.forward(image.clone()) - burns.forward(image)).abs().max().into_scalar::<f32>();
        assert!(difference < 1e-5, "{difference}");
    }
}

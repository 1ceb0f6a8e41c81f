//! Convolution with bias and activation: a path of our own on the CPU, Burn's operations elsewhere.
//!
//! On the CPU, a convolution is a matrix product (`crate::product`) whose right side is never built as a whole. A thread
//! copies some rows of the image, padded, into a strip in which every tap of the kernel is a shift (`strip`), packs a few
//! columns at a time from there, and puts bias and activation on the sums while they are in its cache (`direct`). Kernels
//! of 3×3 with stride 1 take Winograd's way instead (`winograd`). Each output is summed in the same order whoever computes
//! it: results do not depend on the number of threads.

mod direct;
mod strip;
#[cfg(test)]
mod tests;
mod winograd;

use crate::device::is_cpu;
pub use crate::product::Activation;
use crate::product::{Instructions, filled};
use burn::backend::Flex;
use burn::tensor::activation::{gelu, relu, silu};
use burn::tensor::module::{conv_transpose2d, conv2d};
use burn::tensor::ops::{ConvOptions, ConvTransposeOptions};
use burn::tensor::{Device, Tensor, TensorData};
use direct::DirectConvolution;
use std::fmt;
use std::mem::MaybeUninit;
use winograd::WinogradConvolution;

/// Sizes of a convolution with a square kernel, the same stride and padding along both axes, and one group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConvolutionShape {
    /// Input channels.
    pub inputs: usize,
    /// Output channels.
    pub outputs: usize,
    /// Height and width of the kernel.
    pub kernel: usize,
    /// Pixels from one output to the next.
    pub stride: usize,
    /// Zeros around the image, on each side.
    pub padding: usize,
    /// Whether it is a transposed convolution with a 2×2 kernel and stride 2, which doubles the image; `kernel`, `stride`
    /// and `padding` are then 1, 1, 0.
    pub doubling: bool,
}

impl ConvolutionShape {
    /// An ordinary convolution.
    pub fn new(inputs: usize, outputs: usize, kernel: usize, stride: usize, padding: usize) -> Self {
        Self { inputs, outputs, kernel, stride, padding, doubling: false }
    }

    /// A transposed convolution with a 2×2 kernel and stride 2.
    pub fn doubling(inputs: usize, outputs: usize) -> Self {
        Self { inputs, outputs, kernel: 1, stride: 1, padding: 0, doubling: true }
    }

    /// Height and width of the output before doubling.
    fn output_size(&self, input: [usize; 2]) -> [usize; 2] {
        input.map(|size| (size + 2 * self.padding + 1).saturating_sub(self.kernel).div_ceil(self.stride))
    }

    /// Output pixels per computed column, along each axis.
    fn scale(&self) -> usize {
        if self.doubling { 2 } else { 1 }
    }
}

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
    Direct(DirectConvolution),
    /// On the CPU, 3×3 with stride 1.
    Winograd(WinogradConvolution),
    /// On other devices, and for shapes that the CPU path leaves out.
    Tensors(Box<ConvolutionTensors>),
}

#[derive(Clone)]
struct ConvolutionTensors {
    weight: Tensor<4>,
    bias: Tensor<1>,
}

impl Parameters {
    /// For the CPU.
    fn packed(
        weight: &[f32],
        bias: &[f32],
        shape: ConvolutionShape,
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        if WinogradConvolution::suits(shape) {
            Self::Winograd(WinogradConvolution::new(weight, bias, shape, activation, instructions))
        } else if shape.doubling {
            let (weight, bias) = by_output_pixel(weight, bias, shape);
            Self::Direct(DirectConvolution::new(&weight, &bias, shape, activation, instructions))
        } else {
            Self::Direct(DirectConvolution::new(weight, bias, shape, activation, instructions))
        }
    }
}

impl Convolution {
    /// Puts one together from `weight` `[outputs, inputs, kernel, kernel]` (of a doubling shape: `[inputs, outputs, 2,
    /// 2]`, as PyTorch stores transposed convolutions) and `bias` `[outputs]`, row-major, for `device`.
    ///
    /// # Panics
    /// If the lengths are not what `shape` says.
    pub fn new(
        weight: Vec<f32>,
        bias: Vec<f32>,
        shape: ConvolutionShape,
        activation: Activation,
        device: &Device,
    ) -> Self {
        let ConvolutionShape { inputs, outputs, kernel, padding, .. } = shape;
        let weight_shape = if shape.doubling { [inputs, outputs, 2, 2] } else { [outputs, inputs, kernel, kernel] };
        assert_eq!(weight.len(), weight_shape.iter().product::<usize>(), "weights of a convolution {shape:?}");
        assert_eq!(bias.len(), outputs, "biases of a convolution {shape:?}");
        let parameters = if is_cpu(device) && padding < kernel {
            Parameters::packed(&weight, &bias, shape, activation, Instructions::best())
        } else {
            Parameters::Tensors(Box::new(ConvolutionTensors {
                weight: Tensor::from_data(TensorData::new(weight, weight_shape), device),
                bias: Tensor::from_data(TensorData::new(bias, [outputs]), device),
            }))
        };
        Self { shape, activation, parameters }
    }

    /// `[batch, inputs, height, width]` → `[batch, outputs, height', width']`.
    ///
    /// # Panics
    /// If `input` lies on another device than the parameters, has other channels, or is smaller than the kernel.
    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        self.forward_joined(vec![input])
    }

    /// As [`forward`](Self::forward), of `inputs` joined along their channels; on the CPU the joined tensor is never
    /// made.
    ///
    /// # Panics
    /// As `forward`, and if the inputs differ in batch, height, or width.
    pub fn forward_joined(&self, inputs: Vec<Tensor<4>>) -> Tensor<4> {
        match &self.parameters {
            Parameters::Direct(packed) => {
                self.forward_packed(inputs, |images, size, output| packed.forward(images, size, output))
            }
            Parameters::Winograd(packed) => {
                self.forward_packed(inputs, |images, size, output| packed.forward(images, size, output))
            }
            Parameters::Tensors(parameters) => {
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
                }
            }
        }
    }

    /// `forward` convolves one image, given as several with some channels each, of a height and width, and returns how
    /// many values it wrote.
    fn forward_packed(
        &self,
        inputs: Vec<Tensor<4>>,
        forward: impl Fn(&[&[f32]], [usize; 2], &mut [MaybeUninit<f32>]) -> usize,
    ) -> Tensor<4> {
        let device = inputs[0].device();
        let [batch, _, height, width] = inputs[0].dims();
        let channels: usize = inputs.iter().map(|input| input.dims()[1]).sum();
        assert_eq!(channels, self.shape.inputs, "channels of a convolution's input");
        let smallest = self.shape.kernel.saturating_sub(2 * self.shape.padding).max(1);
        assert!(height.min(width) >= smallest, "an image {height}×{width} is too small for {:?}", self.shape);
        let inputs: Vec<_> = inputs
            .into_iter()
            .map(|input| {
                let dims = input.dims();
                assert_eq!([dims[0], dims[2], dims[3]], [batch, height, width], "sizes of joined inputs");
                let input = input.try_into_primitive::<Flex>().expect("the input is on the parameters' device");
                // Within an image rows and channels have to follow each other; the images need not.
                let strides = input.layout().strides();
                let dense = [(height * width) as isize, width as isize, 1];
                if strides[1..] == dense { input } else { input.to_contiguous() }
            })
            .collect();
        let [out_height, out_width] = self.shape.output_size([height, width]).map(|size| size * self.shape.scale());
        let image_len = self.shape.outputs * out_height * out_width;
        let output = filled(batch * image_len, |output| {
            let images = output.chunks_exact_mut(image_len).enumerate().map(|(index, output)| {
                let images: Vec<&[f32]> = inputs
                    .iter()
                    .map(|input| {
                        let layout = input.layout();
                        let start = layout.start_offset() + index * layout.strides()[0] as usize;
                        &input.storage::<f32>()[start..][..layout.shape()[1] * height * width]
                    })
                    .collect();
                forward(&images, [height, width], output)
            });
            images.sum()
        });
        Tensor::from_data(TensorData::new(output, [batch, self.shape.outputs, out_height, out_width]), &device)
    }
}

/// The parameters of a doubling convolution as those of a 1×1 convolution whose outputs are (channel, row, column) of the
/// 2×2 block that a pixel becomes.
fn by_output_pixel(weight: &[f32], bias: &[f32], shape: ConvolutionShape) -> (Vec<f32>, Vec<f32>) {
    let rows = 4 * shape.outputs;
    let weight = (0..rows).flat_map(|row| weight.iter().skip(row).step_by(rows).copied()).collect();
    (weight, bias.iter().flat_map(|value| [*value; 4]).collect())
}

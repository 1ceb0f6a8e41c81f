//! 2D convolution with bias and activation.
//!
//! A convolution is a matrix product ([`gemm`](crate::gemm)) whose right operand (im2col) is never built as a whole. A
//! thread copies some rows of the image, padded, into a strip in which every tap of the kernel is a shift (`strip`). It
//! packs a few columns of the strip at a time, and applies bias and activation to the sums while they are in its cache
//! (`direct`). 3×3 kernels with stride 1 use Winograd's algorithm instead (`winograd`). Every output is summed in the
//! same order on any thread, so results do not depend on the number of threads.

mod direct;
mod strip;
#[cfg(test)]
mod tests;
mod winograd;

use crate::Activation;
use crate::instructions::Instructions;
use direct::DirectConvolution;
use winograd::WinogradConvolution;

/// Shape of a convolution with a square kernel, the same stride and padding along both axes, and one group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConvolutionShape {
    /// Input channels.
    pub inputs: usize,
    /// Output channels.
    pub outputs: usize,
    /// Height and width of the kernel.
    pub kernel: usize,
    /// Distance between outputs, in input pixels.
    pub stride: usize,
    /// Width of the zero border on each side of the image.
    pub padding: usize,
    /// True for a transposed convolution with a 2×2 kernel and stride 2, which doubles the image size. `kernel`,
    /// `stride` and `padding` are then 1, 1, 0.
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

    /// Shape of the weights, as PyTorch stores them.
    pub fn weight_shape(&self) -> [usize; 4] {
        let Self { inputs, outputs, kernel, .. } = *self;
        if self.doubling { [inputs, outputs, 2, 2] } else { [outputs, inputs, kernel, kernel] }
    }

    /// Height and width of the product's result, before doubling.
    fn product_size(&self, input: [usize; 2]) -> [usize; 2] {
        input.map(|size| (size + 2 * self.padding + 1).saturating_sub(self.kernel).div_ceil(self.stride))
    }

    /// Height and width of the output for an input of height and width `input`.
    pub fn output_size(&self, input: [usize; 2]) -> [usize; 2] {
        self.product_size(input).map(|size| size * self.scale())
    }

    /// Output pixels per column of the product, along each axis.
    fn scale(&self) -> usize {
        if self.doubling { 2 } else { 1 }
    }
}

/// A convolution whose weights are packed for the microkernel.
#[derive(Clone, Debug)]
pub struct PackedConvolution {
    shape: ConvolutionShape,
    algorithm: Algorithm,
}

#[derive(Clone, Debug)]
enum Algorithm {
    Direct(DirectConvolution),
    Winograd(WinogradConvolution),
}

impl PackedConvolution {
    /// True if the shape can be packed: the strip layout requires padding smaller than the kernel.
    pub fn supports(shape: ConvolutionShape) -> bool {
        shape.padding < shape.kernel
    }

    /// Packs `weight` `[outputs, inputs, kernel, kernel]` (for a doubling shape `[inputs, outputs, 2, 2]`, as PyTorch
    /// stores transposed convolutions) and `bias` `[outputs]`, row-major.
    ///
    /// # Panics
    /// If the lengths do not match `shape`, or [`Self::supports`] returns false for it.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        shape: ConvolutionShape,
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        assert_eq!(weight.len(), shape.weight_shape().iter().product::<usize>(), "number of weights for {shape:?}");
        assert_eq!(bias.len(), shape.outputs, "number of biases for {shape:?}");
        assert!(Self::supports(shape), "unsupported padding in {shape:?}");
        let algorithm = if WinogradConvolution::suits(shape) {
            Algorithm::Winograd(WinogradConvolution::new(weight, bias, shape, activation, instructions))
        } else if shape.doubling {
            let (weight, bias) = by_output_pixel(weight, bias, shape);
            Algorithm::Direct(DirectConvolution::new(&weight, &bias, shape, activation, instructions))
        } else {
            Algorithm::Direct(DirectConvolution::new(weight, bias, shape, activation, instructions))
        };
        Self { shape, algorithm }
    }

    /// Convolves one image of height and width `size` to `output` `[outputs, height', width']`. The image is the
    /// concatenation of `parts` along channels, each `[channels, height, width]`.
    ///
    /// # Panics
    /// If the image is smaller than the kernel, or a length does not match.
    pub fn forward(&self, parts: &[&[f32]], size: [usize; 2], output: &mut [f32]) {
        let [height, width] = size;
        let smallest = self.shape.kernel.saturating_sub(2 * self.shape.padding).max(1);
        assert!(height.min(width) >= smallest, "a {height}×{width} image is too small for {:?}", self.shape);
        let len: usize = parts.iter().map(|part| part.len()).sum();
        assert_eq!(len, self.shape.inputs * height * width, "length of a convolution's input");
        let output_len = self.shape.outputs * self.shape.output_size(size).iter().product::<usize>();
        assert_eq!(output.len(), output_len, "length of a convolution's output");
        match &self.algorithm {
            Algorithm::Direct(convolution) => convolution.forward(parts, size, output),
            Algorithm::Winograd(convolution) => convolution.forward(parts, size, output),
        }
    }
}

/// Converts the parameters of a doubling convolution to a 1×1 convolution whose outputs are the (channel, row, column)
/// of each pixel's 2×2 output block.
fn by_output_pixel(weight: &[f32], bias: &[f32], shape: ConvolutionShape) -> (Vec<f32>, Vec<f32>) {
    let rows = 4 * shape.outputs;
    let weight = (0..rows).flat_map(|row| weight.iter().skip(row).step_by(rows).copied()).collect();
    (weight, bias.iter().flat_map(|value| [*value; 4]).collect())
}

//! 1×1 and 3×3 convolutions of feature maps.

use super::FeatureMap;
use super::direct::DirectConvolution;
use super::winograd::WinogradConvolution;
use crate::Activation;
use crate::instructions::Instructions;

/// A convolution with a kernel of 1×1 (stride 1) or 3×3 (stride 1 or 2, padding 1), with bias and activation.
#[derive(Clone, Debug)]
pub struct MapConvolution {
    inputs: usize,
    outputs: usize,
    stride: usize,
    algorithm: Algorithm,
}

#[derive(Clone, Debug)]
enum Algorithm {
    Direct(DirectConvolution),
    Winograd(WinogradConvolution),
}

impl MapConvolution {
    /// True if a `kernel` × `kernel` convolution with this stride can be packed.
    pub fn supports(kernel: usize, stride: usize) -> bool {
        matches!((kernel, stride), (1, 1) | (3, 1 | 2))
    }

    /// Packs `weight` `[outputs, inputs, kernel, kernel]` and `bias` `[outputs]`, row-major. The padding is
    /// `kernel / 2`.
    ///
    /// # Panics
    /// If [`Self::supports`] returns false, or the length of `weight` is not a multiple of `outputs · kernel²`.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        kernel: usize,
        stride: usize,
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        assert!(Self::supports(kernel, stride), "unsupported: a {kernel}×{kernel} convolution with stride {stride}");
        let (outputs, taps) = (bias.len(), kernel * kernel);
        let inputs = weight.len() / (outputs * taps).max(1);
        assert_eq!(weight.len(), inputs * outputs * taps, "number of weights of a convolution");
        let algorithm = if WinogradConvolution::suits(inputs, outputs, kernel, stride) {
            Algorithm::Winograd(WinogradConvolution::new(weight, bias, activation, instructions))
        } else {
            Algorithm::Direct(DirectConvolution::new(weight, bias, (kernel, stride), activation, instructions))
        };
        Self { inputs, outputs, stride, algorithm }
    }

    /// Input channels.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Output channels.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Convolves `input` to `output` and adds `residual`, if any, after the activation. `output` is reshaped as needed;
    /// `residual` must have the same shape. `phases` is scratch memory for stride 2.
    ///
    /// # Panics
    /// If the channels of `input` or the shape of `residual` do not match.
    pub fn forward(
        &self,
        input: &FeatureMap,
        residual: Option<&FeatureMap>,
        phases: &mut FeatureMap,
        output: &mut FeatureMap,
    ) {
        self.forward_from(input, [0; 2], residual, phases, output);
    }

    /// Like [`forward`](Self::forward), with the centre of the first output at row and column `start` of the input,
    /// each less than the stride. With stride 2, a start of 1 leaves the outputs of a start of 0 on the input without
    /// its first row or column, except that they still see it.
    ///
    /// # Panics
    /// As `forward`, or if `start` is out of range.
    pub fn forward_from(
        &self,
        input: &FeatureMap,
        start: [usize; 2],
        residual: Option<&FeatureMap>,
        phases: &mut FeatureMap,
        output: &mut FeatureMap,
    ) {
        assert_eq!(input.channels(), self.inputs, "channels of a convolution's input");
        assert!(start.iter().all(|start| *start < self.stride), "start {start:?} of stride {}", self.stride);
        let outputs = |size: usize, start: usize| size.saturating_sub(start).div_ceil(self.stride);
        let (height, width) = (outputs(input.height(), start[0]), outputs(input.width(), start[1]));
        output.reshape(self.outputs, height, width);
        if let Some(residual) = residual {
            let has_shape = residual.channels() == self.outputs && residual.layout() == output.layout();
            assert!(has_shape, "shape of a residual");
        }
        match &self.algorithm {
            Algorithm::Direct(convolution) => convolution.forward(input, start, residual, phases, output),
            Algorithm::Winograd(convolution) => convolution.forward(input, residual, output),
        }
    }
}

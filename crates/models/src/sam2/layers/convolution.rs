//! Convolutions: our kernels on the CPU, Burn's operations on other devices.

use super::host::{HostValues, from_host};
use crate::convolution::{Convolution, ConvolutionShape};
use crate::device::is_cpu;
use crate::sam2::Sam2Error;
use crate::sam2::weights::WeightReader;
use crate::transfer::upload;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor};
use splatseg_kernels::depthwise::DepthwiseConvolution;
use splatseg_kernels::{Activation, Instructions};

/// A convolution of channels-last maps.
#[derive(Clone, Debug)]
pub(crate) struct Conv2d {
    shape: ConvShape,
    parameters: Parameters,
}

/// The hyper-parameters of a [`Conv2d`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct ConvShape {
    pub inputs: usize,
    pub outputs: usize,
    pub kernel: usize,
    pub stride: usize,
    pub padding: usize,
    pub groups: usize,
}

#[derive(Clone, Debug)]
enum Parameters {
    /// Each channel by itself, on the CPU.
    Depthwise(DepthwiseConvolution),
    /// With one group.
    Whole(Box<Convolution>),
    /// Each channel by itself, on other devices: `[channels, 1, k, k]` and `[channels]`.
    Tensors(Box<(Tensor<4>, Tensor<1>)>),
}

impl Conv2d {
    /// Loads `weight` (`[out, in / groups, k, k]`) and `bias`.
    pub fn load(reader: &WeightReader, shape: ConvShape) -> Result<Self, Sam2Error> {
        let ConvShape { inputs, outputs, kernel, groups, .. } = shape;
        let weight = reader.floats("weight", &[outputs, inputs / groups, kernel, kernel])?;
        Ok(Self::new(weight, reader.floats("bias", &[outputs])?, shape, reader.device()))
    }

    /// Creates a convolution from `weight` `[out, in / groups, k, k]`, row-major, and `bias` `[out]`.
    pub fn new(weight: Vec<f32>, bias: Vec<f32>, shape: ConvShape, device: &Device) -> Self {
        let ConvShape { inputs, outputs, kernel, stride, padding, groups } = shape;
        let parameters = if groups == 1 {
            let shape = ConvolutionShape::new(inputs, outputs, kernel, stride, padding);
            Parameters::Whole(Box::new(Convolution::new(weight, bias, shape, Activation::None, device)))
        } else if is_cpu(device) {
            assert!(groups == inputs && groups == outputs && padding == kernel / 2, "unsupported: {shape:?}");
            Parameters::Depthwise(DepthwiseConvolution::new(&weight, &bias, kernel, stride, Instructions::best()))
        } else {
            let weight = upload(weight, [outputs, inputs / groups, kernel, kernel], device);
            Parameters::Tensors(Box::new((weight, upload(bias, [outputs], device))))
        };
        Self { shape, parameters }
    }

    /// `[objects, height, width, in]` to `[objects, height / stride, width / stride, out]`.
    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let Parameters::Depthwise(convolution) = &self.parameters else {
            return self.forward_planes(input.permute([0, 3, 1, 2])).permute([0, 2, 3, 1]);
        };
        let ([objects, height, width, channels], device) = (input.dims(), input.device());
        let [out_height, out_width] = convolution.output_size([height, width]);
        let input = HostValues::from_tensor(input);
        let mut output = vec![0.0; objects * out_height * out_width * channels];
        let maps = input.as_slice().chunks_exact(height * width * channels);
        for (map, output) in maps.zip(output.chunks_exact_mut(out_height * out_width * channels)) {
            convolution.forward(map, [height, width], output);
        }
        from_host(output, [objects, out_height, out_width, channels], &device)
    }

    /// Like [`Self::forward`], for channels-first maps `[objects, in, height, width]`.
    pub fn forward_planes(&self, input: Tensor<4>) -> Tensor<4> {
        match &self.parameters {
            Parameters::Whole(convolution) => convolution.forward(input),
            Parameters::Depthwise(_) => self.forward(input.permute([0, 2, 3, 1])).permute([0, 3, 1, 2]),
            Parameters::Tensors(parameters) => {
                let (weight, bias) = parameters.as_ref().clone();
                let ConvShape { stride, padding, groups, .. } = self.shape;
                conv2d(input, weight, Some(bias), ConvOptions::new([stride; 2], [padding; 2], [1, 1], groups))
            }
        }
    }
}

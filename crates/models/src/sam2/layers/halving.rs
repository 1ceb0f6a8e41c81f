//! Layers that halve a map: a strided convolution, a norm over channels, GELU.

use super::host::{HostValues, from_host};
use super::{Activation, Conv2d, ConvShape, LayerNorm, activate};
use crate::device::is_cpu;
use crate::sam2::Sam2Error;
use crate::sam2::weights::WeightReader;
use burn::tensor::Tensor;
use splatseg_kernels::Instructions;
use splatseg_kernels::patch_convolution::PatchConvolution;

/// A layer that halves a channels-last map.
#[derive(Clone, Debug)]
pub(crate) struct Halving {
    convolution: Convolution,
    norm: LayerNorm,
}

#[derive(Clone, Debug)]
enum Convolution {
    /// On the CPU, one pass for all three steps.
    Patches(Box<PatchConvolution>),
    /// On other devices.
    Tensors(Conv2d),
}

impl Halving {
    /// Loads the convolution at index `first` of a sequential module and the norm that follows.
    pub fn load(reader: &WeightReader, first: usize, shape: ConvShape, epsilon: f64) -> Result<Self, Sam2Error> {
        let ConvShape { inputs, outputs, kernel, stride, padding, .. } = shape;
        let parameters = reader.child(first);
        let convolution = if is_cpu(reader.device()) {
            let weight = parameters.floats("weight", &[outputs, inputs, kernel, kernel])?;
            let bias = parameters.floats("bias", &[outputs])?;
            let patches = PatchConvolution::new(&weight, &bias, kernel, stride, padding, Instructions::best());
            Convolution::Patches(Box::new(patches))
        } else {
            Convolution::Tensors(Conv2d::load(&parameters, shape)?)
        };
        Ok(Self { convolution, norm: LayerNorm::load(&reader.child(first + 1), outputs, epsilon)? })
    }

    /// `[objects, height, width, in]` to `[objects, height / 2, width / 2, out]`.
    pub fn forward(&self, map: Tensor<4>) -> Tensor<4> {
        let patches = match &self.convolution {
            Convolution::Patches(patches) => patches,
            Convolution::Tensors(convolution) => {
                return activate(Activation::Gelu, self.norm.forward(convolution.forward(map)));
            }
        };
        let ([objects, height, width, inputs], device, norm) = (map.dims(), map.device(), self.norm.host());
        let [out_height, out_width] = patches.output_size([height, width]);
        let (map, norm) = (HostValues::from_tensor(map), norm.as_kernel());
        let outputs = norm.weight.len();
        let mut output = vec![0.0; objects * out_height * out_width * outputs];
        let maps = map.as_slice().chunks_exact(height * width * inputs);
        for (map, output) in maps.zip(output.chunks_exact_mut(out_height * out_width * outputs)) {
            patches.forward(map, [height, width], norm, Activation::Gelu, output);
        }
        from_host(output, [objects, out_height, out_width, outputs], &device)
    }
}

//! Convolutions of channels-last maps that halve the map, with the norm and the activation that follow: each patch of
//! the map is a token of a linear layer. With so few channels, rearranging the map would take longer than the products.

use crate::Activation;
use crate::gemm::PackedLinear;
use crate::instructions::Instructions;
use crate::layer_norm::LayerNorm;
use rayon::prelude::*;

/// Outputs per job: they stay in a core's cache until the norm and the activation are applied.
const TOKENS: usize = 192;

/// A convolution with a bias and zero padding.
#[derive(Clone, Debug)]
pub struct PatchConvolution {
    /// From patches `[kernel, kernel, inputs]`.
    linear: PackedLinear,
    inputs: usize,
    kernel: usize,
    stride: usize,
    padding: usize,
    instructions: Instructions,
}

impl PatchConvolution {
    /// Packs `weight` `[outputs, inputs, kernel, kernel]`, row-major, and `bias` `[outputs]`.
    ///
    /// # Panics
    /// If the length of `weight` is not a multiple of `outputs · kernel²`, or if `stride` is 0.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        kernel: usize,
        stride: usize,
        padding: usize,
        instructions: Instructions,
    ) -> Self {
        assert!(stride > 0, "a convolution's stride is 0");
        let (outputs, area) = (bias.len(), kernel * kernel);
        let inputs = weight.len() / (outputs * area);
        assert_eq!(weight.len(), outputs * inputs * area, "weights of a convolution");
        let element = |index: usize| {
            let (pixel, input, output) = (index / (outputs * inputs), index / outputs % inputs, index % outputs);
            weight[(output * inputs + input) * area + pixel]
        };
        let patches: Vec<f32> = (0..weight.len()).map(element).collect();
        let linear = PackedLinear::new(&patches, bias, instructions);
        Self { linear, inputs, kernel, stride, padding, instructions }
    }

    /// Height and width of the output for an input of that height and width, which must be at least the kernel's.
    pub fn output_size(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|length| (length + 2 * self.padding).saturating_sub(self.kernel) / self.stride + 1)
    }

    /// Convolves `map` `[height, width, inputs]`, normalises each pixel's outputs, and applies the activation. Writes
    /// `[height', width', outputs]`, see [`Self::output_size`].
    ///
    /// # Panics
    /// If a length does not match.
    pub fn forward(
        &self,
        map: &[f32],
        size: [usize; 2],
        norm: LayerNorm<'_>,
        activation: Activation,
        output: &mut [f32],
    ) {
        let [out_height, out_width] = self.output_size(size);
        let [depth, outputs] = self.linear.dims();
        assert_eq!(map.len(), size[0] * size[1] * self.inputs, "values of a map");
        assert_eq!(output.len(), out_height * out_width * outputs, "outputs of a convolution");
        let rows = (TOKENS / out_width).max(1);
        output.par_chunks_mut(rows * out_width * outputs).with_max_len(1).enumerate().for_each_init(
            Vec::new,
            |patches, (job, output)| {
                patches.clear();
                patches.resize(output.len() / outputs * depth, 0.0);
                for (row, patches) in patches.chunks_exact_mut(out_width * depth).enumerate() {
                    self.gather(map, size, job * rows + row, patches);
                }
                self.linear.forward_into(patches, output);
                self.instructions.run(
                    #[inline(always)]
                    || {
                        norm.apply(output);
                        activation.apply(output);
                    },
                );
            },
        );
    }

    /// Copies the patches of a row of outputs. What lies outside the map must be zero already.
    fn gather(&self, map: &[f32], [height, width]: [usize; 2], row: usize, patches: &mut [f32]) {
        let line = self.kernel * self.inputs;
        for (column, patch) in patches.chunks_exact_mut(self.kernel * line).enumerate() {
            let left = column * self.stride;
            // Columns of the patch inside the map.
            let first = self.padding.saturating_sub(left);
            let end = self.kernel.min((width + self.padding).saturating_sub(left));
            for (ky, part) in patch.chunks_exact_mut(line).enumerate() {
                let y = row * self.stride + ky;
                if y < self.padding || y >= height + self.padding || first >= end {
                    continue;
                }
                let start = (y - self.padding) * width + left + first - self.padding;
                let values = &map[start * self.inputs..][..(end - first) * self.inputs];
                part[first * self.inputs..end * self.inputs].copy_from_slice(values);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(len: usize, factor: usize) -> Vec<f32> {
        (0..len).map(|index| (index * factor % 101) as f32 / 50.0 - 1.0).collect()
    }

    #[test]
    fn equals_the_definition() {
        // Inputs, outputs, kernel, stride, padding, height, width: those of SAM 2, and sizes that leave a rest.
        for [inputs, outputs, kernel, stride, padding, height, width] in
            [[1, 4, 3, 2, 1, 16, 20], [4, 16, 2, 2, 0, 9, 7], [3, 33, 3, 2, 1, 5, 301], [2, 5, 4, 3, 2, 6, 4]]
        {
            let (map, weight) = (noise(height * width * inputs, 37), noise(outputs * inputs * kernel * kernel, 53));
            let bias = noise(outputs, 29);
            let (scale, offset) = (noise(outputs, 71), noise(outputs, 83));
            let norm = LayerNorm { weight: &scale, bias: &offset, epsilon: 1e-6 };
            for instructions in Instructions::available() {
                let layer = PatchConvolution::new(&weight, &bias, kernel, stride, padding, instructions);
                let [out_height, out_width] = layer.output_size([height, width]);
                let mut found = vec![f32::NAN; out_height * out_width * outputs];
                layer.forward(&map, [height, width], norm, Activation::Relu, &mut found);
                let value = |y: usize, x: usize, output: usize| {
                    let mut sum = f64::from(bias[output]);
                    for (ky, kx) in (0..kernel).flat_map(|ky| (0..kernel).map(move |kx| (ky, kx))) {
                        let at = [y * stride + ky, x * stride + kx].map(|at| at.checked_sub(padding));
                        let [Some(y), Some(x)] = at else { continue };
                        if y < height && x < width {
                            sum += (0..inputs)
                                .map(|input| {
                                    let weight = weight[((output * inputs + input) * kernel + ky) * kernel + kx];
                                    f64::from(weight) * f64::from(map[(y * width + x) * inputs + input])
                                })
                                .sum::<f64>();
                        }
                    }
                    sum as f32
                };
                for (pixel, found) in found.chunks_exact(outputs).enumerate() {
                    let mut expected: Vec<f32> =
                        (0..outputs).map(|output| value(pixel / out_width, pixel % out_width, output)).collect();
                    norm.apply(&mut expected);
                    for (found, expected) in found.iter().zip(&expected) {
                        assert!((found - expected.max(0.0)).abs() < 1e-4, "{instructions:?}: {found} {expected}");
                    }
                }
            }
        }
    }
}

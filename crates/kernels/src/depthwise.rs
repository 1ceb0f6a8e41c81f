//! Depthwise convolution of channels-last maps, and what networks do between its layers: means and scales of channels.

use crate::instructions::{Instructions, TileKernel, multiply_add};
use pulp::Simd;
use rayon::prelude::*;

/// Output pixels of a row that are computed together.
const PIXELS: usize = 8;

/// Pixels per task where channels are averaged or scaled.
const PIXELS_PER_TASK: usize = 4096;

/// A convolution of every channel with a square kernel of its own, with bias. The padding is `kernel / 2`.
#[derive(Clone, Debug)]
pub struct DepthwiseConvolution {
    channels: usize,
    kernel: usize,
    stride: usize,
    /// `[kernel, kernel, channels]`.
    weights: Vec<f32>,
    bias: Vec<f32>,
    instructions: Instructions,
}

impl DepthwiseConvolution {
    /// Packs `weight` `[channels, 1, kernel, kernel]` and `bias` `[channels]`, row-major.
    ///
    /// # Panics
    /// If the length of `weight` does not match, or `stride` is 0.
    pub fn new(weight: &[f32], bias: &[f32], kernel: usize, stride: usize, instructions: Instructions) -> Self {
        let (channels, taps) = (bias.len(), kernel * kernel);
        assert_eq!(weight.len(), channels * taps, "weights of a depthwise convolution");
        assert!(stride > 0, "stride of a depthwise convolution");
        let weights = (0..taps).flat_map(|tap| weight.iter().skip(tap).step_by(taps).copied()).collect();
        Self { channels, kernel, stride, weights, bias: bias.to_vec(), instructions }
    }

    /// Height and width of the output for an input of height and width `size`.
    pub fn output_size(&self, size: [usize; 2]) -> [usize; 2] {
        size.map(|length| (length + 2 * (self.kernel / 2)).saturating_sub(self.kernel) / self.stride + 1)
    }

    /// Convolves `input` `[height, width, channels]` of height and width `size` to `output`.
    ///
    /// # Panics
    /// If a length does not match.
    pub fn forward(&self, input: &[f32], size: [usize; 2], output: &mut [f32]) {
        let [height, width] = self.output_size(size);
        assert_eq!(input.len(), size[0] * size[1] * self.channels, "input of a depthwise convolution");
        assert_eq!(output.len(), height * width * self.channels, "output of a depthwise convolution");
        let rows = output.par_chunks_exact_mut((width * self.channels).max(1));
        rows.enumerate().for_each(|(row, output)| {
            self.instructions.run_tiled(Row { convolution: self, input, size, row, output });
        });
    }
}

/// One row of outputs.
struct Row<'a> {
    convolution: &'a DepthwiseConvolution,
    input: &'a [f32],
    size: [usize; 2],
    row: usize,
    output: &'a mut [f32],
}

impl TileKernel for Row<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(mut self, simd: S) {
        let DepthwiseConvolution { channels, kernel, stride, .. } = *self.convolution;
        let has_window = self.output.len() >= PIXELS * channels && channels.is_multiple_of(S::F32_LANES);
        match (has_window, kernel, stride) {
            (true, 3, 1) => self.windows::<S, 3, 1, FUSED>(simd),
            (true, 3, 2) => self.windows::<S, 3, 2, FUSED>(simd),
            (true, 7, 1) => self.windows::<S, 7, 1, FUSED>(simd),
            _ => self.pixels::<S, FUSED>(simd),
        }
    }
}

impl<'a> Row<'a> {
    /// For each row of the kernel that is inside the map, its index and the input row `[width, channels]`.
    #[inline(always)]
    fn lines(&self) -> impl Iterator<Item = (usize, &'a [f32])> + use<'a> {
        let DepthwiseConvolution { channels, kernel, stride, .. } = *self.convolution;
        let (input, [height, width], begin) = (self.input, self.size, self.row * stride);
        let first = (kernel / 2).saturating_sub(begin);
        let end = kernel.min((height + kernel / 2).saturating_sub(begin));
        (first..end).map(move |tap| (tap, &input[(begin + tap - kernel / 2) * width * channels..][..width * channels]))
    }

    /// Computes [`PIXELS`] pixels at a time: every input is loaded once for all of them, and a row of weights stays in
    /// registers. Channels fill whole vectors.
    #[inline(always)]
    fn windows<S: Simd, const KERNEL: usize, const STRIDE: usize, const FUSED: bool>(&mut self, simd: S) {
        let out_width = self.output.len() / self.convolution.channels;
        for start in (0..out_width).step_by(PIXELS) {
            // The last window may overlap the one before.
            let first = start.min(out_width - PIXELS);
            let end = (first + PIXELS - 1) * STRIDE + KERNEL;
            if first * STRIDE >= KERNEL / 2 && end <= self.size[1] + KERNEL / 2 {
                self.window::<S, KERNEL, STRIDE, FUSED, false>(simd, first);
            } else {
                self.window::<S, KERNEL, STRIDE, FUSED, true>(simd, first);
            }
        }
    }

    /// Computes [`PIXELS`] pixels from `first` on, which need padding at the sides only if `PADDED`.
    #[inline(always)]
    fn window<S: Simd, const KERNEL: usize, const STRIDE: usize, const FUSED: bool, const PADDED: bool>(
        &mut self,
        simd: S,
        first: usize,
    ) {
        let (channels, width) = (self.convolution.channels, self.size[1]);
        for (vector, bias) in S::as_simd_f32s(&self.convolution.bias).0.iter().enumerate() {
            let mut sums = [*bias; PIXELS];
            for (tap_row, line) in self.lines() {
                let weights = &self.convolution.weights[tap_row * KERNEL * channels..][..KERNEL * channels];
                let mut taps = [*bias; KERNEL];
                for (tap, weights) in taps.iter_mut().zip(weights.chunks_exact(channels)) {
                    *tap = S::as_simd_f32s(weights).0[vector];
                }
                for column in 0..(PIXELS - 1) * STRIDE + KERNEL {
                    let x = (first * STRIDE + column).wrapping_sub(KERNEL / 2);
                    if PADDED && x >= width {
                        continue;
                    }
                    let value = S::as_simd_f32s(&line[x * channels..][..channels]).0[vector];
                    for (pixel, sum) in sums.iter_mut().enumerate() {
                        let tap = column.wrapping_sub(pixel * STRIDE);
                        if tap < KERNEL {
                            *sum = multiply_add::<S, FUSED>(simd, taps[tap], value, *sum);
                        }
                    }
                }
            }
            for (output, sum) in self.output[first * channels..].chunks_exact_mut(channels).zip(sums) {
                S::as_mut_simd_f32s(output).0[vector] = sum;
            }
        }
    }

    /// Computes one pixel after the other, for any kernel and number of channels.
    #[inline(always)]
    fn pixels<S: Simd, const FUSED: bool>(&mut self, simd: S) {
        let DepthwiseConvolution { channels, kernel, stride, .. } = *self.convolution;
        for x in 0..self.output.len() / channels {
            let begin = x * stride;
            let taps =
                (kernel / 2).saturating_sub(begin)..kernel.min((self.size[1] + kernel / 2).saturating_sub(begin));
            self.output[x * channels..][..channels].copy_from_slice(&self.convolution.bias);
            for (tap_row, line) in self.lines() {
                for tap in taps.clone() {
                    let weights = &self.convolution.weights[(tap_row * kernel + tap) * channels..][..channels];
                    let values = &line[(begin + tap - kernel / 2) * channels..][..channels];
                    let output = &mut self.output[x * channels..][..channels];
                    let ((weights, weight_tail), (values, value_tail)) =
                        (S::as_simd_f32s(weights), S::as_simd_f32s(values));
                    let (sums, sum_tail) = S::as_mut_simd_f32s(output);
                    for ((sum, weight), value) in sums.iter_mut().zip(weights).zip(values) {
                        *sum = multiply_add::<S, FUSED>(simd, *weight, *value, *sum);
                    }
                    for ((sum, weight), value) in sum_tail.iter_mut().zip(weight_tail).zip(value_tail) {
                        *sum = if FUSED { weight.mul_add(*value, *sum) } else { weight * value + *sum };
                    }
                }
            }
        }
    }
}

/// Mean of every channel of `values` `[pixels, channels]`.
///
/// # Panics
/// If `channels` is 0.
pub fn channel_means(values: &[f32], channels: usize) -> Vec<f32> {
    let instructions = Instructions::best();
    let sum = |values: &[f32]| {
        let mut sums = vec![0.0f32; channels];
        instructions.run(
            #[inline(always)]
            || {
                for pixel in values.chunks_exact(channels) {
                    sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += value);
                }
            },
        );
        sums
    };
    let sums: Vec<Vec<f32>> = values.par_chunks(PIXELS_PER_TASK * channels).map(sum).collect();
    let pixels = (values.len() / channels).max(1) as f32;
    (0..channels).map(|channel| sums.iter().map(|sums| sums[channel]).sum::<f32>() / pixels).collect()
}

/// Multiplies every channel of `values` `[pixels, channels]` by its factor.
pub fn scale_channels(values: &mut [f32], factors: &[f32]) {
    let instructions = Instructions::best();
    values.par_chunks_mut(PIXELS_PER_TASK * factors.len().max(1)).for_each(|values| {
        instructions.run(
            #[inline(always)]
            || {
                for pixel in values.chunks_exact_mut(factors.len()) {
                    pixel.iter_mut().zip(factors).for_each(|(value, factor)| *value *= factor);
                }
            },
        );
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(len: usize, seed: usize) -> Vec<f32> {
        (0..len).map(|index| ((index * 7919 + seed * 104_729) % 2003) as f32 / 1001.0 - 1.0).collect()
    }

    /// The definition, in double precision.
    fn expected(weight: &[f32], bias: &[f32], shape: (usize, usize), input: &[f32], size: [usize; 2]) -> Vec<f64> {
        let ((kernel, stride), channels, [height, width]) = (shape, bias.len(), size);
        let out = size.map(|length| (length + 2 * (kernel / 2) - kernel) / stride + 1);
        let mut values = Vec::new();
        for (y, x, channel) in
            (0..out[0]).flat_map(|y| (0..out[1]).flat_map(move |x| (0..channels).map(move |c| (y, x, c))))
        {
            let mut sum = f64::from(bias[channel]);
            for (v, u) in (0..kernel).flat_map(|v| (0..kernel).map(move |u| (v, u))) {
                let (row, column) =
                    ((y * stride + v).wrapping_sub(kernel / 2), (x * stride + u).wrapping_sub(kernel / 2));
                if row < height && column < width {
                    let value = input[(row * width + column) * channels + channel];
                    sum += f64::from(weight[(channel * kernel + v) * kernel + u]) * f64::from(value);
                }
            }
            values.push(sum);
        }
        values
    }

    #[test]
    fn equals_the_definition() {
        for instructions in Instructions::available() {
            for (channels, kernel, stride, size) in [
                (48, 3, 1, [9, 21]),
                (24, 3, 2, [12, 20]),
                (32, 3, 2, [12, 40]),
                (5, 3, 2, [7, 7]),
                (33, 7, 1, [8, 30]),
                (32, 7, 1, [9, 30]),
                (16, 7, 1, [3, 2]),
                (16, 5, 1, [6, 20]),
            ] {
                let (weight, bias) = (noise(channels * kernel * kernel, 1), noise(channels, 2));
                let input = noise(size[0] * size[1] * channels, 3);
                let convolution = DepthwiseConvolution::new(&weight, &bias, kernel, stride, instructions);
                let [height, width] = convolution.output_size(size);
                let mut found = vec![0.0; height * width * channels];
                convolution.forward(&input, size, &mut found);
                let expected = expected(&weight, &bias, (kernel, stride), &input, size);
                assert_eq!(found.len(), expected.len());
                for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
                    let close = (f64::from(*found) - expected).abs() < 1e-5;
                    assert!(close, "{instructions:?}, {channels}, {kernel}: element {index}: {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn channels_are_averaged_and_scaled() {
        let (channels, pixels) = (3, 10_000);
        let mut values: Vec<f32> =
            (0..pixels * channels).map(|index| (index % channels * 2 + index % 2) as f32).collect();
        let means = channel_means(&values, channels);
        let expected: Vec<f32> = (0..channels).map(|channel| channel as f32 * 2.0 + 0.5).collect();
        assert!(means.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-4), "{means:?}");
        let before = values.clone();
        scale_channels(&mut values, &[1.0, 0.5, -2.0]);
        let factors = [1.0, 0.5, -2.0];
        assert!(values.iter().enumerate().all(|(index, value)| *value == before[index] * factors[index % channels]));
    }
}

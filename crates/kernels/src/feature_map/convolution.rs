//! 1×1 and 3×3 convolutions of feature maps.

use super::{FeatureMap, MapLayout};
use crate::Activation;
use crate::gemm::pack_rows;
use crate::instructions::{Instructions, LANES, TileKernel, multiply_add};
use pulp::Simd;
use rayon::prelude::*;

/// Positions that a job computes: a multiple of every tile's columns.
const BLOCK_POSITIONS: usize = 512;
/// Jobs that a layer is divided into if it has fewer blocks of positions: then channels are divided too.
const LEAST_JOBS: usize = 8;

/// A convolution with a kernel of 1×1 (stride 1) or 3×3 (stride 1 or 2, padding 1), with bias and activation.
#[derive(Clone, Debug)]
pub struct MapConvolution {
    inputs: usize,
    outputs: usize,
    kernel: usize,
    stride: usize,
    activation: Activation,
    /// `[groups, inputs, taps, rows]`: a group is as many output channels as a tile has rows.
    weights: Vec<f32>,
    /// One per output channel, up to a whole number of groups.
    bias: Vec<f32>,
    instructions: Instructions,
}

impl MapConvolution {
    /// Whether a kernel of `kernel` × `kernel` with a stride can be packed.
    pub fn supports(kernel: usize, stride: usize) -> bool {
        matches!((kernel, stride), (1, 1) | (3, 1 | 2))
    }

    /// Packs `weight` `[outputs, inputs, kernel, kernel]` and `bias` `[outputs]`, row-major. The padding is
    /// `kernel / 2`.
    ///
    /// # Panics
    /// If [`Self::supports`] is false, or the length of `weight` is not a multiple of `outputs · kernel²`.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        kernel: usize,
        stride: usize,
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        assert!(Self::supports(kernel, stride), "a {kernel}×{kernel} convolution with stride {stride}");
        let (outputs, taps) = (bias.len(), kernel * kernel);
        let depth = weight.len() / outputs.max(1);
        assert!(depth * outputs == weight.len() && depth.is_multiple_of(taps), "weights of a convolution");
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(outputs.next_multiple_of(instructions.rows()), 0.0);
        let mut weights = Vec::with_capacity(padded_bias.len() * depth);
        pack_rows(weight.chunks_exact(depth.max(1)), outputs, depth, instructions.rows(), &mut weights);
        let inputs = depth / taps;
        Self { inputs, outputs, kernel, stride, activation, weights, bias: padded_bias, instructions }
    }

    /// Input channels.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Output channels.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Convolves `input` to `output`, which gets the shape that it needs, and adds `residual`, which has that shape,
    /// after the activation. `phases` is memory for a stride of 2.
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
        assert_eq!(input.channels(), self.inputs, "channels of a convolution's input");
        let (height, width) = (input.height().div_ceil(self.stride), input.width().div_ceil(self.stride));
        output.reshape(self.outputs, height, width);
        let layout = output.layout();
        if let Some(residual) = residual {
            assert!(residual.channels() == self.outputs && residual.layout() == layout, "shape of a residual");
        }
        let (input, channel_stride) = match self.stride {
            1 => (input, layout.plane()),
            _ => {
                split_phases(input, phases);
                (&*phases, 4 * layout.plane())
            }
        };
        let taps = self.taps(layout);
        let residual = residual.map(FeatureMap::values);
        let shared = Shared { convolution: self, layout, input: input.values(), channel_stride, taps: &taps, residual };
        self.jobs(output).into_par_iter().with_max_len(1).for_each(|job| self.instructions.run_tiled((shared, job)));
    }

    /// For each tap, the offset of its value from a position of the output.
    fn taps(&self, layout: MapLayout) -> Vec<usize> {
        let (pitch, plane) = (layout.pitch(), layout.plane());
        let tap = |index: usize| (index / 3, index % 3);
        match (self.kernel, self.stride) {
            (1, _) => vec![layout.lead()],
            (_, 1) => (0..9).map(tap).map(|(y, x)| y * pitch + x).collect(),
            _ => {
                // Rows and columns 2i - 1 and 2i + 1 are i - 1 and i of the odd phase, 2i is i of the even one.
                let part = |k: usize| (usize::from(k != 1), usize::from(k > 0));
                let offset = |(y, x)| {
                    let ((odd_row, y), (odd_column, x)) = (part(y), part(x));
                    (2 * odd_row + odd_column) * plane + y * pitch + x
                };
                (0..9).map(tap).map(offset).collect()
            }
        }
    }

    /// Cuts the output into blocks of positions and groups of channels.
    fn jobs<'a>(&self, output: &'a mut FeatureMap) -> Vec<Job<'a>> {
        let layout = output.layout();
        let rows = self.instructions.rows();
        let blocks = layout.positions().div_ceil(BLOCK_POSITIONS);
        let groups = self.bias.len() / rows;
        let shares = LEAST_JOBS.div_ceil(blocks.max(1)).min(groups);
        let groups_per_share = groups.div_ceil(shares.max(1)).max(1);
        let shares = groups.div_ceil(groups_per_share);
        let mut jobs: Vec<Job> = (0..shares * blocks)
            .map(|index| Job {
                first_group: index / blocks * groups_per_share,
                first_position: index % blocks * BLOCK_POSITIONS,
                channels: Vec::with_capacity(groups_per_share * rows),
            })
            .collect();
        for (channel, plane) in output.planes_mut().enumerate() {
            let share = channel / (groups_per_share * rows);
            let positions = &mut plane[layout.lead()..][..layout.positions()];
            for (block, values) in positions.chunks_mut(BLOCK_POSITIONS).enumerate() {
                jobs[share * blocks + block].channels.push(values);
            }
        }
        jobs
    }
}

/// The part of a convolution that all jobs read.
#[derive(Clone, Copy)]
struct Shared<'a> {
    convolution: &'a MapConvolution,
    layout: MapLayout,
    input: &'a [f32],
    /// Values from one input channel to the next.
    channel_stride: usize,
    taps: &'a [usize],
    residual: Option<&'a [f32]>,
}

/// Some positions of some output channels.
struct Job<'a> {
    first_group: usize,
    first_position: usize,
    /// The positions of each channel.
    channels: Vec<&'a mut [f32]>,
}

impl TileKernel for (Shared<'_>, Job<'_>) {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S) {
        let (shared, mut job) = self;
        let columns = VECTORS * S::F32_LANES;
        let len = job.channels.first().map_or(0, |channel| channel.len());
        let group_len = shared.convolution.inputs * shared.taps.len() * ROWS;
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        for start in (0..len).step_by(columns) {
            let end = len.min(start + columns);
            for (group, channels) in job.channels.chunks_mut(ROWS).enumerate() {
                let group = job.first_group + group;
                let weights = &shared.convolution.weights[group * group_len..][..group_len];
                let position = job.first_position + start;
                shared.sum::<S, ROWS, VECTORS, FUSED>(simd, group, weights, position, &mut sums);
                for (row, channel) in channels.iter_mut().enumerate() {
                    let values = bytemuck::cast_slice_mut(&mut sums[row]);
                    shared.finish(group * ROWS + row, position, values, &mut channel[start..end]);
                }
            }
        }
        let (pitch, width) = (shared.layout.pitch(), shared.layout.width);
        let first_zero = (width + pitch - job.first_position % pitch) % pitch;
        for channel in &mut job.channels {
            channel.iter_mut().skip(first_zero).step_by(pitch).for_each(|zero| *zero = 0.0);
        }
    }
}

impl Shared<'_> {
    /// The sums of products and the bias of one group of channels, from `position` on.
    #[inline(always)]
    fn sum<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
        &self,
        simd: S,
        group: usize,
        weights: &[f32],
        position: usize,
        out: &mut [[S::f32s; VECTORS]; ROWS],
    ) {
        let bias = &self.convolution.bias[group * ROWS..][..ROWS];
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        for row in 0..ROWS {
            sums[row] = [simd.splat_f32s(bias[row]); VECTORS];
        }
        let channels = self.input[position..].chunks(self.channel_stride);
        for (channel, weights) in channels.zip(weights.chunks_exact(self.taps.len() * ROWS)) {
            for (tap, weights) in self.taps.iter().zip(weights.as_chunks::<ROWS>().0) {
                let (pixels, _) = S::as_simd_f32s(&channel[*tap..][..VECTORS * S::F32_LANES]);
                let mut vectors = [simd.splat_f32s(0.0); VECTORS];
                vectors.copy_from_slice(pixels);
                for row in 0..ROWS {
                    let factor = simd.splat_f32s(weights[row]);
                    for vector in 0..VECTORS {
                        sums[row][vector] = multiply_add::<S, FUSED>(simd, factor, vectors[vector], sums[row][vector]);
                    }
                }
            }
        }
        // To other memory than what the sums are, so that those stay in registers.
        for (out, sums) in out.iter_mut().zip(sums) {
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = sum;
            }
        }
    }

    /// Activation and residual of the sums of one channel, from `position` on; then writes them.
    #[inline(always)]
    fn finish(&self, channel: usize, position: usize, sums: &mut [f32], out: &mut [f32]) {
        for lanes in sums.as_chunks_mut::<LANES>().0 {
            self.convolution.activation.apply(lanes);
        }
        if let Some(residual) = self.residual {
            let start = channel * self.layout.plane() + self.layout.lead() + position;
            let residual = &residual[start..][..sums.len()];
            sums.iter_mut().zip(residual).for_each(|(sum, residual)| *sum += residual);
        }
        out.copy_from_slice(&sums[..out.len()]);
    }
}

/// Copies the pixels of even and odd rows and columns to maps of their own: channel by channel (even, even), (even, odd),
/// (odd, even), (odd, odd), each of the size of the even one.
fn split_phases(input: &FeatureMap, phases: &mut FeatureMap) {
    let height = input.height();
    phases.reshape(4 * input.channels(), height.div_ceil(2), input.width().div_ceil(2));
    let layout = phases.layout();
    phases.values_mut().par_chunks_exact_mut(4 * layout.plane()).enumerate().for_each(|(channel, planes)| {
        for (phase, plane) in planes.chunks_exact_mut(layout.plane()).enumerate() {
            let rows = plane[layout.lead()..].chunks_exact_mut(layout.pitch()).take(layout.height);
            for (row, out) in rows.enumerate() {
                let out = &mut out[..layout.width];
                let source = 2 * row + phase / 2;
                let values = if source < height { input.row(channel, source) } else { &[] };
                let values = values.get(phase % 2..).unwrap_or(&[]);
                // An odd size has one odd row or column less than even ones.
                out[values.len().div_ceil(2)..].fill(0.0);
                out.iter_mut().zip(values.iter().step_by(2)).for_each(|(out, value)| *out = *value);
            }
        }
    });
}

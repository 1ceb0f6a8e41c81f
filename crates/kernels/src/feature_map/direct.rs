//! Direct convolution: every kernel tap is a shift of the whole map.

use super::tile::{finish, sum_products, write};
use super::{FeatureMap, MapLayout};
use crate::Activation;
use crate::gemm::pack_rows;
use crate::instructions::{Instructions, TileKernel};
use pulp::Simd;
use rayon::prelude::*;

/// Positions per job: a multiple of every tile's columns.
const BLOCK_POSITIONS: usize = 512;
/// Minimum number of jobs per layer, if it has enough channels: with fewer blocks of positions, channels are divided
/// too.
const LEAST_JOBS: usize = 8;

/// A convolution with a kernel of 1×1 (stride 1) or 3×3 (stride 1 or 2).
#[derive(Clone, Debug)]
pub(super) struct DirectConvolution {
    inputs: usize,
    kernel: usize,
    stride: usize,
    activation: Activation,
    /// `[groups, inputs, taps, rows]`: a group has one output channel per row of a tile.
    weights: Vec<f32>,
    /// One per output channel, padded to whole groups.
    bias: Vec<f32>,
    instructions: Instructions,
}

impl DirectConvolution {
    /// Packs `weight` `[outputs, inputs, kernel, kernel]` and `bias` `[outputs]`, row-major.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        (kernel, stride): (usize, usize),
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        let depth = weight.len() / bias.len().max(1);
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(bias.len().next_multiple_of(instructions.rows()), 0.0);
        let mut weights = Vec::with_capacity(padded_bias.len() * depth);
        pack_rows(weight.chunks_exact(depth.max(1)), bias.len(), depth, instructions.rows(), &mut weights);
        let inputs = depth / (kernel * kernel);
        Self { inputs, kernel, stride, activation, weights, bias: padded_bias, instructions }
    }

    /// Convolves `input` to `output`, which must have the right shape, with the first output's centre at `start` (row,
    /// column). `phases` is scratch memory for stride 2.
    pub fn forward(
        &self,
        input: &FeatureMap,
        start: [usize; 2],
        residual: Option<&FeatureMap>,
        phases: &mut FeatureMap,
        output: &mut FeatureMap,
    ) {
        let layout = output.layout();
        let (input, channel_stride) = match self.stride {
            1 => (input, layout.plane()),
            _ => {
                split_phases(input, layout, phases);
                (&*phases, 4 * layout.plane())
            }
        };
        let taps = self.taps(layout, start);
        let residual = residual.map(FeatureMap::values);
        let shared = Shared { convolution: self, layout, input: input.values(), channel_stride, taps: &taps, residual };
        self.jobs(output).into_par_iter().with_max_len(1).for_each(|job| self.instructions.run_tiled((shared, job)));
    }

    /// Offset of each tap's value from an output position.
    fn taps(&self, layout: MapLayout, start: [usize; 2]) -> Taps {
        let (pitch, plane) = (layout.pitch(), layout.plane());
        match (self.kernel, self.stride) {
            (1, _) => Taps::One([layout.lead()]),
            (_, 1) => Taps::Nine(std::array::from_fn(|tap| tap / 3 * pitch + tap % 3)),
            _ => {
                // Offset 1 is row or column i of a phase. From 0, the taps 2i - 1 and 2i + 1 are i - 1 and i of the odd
                // phase, and 2i is i of the even phase. From 1, 2i and 2i + 2 are i and i + 1 of the even phase, and
                // 2i + 1 is i of the odd phase.
                let part = |start: usize, k: usize| match start {
                    0 => (usize::from(k != 1), usize::from(k > 0)),
                    _ => (usize::from(k == 1), 1 + usize::from(k == 2)),
                };
                Taps::Nine(std::array::from_fn(|tap| {
                    let ((odd_row, y), (odd_column, x)) = (part(start[0], tap / 3), part(start[1], tap % 3));
                    (2 * odd_row + odd_column) * plane + y * pitch + x
                }))
            }
        }
    }

    /// Divides the output into blocks of positions and groups of channels.
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

/// Offsets of an output's inputs from the output's position.
#[derive(Clone, Copy, Debug)]
enum Taps {
    One([usize; 1]),
    Nine([usize; 9]),
}

/// The part of a convolution that all jobs read.
#[derive(Clone, Copy)]
struct Shared<'a> {
    convolution: &'a DirectConvolution,
    layout: MapLayout,
    input: &'a [f32],
    /// Distance between input channels, in values.
    channel_stride: usize,
    taps: &'a Taps,
    residual: Option<&'a [f32]>,
}

/// Some positions of some output channels.
struct Job<'a> {
    first_group: usize,
    first_position: usize,
    /// Outputs at these positions, one slice per channel.
    channels: Vec<&'a mut [f32]>,
}

impl TileKernel for (Shared<'_>, Job<'_>) {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S) {
        let (shared, mut job) = self;
        let columns = VECTORS * S::F32_LANES;
        let len = job.channels.first().map_or(0, |channel| channel.len());
        let group_len = shared.convolution.inputs * shared.convolution.kernel.pow(2) * ROWS;
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        for start in (0..len).step_by(columns) {
            let end = len.min(start + columns);
            for (group, channels) in job.channels.chunks_mut(ROWS).enumerate() {
                let group = job.first_group + group;
                let weights = &shared.convolution.weights[group * group_len..][..group_len];
                let position = job.first_position + start;
                let mut first = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
                for (first, bias) in first.iter_mut().zip(&shared.convolution.bias[group * ROWS..][..ROWS]) {
                    *first = [simd.splat_f32s(*bias); VECTORS];
                }
                let input = shared.input[position..].chunks(shared.channel_stride);
                match shared.taps {
                    Taps::One(taps) => {
                        sum_products::<S, ROWS, VECTORS, FUSED, 1>(simd, input, taps, weights, first, &mut sums);
                    }
                    Taps::Nine(taps) => {
                        sum_products::<S, ROWS, VECTORS, FUSED, 9>(simd, input, taps, weights, first, &mut sums);
                    }
                }
                for (row, channel) in channels.iter_mut().enumerate() {
                    let values = bytemuck::cast_slice_mut(&mut sums[row]);
                    let residual = shared.residual.map(|residual| {
                        let plane = (group * ROWS + row) * shared.layout.plane();
                        &residual[plane + shared.layout.lead() + position..]
                    });
                    finish(shared.convolution.activation, values);
                    write(values, residual, &mut channel[start..end]);
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

/// Copies the pixels of even and odd rows and columns to separate maps: for each channel (even, even), (even, odd),
/// (odd, even) and (odd, odd), all with the output's layout.
///
/// A start of 1 on an odd size has one more even row or column than outputs. It lies in the padding after the others,
/// which no tap then reads as the padding before the first.
fn split_phases(input: &FeatureMap, layout: MapLayout, phases: &mut FeatureMap) {
    let height = input.height();
    phases.reshape(4 * input.channels(), layout.height, layout.width);
    phases.values_mut().par_chunks_exact_mut(4 * layout.plane()).enumerate().for_each(|(channel, planes)| {
        for (phase, plane) in planes.chunks_exact_mut(layout.plane()).enumerate() {
            let rows = plane[layout.lead()..].chunks_exact_mut(layout.pitch()).take(layout.height + 1);
            for (row, out) in rows.enumerate() {
                let source = 2 * row + phase / 2;
                let values = if source < height { input.row(channel, source) } else { &[] };
                let values = values.get(phase % 2..).unwrap_or(&[]);
                // A phase may have fewer rows or columns than the layout.
                out[values.len().div_ceil(2)..].fill(0.0);
                out.iter_mut().zip(values.iter().step_by(2)).for_each(|(out, value)| *out = *value);
            }
        }
    });
}

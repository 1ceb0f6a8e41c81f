//! 3×3 convolution with stride 1 by Winograd's algorithm along columns: F(4, 3), six products instead of twelve for
//! four outputs of a column (Lavin and Gray, *Fast algorithms for convolutional neural networks*, CVPR 2016). Along
//! rows, the three taps are shifts, so pixels stay in map order.
//!
//! Four rows of outputs are a *band*. A thread transforms the six input rows of each band to six transformed rows,
//! which stay in the second-level cache while all output channels are computed from them.

use super::tile::{finish, sum_products, write};
use super::{FeatureMap, MapLayout};
use crate::Activation;
use crate::gemm::pack_rows;
use crate::instructions::{Instructions, LANES, TileKernel, multiply_add};
use pulp::Simd;
use rayon::prelude::*;
use std::cell::RefCell;

/// Output rows per band.
const BAND: usize = 4;
/// Transformed rows per band.
const PARTS: usize = 6;
/// Taps along a row, as offsets from a position of the output.
const TAPS: [usize; 3] = [0, 1, 2];
/// Maximum number of transformed values per job: they stay in the second-level cache, with the weights.
const MAX_VALUES: usize = 130_000;
/// Maximum number of transformed weights; more would not stay in the second-level cache.
const MAX_WEIGHTS: usize = 180_000;
/// Minimum number of jobs per layer, if it has enough channels: with fewer blocks of bands, channels are divided too.
const LEAST_JOBS: usize = 4;
/// Extra values after the transformed rows, so that a tile may extend past the end.
const SLACK: usize = 48;

thread_local! {
    /// Transformed rows: a buffer that a thread keeps from one convolution to the next.
    static TRANSFORMED: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

/// A 3×3 convolution with stride 1.
#[derive(Clone, Debug)]
pub(super) struct WinogradConvolution {
    inputs: usize,
    activation: Activation,
    /// `[groups, parts, inputs, taps, rows]`: a group has one output channel per row of a tile.
    weights: Vec<f32>,
    bias: Vec<f32>,
    instructions: Instructions,
}

impl WinogradConvolution {
    /// True if this algorithm suits the convolution.
    pub fn suits(inputs: usize, outputs: usize, kernel: usize, stride: usize) -> bool {
        let weights = PARTS * TAPS.len() * inputs * outputs;
        kernel == 3 && stride == 1 && inputs.min(outputs) >= 8 && weights <= MAX_WEIGHTS
    }

    /// Transforms and packs `weight` `[outputs, inputs, 3, 3]` and `bias` `[outputs]`, row-major.
    pub fn new(weight: &[f32], bias: &[f32], activation: Activation, instructions: Instructions) -> Self {
        let (rows, inputs) = (instructions.rows(), weight.len() / (9 * bias.len()));
        let mut weights = Vec::with_capacity(2 * weight.len());
        for group in weight.chunks(9 * inputs * rows) {
            for part in 0..PARTS {
                let transformed: Vec<f32> = group
                    .as_chunks::<9>()
                    .0
                    .iter()
                    .flat_map(|kernel| TAPS.map(|x| transform_kernel([kernel[x], kernel[3 + x], kernel[6 + x]])[part]))
                    .collect();
                let depth = TAPS.len() * inputs;
                pack_rows(transformed.chunks_exact(depth), rows, depth, rows, &mut weights);
            }
        }
        Self { inputs, activation, weights, bias: bias.to_vec(), instructions }
    }

    /// Convolves `input` to `output`, which must have the right shape.
    pub fn forward(&self, input: &FeatureMap, residual: Option<&FeatureMap>, output: &mut FeatureMap) {
        let shared = Shared { convolution: self, layout: input.layout(), input, residual };
        self.jobs(output).into_par_iter().with_max_len(1).for_each(|job| {
            TRANSFORMED.with_borrow_mut(|transformed| self.instructions.run_tiled((shared, job, transformed)));
        });
    }

    /// Divides the output into blocks of bands and groups of channels.
    fn jobs<'a>(&self, output: &'a mut FeatureMap) -> Vec<Job<'a>> {
        let (layout, rows) = (output.layout(), self.instructions.rows());
        let bands = layout.height.div_ceil(BAND);
        let bands_that_fit = (MAX_VALUES / (PARTS * self.inputs * layout.pitch())).max(1);
        // Blocks of nearly equal size, so that the threads finish together.
        let bands_per_block = bands.div_ceil(bands.div_ceil(bands_that_fit).max(1)).max(1);
        let blocks = bands.div_ceil(bands_per_block);
        let groups = self.bias.len().div_ceil(rows);
        let shares = LEAST_JOBS.div_ceil(blocks.max(1)).min(groups);
        let groups_per_share = groups.div_ceil(shares);
        let shares = groups.div_ceil(groups_per_share);
        let mut jobs: Vec<Job> = (0..shares * blocks)
            .map(|index| Job {
                first_group: index / blocks * groups_per_share,
                first_row: index % blocks * bands_per_block * BAND,
                channels: Vec::with_capacity(groups_per_share * rows),
            })
            .collect();
        for (channel, plane) in output.planes_mut().enumerate() {
            let share = channel / (groups_per_share * rows);
            let positions = &mut plane[layout.lead()..][..layout.positions()];
            let block_len = (bands_per_block * BAND * layout.pitch()).max(1);
            for (block, values) in positions.chunks_mut(block_len).enumerate() {
                jobs[share * blocks + block].channels.push(values);
            }
        }
        jobs
    }
}

/// The part of a convolution that all jobs read.
#[derive(Clone, Copy)]
struct Shared<'a> {
    convolution: &'a WinogradConvolution,
    layout: MapLayout,
    input: &'a FeatureMap,
    residual: Option<&'a FeatureMap>,
}

/// Some bands of some output channels.
struct Job<'a> {
    first_group: usize,
    first_row: usize,
    /// Outputs of these bands, one slice per channel.
    channels: Vec<&'a mut [f32]>,
}

impl TileKernel for (Shared<'_>, Job<'_>, &mut Vec<f32>) {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S) {
        let (shared, mut job, transformed) = self;
        let pitch = shared.layout.pitch();
        let rows = job.channels.first().map_or(0, |channel| channel.len() / pitch);
        let bands = rows.div_ceil(BAND);
        let part_len = (bands * pitch + SLACK).next_multiple_of(16);
        shared.transform::<S, FUSED>(simd, job.first_row, bands, part_len, transformed);
        let inputs = shared.convolution.inputs;
        let weights_len = TAPS.len() * inputs * ROWS;
        let zeros = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        let mut products = [zeros; PARTS];
        for start in (0..bands * pitch).step_by(VECTORS * S::F32_LANES) {
            for (group, channels) in job.channels.chunks_mut(ROWS).enumerate() {
                let group = job.first_group + group;
                let weights = &shared.convolution.weights[group * PARTS * weights_len..][..PARTS * weights_len];
                for (part, (weights, out)) in weights.chunks_exact(weights_len).zip(&mut products).enumerate() {
                    let values = transformed[part * part_len + start..].chunks(PARTS * part_len);
                    sum_products::<S, ROWS, VECTORS, FUSED, 3>(simd, values, &TAPS, weights, zeros, out);
                }
                for (row, channel) in channels.iter_mut().enumerate() {
                    let bias = simd.splat_f32s(shared.convolution.bias[group * ROWS + row]);
                    let mut outputs = [[bias; VECTORS]; BAND];
                    for vector in 0..VECTORS {
                        let column = transform_sums::<S, FUSED>(
                            simd,
                            [0, 1, 2, 3, 4, 5].map(|part| products[part][row][vector]),
                            bias,
                        );
                        for (outputs, value) in outputs.iter_mut().zip(column) {
                            outputs[vector] = value;
                        }
                    }
                    for (row_in_band, outputs) in outputs.iter_mut().enumerate() {
                        let values = bytemuck::cast_slice_mut(outputs);
                        finish(shared.convolution.activation, values);
                        let first_row = (job.first_row, row_in_band);
                        shared.write(group * ROWS + row, first_row, start, values, channel);
                    }
                }
            }
        }
    }
}

impl Shared<'_> {
    /// Computes the transformed rows of some bands, `[inputs, parts, part_len]`, with one row of `pitch` values per
    /// band. The first value of a row is the zero before it. Values after a row are undefined.
    #[inline(always)]
    fn transform<S: Simd, const FUSED: bool>(
        &self,
        simd: S,
        first_row: usize,
        bands: usize,
        part_len: usize,
        transformed: &mut Vec<f32>,
    ) {
        let layout = self.layout;
        let pitch = layout.pitch();
        let window = (layout.width + 2).next_multiple_of(LANES);
        let len = PARTS * part_len * self.convolution.inputs;
        if transformed.len() < len + window {
            transformed.resize(len + window, 0.0);
        }
        let (values, zeros) = transformed.split_at_mut(len);
        let zeros = &mut zeros[..window];
        zeros.fill(0.0);
        let zeros = &*zeros;
        let planes = self.input.values().chunks_exact(layout.plane());
        for (plane, parts) in planes.zip(values.chunks_exact_mut(PARTS * part_len)) {
            for band in 0..bands {
                let mut rows = [zeros; PARTS];
                for (index, row) in rows.iter_mut().enumerate() {
                    // Row -1 and all rows after the last are padding.
                    let source = (first_row + band * BAND + index).wrapping_sub(1);
                    if source < layout.height {
                        *row = &plane[layout.lead() + source * pitch - 1..][..window];
                    }
                }
                transform_rows::<S, FUSED>(simd, rows, &mut parts[band * pitch..], part_len);
            }
        }
    }

    /// Writes values of one channel to one row of each band. `start` is the first value's position in the job's bands.
    #[inline(always)]
    fn write(
        &self,
        channel: usize,
        (first_row, row_in_band): (usize, usize),
        start: usize,
        values: &[f32],
        out: &mut [f32],
    ) {
        let (pitch, width) = (self.layout.pitch(), self.layout.width);
        let mut at = 0;
        while at < values.len() {
            let (band, column) = ((start + at) / pitch, (start + at) % pitch);
            // Keep the zero after each row.
            let len = (values.len() - at).min(width - column);
            let place = (band * BAND + row_in_band) * pitch + column;
            let Some(out) = out.get_mut(place..place + len) else { break };
            let residual = self.residual.map(|residual| {
                let plane = channel * self.layout.plane() + self.layout.lead() + first_row * pitch;
                &residual.values()[plane + place..]
            });
            write(&values[at..], residual, out);
            at += len + usize::from(column + len == width);
        }
    }
}

/// Computes G g for a column of the kernel.
fn transform_kernel([a, b, c]: [f32; 3]) -> [f32; PARTS] {
    let (outer, far) = ((a + c) / 6.0, a / 24.0 + c / 6.0);
    [a / 4.0, -outer - b / 6.0, -outer + b / 6.0, far + b / 12.0, far - b / 12.0, c]
}

/// Computes Bᵀ d: six input rows become the first rows of six parts.
#[inline(always)]
fn transform_rows<S: Simd, const FUSED: bool>(simd: S, rows: [&[f32]; PARTS], parts: &mut [f32], part_len: usize) {
    let factor = |value| simd.splat_f32s(value);
    let times = |factor, value, sum| multiply_add::<S, FUSED>(simd, factor, value, sum);
    let (two, four, minus_four, minus_five) = (factor(2.0), factor(4.0), factor(-4.0), factor(-5.0));
    for start in (0..rows[0].len()).step_by(S::F32_LANES) {
        let mut d = [two; PARTS];
        for (d, row) in d.iter_mut().zip(rows) {
            *d = S::as_simd_f32s(&row[start..][..S::F32_LANES]).0[0];
        }
        let [d0, d1, d2, d3, d4, d5] = d;
        let (even, odd) = (times(minus_four, d2, d4), times(minus_four, d1, d3));
        let (near_even, near_odd) = (simd.sub_f32s(d4, d2), simd.sub_f32s(d3, d1));
        let transformed = [
            times(four, d0, times(minus_five, d2, d4)),
            simd.add_f32s(even, odd),
            simd.sub_f32s(even, odd),
            times(two, near_odd, near_even),
            simd.sub_f32s(near_even, simd.mul_f32s(two, near_odd)),
            times(four, d1, times(minus_five, d3, d5)),
        ];
        for (part, value) in transformed.into_iter().enumerate() {
            S::as_mut_simd_f32s(&mut parts[part * part_len + start..][..S::F32_LANES]).0[0] = value;
        }
    }
}

/// Computes Aᵀ m + bias: four outputs of a column.
#[inline(always)]
fn transform_sums<S: Simd, const FUSED: bool>(simd: S, parts: [S::f32s; PARTS], bias: S::f32s) -> [S::f32s; BAND] {
    let [m0, m1, m2, m3, m4, m5] = parts;
    let times = |factor, value, sum| multiply_add::<S, FUSED>(simd, simd.splat_f32s(factor), value, sum);
    let (sum, difference) = (simd.add_f32s(simd.add_f32s(m1, m2), bias), simd.add_f32s(simd.sub_f32s(m1, m2), bias));
    let (far_sum, far_difference) = (simd.add_f32s(m3, m4), simd.sub_f32s(m3, m4));
    [
        simd.add_f32s(simd.add_f32s(m0, sum), far_sum),
        times(2.0, far_difference, difference),
        times(4.0, far_sum, sum),
        times(8.0, far_difference, simd.add_f32s(m5, difference)),
    ]
}

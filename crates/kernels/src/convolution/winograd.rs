//! Winograd's algorithm for 3×3 convolution: 16 instead of 36 multiplications per 2×2 outputs (F(2×2, 3×3); Lavin and
//! Gray, *Fast algorithms for convolutional neural networks*, 2016).
//!
//! Each 4×4 square of inputs d around 2×2 outputs, and each kernel g, is transformed to 16 numbers. The outputs are
//! Aᵀ\[(G g Gᵀ) ⊙ (Bᵀ d B)\]A. Summing over channels takes 16 matrix products, one per position in the transformed
//! square.

use super::ConvolutionShape;
use crate::Activation;
use crate::gemm::{DEPTH_BLOCK, pack_rows};
use crate::instructions::{Instructions, LANES};
use rayon::prelude::*;
use std::cell::RefCell;
use std::ops::Range;

/// Number of positions in a transformed square.
const POSITIONS: usize = 16;
/// Approximate number of squares transformed together.
const SQUARES: usize = 96;
/// Number of panels of output channels whose products are held together.
const PANELS: usize = 4;

thread_local! {
    /// Buffers that a thread keeps from one convolution to the next: transformed inputs, one channel's transformed
    /// rows, and sums.
    static BUFFERS: RefCell<[Vec<f32>; 3]> = const { RefCell::new([Vec::new(), Vec::new(), Vec::new()]) };
}

/// A 3×3 convolution with stride 1.
#[derive(Clone, Debug)]
pub(super) struct WinogradConvolution {
    shape: ConvolutionShape,
    activation: Activation,
    /// Panels of output channels, ordered by group of panels, then by block of input channels, then by position.
    weights: Vec<f32>,
    /// One per output channel, padded to whole groups.
    bias: Vec<f32>,
    instructions: Instructions,
}

impl WinogradConvolution {
    /// True if this algorithm suits the shape. With few channels, the transforms cost more than they save.
    pub fn suits(shape: ConvolutionShape) -> bool {
        shape.kernel == 3 && shape.stride == 1 && !shape.doubling && shape.inputs.min(shape.outputs) >= 8
    }

    /// Transforms and packs `weight` `[outputs, inputs, 3, 3]` and `bias` `[outputs]`, row-major.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        shape: ConvolutionShape,
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        let group = PANELS * instructions.rows();
        let inputs = shape.inputs;
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(bias.len().next_multiple_of(group), 0.0);
        let mut weights = Vec::with_capacity(POSITIONS * inputs * padded_bias.len());
        let mut transformed = vec![0.0; POSITIONS * group * inputs];
        for kernels in weight.chunks(9 * inputs * group) {
            transformed.fill(0.0);
            for (index, kernel) in kernels.as_chunks::<9>().0.iter().enumerate() {
                for (position, value) in transform_kernel(kernel).into_iter().enumerate() {
                    transformed[position * group * inputs + index] = value;
                }
            }
            for start in (0..inputs).step_by(DEPTH_BLOCK) {
                let end = inputs.min(start + DEPTH_BLOCK);
                for matrix in transformed.chunks_exact(group * inputs) {
                    let rows = matrix.chunks_exact(inputs).map(|row| &row[start..end]);
                    pack_rows(rows, group, end - start, instructions.rows(), &mut weights);
                }
            }
        }
        Self { shape, activation, weights, bias: padded_bias, instructions }
    }

    /// Convolves one image, the concatenation of `images` along channels, to `output` `[outputs, height', width']`.
    /// Writes every value of `output` once.
    pub fn forward(&self, images: &[&[f32]], input: [usize; 2], output: &mut [f32]) {
        let [height, width] = self.shape.product_size(input);
        let squares = [height.div_ceil(2), width.div_ceil(2)];
        let threads = rayon::current_num_threads();
        let rows = (SQUARES / squares[1]).max(1);
        let jobs = squares[0].div_ceil(rows).next_multiple_of(threads).min(squares[0]);
        let mut jobs: Vec<Job> = (0..jobs)
            .map(|job| Job {
                rows: job * squares[0] / jobs..(job + 1) * squares[0] / jobs,
                columns: squares[1],
                channels: Vec::with_capacity(self.shape.outputs),
            })
            .collect();
        for mut channel in output.chunks_exact_mut(height * width) {
            for job in &mut jobs {
                let (values, rest) = channel.split_at_mut((2 * job.rows.len() * width).min(channel.len()));
                job.channels.push(values);
                channel = rest;
            }
        }
        jobs.into_par_iter().with_max_len(1).for_each(|mut job| self.run(images, input, width, &mut job));
    }

    fn run(&self, images: &[&[f32]], input: [usize; 2], width: usize, job: &mut Job) {
        BUFFERS.with_borrow_mut(|[squares, rows, sums]| {
            let columns = self.instructions.columns();
            let count = (job.rows.len() * job.columns).next_multiple_of(columns);
            // Squares beyond the last are not written and hold values from other layers. Their sums are never read.
            if squares.len() < POSITIONS * self.shape.inputs * count {
                squares.resize(POSITIONS * self.shape.inputs * count, 0.0);
            }
            let squares = &mut squares[..POSITIONS * self.shape.inputs * count];
            self.instructions.run(
                #[inline(always)]
                || self.transform_image(images, input, job, count, rows, squares),
            );
            let group = PANELS * self.instructions.rows();
            let group_len = POSITIONS * self.shape.inputs * group;
            for (index, weights) in self.weights.chunks_exact(group_len).enumerate() {
                sums.clear();
                sums.resize(POSITIONS * group * count, 0.0);
                self.sum(weights, squares, sums);
                let channels = index * group..self.shape.outputs.min((index + 1) * group);
                self.instructions.run(
                    #[inline(always)]
                    || self.finish(sums, channels.clone(), width, job),
                );
            }
        })
    }

    /// Computes the products of a group of output channels, `[positions, square panels, channels, columns]`.
    fn sum(&self, mut weights: &[f32], mut squares: &[f32], sums: &mut [f32]) {
        let position_len = sums.len() / POSITIONS;
        let channels = PANELS * self.instructions.rows();
        let count = position_len / channels;
        for start in (0..self.shape.inputs).step_by(DEPTH_BLOCK) {
            let depth = DEPTH_BLOCK.min(self.shape.inputs - start);
            for sums in sums.chunks_exact_mut(position_len) {
                let (left, right);
                (left, weights) = weights.split_at(depth * channels);
                (right, squares) = squares.split_at(depth * count);
                self.instructions.add_product(left, right, depth, sums);
            }
        }
    }

    /// Computes Bᵀ d B of all squares: panels of squares, ordered by block of channels, then by position.
    #[inline(always)]
    fn transform_image(
        &self,
        images: &[&[f32]],
        input: [usize; 2],
        job: &Job,
        count: usize,
        rows: &mut Vec<f32>,
        squares: &mut [f32],
    ) {
        let columns = self.instructions.columns();
        let inputs = self.shape.inputs;
        let row_len = 4 * job.columns;
        rows.clear();
        rows.resize((2 * job.rows.len() + 2) * row_len, 0.0);
        let channels = images.iter().flat_map(|image| image.chunks_exact(input[0] * input[1]));
        for (channel, values) in channels.enumerate() {
            for (y, row) in rows.chunks_exact_mut(row_len).enumerate() {
                let y = (2 * job.rows.start + y).checked_sub(self.shape.padding).filter(|y| *y < input[0]);
                match y {
                    Some(y) => transform_row(&values[y * input[1]..][..input[1]], self.shape.padding, row),
                    None => row.fill(0.0),
                }
            }
            let block = channel / DEPTH_BLOCK * DEPTH_BLOCK;
            let depth = DEPTH_BLOCK.min(inputs - block);
            let block_squares = &mut squares[block * POSITIONS * count..][..depth * POSITIONS * count];
            for (position, panels) in block_squares.chunks_exact_mut(depth * count).enumerate() {
                // Rows of Bᵀ: d0 - d2, d1 + d2, d2 - d1, d1 - d3.
                let (first, second) = [(0, 2), (1, 2), (2, 1), (1, 3)][position / 4];
                let sign = if position / 4 == 1 { 1.0 } else { -1.0 };
                for square_row in 0..job.rows.len() {
                    let part = |row: usize| &rows[(2 * square_row + row) * row_len..][position % 4 * job.columns..];
                    let (first, second) = (&part(first)[..job.columns], &part(second)[..job.columns]);
                    for_each_run(square_row * job.columns, job.columns, columns, |at, run| {
                        let panel = at / columns * depth + channel - block;
                        let out = &mut panels[panel * columns + at % columns..][..run.len()];
                        let terms = first[run.clone()].iter().zip(&second[run]);
                        out.iter_mut().zip(terms).for_each(|(out, (a, b))| *out = a + sign * b);
                    });
                }
            }
        }
    }

    /// Computes AᵀmA, adds bias and applies the activation for a group of output channels.
    #[inline(always)]
    fn finish(&self, sums: &[f32], channels: Range<usize>, width: usize, job: &mut Job) {
        let columns = self.instructions.columns();
        let group = PANELS * self.instructions.rows();
        let position_len = sums.len() / POSITIONS;
        let count = job.rows.len() * job.columns;
        for (index, channel) in channels.enumerate() {
            let bias = self.bias[channel];
            let out = &mut *job.channels[channel];
            for first in (0..count).step_by(LANES) {
                let start = (first / columns * group + index) * columns + first % columns;
                let mut square = [[0.0; LANES]; POSITIONS];
                for (position, lanes) in square.iter_mut().enumerate() {
                    lanes.copy_from_slice(&sums[position * position_len + start..][..LANES]);
                }
                let mut outputs = transform_sums(&square, bias);
                for row in outputs.as_flattened_mut().as_chunks_mut::<LANES>().0 {
                    self.activation.apply(row);
                }
                let end = count.min(first + LANES);
                let mut at = first;
                while at < end {
                    let (y, x) = (at / job.columns, at % job.columns);
                    let len = (end - at).min(job.columns - x);
                    for (dy, row) in outputs.iter().enumerate() {
                        // The last row and column of squares may extend beyond the border.
                        let Some(out) = out.get_mut((2 * y + dy) * width..).filter(|out| !out.is_empty()) else {
                            continue;
                        };
                        let out = &mut out[2 * x..width.min(2 * (x + len))];
                        out.copy_from_slice(&row[2 * (at - first)..][..out.len()]);
                    }
                    at += len;
                }
            }
        }
    }
}

/// Some rows of squares.
struct Job<'a> {
    rows: Range<usize>,
    /// Number of squares per row.
    columns: usize,
    /// Outputs of these rows, one slice per channel.
    channels: Vec<&'a mut [f32]>,
}

/// Splits a row of `len` squares, the first of which has index `start`, at the ends of panels of `columns` squares.
/// Calls `work` with the index of each run's first square and the run's range in the row.
#[inline(always)]
fn for_each_run(start: usize, len: usize, columns: usize, mut work: impl FnMut(usize, Range<usize>)) {
    let mut at = start;
    while at < start + len {
        let end = (at / columns * columns + columns).min(start + len);
        work(at, at - start..end - start);
        at = end;
    }
}

/// G g Gᵀ.
fn transform_kernel(kernel: &[f32; 9]) -> [f32; POSITIONS] {
    let line = |[a, b, c]: [f32; 3]| [a, 0.5 * (a + b + c), 0.5 * (a - b + c), c];
    let rows: [[f32; 4]; 3] = std::array::from_fn(|y| line([kernel[3 * y], kernel[3 * y + 1], kernel[3 * y + 2]]));
    let columns: [[f32; 4]; 4] = std::array::from_fn(|x| line([rows[0][x], rows[1][x], rows[2][x]]));
    std::array::from_fn(|position| columns[position % 4][position / 4])
}

/// Computes d B for one row of the image, `[4, squares]`.
#[inline(always)]
fn transform_row(row: &[f32], padding: usize, out: &mut [f32]) {
    let columns = out.len() / 4;
    let transform = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a - c, b + c, c - b, b - d];
    // The first and last squares extend beyond the border.
    let start = padding.div_ceil(2).min(columns);
    let pairs = row.get(2 * start - padding..).unwrap_or(&[]).as_chunks::<2>().0;
    let inner = start..(start + pairs.len().saturating_sub(1)).min(columns);
    let pixel = |x: usize| x.checked_sub(padding).and_then(|x| row.get(x)).copied().unwrap_or(0.0);
    for x in (0..inner.start).chain(inner.end..columns) {
        let values = transform([pixel(2 * x), pixel(2 * x + 1)], [pixel(2 * x + 2), pixel(2 * x + 3)]);
        (0..4).for_each(|part| out[part * columns + x] = values[part]);
    }
    let (first, rest) = out.split_at_mut(columns);
    let (second, rest) = rest.split_at_mut(columns);
    let (third, fourth) = rest.split_at_mut(columns);
    let parts = first[inner.clone()].iter_mut().zip(&mut second[inner.clone()]);
    let parts = parts.zip(third[inner.clone()].iter_mut().zip(&mut fourth[inner]));
    for (((first, second), (third, fourth)), (left, right)) in
        parts.zip(pairs.iter().zip(pairs.get(1..).unwrap_or(&[])))
    {
        [*first, *second, *third, *fourth] = transform(*left, *right);
    }
}

/// Computes AᵀmA + bias of [`LANES`] squares: two rows of outputs.
#[inline(always)]
fn transform_sums(square: &[[f32; LANES]; POSITIONS], bias: f32) -> [[f32; 2 * LANES]; 2] {
    let mut out = [[0.0; 2 * LANES]; 2];
    for lane in 0..LANES {
        let upper: [f32; 4] = std::array::from_fn(|x| square[x][lane] + square[4 + x][lane] + square[8 + x][lane]);
        let lower: [f32; 4] = std::array::from_fn(|x| square[4 + x][lane] - square[8 + x][lane] - square[12 + x][lane]);
        for (out, [a, b, c, d]) in out.iter_mut().zip([upper, lower]) {
            out[2 * lane] = a + b + c + bias;
            out[2 * lane + 1] = b - c - d + bias;
        }
    }
    out
}

//! Direct convolution: packed weights times columns of the image; threads work on different strips of the image.

use super::ConvolutionShape;
use super::strip::StripLayout;
use crate::Activation;
use crate::gemm::{DEPTH_BLOCK, pack_rows};
use crate::instructions::{Instructions, LANES};
use rayon::prelude::*;
use std::cell::RefCell;

/// Number of columns of a strip computed together: their panels for a block of the inner dimension stay in a core's
/// second-level cache.
const COLUMN_BLOCK: usize = 96;

thread_local! {
    /// Buffers that a thread keeps from one convolution to the next.
    static BUFFERS: RefCell<Buffers> = const { RefCell::new(Buffers { strip: Vec::new(), panels: Vec::new(), sums: Vec::new() }) };
}

struct Buffers {
    strip: Vec<f32>,
    /// Packed pixels.
    panels: Vec<f32>,
    /// `[column panels, rows, columns]`.
    sums: Vec<f32>,
}

/// The parameters of a convolution, packed for the microkernel.
#[derive(Clone, Debug)]
pub(super) struct DirectConvolution {
    shape: ConvolutionShape,
    activation: Activation,
    /// Panels of rows, for one block of the inner dimension (channels, then taps) after another.
    weights: Vec<f32>,
    /// One per row, padded to whole panels.
    bias: Vec<f32>,
    instructions: Instructions,
}

impl DirectConvolution {
    /// Packs `weight` `[outputs, inputs, kernel, kernel]` and `bias` `[outputs]`, row-major. For a doubling shape, the
    /// outputs are the (channel, row, column) of each pixel's output block.
    pub fn new(
        weight: &[f32],
        bias: &[f32],
        shape: ConvolutionShape,
        activation: Activation,
        instructions: Instructions,
    ) -> Self {
        let depth = shape.inputs * shape.kernel * shape.kernel;
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(bias.len().next_multiple_of(instructions.rows()), 0.0);
        let mut weights = Vec::with_capacity(padded_bias.len() * depth);
        for start in (0..depth).step_by(DEPTH_BLOCK) {
            let end = depth.min(start + DEPTH_BLOCK);
            let rows = weight.chunks_exact(depth).map(|row| &row[start..end]);
            pack_rows(rows, bias.len(), end - start, instructions.rows(), &mut weights);
        }
        Self { shape, activation, weights, bias: padded_bias, instructions }
    }

    /// Convolves one image, the concatenation of `images` along channels, to `output` `[outputs, height', width']`.
    /// Writes every value of `output` once.
    pub fn forward(&self, images: &[&[f32]], input: [usize; 2], output: &mut [f32]) {
        let threads = rayon::current_num_threads();
        let layout = StripLayout::new(self.shape, input, threads);
        // With fewer strips than threads, the rows are divided too, into whole panels and whole channels.
        let rows = self.instructions.rows();
        let unit = if self.shape.doubling && !rows.is_multiple_of(4) { 2 * rows } else { rows };
        let units = self.bias.len().div_ceil(unit);
        let shares = threads.div_ceil(layout.strips()).min(units);
        let jobs = self.jobs(&layout, output, units.div_ceil(shares) * unit);
        jobs.into_par_iter().with_max_len(1).for_each(|job| self.run(&layout, images, job));
    }

    /// Divides `output` among jobs.
    fn jobs<'a>(&self, layout: &StripLayout, output: &'a mut [f32], rows: usize) -> Vec<Job<'a>> {
        let scale = self.shape.scale();
        let [height, width] = layout.output;
        let strip_len = scale * scale * layout.rows * width;
        let mut jobs: Vec<Job> = (0..self.bias.len().div_ceil(rows) * layout.strips())
            .map(|index| {
                let first = index % layout.strips() * layout.rows;
                Job {
                    first_row: index / layout.strips() * rows,
                    strip: first..(first + layout.rows).min(height),
                    channels: Vec::with_capacity(rows),
                }
            })
            .collect();
        for (channel, values) in output.chunks_exact_mut(scale * scale * height * width).enumerate() {
            let share = channel * scale * scale / rows;
            for (strip, values) in values.chunks_mut(strip_len).enumerate() {
                jobs[share * layout.strips() + strip].channels.push(values);
            }
        }
        jobs
    }

    fn run(&self, layout: &StripLayout, images: &[&[f32]], mut job: Job) {
        BUFFERS.with_borrow_mut(|Buffers { strip, panels, sums }| {
            if strip.len() < layout.len() {
                strip.resize(layout.len(), 0.0);
            }
            let strip = &mut strip[..layout.len()];
            layout.fill(images, job.strip.clone(), strip);
            let columns = layout.columns(job.strip.len());
            for start in (0..columns).step_by(COLUMN_BLOCK) {
                let block = start..columns.min(start + COLUMN_BLOCK);
                self.sum(layout, strip, block, &job, panels, sums);
                self.instructions.run(
                    #[inline(always)]
                    || self.finish(layout, sums, start, &mut job),
                );
            }
        })
    }

    /// Number of rows of the product that a job computes.
    fn rows(&self, job: &Job) -> usize {
        (job.channels.len() * self.shape.scale().pow(2)).next_multiple_of(self.instructions.rows())
    }

    /// Computes the sums of products of some columns, `[column panels, rows, columns]`.
    fn sum(
        &self,
        layout: &StripLayout,
        strip: &[f32],
        columns: core::ops::Range<usize>,
        job: &Job,
        panels: &mut Vec<f32>,
        sums: &mut Vec<f32>,
    ) {
        let width = self.instructions.columns();
        let rows = self.rows(job);
        sums.clear();
        sums.resize(rows * columns.len().next_multiple_of(width), 0.0);
        let depth = self.weights.len() / self.bias.len();
        for start in (0..depth).step_by(DEPTH_BLOCK) {
            let block = start..depth.min(start + DEPTH_BLOCK);
            panels.clear();
            for column in columns.clone().step_by(width) {
                for inner in block.clone() {
                    let (channel, tap) = (inner / layout.taps.len(), inner % layout.taps.len());
                    let pixels = channel * layout.plane + layout.taps[tap] + column;
                    panels.extend_from_slice(&strip[pixels..pixels + width]);
                }
            }
            let weights = &self.weights[start * self.bias.len() + job.first_row * block.len()..][..rows * block.len()];
            self.instructions.add_product(weights, panels, block.len(), sums);
        }
    }

    /// Adds bias, applies the activation, and writes the sums to the outputs.
    #[inline(always)]
    fn finish(&self, layout: &StripLayout, sums: &mut [f32], start: usize, job: &mut Job) {
        let width = self.instructions.columns();
        let rows = self.rows(job);
        let bias = &self.bias[job.first_row..][..rows];
        for (panel, sums) in sums.chunks_exact_mut(rows * width).enumerate() {
            for (sums, bias) in sums.chunks_exact_mut(width).zip(bias) {
                for lanes in sums.as_chunks_mut::<LANES>().0 {
                    lanes.iter_mut().for_each(|sum| *sum += bias);
                    self.activation.apply(lanes);
                }
            }
            let tile = Tile { column: start + panel * width, values: sums, width };
            match self.shape.scale() {
                1 => write(layout, &tile, &mut job.channels),
                _ => write_doubled(layout, &tile, &mut job.channels),
            }
        }
    }
}

/// Some output rows of some output channels.
struct Job<'a> {
    /// First row of the product.
    first_row: usize,
    /// Output rows, before doubling.
    strip: core::ops::Range<usize>,
    /// Outputs of these rows, one slice per channel.
    channels: Vec<&'a mut [f32]>,
}

/// Finished outputs of all rows of a job, for the columns starting at `column`.
struct Tile<'a> {
    column: usize,
    /// Row-major. In the last tile of a strip, columns beyond the end of the product are meaningless.
    values: &'a [f32],
    /// Number of columns in `values`.
    width: usize,
}

/// Calls `copy` with (output row, output column, position in the tile, length) for each run of columns in the tile that
/// are outputs.
fn for_each_run(layout: &StripLayout, tile: &Tile, rows: usize, mut copy: impl FnMut(usize, usize, usize, usize)) {
    let width = layout.output[1];
    let mut column = tile.column;
    while column < tile.column + tile.width {
        let (y, x) = (column / layout.pitch, column % layout.pitch);
        if y >= rows {
            break;
        }
        let end = tile.column + tile.width - column;
        if x < width {
            copy(y, x, column - tile.column, end.min(width - x));
        }
        column += end.min(layout.pitch - x);
    }
}

/// Copies a tile to the outputs.
fn write(layout: &StripLayout, tile: &Tile, channels: &mut [&mut [f32]]) {
    let width = layout.output[1];
    let rows = channels[0].len() / width;
    for_each_run(layout, tile, rows, |y, x, start, len| {
        for (channel, values) in channels.iter_mut().zip(tile.values.chunks_exact(tile.width)) {
            channel[y * width + x..][..len].copy_from_slice(&values[start..start + len]);
        }
    });
}

/// Like [`write`], for a doubling convolution: four rows form one channel of twice the height and width.
fn write_doubled(layout: &StripLayout, tile: &Tile, channels: &mut [&mut [f32]]) {
    let width = layout.output[1];
    let rows = channels[0].len() / (4 * width);
    for_each_run(layout, tile, rows, |y, x, start, len| {
        let blocks = tile.values.chunks_exact(4 * tile.width);
        for (channel, block) in channels.iter_mut().zip(blocks) {
            for (dy, pair) in block.chunks_exact(2 * tile.width).enumerate() {
                let (left, right) = pair.split_at(tile.width);
                let out = &mut channel[((2 * y + dy) * width + x) * 2..][..2 * len];
                for ((out, left), right) in
                    out.as_chunks_mut::<2>().0.iter_mut().zip(&left[start..]).zip(&right[start..])
                {
                    *out = [*left, *right];
                }
            }
        }
    });
}

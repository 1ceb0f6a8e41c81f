//! Convolution on the CPU: weights packed once, strips of the image shared out among threads.

use super::kernel::{Instructions, PANEL, Product, Tile};
use super::strip::StripLayout;
use super::{Activation, ConvolutionShape};
use rayon::prelude::*;
use std::cell::RefCell;
use std::mem::MaybeUninit;

/// Values of a cache line.
const LINE: usize = 16;

thread_local! {
    /// A thread's strip, kept from one convolution to the next.
    static STRIP: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

/// A convolution's parameters in the order in which the kernel reads them.
#[derive(Clone)]
pub(super) struct PackedConvolution {
    shape: ConvolutionShape,
    activation: Activation,
    /// Panels of [`PANEL`] rows, as [`Product`] wants them; the last is filled up with zeros.
    weights: Vec<f32>,
    bias: Vec<f32>,
    pub instructions: Instructions,
}

impl PackedConvolution {
    /// `weight` `[outputs, inputs, kernel, kernel]`, `bias` `[outputs]`, row-major. For an upsampling shape, rows are
    /// (channel, row, column) of the block of outputs that a pixel becomes.
    pub fn new(weight: &[f32], bias: &[f32], shape: ConvolutionShape, activation: Activation) -> Self {
        let row_len = shape.inputs * shape.kernel * shape.kernel;
        let rows = bias.len().next_multiple_of(PANEL);
        let mut weights = vec![0.0; rows * row_len];
        for (row, values) in weight.chunks_exact(row_len).enumerate() {
            let panel = &mut weights[row / PANEL * PANEL * row_len..][..PANEL * row_len];
            panel.iter_mut().skip(row % PANEL).step_by(PANEL).zip(values).for_each(|(out, value)| *out = *value);
        }
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(rows, 0.0);
        Self { shape, activation, weights, bias: padded_bias, instructions: Instructions::best() }
    }

    /// Convolves one image, whose channels are those of all `images` in order, to `output` `[outputs, height', width']`.
    /// Returns how many values it wrote, which is all of them, each once.
    pub fn forward(&self, images: &[&[f32]], input: [usize; 2], output: &mut [MaybeUninit<f32>]) -> usize {
        let threads = rayon::current_num_threads();
        let layout = StripLayout::new(self.shape, input, threads);
        // If there are fewer strips than threads, the channels are shared out too.
        let panels = self.bias.len() / PANEL;
        let shares = threads.div_ceil(layout.strips()).min(panels);
        let panels_per_job = panels.div_ceil(shares);
        let jobs = self.jobs(&layout, output, panels_per_job);
        jobs.into_par_iter().with_max_len(1).map(|job| self.run(&layout, images, job)).sum()
    }

    /// Cuts `output` into what the jobs write.
    fn jobs<'a>(&self, layout: &StripLayout, output: &'a mut [MaybeUninit<f32>], panels: usize) -> Vec<Job<'a>> {
        let scale = self.shape.scale();
        let [height, width] = layout.output;
        let strip_len = scale * scale * layout.rows * width;
        let mut jobs: Vec<Job> = (0..self.bias.len().div_ceil(panels * PANEL) * layout.strips())
            .map(|index| {
                let first_row = index % layout.strips() * layout.rows;
                Job {
                    first_panel: index / layout.strips() * panels,
                    rows: first_row..(first_row + layout.rows).min(height),
                    channels: Vec::with_capacity(panels * PANEL),
                }
            })
            .collect();
        for (channel, values) in output.chunks_exact_mut(scale * scale * height * width).enumerate() {
            let share = channel * scale * scale / (panels * PANEL);
            for (strip, values) in values.chunks_mut(strip_len).enumerate() {
                jobs[share * layout.strips() + strip].channels.push(values);
            }
        }
        jobs
    }

    fn run(&self, layout: &StripLayout, images: &[&[f32]], mut job: Job) -> usize {
        STRIP.with_borrow_mut(|strip| {
            // From the start of a cache line: a vector then touches one line where taps allow it.
            if strip.len() < layout.len() + LINE {
                strip.resize(layout.len() + LINE, 0.0);
            }
            let start = strip.as_ptr().align_offset(4 * LINE);
            let strip = &mut strip[start..start + layout.len()];
            layout.fill(images, job.rows.clone(), strip);
            let panel_len = self.weights.len() / self.bias.len() * PANEL;
            let panels = (job.channels.len() * self.shape.scale().pow(2)).div_ceil(PANEL);
            let product = Product {
                weights: &self.weights[job.first_panel * panel_len..][..panels * panel_len],
                bias: &self.bias[job.first_panel * PANEL..][..panels * PANEL],
                activation: self.activation,
                strip,
                plane: layout.plane,
                taps: &layout.taps,
                columns: layout.columns(job.rows.len()),
            };
            let mut written = 0;
            match self.shape.scale() {
                1 => self.instructions.run(product, |tile| written += write(layout, &tile, &mut job.channels)),
                _ => self.instructions.run(product, |tile| written += write_doubled(layout, &tile, &mut job.channels)),
            }
            written
        })
    }
}

/// Some rows of some output channels.
struct Job<'a> {
    first_panel: usize,
    rows: core::ops::Range<usize>,
    /// For each channel, the rows' outputs.
    channels: Vec<&'a mut [MaybeUninit<f32>]>,
}

/// Calls `copy` with (output row, output column, position in the tile, length) of each run of the tile's columns that
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

/// Writes a tile to its place in the outputs; returns how many values.
fn write(layout: &StripLayout, tile: &Tile, channels: &mut [&mut [MaybeUninit<f32>]]) -> usize {
    let width = layout.output[1];
    let rows = channels[0].len() / width;
    let mut written = 0;
    for_each_run(layout, tile, rows, |y, x, start, len| {
        for (channel, values) in channels[tile.row..].iter_mut().zip(tile.values.chunks_exact(tile.width)).take(PANEL) {
            channel[y * width + x..][..len].write_copy_of_slice(&values[start..start + len]);
            written += len;
        }
    });
    written
}

/// As [`write`], of an upsampling convolution: four rows make one channel of twice the size.
fn write_doubled(layout: &StripLayout, tile: &Tile, channels: &mut [&mut [MaybeUninit<f32>]]) -> usize {
    let width = layout.output[1];
    let rows = channels[0].len() / (4 * width);
    let mut written = 0;
    for_each_run(layout, tile, rows, |y, x, start, len| {
        let blocks = tile.values.chunks_exact(4 * tile.width);
        for (channel, block) in channels[tile.row / 4..].iter_mut().zip(blocks).take(PANEL / 4) {
            for (dy, pair) in block.chunks_exact(2 * tile.width).enumerate() {
                let (left, right) = pair.split_at(tile.width);
                let out = &mut channel[((2 * y + dy) * width + x) * 2..][..2 * len];
                for ((out, left), right) in
                    out.as_chunks_mut::<2>().0.iter_mut().zip(&left[start..]).zip(&right[start..])
                {
                    *out = [MaybeUninit::new(*left), MaybeUninit::new(*right)];
                }
                written += 2 * len;
            }
        }
    });
    written
}

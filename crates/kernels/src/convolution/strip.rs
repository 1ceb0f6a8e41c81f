//! Strips: rows of the input, laid out so that every kernel tap is a constant offset.

use super::ConvolutionShape;

/// Maximum number of columns of a tile.
pub(super) const MAX_TILE_COLUMNS: usize = 32;

/// Maximum length of a strip, unless a single row of outputs needs more: 1 MiB, half of a typical second-level cache.
const STRIP_LEN: usize = 1 << 18;

/// Layout of a strip of an image. The padded input is split into phases, one for each pair of row and column remainders
/// modulo the stride; neighbours in a phase are inputs of neighbouring outputs. Rows of a phase are `pitch` apart, so
/// output (y, x) is column y · `pitch` + x, and each kernel tap is a constant offset from there. If `pitch` exceeds the
/// output's width, the columns in between are computed and discarded.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StripLayout {
    shape: ConvolutionShape,
    pub input: [usize; 2],
    pub output: [usize; 2],
    pub pitch: usize,
    /// Output rows per strip; the last strip of an image may have fewer.
    pub rows: usize,
    /// Length of a phase.
    phase: usize,
    /// Length of a channel.
    pub plane: usize,
    /// Offset of each kernel tap, row-major.
    pub taps: Vec<usize>,
}

impl StripLayout {
    /// Lays out images of height and width `input`. If one strip cannot hold the whole image, the number of strips is a
    /// multiple of `threads`, but at most one per output row.
    pub fn new(shape: ConvolutionShape, input: [usize; 2], threads: usize) -> Self {
        let output = shape.product_size(input);
        let reach = (shape.kernel - 1) / shape.stride;
        // With stride 1, the right padding of a row is also the left padding of the next row.
        let pitch = if shape.stride == 1 { input[1] + shape.padding } else { output[1] + reach };
        let phases = shape.stride.min(shape.kernel);
        let row_len = shape.inputs * phases * phases * pitch;
        let fitting = (STRIP_LEN / row_len).saturating_sub(reach).clamp(1, output[0].max(1));
        let strips = output[0].div_ceil(fitting);
        let strips = if strips > 1 { strips.next_multiple_of(threads).min(output[0]) } else { 1 };
        let rows = output[0].div_ceil(strips);
        let phase = (rows + reach) * pitch + shape.padding;
        // An odd number of cache lines: planes a power of two apart would compete for few cache sets.
        let lines = (phases * phases * phase + MAX_TILE_COLUMNS).div_ceil(16) | 1;
        let tap = |y: usize, x: usize| {
            let (phase_y, phase_x) = (y % shape.stride, x % shape.stride);
            (phase_y * phases + phase_x) * phase + y / shape.stride * pitch + x / shape.stride
        };
        let taps =
            (0..shape.kernel * shape.kernel).map(|tap_index| tap(tap_index / shape.kernel, tap_index % shape.kernel));
        Self { shape, input, output, pitch, rows, phase, plane: 16 * lines, taps: taps.collect() }
    }

    /// Number of strips per image.
    pub fn strips(&self) -> usize {
        self.output[0].div_ceil(self.rows)
    }

    /// Number of columns from the first to the last output of `rows` rows.
    pub fn columns(&self, rows: usize) -> usize {
        (rows - 1) * self.pitch + self.output[1]
    }

    /// Length of a strip.
    pub fn len(&self) -> usize {
        self.shape.inputs * self.plane
    }

    /// Fills `strip` with the input that output rows `rows` need from `images`, concatenated along channels. Each image
    /// holds whole channels, row-major.
    pub fn fill(&self, images: &[&[f32]], rows: core::ops::Range<usize>, strip: &mut [f32]) {
        let channels = images.iter().flat_map(|image| image.chunks_exact(self.input[0] * self.input[1]));
        for (plane, channel) in strip.chunks_exact_mut(self.plane).zip(channels) {
            if self.shape.kernel == 1 && self.shape.stride == 1 && self.shape.padding == 0 {
                let values = &channel[rows.start * self.pitch..rows.end * self.pitch];
                plane[..values.len()].copy_from_slice(values);
                continue;
            }
            let phases = self.shape.stride.min(self.shape.kernel);
            for (phase, part) in plane.chunks_exact_mut(self.phase).take(phases * phases).enumerate() {
                self.fill_phase(channel, [phase / phases, phase % phases], rows.clone(), part);
            }
        }
    }

    fn fill_phase(
        &self,
        channel: &[f32],
        [phase_y, phase_x]: [usize; 2],
        rows: core::ops::Range<usize>,
        part: &mut [f32],
    ) {
        let ConvolutionShape { kernel, stride, padding, .. } = self.shape;
        let [height, width] = self.input;
        // First column of the phase that is not padding: its index in the row (`left`) and in the input (`first`).
        let left = padding.saturating_sub(phase_x).div_ceil(stride);
        let first = left * stride + phase_x - padding;
        let len = width.saturating_sub(first).div_ceil(stride).min(self.pitch - left);
        let (part, right) = part.split_at_mut(part.len() - padding);
        right.fill(0.0);
        for (y, row) in part.chunks_exact_mut(self.pitch).take(rows.len() + (kernel - 1) / stride).enumerate() {
            let source = (stride * (rows.start + y) + phase_y).checked_sub(padding).filter(|source| *source < height);
            let Some(source) = source else {
                row.fill(0.0);
                continue;
            };
            let source = &channel[source * width + first.min(width)..(source + 1) * width];
            row[..left].fill(0.0);
            row[left + len..].fill(0.0);
            let row = &mut row[left..left + len];
            match stride {
                1 => row.copy_from_slice(&source[..len]),
                2 => row.iter_mut().zip(source.iter().step_by(2)).for_each(|(out, value)| *out = *value),
                _ => row.iter_mut().zip(source.iter().step_by(stride)).for_each(|(out, value)| *out = *value),
            }
        }
    }
}

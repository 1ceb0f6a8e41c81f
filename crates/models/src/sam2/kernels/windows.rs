//! Attention within square windows of a map.

use super::attention::{Rows, Scratch, attend};
use rayon::prelude::*;

/// The maps that [`window_attention`] works on.
#[derive(Clone, Copy, Debug)]
pub struct WindowShape {
    /// Rows of the key map, in tokens.
    pub height: usize,
    /// Columns of the key map.
    pub width: usize,
    /// Side of a key window.
    pub window: usize,
    /// Key tokens per query token along a side: 2 where queries are pooled, else 1.
    pub pooling: usize,
    /// Heads, side by side in the channels.
    pub heads: usize,
    /// Channels of queries, keys and values each.
    pub channels: usize,
    /// Elements from query to query.
    pub query_stride: usize,
}

/// Attention where queries see the keys of their own window only.
///
/// `queries` is `[height / pooling, width / pooling, query_stride]`, of which the first channels count; `qkv` is `[height, width, 3 · channels]`. Windows that
/// reach over the right or lower border are filled up with tokens whose keys and values are `padding`'s (`[3 · channels]`,
/// the projection of a zero token): they take part in the softmax, as in the official code.
pub fn window_attention(queries: &[f32], qkv: &[f32], padding: &[f32], shape: WindowShape) -> Vec<f32> {
    let WindowShape { height, width, window, pooling, channels, .. } = shape;
    let (rows, columns) = (height.div_ceil(window), width.div_ceil(window));
    let results: Vec<Vec<f32>> = (0..rows * columns)
        .into_par_iter()
        .map_init(
            || (Scratch::new(), WindowBuffers::default()),
            |(scratch, buffers), index| {
                buffers.attend(queries, qkv, padding, shape, (index / columns, index % columns), scratch)
            },
        )
        .collect();

    let (out_width, out_window) = (width / pooling, window / pooling);
    let mut out = vec![0f32; (height / pooling) * out_width * channels];
    out.par_chunks_mut(out_width * channels).enumerate().for_each(|(row, out)| {
        for (column, out) in out.chunks_mut(out_window * channels).enumerate() {
            let result = &results[row / out_window * columns + column];
            let start = row % out_window * out.len();
            out.copy_from_slice(&result[start..start + out.len()]);
        }
    });
    out
}

/// Contiguous copies of one head's rows.
#[derive(Default)]
struct WindowBuffers {
    queries: Vec<f32>,
    keys: Vec<f32>,
    values: Vec<f32>,
}

impl WindowBuffers {
    /// The results of one window's queries inside the map, row-major.
    fn attend(
        &mut self,
        queries: &[f32],
        qkv: &[f32],
        padding: &[f32],
        shape: WindowShape,
        (row, column): (usize, usize),
        scratch: &mut Scratch,
    ) -> Vec<f32> {
        let WindowShape { height, width, window, pooling, heads, channels, query_stride } = shape;
        let (top, left) = (row * window / pooling, column * window / pooling);
        let query_rows = (window / pooling).min(height / pooling - top);
        let query_columns = (window / pooling).min(width / pooling - left);
        let head_width = channels / heads;
        let mut out = vec![0f32; query_rows * query_columns * channels];
        for head in 0..heads {
            let at = head * head_width;
            self.queries.clear();
            for y in top..top + query_rows {
                for x in left..left + query_columns {
                    let start = (y * (width / pooling) + x) * query_stride + at;
                    self.queries.extend_from_slice(&queries[start..start + head_width]);
                }
            }
            self.keys.clear();
            self.values.clear();
            for y in row * window..(row + 1) * window {
                for x in column * window..(column + 1) * window {
                    let inside = y < height && x < width;
                    let token = if inside { &qkv[(y * width + x) * 3 * channels..] } else { padding };
                    self.keys.extend_from_slice(&token[channels + at..][..head_width]);
                    self.values.extend_from_slice(&token[2 * channels + at..][..head_width]);
                }
            }
            let rows = |data, count| Rows { data, count, width: head_width, stride: head_width };
            attend(
                rows(&self.queries, query_rows * query_columns),
                rows(&self.keys, window * window),
                rows(&self.values, window * window),
                &mut out[at..],
                channels,
                scratch,
            );
        }
        out
    }
}

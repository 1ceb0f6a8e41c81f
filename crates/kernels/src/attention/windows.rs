//! Attention within square windows of a map, and pooling of its queries (Hiera).

use super::softmax_attention::{PackedKeysAndValues, Scratch, attend};
use rayon::prelude::*;

/// Sizes of the maps for [`window_attention`].
#[derive(Clone, Copy, Debug)]
pub struct WindowShape {
    /// Rows of the key map, in tokens.
    pub height: usize,
    /// Columns of the key map.
    pub width: usize,
    /// Side of a key window.
    pub window: usize,
    /// Key tokens per query token along each axis: 2 if queries are pooled, else 1.
    pub pooling: usize,
    /// Number of heads, side by side in the channels.
    pub heads: usize,
    /// Channels of each of queries, keys and values.
    pub channels: usize,
    /// Distance between queries, in elements.
    pub query_stride: usize,
}

/// Attention in which queries attend only to the keys of their own window.
///
/// `queries` is `[height / pooling, width / pooling, query_stride]`, of which the first `channels` elements are used;
/// `qkv` is `[height, width, 3 · channels]`. Windows that extend beyond the right or lower border are padded with
/// tokens that have the keys and values of `padding` (`[3 · channels]`, the projection of a zero token). As in the
/// official code, these take part in the softmax.
pub fn window_attention(queries: &[f32], qkv: &[f32], padding: &[f32], shape: WindowShape) -> Vec<f32> {
    let WindowShape { height, width, window, pooling, channels, .. } = shape;
    let (rows, columns) = (height.div_ceil(window), width.div_ceil(window));
    let results: Vec<Vec<f32>> = (0..rows * columns)
        .into_par_iter()
        .map_init(
            || (Scratch::new(), PackedKeysAndValues::default()),
            |(scratch, memory), index| {
                attend_in_window([queries, qkv, padding], shape, (index / columns, index % columns), memory, scratch)
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

/// Returns the results of one window's queries that lie inside the map, row-major.
fn attend_in_window(
    [queries, qkv, padding]: [&[f32]; 3],
    shape: WindowShape,
    (row, column): (usize, usize),
    memory: &mut PackedKeysAndValues,
    scratch: &mut Scratch,
) -> Vec<f32> {
    let WindowShape { height, width, window, pooling, heads, channels, query_stride } = shape;
    let (top, left) = (row * window / pooling, column * window / pooling);
    let query_rows = (window / pooling).min(height / pooling - top);
    let query_columns = (window / pooling).min(width / pooling - left);
    let head_width = channels / heads;
    let mut out = vec![0f32; query_rows * query_columns * channels];
    let token = |index: usize| {
        let (y, x) = (row * window + index / window, column * window + index % window);
        if y < height && x < width { &qkv[(y * width + x) * 3 * channels..][..3 * channels] } else { padding }
    };
    let query = |index: usize| {
        let (y, x) = (top + index / query_columns, left + index % query_columns);
        &queries[(y * (width / pooling) + x) * query_stride..][..channels]
    };
    for head in 0..heads {
        let at = head * head_width..(head + 1) * head_width;
        let part = |from: usize| channels * from + at.start..channels * from + at.end;
        let (keys, values) = (part(1), part(2));
        let key = |index: usize| &token(index)[keys.clone()];
        memory.pack(scratch.instructions, window * window, key, |index| &token(index)[values.clone()]);
        let query = |index: usize| &query(index)[at.clone()];
        attend(memory, None, query_rows * query_columns, query, &mut out[at.start..], channels, scratch);
    }
    out
}

/// 2×2 max pooling of the first `channels` elements of each token: `[height, width, stride]` to
/// `[height / 2, width / 2, channels]`.
pub fn max_pool(map: &[f32], (height, width): (usize, usize), stride: usize, channels: usize) -> Vec<f32> {
    let out_width = width / 2;
    let mut out = vec![0f32; height / 2 * out_width * channels];
    out.par_chunks_mut(out_width * channels).enumerate().for_each(|(row, out)| {
        for (column, out) in out.chunks_mut(channels).enumerate() {
            let token = |y: usize, x: usize| &map[((2 * row + y) * width + 2 * column + x) * stride..][..channels];
            let upper = token(0, 0).iter().zip(token(0, 1));
            let lower = token(1, 0).iter().zip(token(1, 1));
            for ((out, (a, b)), (c, d)) in out.iter_mut().zip(upper).zip(lower) {
                *out = a.max(*b).max(c.max(*d));
            }
        }
    });
    out
}

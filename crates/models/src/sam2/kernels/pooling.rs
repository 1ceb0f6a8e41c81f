//! Pooling of channels-last maps.

use rayon::prelude::*;

/// The largest of every 2×2 tokens: the first `channels` of each `stride` elements of a `[height, width, stride]` map to
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

//! Attention within texts: a token sees itself and those before it.

use rayon::prelude::*;
use splatseg_kernels::Instructions;
use splatseg_kernels::exp::exp;
use std::ops::Range;

/// Attention of every token to itself and the tokens before it in its text. `rows` is `[n, 3 · width]`; `texts` are the
/// rows of each text, one after another. Returns `[n, width]`.
///
/// Texts have few tokens, so this takes a small share of the time, and plain loops are fast enough.
pub(super) fn causal_attention(rows: &[f32], width: usize, heads: usize, texts: &[Range<usize>]) -> Vec<f32> {
    let attended = texts.par_iter().map(|text| {
        let rows = &rows[text.start * 3 * width..text.end * 3 * width];
        let mut out = vec![0.0; text.len() * width];
        Instructions::best().run(
            #[inline(always)]
            || attend_in_text(rows, width, heads, &mut out),
        );
        out
    });
    attended.collect::<Vec<_>>().concat()
}

/// [`causal_attention`] of one text.
#[inline(always)]
fn attend_in_text(rows: &[f32], width: usize, heads: usize, out: &mut [f32]) {
    let head_width = width / heads;
    let scale = 1.0 / (head_width as f32).sqrt();
    let mut scores = Vec::new();
    for (token, out) in out.chunks_exact_mut(width).enumerate() {
        for (head, out) in out.chunks_exact_mut(head_width).enumerate() {
            let row = |part: usize, token: usize| &rows[(token * 3 + part) * width + head * head_width..][..head_width];
            scores.clear();
            scores.extend((0..=token).map(|key| dot(row(0, token), row(1, key)) * scale));
            let largest = scores.iter().fold(f32::NEG_INFINITY, |largest, score| largest.max(*score));
            let mut sum = 0.0;
            for (key, score) in scores.iter().enumerate() {
                let weight = exp((score - largest).max(-87.0));
                sum += weight;
                out.iter_mut().zip(row(2, key)).for_each(|(out, value)| *out += weight * value);
            }
            out.iter_mut().for_each(|out| *out /= sum);
        }
    }
}

/// The inner product of two vectors, in lanes.
#[inline(always)]
fn dot(one: &[f32], other: &[f32]) -> f32 {
    let ((ones, one_rest), (others, other_rest)) = (one.as_chunks::<8>(), other.as_chunks::<8>());
    let mut lanes = [0.0; 8];
    for (one, other) in ones.iter().zip(others) {
        (0..8).for_each(|lane| lanes[lane] += one[lane] * other[lane]);
    }
    lanes.iter().sum::<f32>() + one_rest.iter().zip(other_rest).map(|(one, other)| one * other).sum::<f32>()
}

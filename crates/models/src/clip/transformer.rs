//! The blocks that both towers are made of: attention and two linear layers, each after a layer norm and added to its
//! input.

use rayon::prelude::*;
use splatseg_kernels::attention::{HeadRows, multi_head_attention};
use splatseg_kernels::exp::exp;
use splatseg_kernels::gemm::{LinearChain, PackedLinear};
use splatseg_kernels::layer_norm::LayerNorm;
use splatseg_kernels::{Activation, Instructions};
use std::ops::Range;

/// ε of every layer norm.
const EPSILON: f32 = 1e-5;

/// Scale and offset of a layer norm.
#[derive(Clone, Debug)]
pub(super) struct Norm {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

impl Norm {
    pub fn layer(&self) -> LayerNorm<'_> {
        LayerNorm { weight: &self.weight, bias: &self.bias, epsilon: EPSILON }
    }
}

/// One block.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub norm1: Norm,
    pub query_key_value: PackedLinear,
    pub output: PackedLinear,
    pub norm2: Norm,
    pub widen: PackedLinear,
    pub narrow: PackedLinear,
    pub activation: Activation,
    pub heads: usize,
}

impl Block {
    /// Queries, keys and values of `tokens` `[n, width]`: `[n, 3 · width]`.
    pub fn query_key_value(&self, tokens: &[f32]) -> Vec<f32> {
        let layers = [(&self.query_key_value, Activation::None)];
        LinearChain { norm: Some(self.norm1.layer()), layers: &layers }.forward(tokens, None)
    }

    /// The block after its attention: `attended` `[n, width]` is added to the tokens, through a layer, and then the
    /// linear layers' result.
    pub fn finish(&self, tokens: &[f32], attended: &[f32]) -> Vec<f32> {
        let tokens =
            LinearChain { norm: None, layers: &[(&self.output, Activation::None)] }.forward(attended, Some(tokens));
        let layers = [(&self.widen, self.activation), (&self.narrow, Activation::None)];
        LinearChain { norm: Some(self.norm2.layer()), layers: &layers }.forward(&tokens, Some(&tokens))
    }
}

/// Attention of every token to all tokens of its image. `rows` is `[images, count, 3 · width]`; returns
/// `[images, count, width]`.
pub(super) fn full_attention(rows: &[f32], [count, width]: [usize; 2], heads: usize) -> Vec<f32> {
    let problems: Vec<[HeadRows<'_>; 3]> = rows
        .chunks_exact(count * 3 * width)
        .map(|image| {
            [0, width, 2 * width].map(|start| HeadRows {
                data: &image[start..],
                count,
                width: width / heads,
                stride: 3 * width,
            })
        })
        .collect();
    multi_head_attention(&problems, heads, None)
}

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

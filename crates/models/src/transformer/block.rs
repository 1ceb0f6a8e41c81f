//! The blocks that transformers are made of: attention and two linear layers, each after a layer norm and added to its
//! input.

use splatseg_kernels::Activation;
use splatseg_kernels::attention::{HeadRows, multi_head_attention};
use splatseg_kernels::gemm::{LinearChain, PackedLinear};
use splatseg_kernels::layer_norm::LayerNorm;

/// A layer norm.
#[derive(Clone, Debug)]
pub(crate) struct Norm {
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
    /// Added to the variance.
    pub epsilon: f32,
}

impl Norm {
    pub fn layer(&self) -> LayerNorm<'_> {
        LayerNorm { weight: &self.weight, bias: &self.bias, epsilon: self.epsilon }
    }
}

/// One block.
#[derive(Clone, Debug)]
pub(crate) struct Block {
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
pub(crate) fn full_attention(rows: &[f32], [count, width]: [usize; 2], heads: usize) -> Vec<f32> {
    multi_head_attention(&problems(rows, [count, width], heads, 0), heads, None)
}

/// [`full_attention`] of one head: `[images, count, width / heads]`.
pub(crate) fn head_attention(rows: &[f32], [count, width]: [usize; 2], heads: usize, head: usize) -> Vec<f32> {
    multi_head_attention(&problems(rows, [count, width], heads, head), 1, None)
}

/// Queries, keys and values of each image, from a head on.
fn problems(rows: &[f32], [count, width]: [usize; 2], heads: usize, first: usize) -> Vec<[HeadRows<'_>; 3]> {
    let head_width = width / heads;
    rows.chunks_exact(count * 3 * width)
        .map(|image| {
            [0, width, 2 * width].map(|start| HeadRows {
                data: &image[start + first * head_width..],
                count,
                width: head_width,
                stride: 3 * width,
            })
        })
        .collect()
}

//! Attention pooling of a Perception Encoder: one learned query attends to all tokens of the image.

use super::ClipError;
use super::pacing::{Pace, part};
use crate::transformer::{LayerReader, Norm};
use splatseg_kernels::Activation;
use splatseg_kernels::attention::{HeadRows, multi_head_attention};
use splatseg_kernels::gemm::{LinearChain, PackedLinear};

#[derive(Clone, Debug)]
pub(super) struct AttentionPooling {
    /// The query, after its layer.
    query: Vec<f32>,
    key_value: PackedLinear,
    output: PackedLinear,
    norm: Norm,
    widen: PackedLinear,
    narrow: PackedLinear,
    heads: usize,
}

impl AttentionPooling {
    pub fn load(reader: LayerReader<'_>, prefix: &str, width: usize, heads: usize) -> Result<Self, ClipError> {
        let name = |part: &str| format!("{prefix}{part}");
        let latent = reader.tensor(&name("latent"), &[1, 1, width])?;
        Ok(Self {
            query: reader.linear(&name("q"), [width, width])?.forward(&latent),
            key_value: reader.linear(&name("kv"), [width, 2 * width])?,
            output: reader.linear(&name("proj"), [width, width])?,
            norm: reader.norm(&name("norm"), width)?,
            widen: reader.linear(&name("mlp.fc1"), [width, 4 * width])?,
            narrow: reader.linear(&name("mlp.fc2"), [4 * width, width])?,
            heads,
        })
    }

    /// `tokens` `[images, count, width]` to `[images, width]`.
    pub fn forward(&self, tokens: &[f32], count: usize, pace: Pace<'_>) -> Vec<f32> {
        let width = self.query.len();
        let shape = [tokens.len() / width, width];
        let rows = pace.rows(shape, |range| self.key_value.forward(part(tokens, width, range)));
        pace.wait();
        let head_rows = |data, count, stride| HeadRows { data, count, width: width / self.heads, stride };
        let problems: Vec<[HeadRows<'_>; 3]> = rows
            .chunks_exact(count * 2 * width)
            .map(|image| {
                let (keys, values) = (image, &image[width..]);
                [
                    head_rows(&self.query, 1, width),
                    head_rows(keys, count, 2 * width),
                    head_rows(values, count, 2 * width),
                ]
            })
            .collect();
        let pooled = self.output.forward(&multi_head_attention(&problems, self.heads, None));
        let layers = [(&self.widen, Activation::Gelu), (&self.narrow, Activation::None)];
        LinearChain { norm: Some(self.norm.layer()), layers: &layers }.forward(&pooled, Some(&pooled))
    }
}

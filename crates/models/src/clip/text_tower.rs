//! The text tower: a transformer in which a token attends to those before it. The last token is the text's vector.

use super::causal_attention::causal_attention;
use super::image_tower::open_clip_projection;
use super::layout::{self, ClipLayout};
use super::pacing::{Pace, part};
use super::{ClipConfig, ClipError, ClipTokenizer};
use crate::transformer::{Block, LayerReader, Norm};
use splatseg_kernels::gemm::PackedLinear;
use std::ops::Range;

#[derive(Clone, Debug)]
pub(super) struct TextTower {
    /// `[ClipTokenizer::TOKENS, width]`.
    tokens: Vec<f32>,
    /// `[context, width]`.
    positions: Vec<f32>,
    blocks: Vec<Block>,
    norm: Norm,
    projection: PackedLinear,
    width: usize,
}

impl TextTower {
    pub fn load(reader: LayerReader<'_>, config: &ClipConfig) -> Result<Self, ClipError> {
        let prefix = config.layout.text_prefix(reader.checkpoint);
        let (width, context) = (config.text.width, config.context);
        let name = |part: &str| format!("{prefix}{part}");
        let tokens_shape = [ClipTokenizer::TOKENS, width];
        let dims = [width, config.embedding];
        let (tokens, positions, blocks, norm, projection) = match config.layout {
            ClipLayout::HuggingFace => (
                reader.tensor(&name("embeddings.token_embedding.weight"), &tokens_shape)?,
                reader.tensor(&name("embeddings.position_embedding.weight"), &[context, width])?,
                layout::hugging_face_blocks(prefix),
                reader.norm(&name("final_layer_norm"), width)?,
                reader.linear_of("text_projection.weight", None, dims)?,
            ),
            ClipLayout::OpenClip | ClipLayout::PerceptionEncoder => (
                reader.tensor(&name("token_embedding.weight"), &tokens_shape)?,
                reader.tensor(&name("positional_embedding"), &[context, width])?,
                layout::open_clip_blocks(prefix),
                reader.norm(&name("ln_final"), width)?,
                open_clip_projection(reader, &name("text_projection"), dims)?,
            ),
        };
        Ok(Self { tokens, positions, blocks: reader.blocks(&blocks, &config.text)?, norm, projection, width })
    }

    /// Token ids of texts, each with start and end and at most the context long, to `[texts, embedding]`, not
    /// normalised. What would follow the end is left out: no token before it sees it.
    pub fn forward(&self, texts: &[Vec<u32>], pace: Pace<'_>) -> Vec<f32> {
        let width = self.width;
        let mut ranges: Vec<Range<usize>> = Vec::with_capacity(texts.len());
        let mut tokens = Vec::new();
        for text in texts {
            let start = ranges.last().map_or(0, |range| range.end);
            ranges.push(start..start + text.len());
            for (token, positions) in text.iter().zip(self.positions.chunks_exact(width)) {
                let embedding = &self.tokens[*token as usize * width..][..width];
                tokens.extend(embedding.iter().zip(positions).map(|(value, position)| value + position));
            }
        }
        let shape = [tokens.len() / width, width];
        for block in &self.blocks {
            let rows = pace.rows(shape, |range| block.query_key_value(part(&tokens, width, range)));
            let attended = causal_attention(&rows, width, block.heads, &ranges);
            tokens = pace
                .rows(shape, |range| block.finish(part(&tokens, width, range.clone()), part(&attended, width, range)));
        }
        pace.wait();
        let last = ranges.iter().map(|range| &tokens[(range.end - 1) * width..range.end * width]);
        let mut last: Vec<f32> = last.flatten().copied().collect();
        self.norm.layer().apply(&mut last);
        self.projection.forward(&last)
    }
}

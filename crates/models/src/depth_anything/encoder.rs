//! The encoder: a vision transformer with a token for the class (DINOv2, without registers).

use super::resize::{interpolate, plain_taps};
use super::{DepthAnythingConfig, DepthAnythingError};
use crate::transformer::{Block, LayerReader, Norm, full_attention};
use splatseg_kernels::Instructions;
use splatseg_kernels::gemm::PackedLinear;

#[derive(Clone, Debug)]
pub(super) struct Encoder {
    /// From patches `[patch, patch, 3]`.
    patches: PackedLinear,
    /// With its position.
    class: Vec<f32>,
    /// Of the patches, `[grid, grid, width]`.
    positions: Vec<f32>,
    blocks: Vec<Block>,
    norm: Norm,
}

impl Encoder {
    pub fn load(reader: LayerReader<'_>, config: &DepthAnythingConfig) -> Result<Self, DepthAnythingError> {
        let names = config.layout.encoder();
        let (width, patch) = (config.encoder.width, config.patch);
        let weight = reader.tensor(&format!("{}.weight", names.patches), &[width, 3, patch, patch])?;
        let bias = reader.tensor(&format!("{}.bias", names.patches), &[width])?;
        let element = |index: usize| {
            let (pixel, channel, output) = (index / (3 * width), index / width % 3, index % width);
            weight[(output * 3 + channel) * patch * patch + pixel]
        };
        let patches: Vec<f32> = (0..weight.len()).map(element).collect();
        let count = config.grid * config.grid + 1;
        let mut positions = reader.tensor(names.positions, &[1, count, width])?;
        let mut class = reader.tensor(names.class, &[1, 1, width])?;
        class.iter_mut().zip(positions.drain(..width)).for_each(|(value, position)| *value += position);
        Ok(Self {
            patches: PackedLinear::new(&patches, &bias, Instructions::best()),
            class,
            positions,
            blocks: reader.blocks(&config.layout.blocks(reader.checkpoint), &config.encoder)?,
            norm: reader.norm(names.norm, width)?,
        })
    }

    /// Normalised pixels `[rows · patch, columns · patch, 3]` to the tokens of the patches after four blocks,
    /// `[rows, columns, width]` each, after the last norm.
    pub fn forward(&self, pixels: &[f32], grid: [usize; 2], config: &DepthAnythingConfig) -> [Vec<f32>; 4] {
        let width = self.class.len();
        let mut tokens = self.tokens(pixels, grid, config);
        let count = tokens.len() / width;
        let mut found = [const { Vec::new() }; 4];
        let mut taps = config.taps.iter().zip(&mut found).peekable();
        for (number, block) in self.blocks.iter().enumerate() {
            let attended = full_attention(&block.query_key_value(&tokens), [count, width], block.heads);
            tokens = block.finish(&tokens, &attended);
            if let Some((_, out)) = taps.next_if(|(tap, _)| **tap == number + 1) {
                *out = tokens[width..].to_vec();
                self.norm.layer().apply_parallel(out);
            }
            if taps.peek().is_none() {
                break;
            }
        }
        found
    }

    /// The class token and the patches, with their positions: `[1 + rows · columns, width]`.
    fn tokens(&self, pixels: &[f32], [rows, columns]: [usize; 2], config: &DepthAnythingConfig) -> Vec<f32> {
        let line = 3 * config.patch;
        let mut patches = Vec::with_capacity(pixels.len());
        for row in 0..rows {
            for column in 0..columns {
                for y in row * config.patch..(row + 1) * config.patch {
                    patches.extend_from_slice(&pixels[(y * columns + column) * line..][..line]);
                }
            }
        }
        let positions = self.positions_of([rows, columns], config);
        let embedded = self.patches.forward(&patches);
        let mut tokens = self.class.clone();
        tokens.extend(embedded.iter().zip(&positions).map(|(value, position)| value + position));
        tokens
    }

    /// Position embeddings of a grid of patches, `[rows, columns, width]`.
    fn positions_of(&self, [rows, columns]: [usize; 2], config: &DepthAnythingConfig) -> Vec<f32> {
        let grid = config.grid;
        if [rows, columns] == [grid, grid] {
            return self.positions.clone();
        }
        let taps =
            |count: usize| plain_taps(grid, count, (count as f64 + config.layout.position_offset()) / grid as f64);
        interpolate(&self.positions, grid, self.class.len(), &taps(columns), &taps(rows))
    }
}

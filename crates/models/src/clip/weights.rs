//! Reads layers of a CLIP checkpoint.

use super::layout::{BlockNames, QueryKeyValue};
use super::transformer::{Block, Norm};
use super::{ClipError, TowerConfig};
use crate::checkpoint::Checkpoint;
use splatseg_kernels::Instructions;
use splatseg_kernels::gemm::PackedLinear;

/// Maximum ratio of the hidden channels of a block to its width; 4 in every published network.
const MAX_MLP_RATIO: usize = 8;

/// Reads layers by their names.
#[derive(Clone, Copy)]
pub(super) struct LayerReader<'a>(pub &'a Checkpoint);

impl LayerReader<'_> {
    /// A tensor of this shape.
    pub fn tensor(self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ClipError> {
        Ok(self.0.read_f32(name, shape)?)
    }

    /// The layer norm `name.weight`, `name.bias`.
    pub fn norm(self, name: &str, width: usize) -> Result<Norm, ClipError> {
        let read = |part: &str| self.tensor(&format!("{name}.{part}"), &[width]);
        Ok(Norm { weight: read("weight")?, bias: read("bias")? })
    }

    /// The linear layer `name.weight` `[outputs, inputs]`, `name.bias`.
    pub fn linear(self, name: &str, [inputs, outputs]: [usize; 2]) -> Result<PackedLinear, ClipError> {
        self.linear_of(&format!("{name}.weight"), Some(&format!("{name}.bias")), [inputs, outputs])
    }

    /// A linear layer whose weight is `[outputs, inputs]`, by the names of its tensors. Without a bias it is 0.
    pub fn linear_of(
        self,
        weight: &str,
        bias: Option<&str>,
        [inputs, outputs]: [usize; 2],
    ) -> Result<PackedLinear, ClipError> {
        let weight = self.tensor(weight, &[outputs, inputs])?;
        let bias = bias.map_or_else(|| Ok(vec![0.0; outputs]), |bias| self.tensor(bias, &[outputs]))?;
        Ok(packed(&weight, &bias, [inputs, outputs]))
    }

    /// The block of a transformer with this number.
    pub fn block(self, names: &BlockNames, number: usize, tower: &TowerConfig) -> Result<Block, ClipError> {
        let name = |part: &str| format!("{}{number}.{part}", names.blocks);
        let width = tower.width;
        let hidden_name = format!("{}.weight", name(names.mlp[0]));
        let hidden = self.0.info(&hidden_name).and_then(|info| info.shape().first().copied()).unwrap_or_default();
        if !(1..=MAX_MLP_RATIO * width).contains(&hidden) {
            return Err(ClipError::Size {
                path: self.0.path().to_owned(),
                what: hidden_name,
                found: format!("{hidden} outputs"),
                expected: format!("1 to {}", MAX_MLP_RATIO * width),
            });
        }
        let query_key_value = match names.query_key_value {
            QueryKeyValue::Fused(weight, bias) => {
                self.linear_of(&name(weight), Some(&name(bias)), [width, 3 * width])?
            }
            QueryKeyValue::Separate(layers) => {
                let (mut weights, mut biases) = (Vec::new(), Vec::new());
                for layer in layers {
                    weights.extend(self.tensor(&format!("{}.weight", name(layer)), &[width, width])?);
                    biases.extend(self.tensor(&format!("{}.bias", name(layer)), &[width])?);
                }
                packed(&weights, &biases, [width, 3 * width])
            }
        };
        Ok(Block {
            norm1: self.norm(&name(names.norms[0]), width)?,
            query_key_value,
            output: self.linear(&name(names.output), [width, width])?,
            norm2: self.norm(&name(names.norms[1]), width)?,
            widen: self.linear(&name(names.mlp[0]), [width, hidden])?,
            narrow: self.linear(&name(names.mlp[1]), [hidden, width])?,
            activation: tower.activation,
            heads: tower.heads,
        })
    }

    /// All blocks of a transformer.
    pub fn blocks(self, names: &BlockNames, tower: &TowerConfig) -> Result<Vec<Block>, ClipError> {
        (0..tower.blocks).map(|number| self.block(names, number, tower)).collect()
    }
}

/// Packs a layer from its weight `[outputs, inputs]`.
fn packed(weight: &[f32], bias: &[f32], [inputs, outputs]: [usize; 2]) -> PackedLinear {
    PackedLinear::new(&transposed(weight, [outputs, inputs]), bias, Instructions::best())
}

/// The transpose of a matrix `[rows, columns]`.
fn transposed(matrix: &[f32], [rows, columns]: [usize; 2]) -> Vec<f32> {
    (0..rows * columns).map(|index| matrix[index % rows * columns + index / rows]).collect()
}

#[cfg(test)]
mod tests {
    use super::transposed;

    #[test]
    fn a_transpose_swaps_rows_and_columns() {
        assert_eq!(transposed(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [2, 3]), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
    }
}

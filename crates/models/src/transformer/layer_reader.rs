//! Reads layers of a transformer from a checkpoint.

use super::{Block, BlockNames, Norm, QueryKeyValue, TowerConfig};
use crate::checkpoint::{Checkpoint, CheckpointError};
use splatseg_kernels::Instructions;
use splatseg_kernels::gemm::PackedLinear;

/// Maximum ratio of the hidden channels of a block to its width; 4 in every published network.
const MAX_MLP_RATIO: usize = 8;

/// Reads layers by their names.
#[derive(Clone, Copy)]
pub(crate) struct LayerReader<'a> {
    pub checkpoint: &'a Checkpoint,
    /// ε of every layer norm.
    pub epsilon: f32,
}

impl LayerReader<'_> {
    /// A tensor of this shape.
    pub fn tensor(self, name: &str, shape: &[usize]) -> Result<Vec<f32>, CheckpointError> {
        self.checkpoint.read_f32(name, shape)
    }

    /// The layer norm `name.weight`, `name.bias`.
    pub fn norm(self, name: &str, width: usize) -> Result<Norm, CheckpointError> {
        let read = |part: &str| self.tensor(&format!("{name}.{part}"), &[width]);
        Ok(Norm { weight: read("weight")?, bias: read("bias")?, epsilon: self.epsilon })
    }

    /// The linear layer `name.weight` `[outputs, inputs]`, `name.bias`.
    pub fn linear(self, name: &str, [inputs, outputs]: [usize; 2]) -> Result<PackedLinear, CheckpointError> {
        self.linear_of(&format!("{name}.weight"), Some(&format!("{name}.bias")), [inputs, outputs])
    }

    /// [`Self::linear`] whose outputs are multiplied by the tensor `scale` `[outputs]`, if there is one.
    fn linear_scaled(
        self,
        name: &str,
        scale: Option<&str>,
        [inputs, outputs]: [usize; 2],
    ) -> Result<PackedLinear, CheckpointError> {
        let Some(scale) = scale else { return self.linear(name, [inputs, outputs]) };
        let scale = self.tensor(scale, &[outputs])?;
        let mut weight = self.tensor(&format!("{name}.weight"), &[outputs, inputs])?;
        let mut bias = self.tensor(&format!("{name}.bias"), &[outputs])?;
        for ((row, bias), scale) in weight.chunks_exact_mut(inputs).zip(&mut bias).zip(&scale) {
            row.iter_mut().for_each(|weight| *weight *= scale);
            *bias *= scale;
        }
        Ok(packed(&weight, &bias, [inputs, outputs]))
    }

    /// A linear layer whose weight is `[outputs, inputs]`, by the names of its tensors. Without a bias it is 0.
    pub fn linear_of(
        self,
        weight: &str,
        bias: Option<&str>,
        [inputs, outputs]: [usize; 2],
    ) -> Result<PackedLinear, CheckpointError> {
        let weight = self.tensor(weight, &[outputs, inputs])?;
        let bias = bias.map_or_else(|| Ok(vec![0.0; outputs]), |bias| self.tensor(bias, &[outputs]))?;
        Ok(packed(&weight, &bias, [inputs, outputs]))
    }

    /// The block of a transformer with this number.
    pub fn block(self, names: &BlockNames, number: usize, tower: &TowerConfig) -> Result<Block, CheckpointError> {
        let name = |part: &str| format!("{}{number}.{part}", names.blocks);
        let width = tower.width;
        let hidden_name = format!("{}.weight", name(names.mlp[0]));
        let hidden =
            self.checkpoint.info(&hidden_name).and_then(|info| info.shape().first().copied()).unwrap_or_default();
        if !(1..=MAX_MLP_RATIO * width).contains(&hidden) {
            return Err(CheckpointError::Tensor {
                path: self.checkpoint.path().to_owned(),
                tensor: hidden_name,
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
        let scales = names.layer_scales.map(|scales| scales.map(name));
        let [attention_scale, mlp_scale] = [0, 1].map(|index| scales.as_ref().map(|scales| scales[index].as_str()));
        Ok(Block {
            norm1: self.norm(&name(names.norms[0]), width)?,
            query_key_value,
            output: self.linear_scaled(&name(names.output), attention_scale, [width, width])?,
            norm2: self.norm(&name(names.norms[1]), width)?,
            widen: self.linear(&name(names.mlp[0]), [width, hidden])?,
            narrow: self.linear_scaled(&name(names.mlp[1]), mlp_scale, [hidden, width])?,
            activation: tower.activation,
            heads: tower.heads,
        })
    }

    /// All blocks of a transformer.
    pub fn blocks(self, names: &BlockNames, tower: &TowerConfig) -> Result<Vec<Block>, CheckpointError> {
        (0..tower.blocks).map(|number| self.block(names, number, tower)).collect()
    }
}

/// Packs a layer from its weight `[outputs, inputs]`.
pub(crate) fn packed(weight: &[f32], bias: &[f32], [inputs, outputs]: [usize; 2]) -> PackedLinear {
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

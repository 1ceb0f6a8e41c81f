//! Linear layers: tokens times weights packed once.

use super::{DEPTH_BLOCK, pack_columns, pack_rows};
use crate::Activation;
use crate::instructions::{Instructions, LANES};
use crate::layer_norm::LayerNorm;
use rayon::prelude::*;
use std::cell::RefCell;

/// Tokens per job: their panels of a block of the inner dimension stay in the second-level cache of a core.
const TOKEN_BLOCK: usize = 96;

thread_local! {
    /// Buffers that a thread keeps from one layer to the next.
    static BUFFERS: RefCell<Buffers> =
        const { RefCell::new(Buffers { panels: Vec::new(), sums: Vec::new(), tokens: Vec::new() }) };
}

struct Buffers {
    /// Packed tokens.
    panels: Vec<f32>,
    sums: Vec<f32>,
    /// Tokens between layers.
    tokens: Vec<f32>,
}

/// The parameters of a linear layer, packed for the microkernel.
#[derive(Clone, Debug)]
pub struct PackedLinear {
    inputs: usize,
    outputs: usize,
    /// Block by block of the inner dimension, panels of columns.
    weights: Vec<f32>,
    bias: Vec<f32>,
    instructions: Instructions,
}

impl PackedLinear {
    /// Packs `weight` `[inputs, outputs]`, row-major, and `bias` `[outputs]`.
    ///
    /// # Panics
    /// If the length of `weight` is not a multiple of the length of `bias`.
    pub fn new(weight: &[f32], bias: &[f32], instructions: Instructions) -> Self {
        let outputs = bias.len();
        let inputs = weight.len() / outputs;
        assert_eq!(inputs * outputs, weight.len(), "weights of a linear layer");
        let width = instructions.columns();
        let mut weights = Vec::with_capacity(inputs * outputs.next_multiple_of(width));
        for block in weight.chunks(DEPTH_BLOCK * outputs) {
            pack_columns(|| block.chunks_exact(outputs), outputs, width, &mut weights);
        }
        Self { inputs, outputs, weights, bias: bias.to_vec(), instructions }
    }

    /// Returns `[inputs, outputs]`.
    pub fn dims(&self) -> [usize; 2] {
        [self.inputs, self.outputs]
    }

    /// Computes `tokens · weight + bias`: `[count, inputs]` to `[count, outputs]`.
    pub fn forward(&self, tokens: &[f32]) -> Vec<f32> {
        LinearChain { norm: None, layers: &[(self, Activation::None)] }.forward(tokens, None)
    }

    /// Sums of products as tiles, `[column panels, row panels, rows, columns]`.
    #[inline(always)]
    fn sum(&self, tokens: &[f32], panels: &mut Vec<f32>, sums: &mut Vec<f32>) {
        let (rows, columns) = (self.instructions.rows(), self.instructions.columns());
        let count = tokens.len() / self.inputs;
        sums.clear();
        sums.resize(count.next_multiple_of(rows) * self.outputs.next_multiple_of(columns), 0.0);
        let mut weights = self.weights.as_slice();
        for start in (0..self.inputs).step_by(DEPTH_BLOCK) {
            let depth = DEPTH_BLOCK.min(self.inputs - start);
            panels.clear();
            let tokens = tokens.chunks_exact(self.inputs).map(|token| &token[start..start + depth]);
            pack_rows(tokens, count, depth, rows, panels);
            let (block, rest) = weights.split_at(depth * self.outputs.next_multiple_of(columns));
            self.instructions.add_product(panels, block, depth, sums);
            weights = rest;
        }
    }

    /// Adds bias, applies the activation, and converts tiles to rows. `write` receives an offset in `[count, outputs]`
    /// and at most [`LANES`] consecutive outputs of a token.
    #[inline(always)]
    fn finish(&self, sums: &mut [f32], count: usize, activation: Activation, mut write: impl FnMut(usize, &mut [f32])) {
        let (rows, columns) = (self.instructions.rows(), self.instructions.columns());
        let tiles = sums.chunks_exact_mut(count.next_multiple_of(rows) * columns);
        for (tile, (sums, bias)) in tiles.zip(self.bias.chunks(columns)).enumerate() {
            for (row, sums) in sums.chunks_exact_mut(columns).take(count).enumerate() {
                let start = row * self.outputs + tile * columns;
                for (part, (lanes, bias)) in
                    sums.as_chunks_mut::<LANES>().0.iter_mut().zip(bias.chunks(LANES)).enumerate()
                {
                    if let Ok(bias) = <&[f32; LANES]>::try_from(bias) {
                        (0..LANES).for_each(|lane| lanes[lane] += bias[lane]);
                        activation.apply(lanes);
                        write(start + part * LANES, lanes);
                    } else {
                        lanes.iter_mut().zip(bias).for_each(|(lane, bias)| *lane += bias);
                        activation.apply(lanes);
                        write(start + part * LANES, &mut lanes[..bias.len()]);
                    }
                }
            }
        }
    }
}

/// Linear layers in sequence. Each small block of tokens passes through all of them, so intermediate results stay in a
/// core's cache.
#[derive(Clone, Copy, Debug)]
pub struct LinearChain<'a> {
    /// Applied to the tokens first.
    pub norm: Option<LayerNorm<'a>>,
    /// The layers, at least one, each with its activation.
    pub layers: &'a [(&'a PackedLinear, Activation)],
}

impl LinearChain<'_> {
    /// Runs the layers on `tokens`, `[count, inputs]` to `[count, outputs]`, and adds `residual` `[count, outputs]`, if
    /// any.
    pub fn forward(&self, tokens: &[f32], residual: Option<&[f32]>) -> Vec<f32> {
        let (first, last) = (self.layers[0].0, self.layers[self.layers.len() - 1].0);
        let [inputs, outputs] = [first.inputs, last.outputs];
        let mut out = vec![0.0; tokens.len() / inputs * outputs];
        let jobs = out.par_chunks_mut(TOKEN_BLOCK * outputs).zip(tokens.par_chunks(TOKEN_BLOCK * inputs));
        jobs.enumerate().with_max_len(1).for_each(|(job, (out, tokens))| {
            let residual = residual.map(|residual| &residual[job * TOKEN_BLOCK * outputs..][..out.len()]);
            BUFFERS.with_borrow_mut(|buffers| {
                last.instructions.run(
                    #[inline(always)]
                    || self.run(tokens, residual, buffers, out),
                );
            });
        });
        out
    }

    /// Runs a block of tokens through all layers.
    #[inline(always)]
    fn run(
        &self,
        tokens: &[f32],
        residual: Option<&[f32]>,
        Buffers { panels, sums, tokens: hidden }: &mut Buffers,
        out: &mut [f32],
    ) {
        let count = tokens.len() / self.layers[0].0.inputs;
        if let Some(norm) = &self.norm {
            hidden.clear();
            hidden.extend_from_slice(tokens);
            norm.apply(hidden);
        }
        for (index, (layer, activation)) in self.layers.iter().enumerate() {
            let tokens = if index == 0 && self.norm.is_none() { tokens } else { hidden.as_slice() };
            layer.sum(tokens, panels, sums);
            if index + 1 < self.layers.len() {
                hidden.resize(count * layer.outputs, 0.0);
                layer.finish(sums, count, *activation, |at, values| {
                    hidden[at..at + values.len()].copy_from_slice(values)
                });
            } else {
                layer.finish(sums, count, *activation, |at, values| {
                    if let Some(residual) = residual {
                        let residual = &residual[at..at + values.len()];
                        values.iter_mut().zip(residual).for_each(|(value, residual)| *value += residual);
                    }
                    out[at..at + values.len()].copy_from_slice(values);
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equals_the_definition_with_any_number_of_threads() {
        let value = |index: usize, factor: usize| (index * factor % 101) as f32 / 50.0 - 1.0;
        for (count, inputs, outputs) in [(1, 1, 1), (5, 3, 17), (100, 300, 50), (200, 13, 33)] {
            let tokens: Vec<f32> = (0..count * inputs).map(|index| value(index, 37)).collect();
            let weight: Vec<f32> = (0..inputs * outputs).map(|index| value(index, 53)).collect();
            let bias: Vec<f32> = (0..outputs).map(|index| value(index, 29)).collect();
            let residual: Vec<f32> = (0..count * outputs).map(|index| value(index, 71)).collect();
            for instructions in Instructions::available() {
                let layer = PackedLinear::new(&weight, &bias, instructions);
                assert_eq!(layer.dims(), [inputs, outputs]);
                let run = |threads| {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    pool.install(|| {
                        LinearChain { norm: None, layers: &[(&layer, Activation::Relu)] }
                            .forward(&tokens, Some(&residual))
                    })
                };
                let found = run(1);
                assert!(found == run(3), "threads change the result");
                for (index, found) in found.iter().enumerate() {
                    let (token, output) = (index / outputs, index % outputs);
                    let terms = (0..inputs)
                        .map(|k| f64::from(tokens[token * inputs + k]) * f64::from(weight[k * outputs + output]));
                    let sum = terms.sum::<f64>() + f64::from(bias[output]);
                    let expected = sum.max(0.0) + f64::from(residual[index]);
                    let close = (f64::from(*found) - expected).abs() < 1e-6 * inputs as f64;
                    assert!(close, "{instructions:?}, output {index}: {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn a_chain_equals_its_layers_in_sequence() {
        let value = |index: usize, factor: usize| (index * factor % 101) as f32 / 50.0 - 1.0;
        let tokens: Vec<f32> = (0..150 * 20).map(|index| value(index, 37)).collect();
        let layer = |inputs: usize, outputs: usize| {
            let weight: Vec<f32> = (0..inputs * outputs).map(|index| value(index, 53)).collect();
            PackedLinear::new(&weight, &vec![0.5; outputs], Instructions::best())
        };
        let (first, second) = (layer(20, 70), layer(70, 30));
        let (weight, bias) = (vec![2.0; 20], vec![0.25; 20]);
        let norm = LayerNorm { weight: &weight, bias: &bias, epsilon: 1e-6 };
        let found =
            LinearChain { norm: Some(norm), layers: &[(&first, Activation::Relu), (&second, Activation::None)] }
                .forward(&tokens, None);
        let mut normed = tokens;
        norm.apply(&mut normed);
        let hidden = LinearChain { norm: None, layers: &[(&first, Activation::Relu)] }.forward(&normed, None);
        assert!(found == second.forward(&hidden));
    }
}

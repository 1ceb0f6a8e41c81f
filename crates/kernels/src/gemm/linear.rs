//! Linear layers: tokens times weights packed once.

use super::pack_columns;
use super::row_product::{RowProduct, tile_rows};
use crate::instructions::{Instructions, LANES};
use crate::layer_norm::LayerNorm;
use crate::{Activation, AlignedVec};
use rayon::prelude::*;
use std::cell::RefCell;

/// Maximum number of tokens per job: between layers they stay in the second-level cache of a core.
const MAX_TOKEN_BLOCK: usize = 192;

thread_local! {
    /// Buffers that a thread keeps from one layer to the next.
    static BUFFERS: RefCell<Buffers> =
        const { RefCell::new(Buffers { tokens: Vec::new(), next: Vec::new() }) };
}

struct Buffers {
    /// Tokens between layers.
    tokens: Vec<f32>,
    /// Tokens after the layer.
    next: Vec<f32>,
}

/// The parameters of a linear layer, packed for the microkernel.
#[derive(Clone, Debug)]
pub struct PackedLinear {
    inputs: usize,
    outputs: usize,
    /// Panels of columns. On 64-byte boundaries, loading a vector of them touches one cache line.
    weights: AlignedVec,
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
        let mut panels = Vec::with_capacity(inputs * outputs.next_multiple_of(width));
        pack_columns(|| weight.chunks_exact(outputs), outputs, width, &mut panels);
        let weights = AlignedVec::from(panels.as_slice());
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

    /// [`forward`](Self::forward) on the calling thread, to `out` `[count, outputs]`.
    pub(crate) fn forward_into(&self, tokens: &[f32], out: &mut [f32]) {
        self.run(
            tokens,
            Activation::None,
            #[inline(always)]
            |at, values| copy(values, &mut out[at..at + values.len()]),
        );
    }

    /// Multiplies `tokens` `[count, inputs]`, adds bias and applies the activation. `write` receives an offset in
    /// `[count, outputs]` and consecutive outputs of a token.
    #[inline(always)]
    fn run(&self, tokens: &[f32], activation: Activation, mut write: impl FnMut(usize, &mut [f32])) {
        let [depth, outputs] = self.dims();
        self.instructions.run_tiled(RowProduct::new(
            tokens,
            &self.weights,
            [depth, outputs],
            #[inline(always)]
            |token: usize, first: usize, sums: &mut [f32]| {
                let bias = &self.bias[first..first + sums.len()];
                let (vectors, rest) = sums.as_chunks_mut::<LANES>();
                let (vector_biases, rest_bias) = bias.as_chunks::<LANES>();
                for (sums, bias) in vectors.iter_mut().zip(vector_biases) {
                    (0..LANES).for_each(|lane| sums[lane] += bias[lane]);
                    activation.apply(sums);
                }
                if !rest.is_empty() {
                    rest.iter_mut().zip(rest_bias).for_each(|(sum, bias)| *sum += bias);
                    activation.apply(rest);
                }
                write(token * outputs + first, sums);
            },
        ));
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
        let count = tokens.len() / inputs;
        let mut out = vec![0.0; count * outputs];
        let block = token_block(count, tile_rows(last.instructions.rows()));
        let jobs = out.par_chunks_mut(block * outputs).zip(tokens.par_chunks(block * inputs));
        jobs.enumerate().with_max_len(1).for_each(|(job, (out, tokens))| {
            let residual = residual.map(|residual| &residual[job * block * outputs..][..out.len()]);
            BUFFERS.with_borrow_mut(|buffers| self.run(tokens, residual, buffers, out));
        });
        out
    }

    /// Runs a block of tokens through all layers.
    fn run(&self, tokens: &[f32], residual: Option<&[f32]>, buffers: &mut Buffers, out: &mut [f32]) {
        let Buffers { tokens: hidden, next } = buffers;
        let count = tokens.len() / self.layers[0].0.inputs;
        if let Some(norm) = &self.norm {
            hidden.clear();
            hidden.extend_from_slice(tokens);
            self.layers[0].0.instructions.run(
                #[inline(always)]
                || norm.apply(hidden),
            );
        }
        for (index, (layer, activation)) in self.layers.iter().enumerate() {
            let tokens = if index == 0 && self.norm.is_none() { tokens } else { hidden.as_slice() };
            if index + 1 < self.layers.len() {
                next.resize(count * layer.outputs, 0.0);
                layer.run(
                    tokens,
                    *activation,
                    #[inline(always)]
                    |at, values| copy(values, &mut next[at..at + values.len()]),
                );
                std::mem::swap(hidden, next);
                continue;
            }
            layer.run(
                tokens,
                *activation,
                #[inline(always)]
                |at, values| {
                    if let Some(residual) = residual {
                        let residual = &residual[at..at + values.len()];
                        values.iter_mut().zip(residual).for_each(|(value, residual)| *value += residual);
                    }
                    copy(values, &mut out[at..at + values.len()]);
                },
            );
        }
    }
}

/// Copies whole vectors without a call.
#[inline(always)]
fn copy(values: &[f32], out: &mut [f32]) {
    let (vectors, rest) = values.as_chunks::<LANES>();
    let (out_vectors, out_rest) = out.as_chunks_mut::<LANES>();
    for (out, vector) in out_vectors.iter_mut().zip(vectors) {
        *out = *vector;
    }
    for (out, value) in out_rest.iter_mut().zip(rest) {
        *out = *value;
    }
}

/// Tokens per job: as many jobs for each thread, and whole tiles of `rows`. Tokens do not affect each other, so results
/// do not depend on it.
fn token_block(count: usize, rows: usize) -> usize {
    let jobs = count.div_ceil(MAX_TOKEN_BLOCK).next_multiple_of(rayon::current_num_threads());
    count.div_ceil(jobs.max(1)).next_multiple_of(rows).max(rows)
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

//! Attention to remembered feature maps with an axial rotary position encoding, without computing their keys.
//!
//! A key is R(x, y)·(W·m + b): the few channels m of memory are projected to many, then rotated by the position in the
//! map. One half of the channels is rotated by angles that depend only on x, the other half by angles that depend only
//! on y, so
//!
//! q · R(x, y)(W m + b) = (a(x) + c(y)) · (m, 1), with a(x) = \[R(x)(W, b)\]ₓᵀ qₓ and c(y) = \[R(y)(W, b)\]ᵧᵀ qᵧ.
//!
//! a and c have one element more than m. For each query they are computed once per column and once per row of the map.
//! Each remembered token then costs one multiplication per memory channel instead of one per key channel. With SAM
//! 2.1's 64 and 256 channels, 64 × 64 tokens and 7 maps, that is 2.5 times fewer in all. All maps share a + c.

use super::axial_scores::AxialScores;
use super::rotary::rotate;
use super::softmax::{RunningSoftmax, update_softmax};
use super::softmax_attention::{ResultRows, write_result};
use crate::gemm::{pack_columns, pack_rows};
use crate::instructions::{Instructions, LANES};
use rayon::prelude::*;

/// The projection of memory to keys, rotated to every column and every row of the map.
#[derive(Clone, Debug)]
pub struct AxialKeys {
    side: usize,
    /// Memory channels.
    memory_dim: usize,
    /// Query channels.
    hidden: usize,
    /// Panels of `[side · (memory + 1), hidden / 2]`: rotated to each column, first half of the channels.
    columns: Vec<f32>,
    /// The same, rotated to each row, second half of the channels.
    rows: Vec<f32>,
    /// Panels of `[memory + 1, hidden]`, not rotated.
    plain: Vec<f32>,
    instructions: Instructions,
}

/// The memory of one object.
#[derive(Clone, Copy)]
pub struct RememberedMaps<'a> {
    /// `[tokens, memory]`, with position encodings: maps of `side · side` tokens each, then tokens without a position.
    pub keys: &'a [f32],
    /// `[tokens, memory]`, without position encodings.
    pub values: &'a [f32],
    /// Number of tokens at the end that have no position.
    pub unplaced_tokens: usize,
}

/// The memory of one object, packed for any number of queries.
struct PackedMaps {
    maps: usize,
    /// `[side rows, side columns, memory, maps]`, the maps in groups of [`Instructions::axial_group`].
    keys: Vec<f32>,
    /// For each row of the map, panels of the values of (column, map).
    values: Vec<f32>,
    pointers: usize,
    /// Panels of tokens.
    pointer_keys: Vec<f32>,
    pointer_values: Vec<f32>,
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    queries: Vec<f32>,
    columns: Vec<f32>,
    rows: Vec<f32>,
    plain: Vec<f32>,
    scores: Vec<f32>,
    weighted: Vec<f32>,
}

impl AxialKeys {
    /// Rotates and packs the projection `weight` `[memory, hidden]` and `bias` `[hidden]`. `angles` are the rotary
    /// angles of a map of `side` × `side` tokens, `[side · side, hidden / 2]`; the first half of each token's angles
    /// depends on the column, the second on the row.
    pub fn new(weight: &[f32], bias: &[f32], angles: &[[f32; 2]], side: usize, instructions: Instructions) -> Self {
        let hidden = bias.len();
        let projection = [weight, bias].concat();
        let count = projection.len() / hidden;
        let rotated = |token: usize, half: std::ops::Range<usize>| {
            let mut rows = projection.clone();
            rotate(&mut rows, &angles[token * hidden / 2..][..hidden / 2], hidden / 2);
            rows.chunks_exact(hidden).flat_map(|row| row[half.clone()].to_vec()).collect::<Vec<f32>>()
        };
        let packed = |rows: Vec<f32>, depth: usize| {
            let mut panels = Vec::new();
            pack_rows(rows.chunks_exact(depth), rows.len() / depth, depth, instructions.rows(), &mut panels);
            panels
        };
        let columns = (0..side).flat_map(|column| rotated(column, 0..hidden / 2)).collect();
        let rows = (0..side).flat_map(|row| rotated(row * side, hidden / 2..hidden)).collect();
        Self {
            side,
            memory_dim: count - 1,
            hidden,
            columns: packed(columns, hidden / 2),
            rows: packed(rows, hidden / 2),
            plain: packed(projection, hidden),
            instructions,
        }
    }

    /// Memory channels.
    pub fn memory_dim(&self) -> usize {
        self.memory_dim
    }

    /// Returns `softmax(queries · keysᵀ / √hidden) · values`, `[n, memory]`, for rotated `queries` `[n, hidden]`.
    pub fn attend(&self, queries: &[f32], memory: RememberedMaps) -> Vec<f32> {
        let memory = self.pack(memory);
        let mut out = vec![0.0; queries.len() / self.hidden * self.memory_dim];
        let columns = self.instructions.columns();
        let panels = out.par_chunks_mut(columns * self.memory_dim).zip(queries.par_chunks(columns * self.hidden));
        panels.with_max_len(1).for_each_init(Scratch::default, |scratch, (out, queries)| {
            self.attend_panel(queries, &memory, out, scratch);
        });
        out
    }

    fn pack(&self, RememberedMaps { keys, values, unplaced_tokens }: RememberedMaps) -> PackedMaps {
        let (width, rows) = (self.memory_dim, self.instructions.rows());
        let tokens = self.side * self.side;
        let count = keys.len() / width;
        let maps = (count - unplaced_tokens) / tokens;
        let group = self.instructions.axial_group();
        let mut packed_keys = vec![0.0; maps * tokens * width];
        packed_keys.par_chunks_mut((maps * width).max(1)).enumerate().for_each(|(place, out)| {
            for first in (0..maps).step_by(group) {
                let size = group.min(maps - first);
                let out = &mut out[first * width..][..size * width];
                for map in 0..size {
                    let key = &keys[((first + map) * tokens + place) * width..][..width];
                    out[map..].iter_mut().step_by(size).zip(key).for_each(|(out, value)| *out = *value);
                }
            }
        });
        let row_values: Vec<Vec<f32>> = (0..self.side)
            .into_par_iter()
            .map(|row| {
                let value = |index: usize| {
                    let (column, map) = (index / maps, index % maps);
                    &values[(map * tokens + row * self.side + column) * width..][..width]
                };
                let mut panels = Vec::new();
                pack_columns(|| (0..self.side * maps).map(value), width, rows, &mut panels);
                panels
            })
            .collect();
        let (mut pointer_keys, mut pointer_values) = (Vec::new(), Vec::new());
        let pointers = (count - unplaced_tokens) * width;
        pack_rows(keys[pointers..].chunks_exact(width), unplaced_tokens, width, rows, &mut pointer_keys);
        pack_columns(|| values[pointers..].chunks_exact(width), width, rows, &mut pointer_values);
        let values = row_values.concat();
        PackedMaps { maps, keys: packed_keys, values, pointers: unplaced_tokens, pointer_keys, pointer_values }
    }

    fn attend_panel(&self, queries: &[f32], memory: &PackedMaps, out: &mut [f32], scratch: &mut Scratch) {
        let Scratch { queries: panel, columns: by_column, rows: by_row, plain, scores, weighted } = scratch;
        let instructions = self.instructions;
        let (width, lanes) = (self.memory_dim, instructions.columns());
        let count = queries.len() / self.hidden;
        let scale = std::f32::consts::LOG2_E / (self.hidden as f32).sqrt();
        panel.clear();
        pack_rows(queries.chunks_exact(self.hidden), count, self.hidden, lanes, panel);
        panel.iter_mut().for_each(|value| *value *= scale);
        let (first, second) = panel.split_at(self.hidden / 2 * lanes);
        product(instructions, &self.columns, first, self.hidden / 2, by_column);
        product(instructions, &self.rows, second, self.hidden / 2, by_row);

        let mut states = [RunningSoftmax::EMPTY; 2];
        let states = &mut states[..lanes / LANES];
        weighted.clear();
        weighted.resize(width.next_multiple_of(instructions.rows()) * lanes, 0.0);
        let keys = self.side * memory.maps;
        if memory.maps > 0 {
            let rows =
                memory.keys.chunks_exact(keys * width).zip(memory.values.chunks_exact(memory.values.len() / self.side));
            for ((keys_of_row, values), by_row) in rows.zip(by_row.chunks_exact((width + 1) * lanes)) {
                scores.resize(keys * lanes, 0.0);
                let scores = &mut scores[..keys * lanes];
                let (maps, keys) = (memory.maps, keys_of_row);
                instructions.run_tiled(AxialScores { by_column, by_row, keys, maps, scores });
                self.add_values(scores, states, values, weighted);
            }
        }
        if memory.pointers > 0 {
            product(instructions, &self.plain, panel, self.hidden, plain);
            let (channels, rest) = plain.split_at(width * lanes);
            product(instructions, &memory.pointer_keys, channels, width, scores);
            let scores = &mut scores[..memory.pointers * lanes];
            for score in scores.chunks_exact_mut(lanes) {
                score.iter_mut().zip(rest).for_each(|(score, bias)| *score += bias);
            }
            self.add_values(scores, states, &memory.pointer_values, weighted);
        }
        write_result(weighted, states, ResultRows { count, width, stride: width }, out);
    }

    /// Updates the running softmax and the weighted sums with a block of scores `[keys, lanes]`.
    fn add_values(&self, scores: &mut [f32], states: &mut [RunningSoftmax], values: &[f32], weighted: &mut [f32]) {
        self.instructions.run(
            #[inline(always)]
            || update_softmax(scores, states, weighted),
        );
        self.instructions.add_product(values, scores, scores.len() / self.instructions.columns(), weighted);
    }
}

/// Writes the product of row panels with one column panel, `[rows, columns]`, to `out`.
fn product(instructions: Instructions, left: &[f32], right: &[f32], depth: usize, out: &mut Vec<f32>) {
    out.clear();
    out.resize(left.len() / depth * instructions.columns(), 0.0);
    instructions.add_product(left, right, depth, out);
}

#[cfg(test)]
mod tests {
    use super::super::rotary::rotary_angles;
    use super::*;

    const SIDE: usize = 5;
    const MEMORY: usize = 7;
    const HIDDEN: usize = 16;

    fn noise(len: usize, seed: usize) -> Vec<f32> {
        (0..len).map(|index| ((index * 7919 + seed * 104_729) % 2003) as f32 / 500.0 - 2.0).collect()
    }

    /// Attention by definition: computes and rotates the keys one by one.
    fn expected(queries: &[f32], weight: &[f32], bias: &[f32], memory: RememberedMaps) -> Vec<f64> {
        let angles = rotary_angles(SIDE, HIDDEN);
        let tokens = memory.keys.len() / MEMORY;
        let keys: Vec<Vec<f32>> = (0..tokens)
            .map(|token| {
                let sum = |channel: usize| {
                    let terms = (0..MEMORY).map(|k| memory.keys[token * MEMORY + k] * weight[k * HIDDEN + channel]);
                    bias[channel] + terms.sum::<f32>()
                };
                let mut key: Vec<f32> = (0..HIDDEN).map(sum).collect();
                if token < tokens - memory.unplaced_tokens {
                    rotate(&mut key, &angles[token % (SIDE * SIDE) * HIDDEN / 2..][..HIDDEN / 2], HIDDEN / 2);
                }
                key
            })
            .collect();
        let attend = |query: &[f32]| {
            let dot = |key: &Vec<f32>| query.iter().zip(key).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
            let scores: Vec<f64> = keys.iter().map(|key| dot(key) / (HIDDEN as f64).sqrt()).collect();
            let largest = scores.iter().copied().fold(f64::MIN, f64::max);
            let weights: Vec<f64> = scores.iter().map(|score| (score - largest).exp()).collect();
            let sum: f64 = weights.iter().sum();
            let value = |channel: usize| {
                let terms = weights.iter().enumerate();
                terms.map(|(token, weight)| weight * f64::from(memory.values[token * MEMORY + channel])).sum::<f64>()
                    / sum
            };
            (0..MEMORY).map(value).collect::<Vec<f64>>()
        };
        queries.chunks_exact(HIDDEN).flat_map(attend).collect()
    }

    #[test]
    fn equals_attention_to_rotated_keys() {
        let (weight, bias) = (noise(MEMORY * HIDDEN, 1), noise(HIDDEN, 2));
        let queries = noise(37 * HIDDEN, 3);
        let angles = rotary_angles(SIDE, HIDDEN);
        for (maps, unplaced_tokens) in [(0, 3), (1, 0), (2, 1), (4, 5), (7, 4), (11, 20)] {
            let len = (maps * SIDE * SIDE + unplaced_tokens) * MEMORY;
            let (keys, values) = (noise(len, 4), noise(len, 5));
            let memory = RememberedMaps { keys: &keys, values: &values, unplaced_tokens };
            let expected = expected(&queries, &weight, &bias, memory);
            for instructions in Instructions::available() {
                let found = AxialKeys::new(&weight, &bias, &angles, SIDE, instructions).attend(&queries, memory);
                for (found, expected) in found.iter().zip(&expected) {
                    let close = (f64::from(*found) - expected).abs() < 2e-5;
                    assert!(close, "{instructions:?}, {maps} maps: {found} instead of {expected}");
                }
            }
        }
    }
}

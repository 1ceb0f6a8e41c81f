//! Softmax attention in blocks, without the full matrix of scores (FlashAttention, Dao et al. 2022).
//!
//! Scores are computed transposed, keys by queries: the queries of a panel are the lanes of a vector. Maxima and sums
//! over keys then stay within a lane, and the weights already have the panel layout that the product with the values
//! needs.

use super::softmax::{RunningSoftmax, update_softmax};
use crate::gemm::{pack_columns, pack_rows};
use crate::instructions::{Instructions, LANES};
use rayon::prelude::*;

/// Queries per job. All of them attend to a block of keys while it is in a core's second-level cache.
const QUERY_BLOCK: usize = 128;
/// Keys per block; a multiple of the rows of every tile.
const KEY_BLOCK: usize = 120;

/// Rows of all heads, side by side: row i of head h starts at `data[i * stride + h * width]`.
#[derive(Clone, Copy)]
pub struct HeadRows<'a> {
    /// The elements, starting at row 0.
    pub data: &'a [f32],
    /// Number of rows.
    pub count: usize,
    /// Elements per row of one head.
    pub width: usize,
    /// Distance between rows, in elements.
    pub stride: usize,
}

impl<'a> HeadRows<'a> {
    /// Row `index` of a head.
    #[inline(always)]
    fn row(&self, head: usize, index: usize) -> &'a [f32] {
        &self.data[index * self.stride + head * self.width..][..self.width]
    }
}

/// Keys and values of one head, packed for any number of queries.
#[derive(Default)]
pub(super) struct PackedKeysAndValues {
    count: usize,
    width: usize,
    value_width: usize,
    /// Panels of keys, block by block.
    keys: Vec<f32>,
    /// Panels of the values' elements, block by block.
    values: Vec<f32>,
}

impl PackedKeysAndValues {
    /// Replaces the contents with `count` packed keys and values.
    pub fn pack<'a>(
        &mut self,
        instructions: Instructions,
        count: usize,
        key: impl Fn(usize) -> &'a [f32],
        value: impl Fn(usize) -> &'a [f32],
    ) {
        let rows = instructions.rows();
        *self = Self { count, width: key(0).len(), value_width: value(0).len(), ..std::mem::take(self) };
        self.keys.clear();
        self.values.clear();
        instructions.run(
            #[inline(always)]
            || {
                for start in (0..count).step_by(KEY_BLOCK) {
                    let block = start..count.min(start + KEY_BLOCK);
                    pack_rows(block.clone().map(&key), block.len(), self.width, rows, &mut self.keys);
                    pack_columns(|| block.clone().map(&value), self.value_width, rows, &mut self.values);
                }
            },
        );
    }
}

/// Buffers of one thread.
pub(super) struct Scratch {
    pub instructions: Instructions,
    queries: Vec<f32>,
    /// Scores of a block of keys and a panel of queries, `[keys, columns]`.
    scores: Vec<f32>,
    running: Vec<RunningSoftmax>,
    /// Weighted sums of values, `[query panels, value elements, columns]`.
    weighted: Vec<f32>,
}

impl Scratch {
    pub fn new() -> Self {
        let instructions = Instructions::best();
        Self { instructions, queries: Vec::new(), scores: Vec::new(), running: Vec::new(), weighted: Vec::new() }
    }
}

/// A number added to the scores of the first keys.
#[derive(Clone, Copy)]
pub(super) struct Boost {
    /// Number of keys.
    pub keys: usize,
    pub logit: f32,
}

/// Attention of one head: writes `softmax(queries · keysᵀ / √width) · values` for `count` queries, with row i of the
/// result at `out[i * out_stride..]`.
pub(super) fn attend<'a>(
    memory: &PackedKeysAndValues,
    boost: Option<Boost>,
    count: usize,
    query: impl Fn(usize) -> &'a [f32],
    out: &mut [f32],
    out_stride: usize,
    scratch: &mut Scratch,
) {
    let Scratch { instructions, queries, scores, running, weighted } = scratch;
    let (rows, columns) = (instructions.rows(), instructions.columns());
    let scale = std::f32::consts::LOG2_E / (memory.width as f32).sqrt();
    queries.clear();
    instructions.run(
        #[inline(always)]
        || {
            pack_rows((0..count).map(&query), count, memory.width, columns, queries);
            queries.iter_mut().for_each(|value| *value *= scale);
        },
    );
    let value_rows = memory.value_width.next_multiple_of(rows);
    running.clear();
    running.resize(count.div_ceil(columns) * columns / LANES, RunningSoftmax::EMPTY);
    weighted.clear();
    weighted.resize(count.div_ceil(columns) * columns * value_rows, 0.0);
    for start in (0..memory.count).step_by(KEY_BLOCK) {
        let keys = KEY_BLOCK.min(memory.count - start);
        let padded = keys.next_multiple_of(rows);
        let key_panels = &memory.keys[start * memory.width..][..padded * memory.width];
        let value_panels = &memory.values[start * value_rows..][..keys * value_rows];
        let panels = queries.chunks_exact(memory.width * columns);
        let states = running.chunks_exact_mut(columns / LANES);
        for ((queries, states), weighted) in panels.zip(states).zip(weighted.chunks_exact_mut(value_rows * columns)) {
            scores.clear();
            scores.resize(padded * columns, 0.0);
            instructions.add_product(key_panels, queries, memory.width, scores);
            let scores = &mut scores[..keys * columns];
            if let Some(boost) = boost {
                let boosted = boost.keys.saturating_sub(start).min(keys) * columns;
                scores[..boosted].iter_mut().for_each(|score| *score += boost.logit * std::f32::consts::LOG2_E);
            }
            instructions.run(
                #[inline(always)]
                || update_softmax(scores, states, weighted),
            );
            instructions.add_product(value_panels, scores, keys, weighted);
        }
    }
    let (panels, states) = (weighted.chunks_exact(value_rows * columns), running.chunks_exact(columns / LANES));
    for (panel, (weighted, states)) in panels.zip(states).enumerate() {
        let rows =
            ResultRows { count: columns.min(count - panel * columns), width: memory.value_width, stride: out_stride };
        write_result(weighted, states, rows, &mut out[panel * columns * out_stride..]);
    }
}

/// Layout of the output rows of a panel of queries.
#[derive(Clone, Copy)]
pub(super) struct ResultRows {
    /// Number of queries.
    pub count: usize,
    /// Elements per row.
    pub width: usize,
    /// Distance between rows, in elements.
    pub stride: usize,
}

/// Divides the weighted sums of a panel of queries, `[value elements, columns]`, by the sums of the weights and writes
/// one row per query.
pub(super) fn write_result(weighted: &[f32], states: &[RunningSoftmax], rows: ResultRows, out: &mut [f32]) {
    for lane in 0..rows.count {
        let factor = 1.0 / states[lane / LANES].sums[lane % LANES];
        let out = &mut out[lane * rows.stride..][..rows.width];
        for (out, values) in out.iter_mut().zip(weighted.chunks_exact(states.len() * LANES)) {
            *out = values[lane] * factor;
        }
    }
}

/// Attention for several problems (objects), each with `heads` heads: one (queries, keys, values) per problem. All
/// problems have the same number of queries and the same widths. Returns `[problems, queries, heads · value width]`.
///
/// `boost` is a number of keys, and what is added to their scores; they are the first ones.
pub fn multi_head_attention(problems: &[[HeadRows; 3]], heads: usize, boost: Option<(usize, f32)>) -> Vec<f32> {
    let Some([queries, _, values]) = problems.first() else { return Vec::new() };
    let (count, out_stride) = (queries.count, heads * values.width);
    let instructions = Instructions::best();
    let memories: Vec<PackedKeysAndValues> = (0..problems.len() * heads)
        .into_par_iter()
        .map(|index| {
            let ([_, keys, values], head) = (problems[index / heads], index % heads);
            let mut memory = PackedKeysAndValues::default();
            memory.pack(instructions, keys.count, |row| keys.row(head, row), |row| values.row(head, row));
            memory
        })
        .collect();
    let mut out = vec![0f32; problems.len() * count * out_stride];
    let blocks: Vec<(usize, usize, &mut [f32])> = out
        .chunks_mut(count * out_stride)
        .enumerate()
        .flat_map(|(problem, rows)| {
            let blocks = rows.chunks_mut(QUERY_BLOCK * out_stride).enumerate();
            blocks.map(move |(block, rows)| (problem, block * QUERY_BLOCK, rows))
        })
        .collect();
    blocks.into_par_iter().with_max_len(1).for_each_init(Scratch::new, |scratch, (problem, start, out)| {
        let count = out.len() / out_stride;
        for head in 0..heads {
            let query = |row: usize| problems[problem][0].row(head, start + row);
            let out = &mut out[head * values.width..];
            let boost = boost.map(|(keys, logit)| Boost { keys, logit });
            attend(&memories[problem * heads + head], boost, count, query, out, out_stride, scratch);
        }
    });
    out
}

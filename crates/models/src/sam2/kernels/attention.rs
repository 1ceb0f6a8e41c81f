//! Softmax attention in blocks, without a matrix of all scores (FlashAttention, Dao et al. 2022).

use super::exponential::{RunningSoftmax, scale_rows, softmax_block};
use super::matmul::{Matrix, multiply};
use burn::tensor::{Tensor, TensorData};
use pulp::Arch;
use rayon::prelude::*;

/// Queries handled together: their results and scores stay in a core's second-level cache.
const QUERY_BLOCK: usize = 128;
/// Keys handled together.
const KEY_BLOCK: usize = 256;

/// Buffers of one thread.
pub struct Scratch {
    arch: Arch,
    scores: Vec<f32>,
    running: Vec<RunningSoftmax>,
    rescale: Vec<f32>,
    weighted: Vec<f32>,
}

impl Scratch {
    pub fn new() -> Self {
        Self { arch: Arch::new(), scores: Vec::new(), running: Vec::new(), rescale: Vec::new(), weighted: Vec::new() }
    }
}

/// Rows in a slice: `width` elements each, `stride` apart.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    pub data: &'a [f32],
    pub count: usize,
    pub width: usize,
    pub stride: usize,
}

impl<'a> Rows<'a> {
    fn block(&self, start: usize, count: usize) -> Matrix<'a> {
        Matrix::new(&self.data[start * self.stride..], count, self.width, self.stride)
    }
}

/// Attention of one head: `softmax(queries · keysᵀ / √width) · values`, with row i of the result at
/// `out[i * out_stride..]`.
pub fn attend(queries: Rows, keys: Rows, values: Rows, out: &mut [f32], out_stride: usize, scratch: &mut Scratch) {
    let Scratch { arch, scores, running, rescale, weighted } = scratch;
    let scale = std::f32::consts::LOG2_E / (queries.width as f32).sqrt();
    let rows = queries.count;
    running.clear();
    running.resize(rows, RunningSoftmax::EMPTY);
    rescale.resize(rows, 0.0);
    weighted.clear();
    weighted.resize(rows * values.width, 0.0);
    let mut start = 0;
    while start < keys.count {
        let count = KEY_BLOCK.min(keys.count - start);
        scores.resize(rows * count, 0.0);
        multiply(scores, count, queries.block(0, rows), keys.block(start, count).transposed(), scale, false);
        softmax_block(*arch, scores, count, running, &mut rescale[..rows]);
        if start > 0 {
            scale_rows(*arch, weighted, values.width, &rescale[..rows]);
        }
        let probabilities = Matrix::new(scores, rows, count, count);
        multiply(weighted, values.width, probabilities, values.block(start, count), 1.0, start > 0);
        start += count;
    }
    for (row, state) in running.iter().enumerate() {
        let factor = 1.0 / state.sum;
        let result = &mut out[row * out_stride..row * out_stride + values.width];
        for (result, value) in result.iter_mut().zip(&weighted[row * values.width..]) {
            *result = value * factor;
        }
    }
}

/// The rows of all heads, side by side: row i of head h starts at `data[i * stride + h * width]`.
#[derive(Clone, Copy)]
pub struct HeadRows<'a> {
    /// Everything from the first element of row 0.
    pub data: &'a [f32],
    /// Rows.
    pub count: usize,
    /// Elements of one head.
    pub width: usize,
    /// Elements from row to row.
    pub stride: usize,
}

impl<'a> HeadRows<'a> {
    fn head(&self, head: usize) -> Rows<'a> {
        let data = self.data.get(head * self.width..).unwrap_or(&[]);
        Rows { data, count: self.count, width: self.width, stride: self.stride }
    }

    fn block(&self, start: usize, count: usize) -> Self {
        Self { data: &self.data[start * self.stride..], count, ..*self }
    }
}

/// Attention of several problems (objects), each with `heads` heads: one (queries, keys, values) per problem, all of the
/// same number of queries and the same widths. The result is `[problems, queries, heads · value width]`.
pub fn multi_head_attention(problems: &[[HeadRows; 3]], heads: usize) -> Vec<f32> {
    let Some([queries, _, values]) = problems.first() else { return Vec::new() };
    let (count, out_stride) = (queries.count, heads * values.width);
    let mut out = vec![0f32; problems.len() * count * out_stride];
    let mut blocks: Vec<(&[HeadRows; 3], usize, &mut [f32])> = out
        .chunks_mut(count * out_stride)
        .zip(problems)
        .flat_map(|(rows, problem)| {
            let blocks = rows.chunks_mut(QUERY_BLOCK * out_stride).enumerate();
            blocks.map(move |(block, rows)| (problem, block * QUERY_BLOCK, rows))
        })
        .collect();
    blocks.par_iter_mut().for_each_init(Scratch::new, |scratch, ([queries, keys, values], start, out)| {
        let queries = queries.block(*start, out.len() / out_stride);
        for head in 0..heads {
            let out = &mut out[head * values.width..];
            attend(queries.head(head), keys.head(head), values.head(head), out, out_stride, scratch);
        }
    });
    out
}

/// Attention with `heads` heads side by side in the channels: queries `[objects or 1, n, heads · d]`, keys
/// `[objects or 1, m, heads · d]`, values `[objects or 1, m, heads · e]` to `[objects, n, heads · e]`.
pub fn attention(queries: Tensor<3>, keys: Tensor<3>, values: Tensor<3>, heads: usize) -> Tensor<3> {
    let device = queries.device();
    let operands = [queries, keys, values].map(|operand| (operand.dims(), operand.into_data()));
    let objects = operands.iter().map(|([objects, ..], _)| *objects).max().unwrap_or(0);
    let ([_, n, _], [_, _, out_channels]) = (operands[0].0, operands[2].0);
    let problems: Vec<[HeadRows; 3]> = (0..objects)
        .map(|object| {
            std::array::from_fn(|operand| {
                let ([objects, count, channels], data) = &operands[operand];
                let data = data.as_slice::<f32>().expect("the networks compute in float32");
                let start = if *objects == 1 { 0 } else { object * count * channels };
                HeadRows { data: &data[start..], count: *count, width: channels / heads, stride: *channels }
            })
        })
        .collect();
    let out = multi_head_attention(&problems, heads);
    Tensor::from_data(TensorData::new(out, [objects, n, out_channels]), &device)
}

//! The inner loop of axial attention.

use crate::instructions::{Instructions, TileKernel, multiply_add};
use pulp::Simd;

/// Computes the scores of one panel of queries for the tokens of one row of the maps: for column x and map i,
/// (a(x) + c) · (key(x, i), 1), in `scores` `[columns, maps, lanes]`.
pub(super) struct AxialScores<'a> {
    /// a, `[columns, memory + 1, lanes]`.
    pub by_column: &'a [f32],
    /// c, `[memory + 1, lanes]`.
    pub by_row: &'a [f32],
    /// `[columns, memory, maps]`, with the maps in groups of [`Instructions::axial_group`], group by group.
    pub keys: &'a [f32],
    pub maps: usize,
    pub scores: &'a mut [f32],
}

impl Instructions {
    /// Number of maps whose scores are summed together.
    pub(super) fn axial_group(self) -> usize {
        axial_group(self.rows())
    }
}

/// Number of maps that fit the registers of a tile with `rows` rows.
const fn axial_group(rows: usize) -> usize {
    if rows >= 8 { 8 } else { 4 }
}

impl TileKernel for AxialScores<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S) {
        let maps_per_group = const { axial_group(ROWS) };
        let lanes = VECTORS * S::F32_LANES;
        let width = self.by_row.len() / lanes - 1;
        let (by_row, _) = S::as_simd_f32s(self.by_row);
        let by_row = by_row.as_chunks::<VECTORS>().0;
        let columns = self.by_column.chunks_exact(self.by_row.len());
        let keys = self.keys.chunks_exact(width * self.maps);
        for ((by_column, keys), scores) in columns.zip(keys).zip(self.scores.chunks_exact_mut(self.maps * lanes)) {
            let (by_column, _) = S::as_simd_f32s(by_column);
            let vectors = [by_column.as_chunks::<VECTORS>().0, by_row];
            let groups = keys.chunks(width * maps_per_group).zip(scores.chunks_mut(maps_per_group * lanes));
            for (keys, scores) in groups {
                let (scores, _) = S::as_mut_simd_f32s(scores);
                match keys.len() / width {
                    1 => score_group::<S, 1, VECTORS, FUSED>(simd, vectors, keys, scores),
                    2 => score_group::<S, 2, VECTORS, FUSED>(simd, vectors, keys, scores),
                    3 => score_group::<S, 3, VECTORS, FUSED>(simd, vectors, keys, scores),
                    4 => score_group::<S, 4, VECTORS, FUSED>(simd, vectors, keys, scores),
                    5 => score_group::<S, 5, VECTORS, FUSED>(simd, vectors, keys, scores),
                    6 => score_group::<S, 6, VECTORS, FUSED>(simd, vectors, keys, scores),
                    7 => score_group::<S, 7, VECTORS, FUSED>(simd, vectors, keys, scores),
                    _ => score_group::<S, 8, VECTORS, FUSED>(simd, vectors, keys, scores),
                }
            }
        }
    }
}

/// Scores of the `MAPS` tokens at one position; `keys` is `[memory, MAPS]`.
#[inline(always)]
fn score_group<S: Simd, const MAPS: usize, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    [by_column, by_row]: [&[[S::f32s; VECTORS]]; 2],
    keys: &[f32],
    scores: &mut [S::f32s],
) {
    let keys = keys.as_chunks::<MAPS>().0;
    let sum = |a: [S::f32s; VECTORS], b: [S::f32s; VECTORS]| {
        let mut sums = a;
        for vector in 0..VECTORS {
            sums[vector] = simd.add_f32s(a[vector], b[vector]);
        }
        sums
    };
    let mut sums = [sum(by_column[keys.len()], by_row[keys.len()]); MAPS];
    for ((keys, a), b) in keys.iter().zip(by_column).zip(by_row) {
        let query = sum(*a, *b);
        for map in 0..MAPS {
            let key = simd.splat_f32s(keys[map]);
            for vector in 0..VECTORS {
                sums[map][vector] = multiply_add::<S, FUSED>(simd, key, query[vector], sums[map][vector]);
            }
        }
    }
    for (out, sums) in scores.as_chunks_mut::<VECTORS>().0.iter_mut().zip(sums) {
        *out = sums;
    }
}

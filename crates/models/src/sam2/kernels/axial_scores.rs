//! The inner loop of axial attention.

use crate::product::Instructions;
use pulp::{Simd, WithSimd};

/// Scores of one panel of queries for the tokens of one row of the maps: for column x and map i,
/// (a(x) + c) · (key(x, i), 1), to `scores` `[columns, maps, lanes]`.
///
/// `by_column` is a, `[columns, memory + 1, lanes]`; `by_row` is c, `[memory + 1, lanes]`; `keys` is `[columns, memory,
/// maps]`, the maps in groups of [`Instructions::axial_rows`], group by group.
pub fn axial_scores(
    instructions: Instructions,
    by_column: &[f32],
    by_row: &[f32],
    keys: &[f32],
    maps: usize,
    scores: &mut [f32],
) {
    match instructions {
        #[cfg(target_arch = "x86_64")]
        Instructions::V4(simd) => {
            Simd::vectorize(simd, AxialScores::<8, 2, true> { by_column, by_row, keys, maps, scores })
        }
        #[cfg(target_arch = "x86_64")]
        Instructions::V3(simd) => {
            Simd::vectorize(simd, AxialScores::<4, 2, true> { by_column, by_row, keys, maps, scores })
        }
        #[cfg(target_arch = "aarch64")]
        Instructions::Neon(simd) => {
            Simd::vectorize(simd, AxialScores::<4, 4, true> { by_column, by_row, keys, maps, scores })
        }
        Instructions::Portable => {
            Simd::vectorize(pulp::Scalar128b, AxialScores::<4, 4, false> { by_column, by_row, keys, maps, scores })
        }
    }
}

impl Instructions {
    /// Maps whose scores are summed up together.
    pub fn axial_rows(self) -> usize {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::V4(_) => 8,
            _ => 4,
        }
    }
}

struct AxialScores<'a, const GROUP: usize, const VECTORS: usize, const FUSED: bool> {
    by_column: &'a [f32],
    by_row: &'a [f32],
    keys: &'a [f32],
    maps: usize,
    scores: &'a mut [f32],
}

impl<const GROUP: usize, const VECTORS: usize, const FUSED: bool> WithSimd for AxialScores<'_, GROUP, VECTORS, FUSED> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = VECTORS * S::F32_LANES;
        let width = self.by_row.len() / lanes - 1;
        let (by_row, _) = S::as_simd_f32s(self.by_row);
        let by_row = by_row.as_chunks::<VECTORS>().0;
        let columns = self.by_column.chunks_exact(self.by_row.len());
        let keys = self.keys.chunks_exact(width * self.maps);
        for ((by_column, keys), scores) in columns.zip(keys).zip(self.scores.chunks_exact_mut(self.maps * lanes)) {
            let (by_column, _) = S::as_simd_f32s(by_column);
            let vectors = [by_column.as_chunks::<VECTORS>().0, by_row];
            let groups = keys.chunks(width * GROUP).zip(scores.chunks_mut(GROUP * lanes));
            for (keys, scores) in groups {
                let (scores, _) = S::as_mut_simd_f32s(scores);
                match keys.len() / width {
                    1 => group::<S, 1, VECTORS, FUSED>(simd, vectors, keys, scores),
                    2 => group::<S, 2, VECTORS, FUSED>(simd, vectors, keys, scores),
                    3 => group::<S, 3, VECTORS, FUSED>(simd, vectors, keys, scores),
                    4 => group::<S, 4, VECTORS, FUSED>(simd, vectors, keys, scores),
                    5 => group::<S, 5, VECTORS, FUSED>(simd, vectors, keys, scores),
                    6 => group::<S, 6, VECTORS, FUSED>(simd, vectors, keys, scores),
                    7 => group::<S, 7, VECTORS, FUSED>(simd, vectors, keys, scores),
                    _ => group::<S, 8, VECTORS, FUSED>(simd, vectors, keys, scores),
                }
            }
        }
    }
}

/// Scores of `MAPS` tokens at one place, `keys` `[memory, MAPS]`.
#[inline(always)]
fn group<S: Simd, const MAPS: usize, const VECTORS: usize, const FUSED: bool>(
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
                sums[map][vector] = if FUSED {
                    simd.mul_add_f32s(key, query[vector], sums[map][vector])
                } else {
                    simd.add_f32s(simd.mul_f32s(key, query[vector]), sums[map][vector])
                };
            }
        }
    }
    for (out, sums) in scores.as_chunks_mut::<VECTORS>().0.iter_mut().zip(sums) {
        *out = sums;
    }
}

//! Inner products of many vectors, with the same bits on every processor, and searches for the largest.
//!
//! Each lane adds the terms of its sum in order, so results depend neither on the width of the processor's vectors nor
//! on the number of threads. The code never uses fused multiply-add, and Rust does not introduce it by itself.

use crate::gemm::{pack_columns, pack_rows};
use crate::instructions::{Instructions, LANES, multiply_add};
use pulp::{Simd, WithSimd};

/// Number of left-hand rows that share each load of a panel.
pub const ROWS: usize = 4;

/// A matrix of `[depth, width]`, packed into panels of [`LANES`] columns.
#[derive(Clone, Debug)]
pub struct Panels {
    depth: usize,
    /// `[ceil(width / LANES), depth, LANES]`; columns beyond `width` are zero.
    values: Vec<f32>,
}

impl Panels {
    /// Packs the transpose of row-major `[count, dim]` vectors: one column, hence one inner product, per vector.
    pub fn from_vectors(vectors: &[f32], dim: usize) -> Self {
        let mut values = Vec::new();
        pack_rows(vectors.chunks_exact(dim), vectors.len() / dim, dim, LANES, &mut values);
        Self { depth: dim, values }
    }

    /// Packs row-major `[count, dim]` vectors untransposed: one column per dimension, for weighted sums of vectors.
    pub fn from_dimensions(vectors: &[f32], dim: usize) -> Self {
        let mut values = Vec::new();
        pack_columns(|| vectors.chunks_exact(dim), dim, LANES, &mut values);
        Self { depth: vectors.len() / dim, values }
    }

    /// The panels in the order of their columns, each `[depth, LANES]`.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = &[[f32; LANES]]> {
        self.values.as_chunks::<LANES>().0.chunks_exact(self.depth.max(1))
    }
}

/// Returns [`ROWS`] of the row-major `vectors` `[count, dim]`, starting at `first`, as `[dim, ROWS]`; zero beyond the
/// last vector.
#[inline(always)]
pub fn gather_rows(vectors: &[f32], dim: usize, first: usize) -> Vec<f32> {
    let mut rows = Vec::with_capacity(ROWS * dim);
    pack_rows(vectors[first * dim..].chunks_exact(dim).take(ROWS), ROWS, dim, ROWS, &mut rows);
    rows
}

/// `rows`ᵀ · `panel`: `[depth, N]` and `[depth, LANES]` to `[N, LANES]`.
///
/// Uses explicit vectors: auto-vectorised, the vectors run across the rows and every lane is gathered, which takes ten
/// times as long.
#[inline(always)]
pub fn product<const N: usize>(rows: &[[f32; N]], panel: &[[f32; LANES]]) -> [[f32; LANES]; N] {
    product_with(Instructions::best(), rows, panel)
}

#[inline(always)]
fn product_with<const N: usize>(
    instructions: Instructions,
    rows: &[[f32; N]],
    panel: &[[f32; LANES]],
) -> [[f32; LANES]; N] {
    let mut sums = [[0.0; LANES]; N];
    instructions.run_simd(PanelProduct { rows, panel, sums: &mut sums });
    sums
}

/// The work of [`product`].
struct PanelProduct<'a, const N: usize> {
    rows: &'a [[f32; N]],
    panel: &'a [[f32; LANES]],
    sums: &'a mut [[f32; LANES]; N],
}

impl<const N: usize> WithSimd for PanelProduct<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for vector in 0..LANES / S::F32_LANES {
            let mut sums = [simd.splat_f32s(0.0); N];
            for (row, lanes) in self.rows.iter().zip(self.panel) {
                let right = S::as_simd_f32s(lanes).0[vector];
                for (sum, &left) in sums.iter_mut().zip(row) {
                    *sum = multiply_add::<S, false>(simd, simd.splat_f32s(left), right, *sum);
                }
            }
            for (out, sum) in self.sums.iter_mut().zip(sums) {
                S::as_mut_simd_f32s(out).0[vector] = sum;
            }
        }
    }
}

/// The largest of many values and its index, kept per lane.
#[derive(Clone, Copy)]
pub struct LaneMaximum {
    values: [f32; LANES],
    panels: [u32; LANES],
}

impl LaneMaximum {
    /// The state before the first update.
    pub const EMPTY: Self = Self { values: [f32::NEG_INFINITY; LANES], panels: [0; LANES] };

    /// Updates the maxima with the columns of one panel; ignores NaN.
    #[inline(always)]
    pub fn update(&mut self, values: &[f32; LANES], panel: u32) {
        for ((best, index), &value) in self.values.iter_mut().zip(&mut self.panels).zip(values) {
            let larger = value > *best;
            *best = if larger { value } else { *best };
            *index = if larger { panel } else { *index };
        }
    }

    /// Returns the largest value and its column (the lowest column if several are equal); `(−∞, _)` before any update.
    #[inline(always)]
    pub fn largest(&self) -> (f32, u32) {
        let mut largest = (f32::NEG_INFINITY, u32::MAX);
        for (lane, (&value, &panel)) in self.values.iter().zip(&self.panels).enumerate() {
            let column = panel * LANES as u32 + lane as u32;
            if value > largest.0 || (value == largest.0 && column < largest.1) {
                largest = (value, column);
            }
        }
        largest
    }
}

/// Inner product of two vectors of equal length. Eight lanes are summed separately, then added by halves, so the loop
/// becomes vector code and gives the same bits everywhere.
#[inline(always)]
pub fn dot(left: &[f32], right: &[f32]) -> f32 {
    const LANES: usize = 8;
    let mut lanes = [0f32; LANES];
    let (left_chunks, left_rest) = left.as_chunks::<LANES>();
    let (right_chunks, right_rest) = right.as_chunks::<LANES>();
    for (left, right) in left_chunks.iter().zip(right_chunks) {
        for lane in 0..LANES {
            lanes[lane] += left[lane] * right[lane];
        }
    }
    let rest: f32 = left_rest.iter().zip(right_rest).map(|(left, right)| left * right).sum();
    let halves: [f32; LANES / 2] = std::array::from_fn(|lane| lanes[lane] + lanes[lane + LANES / 2]);
    (halves[0] + halves[2]) + (halves[1] + halves[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inner_products_are_right_for_any_length(pairs in prop::collection::vec((-1.0f32..1.0, -1.0f32..1.0), 0..40)) {
            let (left, right): (Vec<f32>, Vec<f32>) = pairs.into_iter().unzip();
            let exact: f64 = left.iter().zip(&right).map(|(left, right)| f64::from(*left) * f64::from(*right)).sum();
            prop_assert!((f64::from(dot(&left, &right)) - exact).abs() < 1e-5);
        }
    }

    proptest! {
        #[test]
        fn products_are_the_same_bits_with_all_instructions(
            rows in prop::collection::vec(prop::array::uniform4(-1.0f32..1.0), 0..9),
            panel in prop::collection::vec(prop::array::uniform16(-1.0f32..1.0), 9),
        ) {
            let mut expected = [[0.0f32; LANES]; 4];
            for (row, lanes) in rows.iter().zip(&panel) {
                for (sums, left) in expected.iter_mut().zip(row) {
                    sums.iter_mut().zip(lanes).for_each(|(sum, right)| *sum += left * right);
                }
            }
            for instructions in Instructions::available() {
                let found = product_with(instructions, &rows, &panel);
                prop_assert_eq!(found.map(|sums| sums.map(f32::to_bits)), expected.map(|sums| sums.map(f32::to_bits)));
            }
        }
    }

    #[test]
    fn the_largest_product_is_the_first_of_equals() {
        let vectors: Vec<f32> = (0..40).flat_map(|index| [(index % 20) as f32, 1.0]).collect();
        let panels = Panels::from_vectors(&vectors, 2);
        let mut maximum = LaneMaximum::EMPTY;
        for (index, panel) in panels.iter().enumerate() {
            let [products] = product(&[[2.0], [0.5]], panel);
            maximum.update(&products, index as u32);
        }
        assert_eq!(maximum.largest(), (38.5, 19));
    }
}

//! The microkernel: sums a tile of the result in registers over a block of the inner dimension.

use crate::instructions::{Instructions, TileKernel, multiply_add};
use pulp::Simd;

impl Instructions {
    /// Adds the products of all `left` panels with all `right` panels to `sums`. `depth` is the inner dimension: a left
    /// panel is `[depth, rows]`, a right panel `[depth, columns]`, and `sums`
    /// `[right panels, left panels, rows, columns]`.
    ///
    /// # Panics
    /// If `sums` is too short.
    pub fn add_product(self, left: &[f32], right: &[f32], depth: usize, sums: &mut [f32]) {
        let tiles = left.len() * right.len() / (depth * depth).max(1);
        let sums = &mut sums[..tiles];
        self.run_tiled(Product { left, right, depth, sums });
    }
}

struct Product<'a> {
    left: &'a [f32],
    right: &'a [f32],
    depth: usize,
    sums: &'a mut [f32],
}

impl TileKernel for Product<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S) {
        let columns = VECTORS * S::F32_LANES;
        if self.depth == 0 || self.left.is_empty() {
            return;
        }
        let row_len = self.left.len() / self.depth * columns;
        for (right, sums) in self.right.chunks_exact(self.depth * columns).zip(self.sums.chunks_exact_mut(row_len)) {
            let (right, _) = S::as_simd_f32s(right);
            for (left, sums) in self.left.chunks_exact(self.depth * ROWS).zip(sums.chunks_exact_mut(ROWS * columns)) {
                let (sums, _) = S::as_mut_simd_f32s(sums);
                add_tile::<S, ROWS, VECTORS, FUSED>(simd, left, right, sums);
            }
        }
    }
}

#[inline(always)]
fn add_tile<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(
    simd: S,
    left: &[f32],
    right: &[S::f32s],
    out: &mut [S::f32s],
) {
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
    for (left, right) in left.as_chunks::<ROWS>().0.iter().zip(right.as_chunks::<VECTORS>().0) {
        let right = *right;
        for row in 0..ROWS {
            let factor = simd.splat_f32s(left[row]);
            for vector in 0..VECTORS {
                sums[row][vector] = multiply_add::<S, FUSED>(simd, factor, right[vector], sums[row][vector]);
            }
        }
    }
    for (out, sums) in out.as_chunks_mut::<VECTORS>().0.iter_mut().zip(sums) {
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = simd.add_f32s(*out, sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uses integers, so every order of summation gives the same result.
    #[test]
    fn equals_the_definition() {
        for instructions in Instructions::available() {
            let (rows, columns) = (instructions.rows(), instructions.columns());
            for (depth, left_panels, right_panels) in [(1, 1, 1), (7, 3, 2), (40, 2, 5), (0, 2, 2)] {
                let value = |index: usize, factor: usize| (index * factor % 11) as f32 - 5.0;
                let left: Vec<f32> = (0..depth * rows * left_panels).map(|index| value(index, 7)).collect();
                let right: Vec<f32> = (0..depth * columns * right_panels).map(|index| value(index, 3)).collect();
                let mut sums = vec![1.0; rows * columns * left_panels * right_panels];
                if depth > 0 {
                    instructions.add_product(&left, &right, depth, &mut sums);
                }
                for (index, sum) in sums.iter().enumerate() {
                    let (tile, row, column) = (index / (rows * columns), index / columns % rows, index % columns);
                    let (i, j) = (tile % left_panels, tile / left_panels);
                    let terms = (0..depth)
                        .map(|k| left[(i * depth + k) * rows + row] * right[(j * depth + k) * columns + column]);
                    assert_eq!(*sum, 1.0 + terms.sum::<f32>(), "{instructions:?}, element {index}");
                }
            }
        }
    }
}

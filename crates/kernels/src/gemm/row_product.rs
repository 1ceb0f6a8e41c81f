//! Products of rows that are read in place with packed columns. Rows need no packing, which with few channels takes as
//! long as the product, and a finished tile goes to its destination from registers.

use crate::instructions::{TileKernel, multiply_add};
use pulp::Simd;

/// Elements of the largest tile.
const MAX_TILE: usize = 384;

/// Rows of a tile with AVX-512, which has registers for more than the tiles of packed operands need.
const MANY_ROWS: usize = 12;

/// Rows of a tile, for instructions whose tiles of packed operands have `rows`.
pub(super) const fn tile_rows(rows: usize) -> usize {
    if rows == 8 { MANY_ROWS } else { rows }
}

/// The products of rows with panels of columns.
pub(super) struct RowProduct<'a, F> {
    rows: &'a [f32],
    columns: &'a [f32],
    depth: usize,
    /// Number of columns without those that pad the last panel.
    outputs: usize,
    finish: F,
}

impl<'a, F: FnMut(usize, usize, &mut [f32])> RowProduct<'a, F> {
    /// The products of all `rows` `[count, depth]` with all panels of `columns` `[panels, depth, columns of a tile]`,
    /// which have `outputs` columns in all. `finish`, which must be inlined, receives a row, a first column, and the
    /// sums of the columns of a panel from there.
    pub fn new(rows: &'a [f32], columns: &'a [f32], [depth, outputs]: [usize; 2], finish: F) -> Self {
        Self { rows, columns, depth, outputs, finish }
    }
}

impl<F: FnMut(usize, usize, &mut [f32])> TileKernel for RowProduct<'_, F> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(self, simd: S) {
        if tile_rows(ROWS) == MANY_ROWS {
            self.multiply::<S, MANY_ROWS, VECTORS, FUSED>(simd);
        } else {
            self.multiply::<S, ROWS, VECTORS, FUSED>(simd);
        }
    }
}

impl<F: FnMut(usize, usize, &mut [f32])> RowProduct<'_, F> {
    #[inline(always)]
    fn multiply<S: Simd, const ROWS: usize, const VECTORS: usize, const FUSED: bool>(mut self, simd: S) {
        let (depth, width) = (self.depth, VECTORS * S::F32_LANES);
        if depth == 0 {
            return;
        }
        let mut tile = [0.0f32; MAX_TILE];
        for (panel, columns) in self.columns.chunks_exact(depth * width).enumerate() {
            let first = panel * width;
            let used = width.min(self.outputs - first);
            let (columns, _) = S::as_simd_f32s(columns);
            for (group, rows) in self.rows.chunks(ROWS * depth).enumerate() {
                let count = rows.len() / depth;
                // The last group may lack rows: its last one is computed again in their place.
                let mut lines = [rows; ROWS];
                for (row, line) in lines.iter_mut().enumerate() {
                    *line = &rows[row.min(count - 1) * depth..];
                }
                // Half of a tile is enough for few columns.
                if VECTORS == 2 && used <= S::F32_LANES {
                    sum::<S, ROWS, VECTORS, 1, FUSED>(simd, lines, depth, columns, &mut tile);
                } else {
                    sum::<S, ROWS, VECTORS, VECTORS, FUSED>(simd, lines, depth, columns, &mut tile);
                }
                for (row, sums) in tile.chunks_exact_mut(width).take(count).enumerate() {
                    (self.finish)(group * ROWS + row, first, &mut sums[..used]);
                }
            }
        }
    }
}

/// Sums a tile of `ROWS` lines and the first `USED` of `VECTORS` vectors of a panel of columns.
#[inline(always)]
fn sum<S: Simd, const ROWS: usize, const VECTORS: usize, const USED: usize, const FUSED: bool>(
    simd: S,
    mut lines: [&[f32]; ROWS],
    depth: usize,
    columns: &[S::f32s],
    tile: &mut [f32; MAX_TILE],
) {
    // With `array::from_fn` the compiler checks bounds in the loop below.
    for line in &mut lines {
        *line = &line[..depth];
    }
    let columns = &columns.as_chunks::<VECTORS>().0[..depth];
    let mut sums = [[simd.splat_f32s(0.0); USED]; ROWS];
    for k in 0..depth {
        for row in 0..ROWS {
            let factor = simd.splat_f32s(lines[row][k]);
            for vector in 0..USED {
                sums[row][vector] = multiply_add::<S, FUSED>(simd, factor, columns[k][vector], sums[row][vector]);
            }
        }
    }
    let (tile, _) = S::as_mut_simd_f32s(tile.as_mut_slice());
    for (out, sums) in tile.as_chunks_mut::<VECTORS>().0.iter_mut().zip(sums) {
        out[..USED].copy_from_slice(&sums);
    }
}

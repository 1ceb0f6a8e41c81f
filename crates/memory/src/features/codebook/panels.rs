//! The inner products of the codebook, sixteen at a time.
//!
//! Every sum runs over its terms in order, one sum per lane, so results do not depend on how wide the processor's
//! vectors are, nor on threads. Fused multiply-add is never asked for, and Rust does not introduce it by itself.

/// Sums that are computed side by side.
pub const LANES: usize = 16;
/// Left-hand rows that share each load of a panel.
pub const ROWS: usize = 4;

/// A matrix of `[depth, width]`, cut into panels of [`LANES`] columns that each lie in one piece.
#[derive(Clone, Debug)]
pub struct Panels {
    depth: usize,
    /// `[ceil(width / LANES), depth]`; columns beyond `width` are zero.
    lanes: Vec<[f32; LANES]>,
}

impl Panels {
    /// The transpose of row-major `[count, dim]` vectors: one column, and so one inner product, per vector.
    pub fn of_vectors(vectors: &[f32], dim: usize) -> Self {
        let count = vectors.len() / dim;
        let mut lanes = vec![[0.0; LANES]; count.div_ceil(LANES) * dim];
        for (group, panel) in vectors.chunks(LANES * dim).zip(lanes.chunks_exact_mut(dim)) {
            for (lane, vector) in group.chunks_exact(dim).enumerate() {
                for (row, &value) in panel.iter_mut().zip(vector) {
                    row[lane] = value;
                }
            }
        }
        Self { depth: dim, lanes }
    }

    /// Row-major `[count, dim]` vectors as they are: one column per dimension, for weighted sums of vectors.
    pub fn of_dimensions(vectors: &[f32], dim: usize) -> Self {
        let count = vectors.len() / dim;
        let mut lanes = vec![[0.0; LANES]; dim.div_ceil(LANES) * count];
        for (index, panel) in lanes.chunks_exact_mut(count.max(1)).enumerate() {
            for (row, vector) in panel.iter_mut().zip(vectors.chunks_exact(dim)) {
                for (lane, &value) in row.iter_mut().zip(&vector[index * LANES..]) {
                    *lane = value;
                }
            }
        }
        Self { depth: count, lanes }
    }

    /// The panels in the order of their columns, each `[depth, LANES]`.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = &[[f32; LANES]]> {
        self.lanes.chunks_exact(self.depth.max(1))
    }
}

/// `rows`ᵀ · `panel`: `[depth, N]` and `[depth, LANES]` to `[N, LANES]`.
#[inline(always)]
pub fn product<const N: usize>(rows: &[[f32; N]], panel: &[[f32; LANES]]) -> [[f32; LANES]; N] {
    let mut sums = [[0.0; LANES]; N];
    for (row, lanes) in rows.iter().zip(panel) {
        for (sum, &left) in sums.iter_mut().zip(row) {
            for (sum, &right) in sum.iter_mut().zip(lanes) {
                *sum += left * right;
            }
        }
    }
    sums
}

/// The largest of many values and its index, kept per lane.
#[derive(Clone, Copy)]
pub struct LaneMaximum {
    values: [f32; LANES],
    panels: [u32; LANES],
}

impl LaneMaximum {
    /// Nothing seen yet.
    pub const EMPTY: Self = Self { values: [f32::NEG_INFINITY; LANES], panels: [0; LANES] };

    /// Takes in the values of the columns of one panel; NaN is passed over.
    #[inline(always)]
    pub fn update(&mut self, values: &[f32; LANES], panel: u32) {
        for ((best, index), &value) in self.values.iter_mut().zip(&mut self.panels).zip(values) {
            let larger = value > *best;
            *best = if larger { value } else { *best };
            *index = if larger { panel } else { *index };
        }
    }

    /// The largest value and its column, the lowest one of several; `(−∞, _)` if nothing was seen.
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

//! Spacing of the vectors of a codebook.

use rayon::prelude::*;
use splatseg_kernels::inner_products::{LaneMaximum, Panels, ROWS, gather_rows, product};
use splatseg_kernels::instructions::LANES;
use splatseg_kernels::{Instructions, Vectorize};

/// Distances of the codes to their nearest neighbours.
#[derive(Clone, Debug)]
pub struct Spacing {
    /// Largest inner product of each code with another one; −1 in a codebook of one code. `[N]`
    pub coherences: Vec<f32>,
    /// The largest of `coherences`.
    pub max_coherence: f32,
    /// Smallest Euclidean distance of two codes; infinite in a codebook of one code.
    pub min_distance: f32,
}

impl Spacing {
    /// Returns the spacing of the integer ids from 1 to `count`, which all have the same direction.
    pub fn from_integers(count: usize) -> Self {
        let (coherence, min_distance) = if count == 1 { (-1.0, f32::INFINITY) } else { (1.0, 1.0) };
        Self { coherences: Vec::new(), max_coherence: coherence, min_distance }
    }

    /// Measures the spacing of unit vectors, row-major `[N, dim]`, in O(N² · dim) on all threads.
    pub fn measure(vectors: &[f32], dim: usize) -> Self {
        let panels = Panels::from_vectors(vectors, dim);
        let instructions = Instructions::best();
        let mut nearest = vec![(-1.0, 0); vectors.len() / dim];
        nearest.par_chunks_mut(ROWS).enumerate().with_min_len(8).for_each(|(group, nearest)| {
            instructions.run(NearestOfRows { vectors, dim, first: group * ROWS, panels: &panels, nearest });
        });
        let vector = |index: usize| &vectors[index * dim..(index + 1) * dim];
        let distances = nearest.iter().enumerate().map(|(index, &(_, other))| {
            if nearest.len() == 1 { f32::INFINITY } else { distance(vector(index), vector(other as usize)) }
        });
        let min_distance = distances.fold(f32::INFINITY, f32::min);
        let coherences: Vec<f32> = nearest.into_iter().map(|(coherence, _)| coherence).collect();
        let max_coherence = coherences.iter().copied().fold(-1.0, f32::max);
        Self { coherences, max_coherence, min_distance }
    }
}

/// Finds the nearest other vector of each row from `first` on: inner product and index.
struct NearestOfRows<'a> {
    vectors: &'a [f32],
    dim: usize,
    first: usize,
    panels: &'a Panels,
    nearest: &'a mut [(f32, u32)],
}

impl Vectorize for NearestOfRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { vectors, dim, first, panels, nearest } = self;
        let rows = gather_rows(vectors, dim, first);
        let mut maxima = [LaneMaximum::EMPTY; ROWS];
        for (index, panel) in panels.iter().enumerate() {
            let mut products = product(rows.as_chunks::<ROWS>().0, panel);
            for (row, products) in products.iter_mut().enumerate() {
                exclude_columns(products, index, first + row, vectors.len() / dim);
                maxima[row].update(products, index as u32);
            }
        }
        for (nearest, maximum) in nearest.iter_mut().zip(&maxima) {
            let (coherence, index) = maximum.largest();
            if coherence > f32::NEG_INFINITY {
                *nearest = (coherence, index);
            }
        }
    }
}

/// Sets the products of a vector with itself and with the padding columns of the last panel to −∞.
#[inline(always)]
pub fn exclude_columns(products: &mut [f32; LANES], panel: usize, own: usize, count: usize) {
    let first = panel * LANES;
    if own / LANES == panel {
        products[own % LANES] = f32::NEG_INFINITY;
    }
    if first + LANES > count {
        products[count - first..].fill(f32::NEG_INFINITY);
    }
}

fn distance(left: &[f32], right: &[f32]) -> f32 {
    left.iter().zip(right).map(|(left, right)| (left - right) * (left - right)).sum::<f32>().sqrt()
}

//! Pushes the closest vectors of a codebook apart.
//!
//! The paper minimises L = −min over i of (min over j≠i ‖c_i − c_j‖). Its gradient moves one pair at a time. Instead
//! each code i follows a soft minimum over its own neighbours, the Riesz energy Σ_j ‖c_i − c_j‖^(−2p): as p → ∞,
//! (Σ_j ‖c_i − c_j‖^(−2p))^(−1/(2p)) → min_j ‖c_i − c_j‖, so that its gradient becomes that of the inner minimum of L,
//! for all codes at once. Small p first spreads the codes evenly; p then doubles from 4 to 512. Steps shrink as 1/p,
//! since the energy's curvature grows with p, and shrink to zero at the end.
//!
//! p is a power of two, so that powers are squarings: library functions differ in the last bit between platforms.

use super::spacing::exclude_columns;
use rayon::prelude::*;
use splatseg_kernels::inner_products::{LaneMaximum, Panels, ROWS, gather_rows, product};
use splatseg_kernels::instructions::LANES;
use splatseg_kernels::{Instructions, Vectorize};

/// Maximum number of steps; fewer if they take too much work.
const MAX_STEPS: usize = 400;
/// Bounds steps · pairs · ([`PAIR_COST`] + dimensions): about a second on two cores with AVX2.
const WORK_BUDGET: usize = 40_000_000_000;
/// Cost of a pair's weight, in units of the time for one dimension.
const PAIR_COST: usize = 40;
/// log2 of the first exponent p.
const FIRST_SQUARINGS: u32 = 2;
/// log2 of the last exponent p.
const LAST_SQUARINGS: u32 = 9;
/// Step size times p, in units of the mean offset of a code from its closest neighbours.
const STEP_TIMES_EXPONENT: f32 = 2.0;
const MOMENTUM: f32 = 0.8;
/// Part of the steps during which p stays at its last value and the step size falls to zero.
const COOLING: f32 = 0.2;
/// Neighbours with a weight below this, relative to the nearest neighbour's, are left out. This also avoids denormals.
const MIN_WEIGHT: f32 = 1e-6;
/// Minimum of 1 − ⟨c_i, c_j⟩, for coinciding vectors.
const MIN_GAP: f32 = 1e-7;

/// Exponent and size of one step.
#[derive(Clone, Copy)]
struct Step {
    /// p = 2^squarings.
    squarings: u32,
    /// Multiplies the normalised forces.
    size: f32,
    /// Gap ratios below this have weights below [`MIN_WEIGHT`].
    min_ratio: f32,
}

/// Moves the unit vectors from index `first` on away from all others; `vectors` is row-major `[N, dim]`.
///
/// The vectors before `first` do not move. `progress` receives the fraction done after every step. Large codebooks take
/// fewer steps, to bound the time; very large ones take none.
pub fn spread(vectors: &mut [f32], dim: usize, first: usize, progress: &mut dyn FnMut(f32)) {
    let count = vectors.len() / dim;
    let moved = count - first;
    if count < 2 {
        return;
    }
    let steps = steps(moved, count, dim);
    let mut velocities = vec![0.0; moved * dim];
    let mut forces = vec![0.0; moved * dim];
    for index in 0..steps {
        let step = Step::at(index as f32 / steps as f32);
        compute_forces(vectors, dim, first, step, &mut forces);
        let moving = vectors[first * dim..].chunks_exact_mut(dim);
        for ((vector, velocity), force) in moving.zip(velocities.chunks_exact_mut(dim)).zip(forces.chunks_exact(dim)) {
            advance(vector, velocity, force, step.size);
        }
        progress((index + 1) as f32 / steps as f32);
    }
}

/// Cost of one step that moves `moved` of `count` codes, in units of the time for one dimension of an inner product.
fn work_of_step(moved: usize, count: usize, dim: usize) -> usize {
    moved.saturating_mul(count).saturating_mul(dim.saturating_add(PAIR_COST)).max(1)
}

fn steps(moved: usize, count: usize, dim: usize) -> usize {
    (WORK_BUDGET / work_of_step(moved, count, dim)).min(MAX_STEPS)
}

/// Cost of [`spread`] in the same unit.
pub fn work(moved: usize, count: usize, dim: usize) -> usize {
    steps(moved, count, dim).saturating_mul(work_of_step(moved, count, dim))
}

impl Step {
    /// The step after a fraction `done` of all steps.
    fn at(done: f32) -> Self {
        let heating = (done / (1.0 - COOLING)).min(1.0);
        let stages = (LAST_SQUARINGS - FIRST_SQUARINGS) as f32;
        // Rounded to nearest, so the first and the last exponent take half as long as the others.
        let squarings = FIRST_SQUARINGS + (stages * heating + 0.5) as u32;
        let cooling = ((1.0 - done) / COOLING).min(1.0);
        let min_ratio = (0..squarings).fold(MIN_WEIGHT, |ratio, _| ratio.sqrt());
        Self { squarings, size: STEP_TIMES_EXPONENT / (1u32 << squarings) as f32 * cooling, min_ratio }
    }
}

/// Scales to unit length; the zero vector becomes the first axis.
pub fn normalize(vector: &mut [f32]) {
    let norm = vector.iter().fold(0.0, |sum, value| sum + value * value).sqrt();
    if norm > 0.0 {
        vector.iter_mut().for_each(|value| *value /= norm);
    } else if let Some(first) = vector.first_mut() {
        *first = 1.0;
    }
}

/// One momentum step against `force`, along the sphere.
fn advance(vector: &mut [f32], velocity: &mut [f32], force: &[f32], size: f32) {
    let radial = force.iter().zip(vector.iter()).fold(0.0, |sum, (force, value)| sum + force * value);
    for ((value, velocity), force) in vector.iter_mut().zip(velocity).zip(force) {
        *velocity = MOMENTUM * *velocity - size * (force - radial * *value);
        *value += *velocity;
    }
    normalize(vector);
}

/// Computes the weighted mean of the neighbours of every moving code, from which the code is pushed away; `forces` is
/// `[N − first, dim]`.
fn compute_forces(vectors: &[f32], dim: usize, first: usize, step: Step, forces: &mut [f32]) {
    let columns = Panels::from_vectors(vectors, dim);
    let dimensions = Panels::from_dimensions(vectors, dim);
    let instructions = Instructions::best();
    forces.par_chunks_mut(ROWS * dim).enumerate().with_min_len(4).for_each_init(
        Vec::new,
        |weights, (group, forces)| {
            let rows = RowGroup { vectors, dim, first: first + group * ROWS };
            instructions.run(RowForces { rows, columns: &columns, dimensions: &dimensions, step, weights, forces });
        },
    );
}

/// The work of [`compute_forces`] on one group of rows.
struct RowForces<'a> {
    rows: RowGroup<'a>,
    columns: &'a Panels,
    dimensions: &'a Panels,
    step: Step,
    /// Room for `[N padded to LANES, ROWS]`.
    weights: &'a mut Vec<[f32; ROWS]>,
    /// `[ROWS or fewer, dim]`
    forces: &'a mut [f32],
}

impl Vectorize for RowForces<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let gaps = self.rows.inner_products(self.columns, self.weights);
        let totals = weigh(self.weights, gaps, self.step);
        self.rows.mean_neighbours(self.dimensions, self.weights, totals, self.forces);
    }
}

/// [`ROWS`] codes from index `first` on.
struct RowGroup<'a> {
    vectors: &'a [f32],
    dim: usize,
    first: usize,
}

impl RowGroup<'_> {
    /// Fills `products` with the inner products `[N padded to LANES, ROWS]` of all codes and these rows, −∞ of each row
    /// with itself. Returns the smallest gap 1 − product of each row.
    #[inline(always)]
    fn inner_products(&self, columns: &Panels, products: &mut Vec<[f32; ROWS]>) -> [f32; ROWS] {
        let rows = gather_rows(self.vectors, self.dim, self.first);
        let count = self.vectors.len() / self.dim;
        let mut maxima = [LaneMaximum::EMPTY; ROWS];
        products.clear();
        for (index, panel) in columns.iter().enumerate() {
            let mut sums = product(rows.as_chunks::<ROWS>().0, panel);
            for (row, sums) in sums.iter_mut().enumerate() {
                exclude_columns(sums, index, self.first + row, count);
                maxima[row].update(sums, 0);
            }
            for lane in 0..LANES {
                products.push(sums.map(|sums| sums[lane]));
            }
        }
        maxima.map(|maximum| (1.0 - maximum.largest().0).max(MIN_GAP))
    }

    /// Writes Σ_j w_ij c_j / Σ_j w_ij for these codes; `weights` is `[N padded, ROWS]`.
    #[inline(always)]
    fn mean_neighbours(&self, dimensions: &Panels, weights: &[[f32; ROWS]], totals: [f32; ROWS], means: &mut [f32]) {
        for (panel_index, panel) in dimensions.iter().enumerate() {
            let sums = product(weights, panel);
            for ((mean, sums), total) in means.chunks_exact_mut(self.dim).zip(&sums).zip(totals) {
                for (mean, sum) in mean[panel_index * LANES..].iter_mut().zip(sums) {
                    *mean = sum / total;
                }
            }
        }
    }
}

/// Turns inner products into weights (smallest gap / gap)^p in place, and sums them per row.
///
/// The squared distance of unit vectors is twice their gap, so the weight is their energy relative to the nearest
/// pair's.
#[inline(always)]
fn weigh(products: &mut [[f32; ROWS]], smallest_gaps: [f32; ROWS], step: Step) -> [f32; ROWS] {
    let mut totals = [[0.0; ROWS]; LANES];
    // Blocks are squared side by side: a chain of squarings would wait for each product in turn.
    for block in products.as_chunks_mut::<LANES>().0 {
        for weights in block.iter_mut() {
            for (weight, smallest) in weights.iter_mut().zip(smallest_gaps) {
                let gap = 1.0 - *weight;
                let ratio = smallest / if gap < smallest { smallest } else { gap };
                *weight = if ratio < step.min_ratio { 0.0 } else { ratio };
            }
        }
        for _ in 0..step.squarings {
            block.as_flattened_mut().iter_mut().for_each(|weight| *weight *= *weight);
        }
        for (totals, weights) in totals.iter_mut().zip(block.iter()) {
            totals.iter_mut().zip(weights).for_each(|(total, weight)| *total += weight);
        }
    }
    let mut sums = [0.0; ROWS];
    for totals in totals {
        sums.iter_mut().zip(totals).for_each(|(sum, total)| *sum += total);
    }
    sums
}

//! Sparse symmetric systems of 6×6 blocks, solved by elimination.
//!
//! Blocks are eliminated in the order of their number of neighbours (minimum degree), which keeps the system sparse. All
//! sums are in a fixed order and in double precision, so the result has the same bits on every machine.

use crate::linear::Matrix6;
use crate::se3::Twist;
use splatseg_geometry::Cholesky;
use std::collections::{BTreeMap, BTreeSet};

/// A symmetric positive definite system.
#[derive(Clone, Debug)]
pub(crate) struct BlockSystem {
    diagonal: Vec<Matrix6>,
    /// For each row, the other blocks by column.
    rows: Vec<BTreeMap<usize, Matrix6>>,
    right: Vec<Twist>,
}

/// A row after its elimination.
struct Eliminated {
    row: usize,
    /// `A⁻¹ b`.
    right: Twist,
    /// `A⁻¹ A_j` for the rows `j` that were left.
    others: Vec<(usize, Matrix6)>,
}

impl BlockSystem {
    /// A system of zeros.
    pub(crate) fn new(size: usize) -> Self {
        Self { diagonal: vec![[[0.0; 6]; 6]; size], rows: vec![BTreeMap::new(); size], right: vec![[0.0; 6]; size] }
    }

    /// Adds a block, and its transpose on the other side of the diagonal.
    pub(crate) fn add(&mut self, row: usize, column: usize, block: &Matrix6) {
        if row == column {
            add_to(&mut self.diagonal[row], block, 1.0);
        } else {
            add_to(self.rows[row].entry(column).or_insert([[0.0; 6]; 6]), block, 1.0);
            add_to(self.rows[column].entry(row).or_insert([[0.0; 6]; 6]), &transposed(block), 1.0);
        }
    }

    /// Adds to the right-hand side.
    pub(crate) fn add_right(&mut self, row: usize, part: &Twist) {
        self.right[row].iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
    }

    /// Multiplies the diagonal by `1 + damping`.
    pub(crate) fn damp(&mut self, damping: f64) {
        for block in &mut self.diagonal {
            (0..6).for_each(|k| block[k][k] += damping * block[k][k] + 1e-9);
        }
    }

    /// Solves the system. `None` if it is not positive definite.
    pub(crate) fn solve(mut self) -> Option<Vec<Twist>> {
        let mut order: BTreeSet<(usize, usize)> =
            self.rows.iter().enumerate().map(|(row, others)| (others.len(), row)).collect();
        let mut eliminated = Vec::with_capacity(self.rows.len());
        while let Some((_, row)) = order.pop_first() {
            eliminated.push(self.eliminate(row, &mut order)?);
        }
        let mut solution = vec![[0.0; 6]; self.rows.len()];
        for Eliminated { row, right, others } in eliminated.into_iter().rev() {
            let mut value = right;
            for (other, block) in &others {
                let part = multiplied(block, &solution[*other]);
                value.iter_mut().zip(part).for_each(|(value, part)| *value -= part);
            }
            solution[row] = value;
        }
        Some(solution)
    }

    fn eliminate(&mut self, row: usize, order: &mut BTreeSet<(usize, usize)>) -> Option<Eliminated> {
        let factor = Cholesky::new(&self.diagonal[row], 0.0)?;
        let blocks: Vec<(usize, Matrix6)> = std::mem::take(&mut self.rows[row]).into_iter().collect();
        let right = factor.solve(&self.right[row]);
        let others: Vec<(usize, Matrix6)> =
            blocks.iter().map(|(other, block)| (*other, factor.solve_columns(block))).collect();
        for (index, (one, block)) in blocks.iter().enumerate() {
            let before = self.rows[*one].len();
            self.rows[*one].remove(&row);
            let left = transposed(block);
            let part = multiplied(&left, &right);
            self.right[*one].iter_mut().zip(part).for_each(|(sum, part)| *sum -= part);
            for (other, solved) in &others[index..] {
                let product = product(&left, solved);
                if one == other {
                    add_to(&mut self.diagonal[*one], &product, -1.0);
                } else {
                    add_to(self.rows[*one].entry(*other).or_insert([[0.0; 6]; 6]), &product, -1.0);
                }
            }
            order.remove(&(before, *one));
        }
        // The lower triangle follows the upper one.
        for (index, (one, _)) in blocks.iter().enumerate() {
            for (other, _) in &blocks[index + 1..] {
                let upper = self.rows[*one].get(other).copied()?;
                self.rows[*other].insert(*one, transposed(&upper));
            }
        }
        order.extend(blocks.iter().map(|(other, _)| (self.rows[*other].len(), *other)));
        Some(Eliminated { row, right, others })
    }
}

fn add_to(sum: &mut Matrix6, block: &Matrix6, factor: f64) {
    for (sum, row) in sum.iter_mut().zip(block) {
        sum.iter_mut().zip(row).for_each(|(sum, part)| *sum += factor * part);
    }
}

pub(crate) fn transposed(block: &Matrix6) -> Matrix6 {
    std::array::from_fn(|row| std::array::from_fn(|column| block[column][row]))
}

pub(crate) fn product(left: &Matrix6, right: &Matrix6) -> Matrix6 {
    let mut result = [[0.0; 6]; 6];
    // Row by row, so that it is done with vectors: most of the time of a correction is spent here.
    for (result, left) in result.iter_mut().zip(left) {
        for (factor, right) in left.iter().zip(right) {
            result.iter_mut().zip(right).for_each(|(sum, part)| *sum += factor * part);
        }
    }
    result
}

pub(crate) fn multiplied(matrix: &Matrix6, vector: &Twist) -> Twist {
    std::array::from_fn(|row| (0..6).map(|k| matrix[row][k] * vector[k]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keyframes::Random;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn the_solution_solves_the_system(size in 1usize..12, links in 0usize..20, seed in 0u64..1000) {
            let mut random = Random(seed);
            let mut number = || random.below(2001) as f64 / 1000.0 - 1.0;
            let mut system = BlockSystem::new(size);
            let mut dense = vec![vec![0.0; 6 * size]; 6 * size];
            let identity: Matrix6 = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(u8::from(r == c))));
            let mut add = |system: &mut BlockSystem, row: usize, column: usize, block: &Matrix6| {
                system.add(row, column, block);
                for r in 0..6 {
                    for c in 0..6 {
                        dense[6 * row + r][6 * column + c] += block[r][c];
                        if row != column { dense[6 * column + c][6 * row + r] += block[r][c]; }
                    }
                }
            };
            for row in 0..size {
                add(&mut system, row, row, &identity.map(|row| row.map(|part| 200.0 * part)));
            }
            for link in 0..links {
                let (row, column) = (link % size, (link * 7 + 3) % size);
                let block: Matrix6 = std::array::from_fn(|_| std::array::from_fn(|_| number()));
                if row != column { add(&mut system, row, column, &block); }
            }
            let right: Vec<Twist> = (0..size).map(|_| std::array::from_fn(|_| number())).collect();
            right.iter().enumerate().for_each(|(row, part)| system.add_right(row, part));
            let solution = system.solve().unwrap();
            for row in 0..6 * size {
                let found: f64 = (0..6 * size).map(|c| dense[row][c] * solution[c / 6][c % 6]).sum();
                prop_assert!((found - right[row / 6][row % 6]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_singular_system_has_no_solution() {
        assert!(BlockSystem::new(2).solve().is_none());
    }
}

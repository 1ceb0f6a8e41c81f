//! Small systems of linear equations with a positive definite matrix.

/// The Cholesky factor of a positive definite `N`×`N` matrix, in double precision.
#[derive(Clone, Copy, Debug)]
pub struct Cholesky<const N: usize>([[f64; N]; N]);

impl<const N: usize> Cholesky<N> {
    /// Factorises a matrix, of which the lower triangle is read, after adding `damping` to its diagonal. `None` if it is
    /// not positive definite.
    pub fn new(matrix: &[[f64; N]; N], damping: f64) -> Option<Self> {
        let mut factor = [[0.0; N]; N];
        for row in 0..N {
            for column in 0..=row {
                let known: f64 = (0..column).map(|k| factor[row][k] * factor[column][k]).sum();
                let rest = matrix[row][column] - known;
                if row == column {
                    let pivot = rest + damping;
                    if pivot.is_nan() || pivot <= 0.0 {
                        return None;
                    }
                    factor[row][row] = pivot.sqrt();
                } else {
                    factor[row][column] = rest / factor[column][column];
                }
            }
        }
        Some(Self(factor))
    }

    /// The solution of the system with this right-hand side.
    pub fn solve(&self, right: &[f64; N]) -> [f64; N] {
        let factor = &self.0;
        let mut solution = *right;
        for row in 0..N {
            let known: f64 = (0..row).map(|k| factor[row][k] * solution[k]).sum();
            solution[row] = (solution[row] - known) / factor[row][row];
        }
        for row in (0..N).rev() {
            let known: f64 = (row + 1..N).map(|k| factor[k][row] * solution[k]).sum();
            solution[row] = (solution[row] - known) / factor[row][row];
        }
        solution
    }

    /// The solutions for each column of a matrix, as columns.
    pub fn solve_columns(&self, right: &[[f64; N]; N]) -> [[f64; N]; N] {
        let columns: [[f64; N]; N] = std::array::from_fn(|column| self.solve(&right.map(|row| row[column])));
        std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved() {
        let element =
            |row: usize, column: usize| if row == column { 7.0 + row as f64 } else { (row + column) as f64 * 0.1 };
        let matrix: [[f64; 6]; 6] = std::array::from_fn(|row| std::array::from_fn(|column| element(row, column)));
        let right = [1.0, -2.0, 3.0, 0.5, 0.0, 4.0];
        let factor = Cholesky::new(&matrix, 0.0).unwrap();
        for (row, expected) in matrix.iter().zip(right) {
            let found: f64 = row.iter().zip(factor.solve(&right)).map(|(one, other)| one * other).sum();
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let inverse_times_itself = factor.solve_columns(&matrix);
        assert!((inverse_times_itself[2][2] - 1.0).abs() < 1e-12 && inverse_times_itself[2][3].abs() < 1e-12);
        assert!(Cholesky::new(&[[0.0; 6]; 6], 0.0).is_none());
    }
}

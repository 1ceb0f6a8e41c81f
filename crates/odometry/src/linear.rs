//! Symmetric 6×6 systems, in double precision.

/// A symmetric 6×6 matrix.
pub(crate) type Matrix6 = [[f64; 6]; 6];

/// Solves `matrix · x = right` by Cholesky's decomposition. `None` if the matrix is not positive definite.
pub(crate) fn solve(matrix: &Matrix6, right: &[f64; 6]) -> Option<[f64; 6]> {
    let lower = cholesky(matrix)?;
    let mut solution = *right;
    for row in 0..6 {
        for column in 0..row {
            solution[row] -= lower[row][column] * solution[column];
        }
        solution[row] /= lower[row][row];
    }
    for row in (0..6).rev() {
        for below in row + 1..6 {
            solution[row] -= lower[below][row] * solution[below];
        }
        solution[row] /= lower[row][row];
    }
    solution.iter().all(|part| part.is_finite()).then_some(solution)
}

/// The inverse of a positive definite matrix.
pub(crate) fn inverse(matrix: &Matrix6) -> Option<Matrix6> {
    let mut result = [[0.0; 6]; 6];
    for column in 0..6 {
        let mut unit = [0.0; 6];
        unit[column] = 1.0;
        let solved = solve(matrix, &unit)?;
        for row in 0..6 {
            result[row][column] = solved[row];
        }
    }
    Some(result)
}

fn cholesky(matrix: &Matrix6) -> Option<Matrix6> {
    let mut lower = [[0.0; 6]; 6];
    for row in 0..6 {
        for column in 0..=row {
            let mut sum = matrix[row][column];
            for before in 0..column {
                sum -= lower[row][before] * lower[column][before];
            }
            if row == column {
                if !(sum > 0.0 && sum.is_finite()) {
                    return None;
                }
                lower[row][row] = sum.sqrt();
            } else {
                lower[row][column] = sum / lower[column][column];
            }
        }
    }
    Some(lower)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn solutions_and_inverses_multiply_back(rows in prop::array::uniform6(prop::array::uniform6(-1.0f64..1.0))) {
            // AᵀA + 0.1 is positive definite.
            let mut matrix = [[0.0; 6]; 6];
            for (row, column) in (0..36).map(|index| (index / 6, index % 6)) {
                matrix[row][column] = (0..6).map(|k| rows[k][row] * rows[k][column]).sum::<f64>();
                matrix[row][column] += if row == column { 0.1 } else { 0.0 };
            }
            let right = [1.0, -2.0, 3.0, 0.5, 0.0, 1.5];
            let solution = solve(&matrix, &right).unwrap();
            let inverse = inverse(&matrix).unwrap();
            for row in 0..6 {
                let product: f64 = (0..6).map(|k| matrix[row][k] * solution[k]).sum();
                prop_assert!((product - right[row]).abs() < 1e-7);
                let again: f64 = (0..6).map(|k| inverse[row][k] * right[k]).sum();
                prop_assert!((again - solution[row]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_matrix_without_information_has_no_solution() {
        assert_eq!(solve(&[[0.0; 6]; 6], &[1.0; 6]), None);
    }
}

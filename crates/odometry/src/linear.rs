//! Eigenvectors of symmetric 6×6 matrices, in double precision.

/// A symmetric 6×6 matrix.
pub(crate) type Matrix6 = [[f64; 6]; 6];

/// The eigenvalues and eigenvectors of a symmetric matrix.
pub(crate) struct Eigen {
    pub(crate) values: [f64; 6],
    /// Eigenvectors, as columns.
    vectors: Matrix6,
}

impl Eigen {
    /// Decomposes a matrix, by Jacobi's rotations.
    pub(crate) fn new(matrix: &Matrix6) -> Self {
        let mut matrix = *matrix;
        let mut vectors: Matrix6 =
            std::array::from_fn(|row| std::array::from_fn(|column| if row == column { 1.0 } else { 0.0 }));
        // Convergence is quadratic: a few sweeps reach the last bits.
        for _ in 0..8 {
            for (p, q) in (0..6).flat_map(|p| (p + 1..6).map(move |q| (p, q))) {
                if matrix[p][q].abs() > f64::EPSILON * 1e-3 * (matrix[p][p] * matrix[q][q]).abs().sqrt() {
                    rotate(&mut matrix, &mut vectors, p, q);
                }
            }
        }
        Self { values: std::array::from_fn(|k| matrix[k][k]), vectors }
    }

    /// Components of a vector along the eigenvectors.
    pub(crate) fn along(&self, vector: &[f64; 6]) -> [f64; 6] {
        std::array::from_fn(|k| (0..6).map(|row| self.vectors[row][k] * vector[row]).sum())
    }

    /// The vector with these components along the eigenvectors.
    pub(crate) fn combined(&self, along: &[f64; 6]) -> [f64; 6] {
        std::array::from_fn(|row| (0..6).map(|k| self.vectors[row][k] * along[k]).sum())
    }

    /// Diagonal of the inverse matrix: the variances, if the matrix is an information matrix. Infinite where it says
    /// nothing.
    pub(crate) fn variances(&self) -> [f64; 6] {
        let variance = |k: usize| if self.values[k] > 0.0 { 1.0 / self.values[k] } else { f64::INFINITY };
        let part = |row: usize, k: usize| match self.vectors[row][k] {
            0.0 => 0.0,
            component => component * component * variance(k),
        };
        std::array::from_fn(|row| (0..6).map(|k| part(row, k)).sum())
    }
}

/// One of Jacobi's rotations, after which the element at row `p` and column `q` is zero.
fn rotate(matrix: &mut Matrix6, vectors: &mut Matrix6, p: usize, q: usize) {
    let ratio = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
    let tangent = ratio.signum() / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let sine = tangent * cosine;
    let turned = |first: f64, second: f64| (cosine * first - sine * second, sine * first + cosine * second);
    for row in matrix.iter_mut().chain(vectors.iter_mut()) {
        (row[p], row[q]) = turned(row[p], row[q]);
    }
    let rows: [(f64, f64); 6] = std::array::from_fn(|column| turned(matrix[p][column], matrix[q][column]));
    (matrix[p], matrix[q]) = (rows.map(|(first, _)| first), rows.map(|(_, second)| second));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_decomposition_multiplies_back(rows in prop::array::uniform6(prop::array::uniform6(-1.0f64..1.0))) {
            // AᵀA is positive semi-definite.
            let product = |row: usize, column: usize| (0..6).map(|k| rows[k][row] * rows[k][column]).sum::<f64>();
            let matrix: Matrix6 = std::array::from_fn(|row| std::array::from_fn(|column| product(row, column)));
            let eigen = Eigen::new(&matrix);
            for (index, row) in matrix.iter().enumerate() {
                let unit = std::array::from_fn(|k| if k == index { 1.0 } else { 0.0 });
                let along = eigen.along(&unit);
                let again = eigen.combined(&std::array::from_fn(|k| along[k] * eigen.values[k]));
                for (found, expected) in again.iter().zip(row) {
                    prop_assert!((found - expected).abs() < 1e-12, "{found} {expected}");
                }
                let length: f64 = along.iter().map(|part| part * part).sum();
                prop_assert!((length - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn variances_are_those_of_the_inverse() {
        let mut matrix = [[0.0; 6]; 6];
        for (k, row) in matrix.iter_mut().enumerate() {
            row[k] = 4.0;
        }
        (matrix[0][1], matrix[1][0]) = (2.0, 2.0);
        let variances = Eigen::new(&matrix).variances();
        assert!((variances[0] - 1.0 / 3.0).abs() < 1e-12 && (variances[2] - 0.25).abs() < 1e-12, "{variances:?}");
        assert_eq!(Eigen::new(&[[0.0; 6]; 6]).variances(), [f64::INFINITY; 6]);
    }
}

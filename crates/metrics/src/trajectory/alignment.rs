//! Rigid alignment of two sets of positions: Horn, *Closed-form solution of absolute orientation using unit quaternions*,
//! JOSA A 1987. The result is that of Umeyama's method without scale, which `evo` uses.

use super::PosePair;
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4};

/// Ratio of the second to the first singular value of the covariance below which positions count as a line: a width of
/// a tenth of a millionth of the length.
const MIN_WIDTH_RATIO: f64 = 1e-14;

/// Maximum number of sweeps of Jacobi's method, which needs about six.
const MAX_SWEEPS: usize = 50;

/// A rotation and a translation from the world of an estimated trajectory to that of the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidAlignment {
    /// Rotation.
    pub rotation: DMat3,
    /// Translation after the rotation, metres.
    pub translation: DVec3,
}

impl RigidAlignment {
    /// Computes the alignment that minimises the sum of squared distances between true and estimated positions. Returns
    /// `None` if it is not unique because the positions lie on one line.
    pub(super) fn between(pairs: &[PosePair]) -> Option<Self> {
        let count = pairs.len() as f64;
        let mean = |position: &dyn Fn(&PosePair) -> DVec3| pairs.iter().map(position).sum::<DVec3>() / count;
        let truth_mean = mean(&|pair| pair.truth.translation());
        let estimate_mean = mean(&|pair| pair.estimate.translation());
        // Column j has the estimate times component j of the truth.
        let mut covariance = DMat3::ZERO;
        for pair in pairs {
            let truth = pair.truth.translation() - truth_mean;
            let estimate = pair.estimate.translation() - estimate_mean;
            covariance += DMat3::from_cols(estimate * truth.x, estimate * truth.y, estimate * truth.z) * count.recip();
        }
        let mut eigen = symmetric_eigen(horn_matrix(covariance));
        eigen.sort_by(|(one, _), (other, _)| other.total_cmp(one));
        let [(largest, quaternion), (second, _), (third, _), _] = eigen;
        // The eigenvalues are sums and differences of the singular values of the covariance.
        let (first_singular, second_singular) = ((largest + second) / 2.0, (largest + third) / 2.0);
        // False if one of them is NaN.
        let is_unique = second_singular > f64::EPSILON.max(MIN_WIDTH_RATIO * first_singular);
        let [w, x, y, z] = quaternion.to_array();
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        is_unique.then(|| Self { rotation, translation: truth_mean - rotation * estimate_mean })
    }

    /// Moves a position of the estimated trajectory to the world of the true one.
    pub fn to_truth(&self, position: DVec3) -> DVec3 {
        self.rotation * position + self.translation
    }
}

/// Returns Horn's symmetric matrix. Its eigenvector with the largest eigenvalue is the quaternion (w, x, y, z) of the
/// best rotation.
fn horn_matrix(covariance: DMat3) -> DMat4 {
    let [[xx, yx, zx], [xy, yy, zy], [xz, yz, zz]] = covariance.to_cols_array_2d();
    DMat4::from_cols_array_2d(&[
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ])
}

/// Returns the eigenvalues of a symmetric matrix with their unit eigenvectors, by Jacobi's method. It uses no function
/// that rounds differently on different machines.
fn symmetric_eigen(matrix: DMat4) -> [(f64, DVec4); 4] {
    let mut matrix = matrix.to_cols_array_2d();
    let mut vectors = DMat4::IDENTITY.to_cols_array_2d();
    for _ in 0..MAX_SWEEPS {
        let off_diagonal: f64 = (0..4)
            .flat_map(|row| (0..row).map(move |column| (row, column)))
            .map(|(row, column)| matrix[row][column].abs())
            .sum();
        // Not a number for positions that are not finite.
        if off_diagonal == 0.0 || !off_diagonal.is_finite() {
            break;
        }
        for p in 0..3 {
            for q in p + 1..4 {
                rotate(&mut matrix, &mut vectors, (p, q));
            }
        }
    }
    [0, 1, 2, 3].map(|index| (matrix[index][index], DVec4::from_array(vectors[index])))
}

/// Applies the rotation in the plane of axes `p` and `q` that makes the entry `(p, q)` of a symmetric matrix zero. `vectors`
/// contains the eigenvectors found so far, one per row.
fn rotate(matrix: &mut [[f64; 4]; 4], vectors: &mut [[f64; 4]; 4], (p, q): (usize, usize)) {
    let entry = matrix[p][q];
    let (first, second) = (matrix[p][p], matrix[q][q]);
    // Too small to change the diagonal.
    if first + entry == first && second + entry == second {
        (matrix[p][q], matrix[q][p]) = (0.0, 0.0);
        return;
    }
    let theta = (second - first) / (2.0 * entry);
    let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cosine = (tangent * tangent + 1.0).sqrt().recip();
    let sine = tangent * cosine;
    let turned = |p_value: f64, q_value: f64| (cosine * p_value - sine * q_value, sine * p_value + cosine * q_value);
    for row in matrix.iter_mut() {
        (row[p], row[q]) = turned(row[p], row[q]);
    }
    for column in 0..4 {
        (matrix[p][column], matrix[q][column]) = turned(matrix[p][column], matrix[q][column]);
        (vectors[p][column], vectors[q][column]) = turned(vectors[p][column], vectors[q][column]);
    }
    (matrix[p][q], matrix[q][p]) = (0.0, 0.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use splatseg_geometry::Pose;

    fn pair(truth: DVec3, estimate: DVec3) -> PosePair {
        PosePair { truth: Pose::from_translation(truth), estimate: Pose::from_translation(estimate) }
    }

    #[test]
    fn positions_on_a_line_have_no_alignment() {
        let line = |step: f64| DVec3::new(0.3, -0.7, 0.2) * step + DVec3::new(100.0, 20.0, -5.0);
        let pairs: Vec<PosePair> =
            (0..50).map(|step| pair(line(f64::from(step)), line(f64::from(step)) * 0.5)).collect();
        for count in [1, 2, 3, 50] {
            assert_eq!(RigidAlignment::between(&pairs[..count]), None, "{count}");
        }
        assert_eq!(RigidAlignment::between(&[]), None);
        let far = DVec3::splat(f64::MAX);
        assert_eq!(RigidAlignment::between(&[pair(far, far), pair(-far, far), pair(DVec3::X, DVec3::Y)]), None);
    }

    proptest! {
        #[test]
        fn a_moved_trajectory_is_moved_back(
            points in prop::collection::vec(prop::array::uniform3(-3.0f64..3.0), 4..30),
            turn in prop::array::uniform4(-1.0f64..1.0), shift in prop::array::uniform3(-9.0f64..9.0),
        ) {
            let rotation = DQuat::from_array(turn);
            prop_assume!(rotation.length() > 0.1);
            let (rotation, shift) = (rotation.normalize(), DVec3::from(shift));
            let pairs: Vec<PosePair> =
                points.iter().map(|point| pair(rotation * DVec3::from(*point) + shift, DVec3::from(*point))).collect();
            let found = RigidAlignment::between(&pairs).unwrap();
            for point in points {
                let point = DVec3::from(point);
                prop_assert!(found.to_truth(point).distance(rotation * point + shift) < 1e-11);
            }
        }

        #[test]
        fn no_small_turn_is_better(
            points in prop::collection::vec(prop::array::uniform6(-3.0f64..3.0), 3..20),
            axis in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let pairs: Vec<PosePair> = points
                .iter()
                .map(|point| pair(DVec3::from_slice(&point[..3]), DVec3::from_slice(&point[3..])))
                .collect();
            let found = RigidAlignment::between(&pairs);
            prop_assume!(found.is_some());
            let found = found.unwrap();
            prop_assert!((found.rotation.determinant() - 1.0).abs() < 1e-12);
            let cost = |alignment: &RigidAlignment| -> f64 {
                let apart = |pair: &PosePair| {
                    alignment.to_truth(pair.estimate.translation()).distance_squared(pair.truth.translation())
                };
                pairs.iter().map(apart).sum()
            };
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from(axis) * 0.01));
            let turned = RigidAlignment { rotation: turn * found.rotation, translation: turn * found.translation };
            prop_assert!(cost(&found) <= cost(&turned) + 1e-9);
        }
    }
}

//! The rigid motion between two sets of points of which many pairs are wrong (RANSAC: Fischler and Bolles, 1981).

use crate::keyframes::Random;
use crate::linear::{Eigen, Matrix6};
use crate::se3;
use glam::{DMat3, DMat4, DVec3, Vec3};
use splatseg_geometry::Pose;

/// Draws of three pairs, and how many of them at most are tried on all pairs.
const DRAWS: usize = 1500;
const TRIALS: usize = 250;

/// Sides of a triangle are compared only if they are at least this long, metres.
const MIN_SIDE: f32 = 0.15;

/// Two points of a pair.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointPair {
    /// Index of the frame's feature: of several pairs with the same feature at most one is right.
    pub(crate) feature: u16,
    /// In the frame's camera coordinates, metres.
    pub(crate) here: Vec3,
    /// In the map, metres.
    pub(crate) there: Vec3,
}

impl PointPair {
    /// Largest error of a right pair, metres: the noise of both depths, and corners that are found a pixel apart.
    fn tolerance(&self) -> f32 {
        let depth = self.here.z;
        0.035 + 0.008 * depth * depth
    }
}

/// A motion with the pairs that agree with it.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// There from here.
    pub(crate) pose: Pose,
    /// Number of features with a pair that agrees.
    pub(crate) inliers: usize,
}

/// Finds the motion that most pairs agree with. Pairs of the same feature must follow each other.
pub(crate) fn find_motion(pairs: &[PointPair], seed: u64) -> Option<Motion> {
    if pairs.len() < 3 {
        return None;
    }
    let mut random = Random(seed);
    let (mut best, mut trials): (Option<Motion>, usize) = (None, 0);
    for _ in 0..DRAWS {
        let drawn = [(); 3].map(|()| pairs[random.below(pairs.len())]);
        let Some(pose) = triangle_motion(&drawn) else { continue };
        let inliers = count_inliers(pairs, &pose);
        if best.as_ref().is_none_or(|best| inliers > best.inliers) {
            best = Some(Motion { pose, inliers });
        }
        trials += 1;
        if trials >= TRIALS {
            break;
        }
    }
    let mut best = best?;
    for _ in 0..4 {
        let pose = refined(pairs, &best.pose);
        let inliers = count_inliers(pairs, &pose);
        if inliers < best.inliers {
            break;
        }
        best = Motion { pose, inliers };
    }
    Some(best)
}

fn count_inliers(pairs: &[PointPair], pose: &Pose) -> usize {
    let local = pose.relative_to(DVec3::ZERO);
    let (mut count, mut last) = (0, None);
    for pair in pairs {
        if last != Some(pair.feature) && local.to_world(pair.here).distance(pair.there) < pair.tolerance() {
            (count, last) = (count + 1, Some(pair.feature));
        }
    }
    count
}

/// The motion of a triangle; `None` if the two triangles differ.
fn triangle_motion(pairs: &[PointPair; 3]) -> Option<Pose> {
    for (one, other) in [(0, 1), (1, 2), (2, 0)] {
        let (one, other) = (&pairs[one], &pairs[other]);
        let (here, there) = (one.here.distance(other.here), one.there.distance(other.there));
        if here < MIN_SIDE || (here - there).abs() > one.tolerance() + other.tolerance() {
            return None;
        }
    }
    let here = axes(&pairs.map(|pair| pair.here))?;
    let there = axes(&pairs.map(|pair| pair.there))?;
    let rotation = there * here.transpose();
    let mean = |points: [Vec3; 3]| (points[0] + points[1] + points[2]).as_dvec3() / 3.0;
    let translation = mean(pairs.map(|pair| pair.there)) - rotation * mean(pairs.map(|pair| pair.here));
    Pose::from_matrix(DMat4::from_mat3_translation(rotation, translation)).ok()
}

/// Axes of a triangle, as columns.
fn axes(points: &[Vec3; 3]) -> Option<DMat3> {
    let [first, second, third] = points.map(|point| point.as_dvec3());
    let x = (second - first).try_normalize()?;
    let z = x.cross(third - first).try_normalize()?;
    Some(DMat3::from_cols(x, z.cross(x), z))
}

/// The motion with the least squared error over the pairs that agree, by one Gauss-Newton step.
fn refined(pairs: &[PointPair], pose: &Pose) -> Pose {
    let mut matrix: Matrix6 = [[0.0; 6]; 6];
    let mut right = [0.0; 6];
    for pair in pairs {
        let moved = pose.to_world(pair.here);
        let error = moved - pair.there.as_dvec3();
        let tolerance = f64::from(pair.tolerance());
        if error.length() >= tolerance {
            continue;
        }
        let weight = 1.0 / (tolerance * tolerance);
        // d(exp(ξ) · moved)/dξ = [I, −moved×].
        let rotations = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis.cross(moved));
        let columns = [DVec3::X, DVec3::Y, DVec3::Z, rotations[0], rotations[1], rotations[2]];
        for (row, one) in columns.iter().enumerate() {
            right[row] += weight * one.dot(error);
            for (column, other) in columns.iter().enumerate() {
                matrix[row][column] += weight * one.dot(*other);
            }
        }
    }
    let system = Eigen::new(&matrix);
    let along = system.along(&right);
    let largest = system.values.iter().copied().fold(0.0, f64::max);
    let solved =
        std::array::from_fn(|k| if system.values[k] > 1e-9 * largest { -along[k] / system.values[k] } else { 0.0 });
    se3::exponential(&system.combined(&solved)) * *pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_motion_is_found_although_two_thirds_of_the_pairs_are_wrong(
            twist in prop::array::uniform6(-0.8f64..0.8), seed in 0u64..1000,
        ) {
            let (truth, mut random) = (se3::exponential(&twist), Random(seed));
            let mut coordinate = || random.below(4000) as f32 * 0.001 - 2.0;
            let pairs: Vec<PointPair> = (0..90u16).map(|feature| {
                let here = Vec3::new(coordinate(), coordinate(), coordinate() * 0.5 + 2.0);
                let there = if feature % 3 == 0 { truth.to_world(here).as_vec3() }
                    else { Vec3::new(coordinate(), coordinate(), coordinate()) };
                PointPair { feature, here, there }
            }).collect();
            let found = find_motion(&pairs, seed).unwrap();
            let (distance, angle) = se3::size(&(truth.inverse() * found.pose));
            let agrees = |pair: &PointPair| found.pose.to_world(pair.here).as_vec3().distance(pair.there) <= pair.tolerance();
            prop_assert!(pairs.iter().step_by(3).all(agrees), "{} {distance} {angle}", found.inliers);
            // A wrong pair that happens to agree moves the result, too.
            if found.inliers == 30 {
                prop_assert!(distance < 0.01 && angle < 0.01, "{distance} {angle}");
            }
        }
    }

    #[test]
    fn points_on_a_line_have_no_motion() {
        let pairs: Vec<PointPair> = (0..20u16)
            .map(|feature| {
                let point = Vec3::new(f32::from(feature) * 0.2, 0.0, 2.0);
                PointPair { feature, here: point, there: point }
            })
            .collect();
        assert!(find_motion(&pairs, 1).is_none());
        assert!(find_motion(&[], 1).is_none());
    }
}

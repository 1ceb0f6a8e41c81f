//! Fits a plane to points.

use glam::Vec3;

/// Rounds of power iteration; few suffice because points on a surface spread far less across it than along it.
const ROUNDS: usize = 8;

/// The direction in which points spread least, a unit vector. `offsets` are the points, relative to a point of the
/// plane, and their weights.
pub(super) fn normal(offsets: impl Iterator<Item = (Vec3, f32)>) -> Vec3 {
    let mut spread = [Vec3::ZERO; 3];
    for (offset, weight) in offsets {
        spread.iter_mut().zip(offset.to_array()).for_each(|(row, part)| *row += weight * part * offset);
    }
    least_spread(spread)
}

/// As [`normal`], from the rows of the sum of the offsets' outer products.
pub(super) fn least_spread(spread: [Vec3; 3]) -> Vec3 {
    let times = |vector: Vec3| Vec3::from(spread.map(|row| row.dot(vector)));
    // The two directions of greatest spread, from arbitrary starts; the normal is orthogonal to both.
    let (mut first, mut second) = (Vec3::new(0.57, 0.61, 0.55), Vec3::new(-0.61, 0.72, 0.33));
    for _ in 0..ROUNDS {
        first = times(first).normalize_or(Vec3::X);
        second = times(second).reject_from_normalized(first).normalize_or(first.any_orthonormal_vector());
    }
    first.cross(second)
}

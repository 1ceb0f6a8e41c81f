//! The tightest box around an object, of any orientation.

use super::OrientedBox;
use super::patches::Patch;
use super::stray::weighted_quantiles;
use glam::{DMat3, DVec3, Mat3, Quat, Vec3};
use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;

/// Share of the observations ([`Patch::weight`]) that may lie outside each face, because measurements and masks are noisy.
const TAIL: f64 = 0.005;
/// Added to each side when boxes are compared, metres, so that sides thinner than this hardly matter.
const THIN: f32 = 0.01;
/// Weight of the surface's distance from the box's faces, relative to the box's volume.
const FACE_WEIGHT: f32 = 2.0;
/// Boxes are compared on a sample of the surface with one point per cell. Number of cells along the longest side.
const CELLS: f32 = 12.0;
/// Rotations about each axis from which the search starts.
const TURNS: usize = 6;
/// Number of starts that are refined, the best ones first.
const SEARCHES: usize = 3;
/// Steps of the search, degrees.
const STEPS: [f32; 6] = [8.0, 4.0, 2.0, 1.0, 0.5, 0.25];
/// Maximum number of steps of one size.
const MAX_STEPS: usize = 16;

/// A sample of the surface.
#[derive(Clone, Copy, Debug)]
struct Sample {
    mean: Vec3,
    area: f32,
}

/// The tightest box around patches without stray ones.
pub(super) fn oriented_box(patches: &[Patch]) -> OrientedBox {
    let samples = sampled(patches);
    let mut starts: Vec<(f32, Mat3)> =
        starts(&samples).into_iter().map(|axes| (looseness(&samples, axes), axes)).collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let searched = starts.into_iter().take(SEARCHES).map(|start| searched(&samples, start));
    let best = searched.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(Mat3::IDENTITY, |(_, axes)| axes);
    box_along(patches, nearest_to_world(best))
}

/// Samples the surface: one point for each cell that it passes through.
fn sampled(patches: &[Patch]) -> Vec<Sample> {
    let (min, max) = extent(patches.iter().map(|patch| patch.mean));
    let cell = ((max - min).max_element() / CELLS).max(1e-3);
    let mut cells: BTreeMap<[i32; 3], (DVec3, f64)> = BTreeMap::new();
    for patch in patches {
        let place = ((patch.mean - min) / cell).floor().as_ivec3().to_array();
        let (sum, area) = cells.entry(place).or_default();
        *sum += f64::from(patch.area()) * patch.mean.as_dvec3();
        *area += f64::from(patch.area());
    }
    let sample = |(sum, area): (DVec3, f64)| Sample { mean: (sum / area).as_vec3(), area: area as f32 };
    cells.into_values().map(sample).collect()
}

fn extent(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), point| (min.min(point), max.max(point)))
}

/// The world's axes and the principal axes, each rotated about each of its axes.
fn starts(samples: &[Sample]) -> Vec<Mat3> {
    let mut starts = Vec::new();
    for axes in [Mat3::IDENTITY, principal_axes(samples)] {
        for axis in 0..3 {
            for turn in 0..TURNS {
                starts.push(turned(axes, axis, FRAC_PI_2 * turn as f32 / TURNS as f32));
            }
        }
    }
    starts
}

fn turned(axes: Mat3, axis: usize, angle: f32) -> Mat3 {
    Mat3::from_axis_angle(axes.col(axis).normalize(), angle) * axes
}

/// How loosely a box with these axes surrounds the surface: its volume, increased if the surface does not lie on its
/// faces. The volume alone does not determine the rotation of a corner of two walls.
fn looseness(samples: &[Sample], axes: Mat3) -> f32 {
    let box_from_world = axes.transpose();
    let (min, max) = extent(samples.iter().map(|sample| box_from_world * sample.mean));
    let size = max - min + THIN;
    let (mut distance, mut area) = (0.0, 0.0);
    for sample in samples {
        let place = box_from_world * sample.mean;
        distance += sample.area * (place - min).min(max - place).min_element();
        area += sample.area;
    }
    let mean_side = size.element_sum() / 3.0;
    size.element_product() * (1.0 + FACE_WEIGHT * distance / area.max(f32::MIN_POSITIVE) / mean_side)
}

/// Rotates the axes in smaller and smaller steps as long as the box gets tighter.
fn searched(samples: &[Sample], start: (f32, Mat3)) -> (f32, Mat3) {
    let mut best = start;
    for step in STEPS {
        for _ in 0..MAX_STEPS {
            let before = best.0;
            for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
                let axes = turned(best.1, axis, sign * step.to_radians());
                let found = looseness(samples, axes);
                if found < best.0 {
                    best = (found, axes);
                }
            }
            if best.0 >= before * 0.9999 {
                break;
            }
        }
    }
    best
}

/// The principal axes of the surface, right-handed, by Jacobi's method.
fn principal_axes(samples: &[Sample]) -> Mat3 {
    let total: f64 = samples.iter().map(|sample| f64::from(sample.area)).sum();
    let weighted = |sample: &Sample| f64::from(sample.area) / total * sample.mean.as_dvec3();
    let mean: DVec3 = samples.iter().map(weighted).sum();
    let mut spread = DMat3::ZERO;
    for sample in samples {
        let offset = sample.mean.as_dvec3() - mean;
        let weight = f64::from(sample.area) / total;
        spread += DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z) * weight;
    }
    let mut axes = DMat3::IDENTITY;
    for _ in 0..12 {
        for (first, second) in [(0, 1), (0, 2), (1, 2)] {
            let off = spread.col(second)[first];
            if off.abs() < 1e-15 {
                continue;
            }
            let angle = 0.5 * (2.0 * off).atan2(spread.col(second)[second] - spread.col(first)[first]);
            let (sine, cosine) = angle.sin_cos();
            let mut rotation = DMat3::IDENTITY;
            rotation.col_mut(first)[first] = cosine;
            rotation.col_mut(second)[second] = cosine;
            rotation.col_mut(second)[first] = sine;
            rotation.col_mut(first)[second] = -sine;
            spread = rotation.transpose() * spread * rotation;
            axes *= rotation;
        }
    }
    axes.as_mat3()
}

/// Permutes and flips the axes of a box to be as close as possible to the world's.
fn nearest_to_world(axes: Mat3) -> Mat3 {
    let mut best = (f32::NEG_INFINITY, axes);
    for [x, y, z] in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
        for signs in 0..4 {
            let sign = |bit: usize| if signs >> bit & 1 == 1 { -1.0 } else { 1.0 };
            let (first, second) = (axes.col(x) * sign(0), axes.col(y) * sign(1));
            let candidate = Mat3::from_cols(first, second, first.cross(second));
            debug_assert!(candidate.z_axis.dot(axes.col(z)).abs() > 0.99);
            // The larger the trace, the smaller the angle.
            let trace = candidate.x_axis.x + candidate.y_axis.y + candidate.z_axis.z;
            if trace > best.0 + 1e-6 {
                best = (trace, candidate);
            }
        }
    }
    best.1
}

/// The box with these axes around all patches except the outermost [`TAIL`] at each face.
fn box_along(patches: &[Patch], axes: Mat3) -> OrientedBox {
    let (mut min, mut max) = (Vec3::ZERO, Vec3::ZERO);
    for axis in 0..3 {
        let along = patches.iter().map(|patch| (axes.col(axis).dot(patch.mean), patch.weight()));
        (min[axis], max[axis]) = weighted_quantiles(&mut along.collect::<Vec<_>>(), TAIL);
    }
    let rotation = Quat::from_mat3(&axes).normalize();
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    OrientedBox { center: (axes * (0.5 * (min + max))).as_dvec3(), size: max - min, rotation }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Patches on some faces of a box: its size, its axes, and the faces by axis and sign.
    fn on_faces(size: Vec3, axes: Mat3, faces: &[(usize, f32)]) -> Vec<Patch> {
        let mut patches = Vec::new();
        for (axis, sign) in faces {
            let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
            for index in 0..=20 * 21 {
                let mut place = Vec3::ZERO;
                place[*axis] = 0.5 * sign;
                place[first] = (index % 21) as f32 / 20.0 - 0.5;
                place[second] = (index / 21) as f32 / 20.0 - 0.5;
                let area = size[first] * size[second];
                let mean = Vec3::new(3.0, -1.0, 0.5) + axes * (size * place);
                patches.push(Patch::seen(mean, 0.05 * area.sqrt()));
            }
        }
        patches
    }

    /// The lengths of the box, sorted.
    fn sorted(size: Vec3) -> [f32; 3] {
        let mut size = size.to_array();
        size.sort_by(f32::total_cmp);
        size
    }

    fn assert_fits(found: &OrientedBox, size: Vec3) {
        let off = found.center.distance(DVec3::new(3.0, -1.0, 0.5));
        assert!(off < 0.03, "{found:?}: off by {off}");
        for (found, expected) in sorted(found.size).into_iter().zip(sorted(size)) {
            assert!((found - expected).abs() < 0.04 * size.max_element(), "{found} {expected}");
        }
        assert!((found.rotation.length() - 1.0).abs() < 1e-5 && found.rotation.w >= 0.0);
    }

    #[test]
    fn a_box_in_any_direction_is_found_from_three_faces() {
        for turn in 0..12 {
            let angle = turn as f32;
            let rotation = Quat::from_euler(glam::EulerRot::XYZ, 0.7 * angle, 1.3 * angle, 2.1 * angle);
            let size = Vec3::new(0.9, 0.5, 0.3);
            let patches = on_faces(size, Mat3::from_quat(rotation), &[(0, 1.0), (1, 1.0), (2, 1.0)]);
            assert_fits(&oriented_box(&patches), size);
        }
    }

    #[test]
    fn a_corner_of_two_walls_is_not_turned_by_half_a_right_angle() {
        // All boxes around two equal walls at a right angle, whatever their turn, have about the same volume.
        let size = Vec3::new(0.6, 0.6, 1.0);
        for turn in 0..8 {
            let axes = Mat3::from_rotation_z(0.2 * turn as f32);
            assert_fits(&oriented_box(&on_faces(size, axes, &[(0, 1.0), (1, 1.0)])), size);
        }
    }

    #[test]
    fn a_plate_and_a_single_point_have_boxes_too() {
        let plate = oriented_box(&on_faces(Vec3::new(0.8, 0.5, 0.0), Mat3::from_rotation_x(0.4), &[(2, 1.0)]));
        assert_fits(&plate, Vec3::new(0.8, 0.5, 0.0));
        let patch = Patch::seen(Vec3::ONE, 0.1);
        let point = oriented_box(&[patch; 3]);
        assert_eq!((point.center, point.size, point.rotation), (DVec3::ONE, Vec3::ZERO, Quat::IDENTITY));
    }

    #[test]
    fn of_equal_boxes_the_one_along_the_world_is_described() {
        let axes = Mat3::from_cols(-Vec3::Z, Vec3::Y, Vec3::X);
        assert_eq!(nearest_to_world(axes), Mat3::IDENTITY);
        let turned = Mat3::from_rotation_z(0.3);
        let other = Mat3::from_cols(turned.y_axis, -turned.x_axis, turned.z_axis);
        assert!(nearest_to_world(other).abs_diff_eq(turned, 1e-5));
    }
}

//! Which way is up, and how high the floor is.

use crate::PlanError;
use crate::depth_points::{DepthPoints, surface_pieces};
use glam::{DMat3, DVec3, Vec3};
use splatseg_geometry::{Pose, UpEstimate};
use splatseg_objects::DepthView;
use std::collections::BTreeSet;

/// Pixels between the pieces of surface that are looked at.
const STEP: usize = 4;
/// At most about this many views are looked at.
const VIEWS: usize = 150;
/// A piece of surface is level if the cosine between its normal and up is at least this (18 degrees).
const LEVEL: f32 = 0.95;
/// Height of a bin of the histogram of level surfaces, metres.
const BIN: f32 = 0.02;
/// The floor's bin and its neighbours at this distance are one surface.
const BINS_AROUND: usize = 2;
/// The floor has at least this share of the largest level surface: a table may be seen better than the floor.
const LEAST_SHARE: f32 = 0.15;
/// The floor covers at least this area, square metres.
const LEAST_AREA: f32 = 0.5;
/// Side of the squares in which its area is counted, metres.
const SQUARE: f32 = 0.1;
/// Points at most this far from the floor improve its plane, metres.
const NEAR: f64 = 0.06;
/// Rounds of that.
const ROUNDS: usize = 4;
/// A world axis with at least this cosine to the floor's normal is up (2 degrees): worlds are given with up along an
/// axis, and the floor is not measured more exactly than that by every camera.
const AXIS: f64 = 0.9994;

/// The plane of the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Floor {
    /// Unit vector, world coordinates.
    pub up: DVec3,
    /// Distance of the floor from the world's origin along `up`, metres.
    pub height: f64,
}

/// A piece of level surface: its point relative to an origin, and its area.
type Piece = (Vec3, f32);

impl Floor {
    /// Finds the lowest large level surface. The poses give a first estimate of up, the surface itself a better one.
    pub(crate) fn find(views: &[DepthView], max_range: f32) -> Result<Self, PlanError> {
        let origin = views.first().ok_or(PlanError::NoKeyframes)?.world_from_camera.translation();
        let estimate = UpEstimate::of(views.iter().map(|view| &view.world_from_camera));
        let mut up = estimate.ok_or(PlanError::NoKeyframes)?.as_dvec3();
        let mut height = 0.0;
        let pieces = pieces(views, origin, max_range);
        for _ in 0..2 {
            let level: Vec<Piece> = pieces
                .iter()
                .filter(|(_, normal, _)| normal.dot(up.as_vec3()) >= LEVEL)
                .map(|(point, _, area)| (*point, *area))
                .collect();
            height = f64::from(lowest_surface(&level, up.as_vec3()).ok_or(PlanError::NoFloor)?);
            (up, height) = refined(&level, up, height);
        }
        let axes = [DVec3::Z, DVec3::NEG_Z, DVec3::Y, DVec3::NEG_Y, DVec3::X, DVec3::NEG_X];
        if let Some(axis) = axes.into_iter().find(|axis| axis.dot(up) >= AXIS) {
            let near: Vec<&(Vec3, Vec3, f32)> = pieces
                .iter()
                .filter(|(point, normal, _)| {
                    normal.dot(up.as_vec3()) >= LEVEL && (point.as_dvec3().dot(up) - height).abs() < NEAR
                })
                .collect();
            let total: f64 = near.iter().map(|(_, _, area)| f64::from(*area)).sum();
            let moment: f64 = near.iter().map(|(point, _, area)| f64::from(*area) * point.as_dvec3().dot(axis)).sum();
            (up, height) = (axis, if total > 0.0 { moment / total } else { height });
        }
        Ok(Self { up, height: height + origin.dot(up) })
    }
}

/// Pieces of surface of some of the views: points relative to `origin`, world axes.
fn pieces(views: &[DepthView], origin: DVec3, max_range: f32) -> Vec<(Vec3, Vec3, f32)> {
    let stride = views.len().div_ceil(VIEWS).max(1);
    let of = |view: &DepthView| surface_pieces(&DepthPoints::new(view, &Pose::IDENTITY, origin, max_range), STEP);
    views.iter().step_by(stride).flat_map(of).collect()
}

/// Height of the lowest of the large level surfaces along `up`.
fn lowest_surface(level: &[Piece], up: Vec3) -> Option<f32> {
    let height = |piece: &Piece| piece.0.dot(up);
    let lowest = level.iter().map(height).fold(f32::INFINITY, f32::min);
    let highest = level.iter().map(height).fold(f32::NEG_INFINITY, f32::max);
    // Nobody looks at floors that are a kilometre apart.
    let bins = (((highest - lowest) / BIN).min(1e5) as usize) + 1;
    let mut areas = vec![0.0_f32; if level.is_empty() { 0 } else { bins }];
    for piece in level {
        let bin = ((height(piece) - lowest) / BIN) as usize;
        areas[bin.min(bins - 1)] += piece.1;
    }
    let smooth: Vec<f32> = (0..areas.len())
        .map(|bin| areas[bin.saturating_sub(BINS_AROUND)..(bin + BINS_AROUND + 1).min(areas.len())].iter().sum())
        .collect();
    let largest = smooth.iter().copied().fold(0.0, f32::max);
    let is_peak = |bin: usize| {
        let around = &smooth[bin.saturating_sub(2 * BINS_AROUND)..(bin + 2 * BINS_AROUND + 1).min(smooth.len())];
        smooth[bin] >= LEAST_SHARE * largest && around.iter().all(|other| *other <= smooth[bin])
    };
    let candidates = (0..smooth.len()).filter(|bin| is_peak(*bin)).map(|bin| lowest + (bin as f32 + 0.5) * BIN);
    candidates.into_iter().find(|height| covered(level, up, *height) >= LEAST_AREA)
}

/// The area of the floor plan that level pieces near a height cover, square metres.
fn covered(level: &[Piece], up: Vec3, height: f32) -> f32 {
    let (first, second) = up.any_orthonormal_pair();
    let near = level.iter().filter(|(point, _)| (point.dot(up) - height).abs() < 2.5 * BIN);
    let square =
        |(point, _): &Piece| [first, second].map(|axis| (point.dot(axis) / SQUARE).floor().clamp(-1e6, 1e6) as i32);
    near.map(square).collect::<BTreeSet<[i32; 2]>>().len() as f32 * SQUARE * SQUARE
}

/// The plane with the least squared distances from the pieces near it.
fn refined(level: &[Piece], mut up: DVec3, mut height: f64) -> (DVec3, f64) {
    for _ in 0..ROUNDS {
        let near = || level.iter().filter(|(point, _)| (point.as_dvec3().dot(up) - height).abs() < NEAR);
        let total: f64 = near().map(|(_, area)| f64::from(*area)).sum();
        if total <= 0.0 {
            break;
        }
        let mean = near().map(|(point, area)| point.as_dvec3() * f64::from(*area)).sum::<DVec3>() / total;
        let mut spread = DMat3::ZERO;
        for (point, area) in near() {
            let offset = point.as_dvec3() - mean;
            let weight = f64::from(*area) / total;
            spread += DMat3::from_cols(offset * offset.x, offset * offset.y, offset * offset.z) * weight;
        }
        // The normal is the direction of least spread: inverse iteration from the estimate so far.
        let trace = spread.x_axis.x + spread.y_axis.y + spread.z_axis.z;
        let inverse = (spread + DMat3::IDENTITY * (1e-6 * trace.max(1e-12))).inverse();
        let normal = (0..30).fold(up, |normal, _| (inverse * normal).try_normalize().unwrap_or(normal));
        if !normal.is_finite() || normal.dot(up) < 0.9 {
            break;
        }
        (up, height) = (normal, mean.dot(normal));
    }
    (up, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pieces of a square of side `side` metres whose normal is `up`, at a height.
    fn square(up: Vec3, height: f32, side: f32) -> Vec<Piece> {
        let (first, second) = up.any_orthonormal_pair();
        let place = |index: usize| {
            let (x, y) = ((index % 40) as f32 / 40.0 - 0.5, (index / 40) as f32 / 40.0 - 0.5);
            up * height + side * (first * x + second * y)
        };
        (0..1600).map(|index| (place(index), side * side / 1600.0)).collect()
    }

    #[test]
    fn the_floor_is_the_lowest_large_surface_even_if_a_table_is_larger() {
        let up = Vec3::new(0.1, -0.2, 1.0).normalize();
        let level = [square(up, -1.31, 1.5), square(up, -0.6, 3.0), square(up, -1.9, 0.3)].concat();
        let found = lowest_surface(&level, up).unwrap();
        assert!((found + 1.31).abs() < NEAR as f32, "{found}");
        assert_eq!(lowest_surface(&square(up, 0.0, 0.4), up), None, "too small");
        assert_eq!(lowest_surface(&[], up), None);
    }

    #[test]
    fn the_plane_of_the_floor_gives_up_exactly() {
        let up = Vec3::new(0.03, -0.05, 1.0).normalize();
        let (found, height) = refined(&square(up, -1.2, 4.0), Vec3::new(0.05, -0.04, 1.0).normalize().as_dvec3(), -1.2);
        assert!(found.dot(up.as_dvec3()) > 1.0 - 1e-6, "{found}");
        assert!((height + 1.2).abs() < 1e-3, "{height}");
    }
}

//! Depth of segments that the sensor cannot measure: screens, glass, black worktops (docs/PAPER.md, "Memory").
//!
//! A segment without depth in most of its pixels is assumed to continue the plane of the surface around it, so that
//! Gaussians can be added there and remember it. Without a surface nearby, it is assumed to be far away, like sky. This
//! is not in the paper.

use crate::recall::Recall;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use splatseg_geometry::{Image, SegmentId, SegmentMap, distance_transform};
use std::collections::BTreeMap;

/// A segment is completed if at least this share of it has no depth.
const MIN_SHARE: f32 = 0.8;

/// Maximum city-block distance of the surface around a segment from the segment's pixels without depth, pixels.
const REACH: u32 = 12;

/// Minimum number of pixels of the surrounding surface for fitting a plane.
const MIN_SURFACE: usize = 30;

/// Assumed distance of segments without a surrounding surface, metres.
const FAR: f64 = 50.0;

/// Number of plane fits. Each fit gives less weight to pixels far from the previous plane.
const FITS: usize = 5;

/// Relative residual below which pixels have equal weight.
const MIN_RESIDUAL: f64 = 0.01;

/// Returns the frame's depth, completed where segments of `predicted` have no depth and the map has no surface either;
/// `None` if there is nothing to complete. `is_covered` returns true for pixels whose surface the map has.
pub(crate) fn completed_depth(
    recall: &Recall<'_>,
    predicted: &SegmentMap,
    is_covered: impl Fn(usize) -> bool + Sync,
) -> Option<Image<f32>> {
    let observed = recall.frame.depth();
    let surface = |index: usize| match observed.pixels()[index] {
        depth if depth > 0.0 => depth,
        _ if is_covered(index) => recall.depth.pixels()[index],
        _ => 0.0,
    };
    let incomplete = incomplete_segments(predicted, observed.pixels(), &surface);
    if incomplete.is_empty() {
        return None;
    }
    let planes: Vec<(Crop, SegmentId, DVec3)> =
        incomplete.into_par_iter().map(|(id, crop)| (crop, id, plane_around(id, &crop, predicted, &surface))).collect();
    let mut depth = Image::from_fn(observed.width(), observed.height(), |column, row| observed[(column, row)]);
    for (crop, id, plane) in planes {
        for index in crop.pixels(predicted.width()) {
            if predicted.pixels()[index] == id && surface(index) == 0.0 {
                depth.pixels_mut()[index] = (1.0 / plane.dot(homogeneous(index, predicted.width()))) as f32;
            }
        }
    }
    Some(depth)
}

/// A rectangle of pixels: first and last columns and rows.
#[derive(Clone, Copy, Debug)]
struct Crop {
    columns: (usize, usize),
    rows: (usize, usize),
}

impl Crop {
    fn size(&self) -> (usize, usize) {
        (self.columns.1 + 1 - self.columns.0, self.rows.1 + 1 - self.rows.0)
    }

    /// Row-major indices in an image of this width.
    fn pixels(&self, width: usize) -> impl Iterator<Item = usize> + '_ {
        let columns = self.columns.0..=self.columns.1;
        (self.rows.0..=self.rows.1).flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }

    fn grown(&self, by: usize, (width, height): (usize, usize)) -> Self {
        Self {
            columns: (self.columns.0.saturating_sub(by), (self.columns.1 + by).min(width - 1)),
            rows: (self.rows.0.saturating_sub(by), (self.rows.1 + by).min(height - 1)),
        }
    }
}

/// Returns the segments that lack depth in enough of their pixels, and have pixels without any surface, each with the
/// bounding box of the latter.
fn incomplete_segments(
    predicted: &SegmentMap,
    observed: &[f32],
    surface: &impl Fn(usize) -> f32,
) -> BTreeMap<SegmentId, Crop> {
    let mut areas: BTreeMap<SegmentId, (usize, usize)> = BTreeMap::new();
    let mut crops: BTreeMap<SegmentId, Crop> = BTreeMap::new();
    for (index, (id, observed)) in predicted.pixels().iter().zip(observed).enumerate().filter(|(_, (id, _))| **id != 0)
    {
        let (area, missing) = areas.entry(*id).or_default();
        *area += 1;
        if *observed > 0.0 {
            continue;
        }
        *missing += 1;
        if surface(index) == 0.0 {
            let (column, row) = (index % predicted.width(), index / predicted.width());
            let crop = crops.entry(*id).or_insert(Crop { columns: (column, column), rows: (row, row) });
            crop.columns = (crop.columns.0.min(column), crop.columns.1.max(column));
            crop.rows.1 = row;
        }
    }
    crops.retain(|id, _| {
        let (area, missing) = areas[id];
        missing as f32 >= MIN_SHARE * area as f32
    });
    crops
}

/// Returns the plane `p` with inverse depth `p · (column, row, 1)` of the surface around a segment's missing pixels. It
/// is fitted to the segment's own surface if there is enough of it: a screen lies in the plane of its frame, not of the
/// wall behind.
fn plane_around(id: SegmentId, crop: &Crop, predicted: &SegmentMap, surface: &impl Fn(usize) -> f32) -> DVec3 {
    let around = crop.grown(REACH as usize, predicted.size());
    let indices: Vec<usize> = around.pixels(predicted.width()).collect();
    let is_missing = |place: usize| predicted.pixels()[indices[place]] == id && surface(indices[place]) == 0.0;
    let distances = distance_transform(around.size(), is_missing);
    let near = indices.iter().zip(distances).filter(|(index, distance)| *distance <= REACH && surface(**index) > 0.0);
    let all: Vec<usize> = near.map(|(index, _)| *index).collect();
    let own: Vec<usize> = all.iter().copied().filter(|index| predicted.pixels()[*index] == id).collect();
    let points = if own.len() >= MIN_SURFACE { own } else { all };
    if points.len() < MIN_SURFACE {
        return DVec3::new(0.0, 0.0, 1.0 / FAR);
    }
    let points: Vec<(DVec3, f64)> = points
        .into_iter()
        .map(|index| (homogeneous(index, predicted.width()), 1.0 / f64::from(surface(index))))
        .collect();
    let plane = fitted_plane(&points);
    // If the plane's depth runs away over the segment, use a plane parallel to the image instead.
    let (least, most) = points
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(least, most), (_, inverse)| (least.min(*inverse), most.max(*inverse)));
    let holds = |plane: &DVec3| {
        let inverses = crop.corners().map(|corner| plane.dot(corner));
        inverses.iter().all(|inverse| (0.5 * least..=2.0 * most).contains(inverse))
    };
    plane.filter(holds).unwrap_or_else(|| {
        let mean = points.iter().map(|(_, inverse)| inverse).sum::<f64>() / points.len() as f64;
        DVec3::new(0.0, 0.0, mean)
    })
}

impl Crop {
    /// The corner pixels as (column, row, 1).
    fn corners(&self) -> [DVec3; 4] {
        let corner = |column: usize, row: usize| DVec3::new(column as f64, row as f64, 1.0);
        let ((left, right), (top, bottom)) = (self.columns, self.rows);
        [corner(left, top), corner(right, top), corner(left, bottom), corner(right, bottom)]
    }
}

/// Returns a pixel as (column, row, 1): planes in space are planes in column, row and inverse depth.
fn homogeneous(index: usize, width: usize) -> DVec3 {
    DVec3::new((index % width) as f64, (index / width) as f64, 1.0)
}

/// Fits the plane with the least absolute residuals, relative to the inverse depths, by reweighted least squares.
/// Returns `None` if the points lie on a line.
fn fitted_plane(points: &[(DVec3, f64)]) -> Option<DVec3> {
    let mean = points.iter().map(|(at, _)| *at).sum::<DVec3>() / points.len() as f64;
    let mut plane: Option<DVec3> = None;
    for _ in 0..FITS {
        let (mut squares, mut products) = (DMat3::ZERO, DVec3::ZERO);
        for (at, inverse) in points {
            let at = DVec3::new(at.x - mean.x, at.y - mean.y, 1.0);
            let residual = plane.map_or(0.0, |plane| (1.0 - plane.dot(at) / inverse).abs());
            let weight = 1.0 / residual.max(MIN_RESIDUAL);
            squares += weight * DMat3::from_cols(at * at.x, at * at.y, at);
            products += weight * *inverse * at;
        }
        // Points on a line have a determinant of about 0. Pixels spread over two lines have a far larger one.
        if squares.determinant() <= squares.z_axis.z.powi(3) {
            return None;
        }
        plane = Some(squares.inverse() * products);
    }
    plane.map(|plane| DVec3::new(plane.x, plane.y, plane.z - plane.x * mean.x - plane.y * mean.y))
}

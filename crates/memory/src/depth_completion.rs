//! Depth of segments that the sensor cannot measure: screens, glass, black worktops (docs/PAPER.md, "Memory").
//!
//! A segment without depth in most of its pixels is assumed to continue the plane of the surface around it, so that
//! Gaussians can be added there and remember it. Without a surface nearby, it is assumed to be far away, like sky. This
//! is not in the paper.
//!
//! A pixel counts as a surface continued ([`SurfaceKind::Continued`]) only if it lies between two pixels that the plane is
//! fitted to, left and right or above and below, also in depth, and at least half of all these were measured. Otherwise
//! its depth is a guess, or continues one.

use crate::recall::Recall;
use crate::settings::COVERED;
use crate::tile_surface::{RUN, run, run_mut};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use splatseg_geometry::{Image, SegmentId, SegmentMap, SurfaceKind, distance_transform};
use splatseg_kernels::{Instructions, Vectorize};
use splatseg_render::TileWeights;
use std::collections::BTreeMap;

/// A segment is completed if at least this share of it has no depth.
const MIN_SHARE: f32 = 0.8;

/// Maximum city-block distance of the surface around a segment from the segment's pixels without depth, pixels.
const REACH: u32 = 12;

/// Minimum number of pixels of the surrounding surface for fitting a plane.
const MIN_SURFACE: usize = 30;

/// Assumed distance of segments without a surrounding surface, metres.
const FAR: f64 = 50.0;

/// Maximum relative deviation of a continued pixel's inverse depth from the line between two points of the surface.
const MAX_OFF_LINE: f64 = 0.03;

/// Number of plane fits. Each fit gives less weight to pixels far from the previous plane.
const FITS: usize = 5;

/// Relative residual below which pixels have equal weight.
const MIN_RESIDUAL: f64 = 0.01;

/// A frame's depth, completed.
pub(crate) struct CompletedDepth {
    /// z-depth in metres, 0 where still missing, `[height, width]`.
    pub depth: Image<f32>,
    /// Whether the depth of each pixel was measured or completed, `[height, width]`.
    pub surfaces: Image<SurfaceKind>,
}

/// The plane that a segment is assumed to lie in.
struct Completion {
    id: SegmentId,
    /// The segment's pixels without any surface.
    crop: Crop,
    /// Inverse depth `p · (column, row, 1)`.
    plane: DVec3,
    /// The surface that it is fitted to; `None` if too little of it was measured.
    fitted: Option<FittedSurface>,
}

/// The outermost pixels of a surface in each row and column.
#[derive(Default)]
struct FittedSurface {
    rows: BTreeMap<usize, Span>,
    columns: BTreeMap<usize, Span>,
}

/// Two pixels of a row or column: their places, and their inverse depths.
struct Span {
    places: (usize, usize),
    inverses: (f64, f64),
}

impl FittedSurface {
    fn include(&mut self, (column, row): (usize, usize), inverse: f64) {
        for (spans, line, place) in [(&mut self.rows, row, column), (&mut self.columns, column, row)] {
            let span = spans.entry(line).or_insert(Span { places: (place, place), inverses: (inverse, inverse) });
            if place < span.places.0 {
                span.places.0 = place;
                span.inverses.0 = inverse;
            }
            if place > span.places.1 {
                span.places.1 = place;
                span.inverses.1 = inverse;
            }
        }
    }

    /// True if a pixel of this inverse depth lies on the line between two points of the surface.
    fn surrounds(&self, (column, row): (usize, usize), inverse: f64) -> bool {
        let is_on = |span: Option<&Span>, place: usize| span.is_some_and(|span| span.contains(place, inverse));
        is_on(self.rows.get(&row), column) || is_on(self.columns.get(&column), row)
    }
}

impl Span {
    fn contains(&self, place: usize, inverse: f64) -> bool {
        let (first, last) = self.places;
        if !(first..=last).contains(&place) {
            return false;
        }
        let share = (place - first) as f64 / (last - first).max(1) as f64;
        let between = self.inverses.0 + share * (self.inverses.1 - self.inverses.0);
        (inverse / between - 1.0).abs() <= MAX_OFF_LINE
    }
}

impl Completion {
    /// The inverse depth at a pixel, and what is known about it.
    fn at(&self, index: usize, width: usize) -> (f64, SurfaceKind) {
        let inverse = self.plane.dot(homogeneous(index, width));
        let pixel = (index % width, index / width);
        let is_continued = self.fitted.as_ref().is_some_and(|surface| surface.surrounds(pixel, inverse));
        (inverse, if is_continued { SurfaceKind::Continued } else { SurfaceKind::Assumed })
    }
}

/// Returns the frame's depth, completed where segments of `predicted` have no depth and the map has no surface either;
/// `None` if there is nothing to complete. `surfaces` has one entry for each Gaussian of the map.
pub(crate) fn completed_depth(
    recall: &Recall<'_>,
    predicted: &SegmentMap,
    surfaces: &[SurfaceKind],
) -> Option<CompletedDepth> {
    let observed = recall.frame.depth();
    let is_covered = |index: usize| recall.covered.pixels()[index] >= COVERED;
    let surface = |index: usize| match observed.pixels()[index] {
        depth if depth > 0.0 => depth,
        _ if is_covered(index) => recall.depth.pixels()[index],
        _ => 0.0,
    };
    let incomplete = incomplete_segments(predicted, observed.pixels(), &surface);
    if incomplete.is_empty() {
        return None;
    }
    let from_measured = weights_of_measured(recall, surfaces);
    let is_measured = |index: usize| {
        let (measured, all) = (from_measured.pixels()[index], recall.silhouette.pixels()[index]);
        observed.pixels()[index] > 0.0 || 2.0 * measured >= all
    };
    let completion = |(id, crop)| completion(id, crop, predicted, &surface, &is_measured);
    let completions: Vec<Completion> = incomplete.into_par_iter().map(completion).collect();
    let mut depth = Image::from_fn(observed.width(), observed.height(), |column, row| observed[(column, row)]);
    let mut surfaces = Image::filled(observed.width(), observed.height(), SurfaceKind::Observed);
    for completion in completions {
        for index in completion.crop.pixels(predicted.width()) {
            if predicted.pixels()[index] == completion.id && surface(index) == 0.0 {
                let (inverse, kind) = completion.at(index, predicted.width());
                depth.pixels_mut()[index] = (1.0 / inverse) as f32;
                surfaces.pixels_mut()[index] = kind;
            }
        }
    }
    Some(CompletedDepth { depth, surfaces })
}

/// The part of the rendered silhouette, 0 to 1, that shows observed Gaussians, `[height, width]`.
fn weights_of_measured(recall: &Recall<'_>, surfaces: &[SurfaceKind]) -> Image<f32> {
    if surfaces.iter().all(|surface| *surface == SurfaceKind::Observed) {
        return recall.silhouette.clone();
    }
    let tiles = recall.view.weights().tiles();
    let sums_of = |tile| Instructions::best().run(SumMeasured { tile, surfaces });
    let sums: Vec<[f32; TileWeights::PIXELS]> = tiles.par_iter().map(sums_of).collect();
    let mut measured = Image::filled(recall.frame.width(), recall.frame.height(), 0.0);
    for (tile, sums) in tiles.iter().zip(&sums) {
        let ((left, top), (width, height)) = (tile.origin(), tile.size());
        for row in 0..height {
            let (from, to) = (row * TileWeights::SIDE, (top + row) * recall.frame.width() + left);
            measured.pixels_mut()[to..to + width].copy_from_slice(&sums[from..from + width]);
        }
    }
    measured
}

/// The sums of [`weights_of_measured`] in one tile.
struct SumMeasured<'a> {
    tile: &'a TileWeights,
    surfaces: &'a [SurfaceKind],
}

impl Vectorize for SumMeasured<'_> {
    type Output = [f32; TileWeights::PIXELS];

    #[inline(always)]
    fn run(self) -> [f32; TileWeights::PIXELS] {
        let mut sums = [0f32; TileWeights::PIXELS];
        for column in 0..self.tile.gaussians().len() {
            if self.surfaces[self.tile.gaussians()[column] as usize] != SurfaceKind::Observed {
                continue;
            }
            let (firsts, weights) = self.tile.runs(column);
            for index in 0..firsts.len().min(weights.len()) {
                let (mut sum, weights) = (*run(&sums, firsts[index]), weights[index]);
                for lane in 0..RUN {
                    sum[lane] += weights[lane];
                }
                *run_mut(&mut sums, firsts[index]) = sum;
            }
        }
        sums
    }
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

/// Returns the plane of the surface around a segment's missing pixels. It is fitted to the segment's own surface if there
/// is enough of it: a screen lies in the plane of its frame, not of the wall behind. `is_measured` returns true for pixels
/// whose surface was measured, now or before.
fn completion(
    id: SegmentId,
    crop: Crop,
    predicted: &SegmentMap,
    surface: &impl Fn(usize) -> f32,
    is_measured: &impl Fn(usize) -> bool,
) -> Completion {
    let around = crop.grown(REACH as usize, predicted.size());
    let indices: Vec<usize> = around.pixels(predicted.width()).collect();
    let is_missing = |place: usize| predicted.pixels()[indices[place]] == id && surface(indices[place]) == 0.0;
    let distances = distance_transform(around.size(), is_missing);
    let near = indices.iter().zip(distances).filter(|(index, distance)| *distance <= REACH && surface(**index) > 0.0);
    let all: Vec<usize> = near.map(|(index, _)| *index).collect();
    let own: Vec<usize> = all.iter().copied().filter(|index| predicted.pixels()[*index] == id).collect();
    let points = if own.len() >= MIN_SURFACE { own } else { all };
    if points.len() < MIN_SURFACE {
        return Completion { id, crop, plane: DVec3::new(0.0, 0.0, 1.0 / FAR), fitted: None };
    }
    let is_known = 2 * points.iter().filter(|index| is_measured(**index)).count() >= points.len();
    let mut fitted = FittedSurface::default();
    for index in &points {
        fitted.include((index % predicted.width(), index / predicted.width()), 1.0 / f64::from(surface(*index)));
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
    let plane = plane.filter(holds).unwrap_or_else(|| {
        let mean = points.iter().map(|(_, inverse)| inverse).sum::<f64>() / points.len() as f64;
        DVec3::new(0.0, 0.0, mean)
    });
    Completion { id, crop, plane, fitted: is_known.then_some(fitted) }
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

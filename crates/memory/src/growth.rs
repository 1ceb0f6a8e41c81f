//! New Gaussians for the surfaces that a frame shows and the map lacks (docs/PAPER.md, "Memory").
//!
//! Two rules. The paper's ([`grow_per_pixel`], SplaTAM's) adds one Gaussian for every pixel that nothing covers, or
//! whose observed depth disagrees with the rendered one. Ours ([`grow_missing`]) adds only missing surfaces: a surface
//! is missing where the Gaussians up to its depth let most of the light through. So no Gaussian is added behind a
//! surface that the map already shows, where it would never be seen, or where Gaussians of the same surface lie. Inside
//! a segment, one Gaussian stands for a block of pixels; blocks grow with the distance to the nearest border.

use crate::borders::{Borders, MAX_DISTANCE};
use crate::depth_completion::{CompletedDepth, completed_depth};
use crate::map::{NewGaussian, RADIUS_PER_SPACING};
use crate::recall::Recall;
use crate::settings::{COVERED, RELATIVE_TOLERANCE};
use crate::{MemoryRules, MemorySettings};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image, LocalPose, RgbdFrame, SegmentMap, SurfaceKind};

/// Maximum spacing of Gaussians inside a segment, in units of the distance to the nearest border.
const SPACING_PER_DISTANCE: f32 = 2.0;

/// Returns the Gaussians that the growth rule in force adds to a map whose Gaussians have these `surfaces`.
pub(crate) fn new_gaussians(
    recall: &Recall<'_>,
    predicted: &SegmentMap,
    surfaces: &[SurfaceKind],
    (settings, rules): (&MemorySettings, &MemoryRules),
) -> Vec<NewGaussian> {
    match rules.is_papers_map() {
        true => grow_per_pixel(recall, settings),
        false => grow_missing(recall, predicted, surfaces, settings),
    }
}

/// Returns the Gaussians that the paper's rule adds.
fn grow_per_pixel(recall: &Recall<'_>, settings: &MemorySettings) -> Vec<NewGaussian> {
    let frame = recall.frame;
    let focal = focal_length(frame);
    (0..frame.height())
        .into_par_iter()
        .flat_map_iter(|row| {
            (0..frame.width()).filter_map(move |column| {
                let depth = frame.depth()[(column, row)];
                let uncovered = recall.silhouette[(column, row)] < settings.growth_silhouette;
                let disparity = (depth - recall.depth[(column, row)]).abs();
                if depth <= 0.0 || !(uncovered || disparity > settings.depth_disparity) {
                    return None;
                }
                let point_camera = frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                Some(NewGaussian {
                    pixel: row * frame.width() + column,
                    mean: recall.map_from_camera.to_world(point_camera),
                    radius: depth / focal,
                    color: frame.color()[(column, row)],
                    surface: SurfaceKind::Observed,
                })
            })
        })
        .collect()
}

/// Returns the Gaussians that the map lacks, small ones at the borders of predictions.
fn grow_missing(
    recall: &Recall<'_>,
    predicted: &SegmentMap,
    surfaces: &[SurfaceKind],
    settings: &MemorySettings,
) -> Vec<NewGaussian> {
    let frame = recall.frame;
    let completed = completed_depth(recall, predicted, surfaces);
    let depth =
        completed.as_ref().map_or_else(|| frame.depth().as_borrowed(), |completed| completed.depth.as_borrowed());
    let borders = Borders::new(&depth, predicted, RELATIVE_TOLERANCE);
    let states = Image::from_fn(frame.width(), frame.height(), |column, row| {
        let at = (column, row);
        match () {
            () if depth[at] <= 0.0 => PixelState::Skipped,
            () if recall.covered[at] >= COVERED => PixelState::Skipped,
            () if borders.is_mixed(at) => PixelState::Mixed,
            () => PixelState::Missing,
        }
    });
    let map_from_camera = recall.map_from_camera;
    let growth = Growth {
        frame,
        depth: &depth,
        completed: completed.as_ref(),
        map_from_camera,
        borders: &borders,
        states: &states,
        settings,
        focal: focal_length(frame),
    };
    // A power of two, so that quarters of blocks cover them.
    let smallest_side = frame.width().min(frame.height()).max(1);
    let largest = settings.growth_spacing.min(1 << smallest_side.ilog2());
    (0..frame.height())
        .into_par_iter()
        .step_by(largest)
        .flat_map_iter(|top| {
            let mut added = Vec::new();
            for left in (0..frame.width()).step_by(largest) {
                growth.add_block(left, top, largest, &mut added);
            }
            added
        })
        .collect()
}

/// Mean focal length of both axes: pixels are square except for rounding.
fn focal_length(frame: &RgbdFrame) -> f32 {
    0.5 * (frame.intrinsics().fx + frame.intrinsics().fy)
}

/// State of a pixel in growth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PixelState {
    /// No depth, or the map has its surface: a neighbour's Gaussian may cover it.
    Skipped,
    /// Its depth may be a mixture of two surfaces: no Gaussian may cover it.
    Mixed,
    /// Its surface is missing.
    Missing,
}

struct Growth<'a> {
    frame: &'a RgbdFrame<'a>,
    /// The frame's depth, completed.
    depth: &'a CowImage<'a, f32>,
    completed: Option<&'a CompletedDepth>,
    map_from_camera: LocalPose,
    borders: &'a Borders,
    states: &'a Image<PixelState>,
    settings: &'a MemorySettings,
    focal: f32,
}

impl Growth<'_> {
    /// Adds one Gaussian for a block of pixels, or several for its quarters.
    fn add_block(&self, left: usize, top: usize, side: usize, added: &mut Vec<NewGaussian>) {
        let columns = left..(left + side).min(self.frame.width());
        let rows = top..(top + side).min(self.frame.height());
        let (mut missing, mut has_mixed) = (0, false);
        let mut distance = MAX_DISTANCE;
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        for row in rows.clone() {
            for column in columns.clone() {
                distance = distance.min(self.borders.distance((column, row)));
                match self.states[(column, row)] {
                    PixelState::Skipped => {}
                    PixelState::Mixed => has_mixed = true,
                    PixelState::Missing => {
                        let depth = self.depth[(column, row)];
                        (nearest, farthest) = (nearest.min(depth), farthest.max(depth));
                        missing += 1;
                    }
                }
            }
        }
        if missing == 0 {
            return;
        }
        let is_far_from_borders = side as f32 <= SPACING_PER_DISTANCE * distance as f32;
        // A Gaussian farther than the tolerance behind a pixel's surface would not count as that surface.
        let is_one_surface = farthest - nearest <= self.settings.tolerance_at(nearest);
        if side == 1 || (!has_mixed && 2 * missing >= side * side && is_far_from_borders && is_one_surface) {
            added.extend(self.gaussian(columns, rows, side));
            return;
        }
        let half = side / 2;
        for (left, top) in [(left, top), (left + half, top), (left, top + half), (left + half, top + half)] {
            if left < self.frame.width() && top < self.frame.height() {
                self.add_block(left, top, half, added);
            }
        }
    }

    /// Returns the Gaussian for the pixels of a block whose surface is missing.
    fn gaussian(
        &self,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
        side: usize,
    ) -> Option<NewGaussian> {
        let mut count = 0.0;
        let (mut sum, mut color_sum) = (Vec3::ZERO, [0.0; 3]);
        let (mut pixel, mut surface) = (None, SurfaceKind::Observed);
        for row in rows {
            for column in columns.clone().filter(|column| self.states[(*column, row)] == PixelState::Missing) {
                let depth = self.depth[(column, row)];
                sum += self.frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                for (sum, channel) in color_sum.iter_mut().zip(self.frame.color()[(column, row)]) {
                    *sum += f32::from(channel);
                }
                count += 1.0;
                surface = surface.max(self.surface((column, row)));
                pixel.get_or_insert(row * self.frame.width() + column);
            }
        }
        let mean_camera = sum / count;
        Some(NewGaussian {
            pixel: pixel?,
            mean: self.map_from_camera.to_world(mean_camera),
            radius: RADIUS_PER_SPACING * side as f32 * mean_camera.z / self.focal,
            color: color_sum.map(|sum| (sum / count).round() as u8),
            surface,
        })
    }

    /// Whether a pixel's depth was measured or completed.
    fn surface(&self, at: (usize, usize)) -> SurfaceKind {
        match self.completed {
            Some(completed) => completed.surfaces[at],
            None => SurfaceKind::Observed,
        }
    }
}

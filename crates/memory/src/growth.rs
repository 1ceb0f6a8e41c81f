//! Where a frame shows a surface that the map lacks: new Gaussians (docs/METHOD.md, "Memory").
//!
//! Two rules. The paper's ([`by_paper`], SplaTAM's) adds one Gaussian for every pixel that nothing covers, or whose
//! observed depth disagrees with the rendered one. Ours ([`missing`]) adds only what is missing: a surface is missing
//! where the Gaussians up to its depth let most of the light through. So nothing is added behind what the map shows
//! already, where it would never be seen, nor where Gaussians of the same surface lie. Inside a segment one Gaussian
//! stands for a block of pixels, the larger the farther the next border is.

use crate::borders::{Borders, MAX_DISTANCE};
use crate::map::NewGaussian;
use crate::recall::Recall;
use crate::{GrowthRule, MemorySettings};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::{Image, LocalPose, RgbdFrame, SegmentMap};

/// The Gaussians to be added by the rule that `settings` ask for. `seen` are the frame's predictions.
pub(crate) fn new_gaussians(recall: &Recall<'_>, seen: &SegmentMap, settings: &MemorySettings) -> Vec<NewGaussian> {
    match settings.growth_rule() {
        GrowthRule::Paper => by_paper(recall, settings),
        _ => missing(recall, seen, settings),
    }
}

/// The Gaussians that the paper's rule adds.
fn by_paper(recall: &Recall<'_>, settings: &MemorySettings) -> Vec<NewGaussian> {
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
                })
            })
        })
        .collect()
}

/// The Gaussians that the map lacks. `seen` are the frame's predictions, whose borders get fine ones.
fn missing(recall: &Recall<'_>, seen: &SegmentMap, settings: &MemorySettings) -> Vec<NewGaussian> {
    let frame = recall.frame;
    let borders = Borders::new(frame.depth(), seen, settings.edge_disparity);
    let wanted = Image::from_fn(frame.width(), frame.height(), |column, row| {
        let at = (column, row);
        match () {
            () if frame.depth()[at] <= 0.0 => Want::Nothing,
            () if recall.covered[at] >= settings.growth_coverage => Want::Nothing,
            () if borders.is_mixed(at) => Want::Refused,
            () => Want::Gaussian,
        }
    });
    let map_from_camera = recall.map_from_camera;
    let growth =
        Growth { frame, map_from_camera, borders: &borders, wanted: &wanted, settings, focal: focal_length(frame) };
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

/// One number for both axes: pixels are square but for rounding.
fn focal_length(frame: &RgbdFrame) -> f32 {
    0.5 * (frame.intrinsics().fx + frame.intrinsics().fy)
}

/// What a pixel asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Want {
    /// It has no depth, or its surface is known: a Gaussian of others may cover it.
    Nothing,
    /// It must not get a Gaussian.
    Refused,
    /// Its surface is missing.
    Gaussian,
}

struct Growth<'a> {
    frame: &'a RgbdFrame<'a>,
    map_from_camera: LocalPose,
    borders: &'a Borders,
    wanted: &'a Image<Want>,
    settings: &'a MemorySettings,
    focal: f32,
}

impl Growth<'_> {
    /// Adds one Gaussian for a block of pixels, or several for its quarters.
    fn add_block(&self, left: usize, top: usize, side: usize, added: &mut Vec<NewGaussian>) {
        let columns = left..(left + side).min(self.frame.width());
        let rows = top..(top + side).min(self.frame.height());
        let (mut wanting, mut refusing) = (0, false);
        let mut distance = MAX_DISTANCE;
        let (mut nearest, mut farthest) = (f32::INFINITY, 0.0f32);
        for row in rows.clone() {
            for column in columns.clone() {
                distance = distance.min(self.borders.distance((column, row)));
                match self.wanted[(column, row)] {
                    Want::Nothing => {}
                    Want::Refused => refusing = true,
                    Want::Gaussian => {
                        let depth = self.frame.depth()[(column, row)];
                        (nearest, farthest) = (nearest.min(depth), farthest.max(depth));
                        wanting += 1;
                    }
                }
            }
        }
        if wanting == 0 {
            return;
        }
        let is_far_from_borders = side as f32 <= self.settings.spacing_per_distance * distance as f32;
        // A Gaussian farther behind a pixel's surface than that would not count as that surface.
        let is_one_surface = farthest - nearest <= self.settings.depth_disparity;
        if side == 1 || (!refusing && 2 * wanting >= side * side && is_far_from_borders && is_one_surface) {
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

    /// The Gaussian that stands for the wanting pixels of a block.
    fn gaussian(
        &self,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
        side: usize,
    ) -> Option<NewGaussian> {
        let mut count = 0.0;
        let (mut sum, mut color_sum) = (Vec3::ZERO, [0.0; 3]);
        let mut pixel = None;
        for row in rows {
            for column in columns.clone().filter(|column| self.wanted[(*column, row)] == Want::Gaussian) {
                let depth = self.frame.depth()[(column, row)];
                sum += self.frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                for (sum, channel) in color_sum.iter_mut().zip(self.frame.color()[(column, row)]) {
                    *sum += f32::from(channel);
                }
                count += 1.0;
                pixel.get_or_insert(row * self.frame.width() + column);
            }
        }
        let mean_camera = sum / count;
        Some(NewGaussian {
            pixel: pixel?,
            mean: self.map_from_camera.to_world(mean_camera),
            radius: self.settings.radius_per_spacing * side as f32 * mean_camera.z / self.focal,
            color: color_sum.map(|sum| (sum / count).round() as u8),
        })
    }
}

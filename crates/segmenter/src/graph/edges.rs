//! Distances between neighbouring pixels in colour and surface.

use super::color::{Lab, difference};
use super::settings::GraphSettings;
use super::surface::{Facet, Surface};
use glam::Vec3;
use rayon::prelude::*;
use splatseg_geometry::Image;

/// Steps `(column, row)` to the neighbours that follow a pixel in row-major order. The others are symmetric.
pub(super) const NEIGHBORS: [(isize, isize); 4] = [(1, 0), (-1, 1), (0, 1), (1, 1)];

/// Distances are stored as integer multiples of 1 / `QUANTA`, for counting sort.
pub(super) const QUANTA: f32 = 4096.0;

/// Marks neighbours outside the image.
pub(super) const NO_EDGE: u16 = u16::MAX;

/// Distance, in [`QUANTA`], of every pixel to its four [`NEIGHBORS`], `[height, width]`.
pub(super) fn pixel_edges(lab: &Image<Lab>, surface: &Surface, settings: &GraphSettings) -> Vec<[u16; 4]> {
    let (width, height) = lab.size();
    let mut edges = vec![[NO_EDGE; 4]; width * height];
    edges.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        for (column, out) in line.iter_mut().enumerate() {
            for (edge, (right, down)) in out.iter_mut().zip(NEIGHBORS) {
                let (Some(near_column), Some(near_row)) =
                    (column.checked_add_signed(right), row.checked_add_signed(down))
                else {
                    continue;
                };
                if near_column < width && near_row < height {
                    let distance = distance(lab, surface, [(column, row), (near_column, near_row)], settings);
                    *edge = (distance * QUANTA).min(f32::from(NO_EDGE - 1)) as u16;
                }
            }
        }
    });
    edges
}

fn distance(lab: &Image<Lab>, surface: &Surface, pair: [(usize, usize); 2], settings: &GraphSettings) -> f32 {
    let weights = &settings.patches;
    let color = weights.color * difference(lab[pair[0]], lab[pair[1]], settings.lightness);
    let facets = pair.map(|pixel| surface.facets[pixel]);
    let rays = pair.map(|(column, row)| surface.ray(column, row));
    match Fold::between(facets, rays) {
        Some(fold) => {
            let step = (fold.step / settings.surface.noise - 1.0).clamp(0.0, 10.0);
            color + weights.step * step + weights.concave * fold.concave + weights.convex * fold.convex
        }
        None => color,
    }
}

/// The fold between two facets.
pub(super) struct Fold {
    /// Step between the planes halfway between the two rays, 1/m of inverse depth.
    pub step: f32,
    /// Angle between the normals if the fold is concave, about radians (a chord of the unit circle); else 0.
    pub concave: f32,
    /// The same if the fold is convex.
    pub convex: f32,
}

impl Fold {
    /// Compares the planes of two pixels; `None` if either is unknown.
    pub fn between(facets: [Facet; 2], rays: [Vec3; 2]) -> Option<Self> {
        let [first, second] = facets;
        if !(first.is_known() && second.is_known()) {
            return None;
        }
        // Halfway between the rays, the planes agree at a crease but not at a step.
        let difference = second.plane - first.plane;
        let step = (difference.dot(rays[0] + rays[1]) * 0.5).abs();
        let turn = (second.normal - first.normal).length();
        // A convex body lies behind the planes of all its faces, so the visible plane along each ray is the farthest.
        let concave = difference.dot(rays[1] - rays[0]) > 0.0;
        let (concave, convex) = if concave { (turn, 0.0) } else { (0.0, turn) };
        Some(Self { step, concave, convex })
    }
}

//! Fits a plane to the neighbourhood of every pixel.
//!
//! Planes are fitted in inverse depth, for two reasons. The inverse depth of a plane n·X = 1 is n·(x/z, y/z, 1), which
//! is linear over the image. And stereo and structured-light sensors measure disparity, so their noise in inverse depth
//! is the same near and far.

use super::color::{Lab, difference};
use super::settings::SurfaceSettings;
use glam::Vec3;
use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image, Intrinsics};

/// The surface at a pixel, as a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Facet {
    /// Plane coefficients n of n·X = 1 (1/m, camera frame); zero where unknown. The inverse depth of the plane along
    /// the ray (x, y, 1) is `plane · ray`.
    pub plane: Vec3,
    /// Unit normal, towards the camera; zero where unknown.
    pub normal: Vec3,
    /// True if fitted to measured depth, false if copied from a neighbour or unknown.
    pub measured: bool,
}

impl Facet {
    const UNKNOWN: Self = Self { plane: Vec3::ZERO, normal: Vec3::ZERO, measured: false };

    /// True if there is a plane.
    pub fn is_known(&self) -> bool {
        self.normal != Vec3::ZERO
    }
}

/// The facets of a frame, `[height, width]`, and its camera.
pub(super) struct Surface {
    pub facets: Image<Facet>,
    camera: Intrinsics,
}

impl Surface {
    /// Fits planes where there is depth and extends them into holes by a few pixels.
    ///
    /// `depth` is z-depth in metres, 0 where missing. `lab` and `camera` belong to the same image.
    pub fn from_depth(
        depth: &CowImage<'_, f32>,
        camera: Intrinsics,
        lab: &Image<Lab>,
        settings: &SurfaceSettings,
    ) -> Self {
        let inverse = depth.map(|depth| if *depth > 0.0 { 1.0 / depth } else { 0.0 });
        let smooth = smoothed(&inverse, &camera, settings.noise);
        let fit = PlaneFit { inverse: &smooth, camera: &camera, settings, reaches: sample_reaches() };
        let (width, height) = smooth.size();
        let mut facets = Image::filled(width, height, Facet::UNKNOWN);
        facets.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            for (column, facet) in line.iter_mut().enumerate() {
                *facet = fit.at(column, row);
            }
        });
        let mut surface = Self { facets, camera };
        for _ in 0..settings.fill {
            surface.fill_rim(lab);
        }
        surface
    }

    /// The viewing ray (x/z, y/z, 1) of a pixel.
    pub fn ray(&self, column: usize, row: usize) -> Vec3 {
        Vec3::new(
            (column as f32 - self.camera.cx) / self.camera.fx,
            (row as f32 - self.camera.cy) / self.camera.fy,
            1.0,
        )
    }

    /// Copies to each unknown pixel the plane of its known neighbour with the most similar colour.
    fn fill_rim(&mut self, lab: &Image<Lab>) {
        let (width, height) = self.facets.size();
        let known = &self.facets;
        let filled: Vec<Facet> = (0..width * height)
            .into_par_iter()
            .with_min_len(4096)
            .map(|index| {
                let (column, row) = (index % width, index / width);
                if known[(column, row)].is_known() {
                    return known[(column, row)];
                }
                let mut best = (f32::INFINITY, Facet::UNKNOWN);
                for near_row in row.saturating_sub(1)..(row + 2).min(height) {
                    for near_column in column.saturating_sub(1)..(column + 2).min(width) {
                        let near = known[(near_column, near_row)];
                        let distance = difference(lab[(column, row)], lab[(near_column, near_row)], 1.0);
                        // Beyond its horizon the plane is not in front of the camera.
                        if near.is_known() && distance < best.0 && near.plane.dot(self.ray(column, row)) > 1e-3 {
                            best = (distance, Facet { measured: false, ..near });
                        }
                    }
                }
                best.1
            })
            .collect();
        self.facets.pixels_mut().copy_from_slice(&filled);
    }
}

/// Mean over the 3×3 neighbours that can belong to the same surface. Opposite neighbours are used only in pairs, since
/// one alone would shift the mean of a slanted surface.
fn smoothed(inverse: &Image<f32>, camera: &Intrinsics, noise: f32) -> Image<f32> {
    let (width, height) = inverse.size();
    let at = |column: usize, row: usize, right: isize, down: isize| {
        let (column, row) = (column.checked_add_signed(right)?, row.checked_add_signed(down)?);
        (column < width && row < height).then(|| inverse[(column, row)]).filter(|value| *value > 0.0)
    };
    let mut smooth = Image::filled(width, height, 0.0);
    smooth.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        for (column, out) in line.iter_mut().enumerate() {
            let center = inverse[(column, row)];
            if center == 0.0 {
                continue;
            }
            let tolerance = 3.0 * noise + STEEPEST * center / camera.fx;
            let (mut sum, mut count) = (center, 1.0);
            for (right, down) in [(1, 0), (0, 1), (1, 1), (1, -1)] {
                let ends = (at(column, row, right, down), at(column, row, -right, -down));
                if let (Some(first), Some(second)) = ends
                    && (first - center).abs() < tolerance
                    && (second - center).abs() < tolerance
                {
                    sum += first + second;
                    count += 2.0;
                }
            }
            *out = sum / count;
        }
    });
    smooth
}

/// Tangent of the steepest slant, to the viewing ray, at which neighbouring pixels can belong to one surface.
const STEEPEST: f32 = 3.0;

/// Samples on each side of the centre in a plane fit.
const SAMPLES: i32 = 2;

/// Maximum reach of a plane fit, pixels.
const MAX_REACH: usize = 16;

/// For each reach in pixels, the offsets of the sampled rows and columns.
fn sample_reaches() -> Vec<[i32; 2 * SAMPLES as usize + 1]> {
    (0..=MAX_REACH as i32)
        .map(|reach| {
            std::array::from_fn(|index| {
                // Round half away from zero, for symmetry.
                let scaled = (index as i32 - SAMPLES) * reach * 2;
                (scaled + SAMPLES * scaled.signum()) / (2 * SAMPLES)
            })
        })
        .collect()
}

struct PlaneFit<'a> {
    inverse: &'a Image<f32>,
    camera: &'a Intrinsics,
    settings: &'a SurfaceSettings,
    reaches: Vec<[i32; 2 * SAMPLES as usize + 1]>,
}

/// An inverse depth that changes linearly with the offset in pixels.
#[derive(Clone, Copy)]
struct Slope {
    value: f32,
    per_column: f32,
    per_row: f32,
}

impl PlaneFit<'_> {
    fn at(&self, column: usize, row: usize) -> Facet {
        let center = self.inverse[(column, row)];
        if center == 0.0 {
            return Facet::UNKNOWN;
        }
        // An error in the slope of inverse depth matters more for distant planes, so they use a wider window.
        let reach = self.settings.reach * (self.camera.fx / 289.0) * center.recip().sqrt();
        let offsets = &self.reaches[(reach.round() as usize).clamp(2, MAX_REACH)];
        let noise = 3.0 * self.settings.noise;
        let flat = Slope { value: center, per_column: 0.0, per_row: 0.0 };
        let steepest = STEEPEST * center / self.camera.fx;
        let Some(first) = self.refined(column, row, offsets, flat, |distance| noise + steepest * distance) else {
            return Facet::UNKNOWN;
        };
        // Refit around the first plane to drop samples across a crease or a step.
        let second = self.refined(column, row, offsets, first, |_| noise).unwrap_or(first);
        self.facet(column, row, second)
    }

    /// Weighted least squares over the samples, with Tukey's biweight of their distance from `prior`. `None` if the
    /// total weight is too small or the samples are nearly collinear.
    fn refined(
        &self,
        column: usize,
        row: usize,
        offsets: &[i32],
        prior: Slope,
        tolerance: impl Fn(f32) -> f32,
    ) -> Option<Slope> {
        let (width, height) = (self.inverse.width() as i32, self.inverse.height() as i32);
        let (mut s, mut su, mut sv, mut suu, mut suv, mut svv) = (0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32, 0.0f32);
        let (mut sw, mut suw, mut svw) = (0.0f32, 0.0f32, 0.0f32);
        for dv in offsets {
            let near_row = row as i32 + dv;
            if near_row < 0 || near_row >= height {
                continue;
            }
            let line = self.inverse.row(near_row as usize);
            for du in offsets {
                let near_column = column as i32 + du;
                if near_column < 0 || near_column >= width || line[near_column as usize] == 0.0 {
                    continue;
                }
                let (u, v) = (*du as f32, *dv as f32);
                let w = line[near_column as usize] - prior.value;
                let error = (w - prior.per_column * u - prior.per_row * v) / tolerance(u.abs() + v.abs());
                let closeness = (1.0 - error * error).max(0.0);
                let weight = closeness * closeness;
                s += weight;
                (su, sv) = (su + weight * u, sv + weight * v);
                (suu, suv, svv) = (suu + weight * u * u, suv + weight * u * v, svv + weight * v * v);
                (sw, suw, svw) = (sw + weight * w, suw + weight * u * w, svw + weight * v * w);
            }
        }
        if s < self.settings.support {
            return None;
        }
        let (mu, mv, mw) = (su / s, sv / s, sw / s);
        let (cuu, cuv, cvv) = (suu / s - mu * mu, suv / s - mu * mv, svv / s - mv * mv);
        let (cuw, cvw) = (suw / s - mu * mw, svw / s - mv * mw);
        let determinant = cuu * cvv - cuv * cuv;
        // Samples on a line do not determine a plane.
        if determinant < 0.05 * (cuu + cvv) * (cuu + cvv) / 4.0 || determinant <= 0.0 {
            return None;
        }
        let per_column = (cvv * cuw - cuv * cvw) / determinant;
        let per_row = (cuu * cvw - cuv * cuw) / determinant;
        Some(Slope { value: prior.value + mw - per_column * mu - per_row * mv, per_column, per_row })
    }

    fn facet(&self, column: usize, row: usize, slope: Slope) -> Facet {
        let camera = self.camera;
        let (a, b) = (slope.per_column * camera.fx, slope.per_row * camera.fy);
        let (x, y) = ((column as f32 - camera.cx) / camera.fx, (row as f32 - camera.cy) / camera.fy);
        let plane = Vec3::new(a, b, slope.value - a * x - b * y);
        match plane.try_normalize() {
            Some(direction) if slope.value > 0.0 => Facet { plane, normal: -direction, measured: true },
            _ => Facet::UNKNOWN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    const CAMERA: Intrinsics = Intrinsics { fx: 70.0, fy: 72.0, cx: 39.5, cy: 29.5, width: 80, height: 60 };

    /// The surface with inverse depth `inverse(ray)` along each ray. A value of 0 makes a hole.
    fn surface(inverse: impl Fn(Vec3) -> f32) -> Surface {
        let depth = Image::from_fn(80, 60, |column, row| {
            let w = inverse(CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0));
            if w > 0.0 { 1.0 / w } else { 0.0 }
        });
        Surface::from_depth(&depth, CAMERA, &Image::filled(80, 60, [50.0, 0.0, 0.0]), &SurfaceSettings::default())
    }

    #[test]
    fn a_slanted_plane_is_found() {
        let plane = Vec3::new(0.2, 0.3, 0.5);
        let surface = surface(|ray| plane.dot(ray));
        for facet in surface.facets.pixels() {
            assert!(facet.measured && (facet.plane - plane).length() < 1e-3, "{facet:?}");
            assert!(facet.normal.dot(plane.normalize()) < -0.9999);
        }
    }

    #[test]
    fn planes_end_at_a_step_and_reach_into_holes() {
        let (near, far) = (Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.0, 0.0, 0.5));
        let left = |ray: Vec3| ray.x < 0.0;
        let surface = surface(|ray| match ray {
            ray if ray.y > 0.3 => 0.0,
            ray if left(ray) => near.dot(ray),
            ray => far.dot(ray),
        });
        for column in 0..80 {
            let expected = if left(surface.ray(column, 10)) { near } else { far };
            assert!((surface.facets[(column, 10)].plane - expected).length() < 1e-3);
        }
        let first_hole = (0..60).find(|row| surface.ray(5, *row).y > 0.3).unwrap();
        assert!(!surface.facets[(5, first_hole)].measured);
        assert!((surface.facets[(5, first_hole + 3)].plane - near).length() < 1e-3);
        assert!(!surface.facets[(5, first_hole + 4)].is_known());
    }
}

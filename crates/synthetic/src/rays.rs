//! Ray casting of whole images, with only those solids that a part of the image can show.

use super::noise::Sample;
use super::scenery::Scenery;
use super::solids::{Hit, Ray, Solid};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::{Image, Intrinsics, LocalPose};
use std::f32::consts::PI;

/// Side of the squares into which the image is divided, pixels.
const TILE: usize = 20;
/// Tolerance for rounding, in metres or radians.
const SLACK: f32 = 2e-3;

/// A solid that a tile may show.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// Index among the solids.
    index: usize,
    /// No point of the solid is nearer to the camera, metres.
    nearest: f32,
}

/// A camera in a scene.
pub(super) struct Caster<'a> {
    pub(super) scenery: &'a Scenery,
    pub(super) intrinsics: Intrinsics,
    pub(super) pose: LocalPose,
}

impl Caster<'_> {
    /// Casts a ray through the centre of every pixel.
    pub(super) fn image(&self) -> Image<Sample> {
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        // One row of tiles per task.
        let bands: Vec<usize> = (0..height).step_by(TILE).collect();
        let all = self.scenery.solids.iter().enumerate().map(|(index, _)| Candidate { index, nearest: 0.0 });
        let visible = self.candidates((0, 0), (width - 1, height - 1), &all.collect::<Vec<_>>());
        let samples: Vec<Vec<Sample>> = bands.par_iter().map(|top| self.band(*top, &visible)).collect();
        let mut samples = samples.into_iter().flatten();
        Image::from_fn(width, height, |_, _| samples.next().unwrap_or_default())
    }

    /// Returns the samples of the row of tiles that begins at row `top`, row by row.
    fn band(&self, top: usize, visible: &[Candidate]) -> Vec<Sample> {
        let (width, bottom) = (self.intrinsics.width, (top + TILE).min(self.intrinsics.height));
        let mut samples = vec![Sample::default(); width * (bottom - top)];
        for left in (0..width).step_by(TILE) {
            let right = (left + TILE).min(width);
            let candidates = self.candidates((left, top), (right - 1, bottom - 1), visible);
            for row in top..bottom {
                for column in left..right {
                    samples[(row - top) * width + column] = self.sample((column, row), &candidates);
                }
            }
        }
        samples
    }

    /// Returns the direction of a pixel's ray. With depth 1, z is 1 in camera coordinates, so that distance along the
    /// ray is z-depth.
    pub(super) fn direction(&self, (column, row): (usize, usize)) -> Vec3 {
        self.pose.rotation() * self.intrinsics.unproject(Vec2::new(column as f32, row as f32), 1.0)
    }

    /// Returns those of the solids in `among` whose bounding spheres meet the cone around a tile, given by its first and
    /// last pixel, by increasing distance.
    fn candidates(&self, first: (usize, usize), last: (usize, usize), among: &[Candidate]) -> Vec<Candidate> {
        let corners = [first, (first.0, last.1), (last.0, first.1), last].map(|at| self.direction(at).normalize());
        let axis = corners.iter().sum::<Vec3>().normalize();
        let half_angle = corners.iter().map(|corner| angle(axis.dot(*corner))).fold(0.0, f32::max);
        let candidate = |candidate: &Candidate| {
            let index = candidate.index;
            let solid = self.scenery.solids.get(index)?;
            let to_center = solid.center - self.pose.translation();
            let (distance, radius) = (to_center.length(), solid.shape.size().length() / 2.0 + SLACK);
            let half_width = if distance > radius { (radius / distance).asin() } else { PI };
            let may_be_seen = angle(axis.dot(to_center) / distance) <= half_angle + half_width + SLACK;
            (half_width == PI || may_be_seen).then_some(Candidate { index, nearest: distance - radius })
        };
        let mut candidates: Vec<Candidate> = among.iter().filter_map(candidate).collect();
        candidates.sort_by(|one, other| one.nearest.total_cmp(&other.nearest).then(one.index.cmp(&other.index)));
        candidates
    }

    fn sample(&self, pixel: (usize, usize), candidates: &[Candidate]) -> Sample {
        let direction = self.direction(pixel);
        let ray = Ray { origin: self.pose.translation(), direction };
        let Some((solid, hit)) = self.first_hit(ray, candidates) else { return Sample::default() };
        let lit = self.scenery.brightness(ray.origin + hit.t * direction, hit.normal);
        Sample {
            id: solid.id,
            depth: hit.t,
            color: solid.texture.color_at(hit.point_local) * lit,
            cosine: -hit.normal.dot(direction.normalize()),
        }
    }

    /// Returns the first solid hit by a ray, and the hit; of equally near solids, the first in the scenery. Rays from
    /// inside a room always hit one.
    fn first_hit(&self, ray: Ray, candidates: &[Candidate]) -> Option<(&Solid, Hit)> {
        let length = ray.direction.length();
        let mut nearest: Option<(usize, &Solid, Hit)> = None;
        for candidate in candidates {
            if nearest.as_ref().is_some_and(|(_, _, hit)| candidate.nearest > hit.t * length) {
                break;
            }
            let Some(solid) = self.scenery.solids.get(candidate.index) else { continue };
            if let Some(hit) = solid.hit(ray)
                && nearest
                    .as_ref()
                    .is_none_or(|(index, _, before)| hit.t < before.t || hit.t == before.t && candidate.index < *index)
            {
                nearest = Some((candidate.index, solid, hit));
            }
        }
        nearest.map(|(_, solid, hit)| (solid, hit))
    }
}

/// Returns the angle with this cosine.
fn angle(cosine: f32) -> f32 {
    cosine.clamp(-1.0, 1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{corridor, room, tour};

    #[test]
    fn images_show_the_nearest_of_all_solids() {
        let (width, height) = (90, 70);
        let intrinsics = Intrinsics { fx: 80.0, fy: 80.0, cx: 44.5, cy: 34.5, width, height };
        let sceneries = [room::furnished(1, 40, 0), tour::furnished(2, 4, 20), corridor::furnished(3, 8)];
        for scenery in &sceneries {
            for frame in [0.0, 20.0, 222.0, 512.0] {
                let caster = Caster { scenery, intrinsics, pose: scenery.walk.pose(frame) };
                let image = caster.image();
                for row in 0..height {
                    for column in 0..width {
                        let direction = caster.direction((column, row));
                        let ray = Ray { origin: caster.pose.translation(), direction };
                        let (solid, hit) = scenery.first_hit(ray).unwrap();
                        let sample = image[(column, row)];
                        assert_eq!((sample.id, sample.depth), (solid.id, hit.t), "{column}, {row} of {frame}");
                    }
                }
            }
        }
    }
}

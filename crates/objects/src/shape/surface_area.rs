//! The area of a surface of overlapping patches.

use super::patch_grid::PatchGrid;
use super::patches::Patch;
use super::plane::normal;
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Sample points on each disc: `RINGS` circles of this many points, which represent rings of equal area.
const POINTS_PER_RING: usize = 5;
const RINGS: usize = 2;
/// Approximate maximum number of evaluated discs of an object; they represent the others.
const SAMPLES: usize = 1000;
/// A patch lies in the plane through the patches within this many of its sides.
const PLANE_REACH: f32 = 2.5;

/// The area of the union of the patches, square metres. Each is a disc in the plane of its neighbours, with the radius
/// in which the memory considers the surface covered. Area covered by several discs counts once.
pub(super) fn surface_area(patches: &[Patch]) -> f32 {
    // A point of a disc can be covered by another disc whose centre is up to the sum of both radii away.
    let reach = 2.0 * patches.iter().map(|patch| patch.cover).fold(0.0, f32::max);
    let grid = PatchGrid::new(patches, reach);
    let (mut not_shared, mut sampled, mut indices) = (0.0, 0.0, Vec::new());
    for patch in patches.iter().step_by(patches.len().div_ceil(SAMPLES).max(1)) {
        grid.near(patch.mean, &mut indices);
        let reaches = |other: &&Patch| {
            let reach = (patch.cover + other.cover).max(PLANE_REACH * patch.side);
            patch.mean.distance_squared(other.mean) <= reach * reach
        };
        let near: Vec<&Patch> = indices.iter().map(|index| &patches[*index]).filter(reaches).collect();
        not_shared += f64::from(area_not_shared(patch, normal_at(patch, &near), &near));
        sampled += f64::from(disc_area(patch));
    }
    let discs: f64 = patches.iter().map(|patch| f64::from(disc_area(patch))).sum();
    if sampled > 0.0 { (discs * not_shared / sampled) as f32 } else { 0.0 }
}

fn disc_area(patch: &Patch) -> f32 {
    PI * patch.cover * patch.cover
}

/// The area of a disc, with each part divided by the number of discs that cover it.
fn area_not_shared(patch: &Patch, normal: Vec3, near: &[&Patch]) -> f32 {
    let (right, up) = normal.any_orthonormal_pair();
    let mut share = 0.0;
    for ring in 0..RINGS {
        let radius = patch.cover * ((ring as f32 + 0.5) / RINGS as f32).sqrt();
        for step in 0..POINTS_PER_RING {
            let angle = TAU * (step as f32 + 0.5 * ring as f32) / POINTS_PER_RING as f32;
            let point = patch.mean + radius * (angle.cos() * right + angle.sin() * up);
            let covers = |other: &&&Patch| other.mean.distance_squared(point) <= other.cover * other.cover;
            // At least 1, because the disc itself covers the point, except for rounding.
            share += 1.0 / near.iter().filter(covers).count().max(1) as f32;
        }
    }
    disc_area(patch) * share / (RINGS * POINTS_PER_RING) as f32
}

/// The direction in which a patch and its neighbours spread least, a unit vector.
fn normal_at(patch: &Patch, near: &[&Patch]) -> Vec3 {
    let reach = PLANE_REACH * patch.side;
    let close = near.iter().filter(|other| other.mean.distance_squared(patch.mean) <= reach * reach);
    normal(close.map(|other| ((other.mean - patch.mean) / patch.side, other.area() / patch.area())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patches(spacing: f32, copies: usize) -> Vec<Patch> {
        let count = (1.0 / spacing) as usize;
        let mean = |index: usize| Vec3::new((index % count) as f32, (index / count) as f32, 0.0) * spacing;
        let at = |index: usize| Patch { cover: 0.93 * spacing, ..Patch::seen(mean(index), spacing) };
        (0..count * count).flat_map(|index| vec![at(index); copies]).collect()
    }

    #[test]
    fn what_several_patches_cover_counts_once() {
        // A square metre plus the overhang of the outermost discs.
        for (copies, spacing) in [(1, 0.02), (3, 0.02), (1, 0.04)] {
            let area = surface_area(&patches(spacing, copies));
            assert!((1.0..1.0 + 5.0 * spacing).contains(&area), "{copies} {spacing}: {area}");
        }
    }

    #[test]
    fn a_single_disc_has_its_own_area() {
        let patch = Patch::seen(Vec3::ONE, 0.1);
        assert!((surface_area(&[patch]) - 0.01 * PI).abs() < 1e-6);
    }
}

//! The blocks of voxels near surfaces, and the size of voxels.

use crate::depth_planes::DepthPlane;
use crate::fusion::{DepthView, truncation};
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use splatseg_geometry::Image;
use std::collections::HashMap;

/// Voxels along the side of a block.
pub(crate) const SIDE: usize = 8;
/// Voxels in a block.
pub(crate) const VOXELS: usize = SIDE * SIDE * SIDE;
/// No block stands for none.
pub(crate) const NO_BLOCK: u32 = u32::MAX;

/// Bits of each coordinate in a key, and the coordinate that is 0.
const KEY_BITS: u32 = 21;
const KEY_ZERO: i32 = 1 << (KEY_BITS - 1);

/// A voxel: where the surface is, seen from its corner with the lowest coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Voxel {
    /// Distance from the surface, metres, positive in free space.
    pub(crate) distance: f32,
    /// Sum of the weights of its measurements; 0 if there is none.
    pub(crate) weight: f32,
}

/// Bytes of a block with what is found in it.
pub(crate) const BLOCK_BYTES: u64 = (VOXELS * (size_of::<Voxel>() + size_of::<u16>()) + 128) as u64;

/// The blocks of a field, ordered by their coordinates.
pub(crate) struct BlockGrid {
    /// Side of a voxel, metres.
    pub(crate) voxel: f32,
    /// Coordinates of each block, in blocks.
    pub(crate) places: Vec<IVec3>,
    /// Voxels of each block, x fastest.
    pub(crate) blocks: Vec<[Voxel; VOXELS]>,
    numbers: HashMap<IVec3, u32>,
}

impl BlockGrid {
    /// An empty field with these blocks.
    pub(crate) fn new(voxel: f32, places: Vec<IVec3>) -> Self {
        let numbers = places.iter().enumerate().map(|(number, place)| (*place, number as u32)).collect();
        let blocks = vec![[Voxel::default(); VOXELS]; places.len()];
        Self { voxel, places, blocks, numbers }
    }

    /// Number of a block, [`NO_BLOCK`] if it is not kept.
    pub(crate) fn number(&self, place: IVec3) -> u32 {
        self.numbers.get(&place).copied().unwrap_or(NO_BLOCK)
    }

    /// Corner of a block with the lowest coordinates, metres.
    pub(crate) fn corner(&self, block: usize) -> Vec3 {
        self.places[block].as_vec3() * (SIDE as f32 * self.voxel)
    }

    /// The blocks that surround each block and itself, by [`neighbour`].
    pub(crate) fn neighbours(&self, block: usize) -> [u32; 27] {
        std::array::from_fn(|index| {
            let index = index as i32;
            self.number(self.places[block] + IVec3::new(index % 3 - 1, index / 3 % 3 - 1, index / 9 - 1))
        })
    }
}

/// Position of a neighbour among [`BlockGrid::neighbours`], and index of a voxel in it. Coordinates are voxels from the
/// block's corner, from -8 to 15.
pub(crate) fn neighbour(voxel: IVec3) -> (usize, usize) {
    let side = SIDE as i32;
    let block = voxel.div_euclid(IVec3::splat(side)) + 1;
    let inside = voxel.rem_euclid(IVec3::splat(side));
    ((block.x + 3 * block.y + 9 * block.z) as usize, (inside.x + side * (inside.y + side * inside.z)) as usize)
}

/// The blocks that contain the surfaces of all views, in order.
pub(crate) fn blocks_near_surfaces(
    views: &[DepthView],
    planes: impl Fn(&DepthView) -> Image<DepthPlane> + Sync,
    voxel: f32,
) -> Vec<IVec3> {
    let of_view = |view: &DepthView| keys_of(view, &planes(view), voxel);
    let mut keys: Vec<u64> = Vec::new();
    // A few views at a time, since each has many keys before they are joined.
    for views in views.chunks(16) {
        let found: Vec<Vec<u64>> = views.par_iter().map(of_view).collect();
        keys.extend(found.into_iter().flatten());
        keys.sort_unstable();
        keys.dedup();
    }
    keys.into_iter().map(place).collect()
}

fn keys_of(view: &DepthView, planes: &Image<DepthPlane>, voxel: f32) -> Vec<u64> {
    let (band, block) = (truncation(voxel), SIDE as f32 * voxel);
    let mut keys: Vec<u64> = Vec::new();
    let (width, height) = planes.size();
    for row in 0..height {
        for column in 0..width {
            let plane = planes[(column, row)];
            if plane.weight <= 0.0 {
                continue;
            }
            let ray = view.ray(column, row);
            // Rays are straight, but surfaces oblique: the band is longer along them.
            let reach = (band / plane.distance_per_depth).min(3.0 * band);
            let depth = plane.inverse.recip();
            let steps = (2.0 * reach / (0.5 * block)).ceil().max(1.0) as usize;
            for step in 0..=steps {
                let along = depth - reach + 2.0 * reach * step as f32 / steps as f32;
                let point = view.world_from_camera.to_world(ray * along);
                // The surface nets look at a voxel's neighbours.
                for corner in [point - voxel, point + voxel] {
                    let key = key((corner / block).floor());
                    if let Some(key) = key.filter(|key| keys.last() != Some(key)) {
                        keys.push(key);
                    }
                }
            }
        }
    }
    keys.sort_unstable();
    keys.dedup();
    keys
}

/// One number for a block's coordinates, which orders blocks. `None` if they are too far away.
fn key(place: Vec3) -> Option<u64> {
    let is_near = place.abs().max_element() < KEY_ZERO as f32 - 2.0;
    let [x, y, z] = place.as_ivec3().to_array().map(|part| (part + KEY_ZERO) as u64);
    is_near.then_some((z << (2 * KEY_BITS)) | (y << KEY_BITS) | x)
}

fn place(key: u64) -> IVec3 {
    let part = |shift: u32| ((key >> shift) & ((1 << KEY_BITS) - 1)) as i32 - KEY_ZERO;
    IVec3::new(part(0), part(KEY_BITS), part(2 * KEY_BITS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_stand_for_places() {
        for at in [IVec3::ZERO, IVec3::new(-5, 900, -100_000), IVec3::splat(-1)] {
            assert_eq!(place(key(at.as_vec3()).unwrap()), at);
        }
        assert_eq!((key(Vec3::splat(2e6)), key(Vec3::NAN), key(Vec3::NEG_INFINITY)), (None, None, None));
    }

    #[test]
    fn neighbours_are_found_by_voxel() {
        let grid = BlockGrid::new(0.1, vec![IVec3::ZERO, IVec3::X, IVec3::new(-1, -1, -1)]);
        let around = grid.neighbours(0);
        let at = |x, y, z| {
            let (block, voxel) = neighbour(IVec3::new(x, y, z));
            (around[block], voxel)
        };
        assert_eq!((at(0, 0, 0), at(8, 1, 0), at(-1, -1, -1)), ((0, 0), (1, 8), (2, VOXELS - 1)));
        assert_eq!(at(0, 8, 0).0, NO_BLOCK);
    }
}

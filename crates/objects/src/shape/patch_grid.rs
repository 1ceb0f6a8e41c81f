//! Search for the patches near a point.

use super::patches::Patch;
use glam::Vec3;
use std::collections::BTreeMap;

/// A grid of patches.
pub(super) struct PatchGrid {
    /// Indices of the patches in each cell.
    cells: BTreeMap<[i32; 3], Vec<usize>>,
    side: f32,
}

impl PatchGrid {
    /// A grid that finds all patches within `reach`, metres, which must be positive.
    pub fn new(patches: &[Patch], reach: f32) -> Self {
        Self::of(patches, 0..patches.len(), reach)
    }

    /// As [`Self::new`], of the patches with these indices.
    pub fn of(patches: &[Patch], indices: impl IntoIterator<Item = usize>, reach: f32) -> Self {
        let mut cells: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
        for index in indices {
            cells.entry(cell_of(patches[index].mean, reach)).or_default().push(index);
        }
        Self { cells, side: reach }
    }

    /// Collects the indices of all patches within the grid's reach of a point, and of some farther away.
    pub fn near(&self, place: Vec3, near: &mut Vec<usize>) {
        near.clear();
        let [x, y, z] = cell_of(place, self.side);
        let around = |center: i32| center.saturating_sub(1)..=center.saturating_add(1);
        for x in around(x) {
            for y in around(y) {
                let range = [x, y, z.saturating_sub(1)]..=[x, y, z.saturating_add(1)];
                near.extend(self.cells.range(range).flat_map(|(_, patches)| patches));
            }
        }
    }
}

fn cell_of(place: Vec3, side: f32) -> [i32; 3] {
    (place / side).floor().as_ivec3().to_array()
}

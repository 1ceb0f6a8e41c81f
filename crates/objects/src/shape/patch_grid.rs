//! Search for the patches near a point.

use super::patches::Patch;
use glam::Vec3;
use std::collections::BTreeMap;
use std::ops::Range;

/// A grid of patches.
pub(super) struct PatchGrid {
    /// Where the patches of each cell are in `patches`.
    cells: BTreeMap<[i32; 3], Range<usize>>,
    /// Indices of the patches, by cell.
    patches: Vec<usize>,
    side: f32,
}

impl PatchGrid {
    /// A grid that finds all patches within `reach`, metres, which must be positive.
    pub fn new(patches: &[Patch], reach: f32) -> Self {
        Self::of(patches, 0..patches.len(), reach)
    }

    /// As [`Self::new`], of the patches with these indices.
    pub fn of(patches: &[Patch], indices: impl IntoIterator<Item = usize>, reach: f32) -> Self {
        let cell = |index: usize| (cell_of(patches[index].mean, reach), index);
        let mut placed: Vec<([i32; 3], usize)> = indices.into_iter().map(cell).collect();
        placed.sort_unstable();
        let mut end = 0;
        let of_cell = |cell: &[([i32; 3], usize)]| {
            let start = end;
            end += cell.len();
            (cell[0].0, start..end)
        };
        let cells = placed.chunk_by(|one, next| one.0 == next.0).map(of_cell).collect();
        Self { cells, patches: placed.into_iter().map(|(_, index)| index).collect(), side: reach }
    }

    /// Collects the indices of all patches within the grid's reach of a point, and of some farther away.
    pub fn near(&self, place: Vec3, near: &mut Vec<usize>) {
        near.clear();
        self.around(cell_of(place, self.side)).for_each(|cell| near.extend(&self.patches[cell]));
    }

    /// Calls a function for each cell, with the cell and those that have all patches within the grid's reach of one in it:
    /// ranges of [`Self::patches`].
    pub fn for_each_cell(&self, mut each: impl FnMut(Range<usize>, &[Range<usize>])) {
        let mut around = Vec::new();
        for (cell, patches) in &self.cells {
            around.clear();
            around.extend(self.around(*cell));
            each(patches.clone(), &around);
        }
    }

    fn around(&self, [x, y, z]: [i32; 3]) -> impl Iterator<Item = Range<usize>> {
        let around = |center: i32| center.saturating_sub(1)..=center.saturating_add(1);
        let columns = around(x).flat_map(move |x| around(y).map(move |y| (x, y)));
        columns.flat_map(move |(x, y)| {
            let range = [x, y, z.saturating_sub(1)]..=[x, y, z.saturating_add(1)];
            self.cells.range(range).map(|(_, patches)| patches.clone())
        })
    }

    /// The indices of the patches, by cell.
    pub fn patches(&self) -> &[usize] {
        &self.patches
    }
}

fn cell_of(place: Vec3, side: f32) -> [i32; 3] {
    (place / side).floor().as_ivec3().to_array()
}

//! The pixels of a segment that have no depth.

use glam::Vec2;
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::BTreeMap;

/// A pixel (column, row) and the direction, in columns and rows, of a neighbour.
pub(super) type Step = ((usize, usize), (isize, isize));

/// The pixels without depth of one id in one frame: a mask of the box that holds them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Region {
    pub id: SegmentId,
    /// First column of the box.
    pub left: usize,
    /// First row of the box.
    pub top: usize,
    /// Columns of the box.
    pub width: usize,
    /// Rows of the box.
    pub height: usize,
    /// Which pixels of the box belong to the region, `[height, width]`.
    pub(super) mask: Vec<bool>,
    /// Pixels in the mask.
    pub area: usize,
    /// Those of them that the map does not cover.
    pub bare: usize,
}

/// Columns and rows, both ends included, and pixels of an id.
#[derive(Clone, Copy, Debug)]
struct Extent {
    columns: (usize, usize),
    rows: (usize, usize),
    area: usize,
}

impl Region {
    /// The regions of a map of pixels without depth that have at least `min_bare` pixels in the map of bare ones, by
    /// increasing id.
    pub fn of_maps(depthless: &SegmentMap, bare: &SegmentMap, min_bare: usize) -> Vec<Self> {
        let mut bare_areas = bare.areas();
        bare_areas.retain(|_, area| *area >= min_bare);
        let mut extents: BTreeMap<SegmentId, Extent> = BTreeMap::new();
        for_each_run(depthless, |id, row, from, to| {
            if !bare_areas.contains_key(&id) {
                return;
            }
            let extent = extents.entry(id).or_insert(Extent { columns: (from, to - 1), rows: (row, row), area: 0 });
            extent.columns = (extent.columns.0.min(from), extent.columns.1.max(to - 1));
            extent.rows.1 = row;
            extent.area += to - from;
        });
        extents.into_iter().map(|(id, extent)| Self::cut(depthless, id, extent, bare_areas[&id])).collect()
    }

    fn cut(depthless: &SegmentMap, id: SegmentId, extent: Extent, bare: usize) -> Self {
        let (left, top) = (extent.columns.0, extent.rows.0);
        let (width, height) = (extent.columns.1 - left + 1, extent.rows.1 - top + 1);
        let mut mask = Vec::with_capacity(width * height);
        for row in top..top + height {
            mask.extend(depthless.row(row)[left..left + width].iter().map(|found| *found == id));
        }
        Self { id, left, top, width, height, mask, area: extent.area, bare }
    }

    /// The lengths of the runs in the mask, row by row: outside, inside, outside and so on.
    pub fn runs(&self) -> Vec<u32> {
        let mut runs = Vec::new();
        let mut is_inside = false;
        for run in self.mask.chunk_by(|left, right| left == right) {
            if run[0] != is_inside {
                runs.push(0);
                is_inside = run[0];
            }
            runs.push(run.len() as u32);
            is_inside = !is_inside;
        }
        runs
    }

    /// The mask with these [`Self::runs`], of so many pixels; `None` if they are of another number.
    pub fn mask_of_runs(runs: &[u32], pixels: usize) -> Option<Vec<bool>> {
        let total: u64 = runs.iter().map(|run| u64::from(*run)).sum();
        if total != pixels as u64 {
            return None;
        }
        let mut mask = Vec::with_capacity(pixels);
        for (index, run) in runs.iter().enumerate() {
            mask.resize(mask.len() + *run as usize, index % 2 == 1);
        }
        Some(mask)
    }

    /// Whether the region shows at a point (column, row) of the image: whether it has the pixel around that.
    #[inline(always)]
    pub fn contains(&self, column: f32, row: f32) -> bool {
        let (column, row) = (column - self.left as f32 + 0.5, row - self.top as f32 + 0.5);
        let is_inside = column >= 0.0 && row >= 0.0 && column < self.width as f32 && row < self.height as f32;
        is_inside && self.mask[row as usize * self.width + column as usize]
    }

    /// The corners of the box as (column, row): outer edges of its pixels.
    pub fn corners(&self) -> [Vec2; 4] {
        let (left, top) = (self.left as f32 - 0.5, self.top as f32 - 0.5);
        let (right, bottom) = (left + self.width as f32, top + self.height as f32);
        [Vec2::new(left, top), Vec2::new(right, top), Vec2::new(left, bottom), Vec2::new(right, bottom)]
    }

    /// The pixels (column, row) of the region, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let inside = self.mask.iter().enumerate().filter(|(_, is_inside)| **is_inside);
        inside.map(|(index, _)| (self.left + index % self.width, self.top + index / self.width))
    }

    /// The region's pixels at its border, each with the ways that lead out.
    pub fn border_steps(&self) -> Vec<Step> {
        let mut steps = Vec::new();
        for row in 0..self.height {
            let start = row * self.width;
            for column in 0..self.width {
                let index = start + column;
                if !self.mask[index] {
                    continue;
                }
                let neighbours = [
                    (column > 0 && self.mask[index - 1], (-1, 0)),
                    (column + 1 < self.width && self.mask[index + 1], (1, 0)),
                    (row > 0 && self.mask[index - self.width], (0, -1)),
                    (row + 1 < self.height && self.mask[index + self.width], (0, 1)),
                ];
                if neighbours.iter().all(|(is_inside, _)| *is_inside) {
                    continue;
                }
                let at = (self.left + column, self.top + row);
                steps.extend(neighbours.into_iter().filter(|(is_inside, _)| !is_inside).map(|(_, step)| (at, step)));
            }
        }
        steps
    }
}

/// Calls `run(id, row, from, to)` for every run of columns `from..to` with an id.
fn for_each_run(map: &SegmentMap, mut run: impl FnMut(SegmentId, usize, usize, usize)) {
    for row in 0..map.height() {
        let mut from = 0;
        for pixels in map.row(row).chunk_by(|left, right| left == right) {
            let to = from + pixels.len();
            if pixels[0] != 0 {
                run(pixels[0], row, from, to);
            }
            from = to;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_hold_the_pixels_of_their_id() {
        let map = SegmentMap::from_pixels(4, 3, vec![0, 5, 5, 0, 2, 0, 5, 9, 2, 2, 5, 0]).unwrap();
        let mut bare = map.clone();
        bare[(1, 0)] = 0;
        let regions = Region::of_maps(&map, &bare, 2);
        assert_eq!(
            regions.iter().map(|region| (region.id, region.area, region.bare)).collect::<Vec<_>>(),
            [(2, 3, 3), (5, 4, 3)]
        );
        for region in &regions {
            for (column, row) in (-1..6).flat_map(|column| (-1..5).map(move |row| (column, row))) {
                let is_in_image = (0..4).contains(&column) && (0..3).contains(&row);
                let expected = is_in_image && map[(column as usize, row as usize)] == region.id;
                assert_eq!(region.contains(column as f32, row as f32), expected);
                assert_eq!(region.contains(column as f32 + 0.4, row as f32 - 0.4), expected);
            }
        }
        assert_eq!(regions[1].pixels().collect::<Vec<_>>(), [(1, 0), (2, 0), (2, 1), (2, 2)]);
        assert_eq!(regions[1].border_steps().len(), 10);
        assert!(Region::of_maps(&map, &bare, 4).is_empty());
        let nothing = SegmentMap::filled(0, 0, 0);
        assert!(Region::of_maps(&nothing, &nothing, 1).is_empty());
    }

    #[test]
    fn a_mask_is_saved_as_runs() {
        let region = |pixels: [u32; 6]| {
            let map = SegmentMap::from_pixels(3, 2, pixels.to_vec()).unwrap();
            Region::of_maps(&map, &map, 1).remove(0)
        };
        for (pixels, runs) in [([1, 0, 1, 1, 1, 0], vec![0, 1, 1, 3, 1]), ([0, 1, 1, 1, 1, 0], vec![1, 4, 1])] {
            let region = region(pixels);
            assert_eq!(region.runs(), runs);
            assert_eq!(Region::mask_of_runs(&runs, 6), Some(region.mask));
            assert_eq!((Region::mask_of_runs(&runs, 5), Region::mask_of_runs(&runs, 7)), (None, None));
        }
        assert_eq!(Region::mask_of_runs(&[u32::MAX, u32::MAX, 8], 6), None);
    }

    #[test]
    fn border_steps_lead_from_pixels_of_the_region_to_others() {
        let map = SegmentMap::from_fn(9, 7, |column, row| u32::from((column * 5 + row * 3) % 7 < 4 && column > 1));
        let region = Region::of_maps(&map, &map, 1).remove(0);
        let mut expected: Vec<Step> = region
            .pixels()
            .flat_map(|at| [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|step| (at, step)))
            .filter(|(at, step)| !region.contains((at.0 as isize + step.0) as f32, (at.1 as isize + step.1) as f32))
            .collect();
        let mut found = region.border_steps();
        expected.sort_unstable();
        found.sort_unstable();
        assert_eq!(found, expected);
    }
}

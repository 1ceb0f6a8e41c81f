//! Finds the surfaces that are there twice once the map has been corrected.

use crate::map::RADIUS_PER_SPACING;
use glam::Vec3;
use rayon::prelude::*;
use splatseg_geometry::KeyframeId;
use std::ops::Range;

/// Gaussians of keyframes that are closer than this in number were never apart...
const MIN_KEYFRAMES_APART: KeyframeId = 8;
/// ...unless a correction brings them closer by this much, metres: they were in different parts of the map.
const PARTS_APART: f32 = 5.0;

/// Two Gaussians show the same surface if they are closer than this share of the larger one's spacing...
const MAX_DISTANCE_PER_SPACING: f32 = 0.75;
/// ...within these limits, metres: what remains of the drift, and what is surely another thing.
const DISTANCE_LIMITS: (f32, f32) = (0.03, 0.08);

/// A correction that brings two Gaussians closer by less than this, metres, says nothing about them.
const MIN_APPROACH: f32 = 0.01;

/// Bits per coordinate of a cell's number.
const CELL_BITS: u32 = 21;

/// A later Gaussian on the surface of an earlier one.
#[derive(Clone, Copy)]
pub(crate) struct Double {
    pub(crate) later: usize,
    pub(crate) earlier: usize,
}

/// The Gaussians of a map that has been corrected.
pub(crate) struct Corrected<'a> {
    /// Centres before and after, metres.
    pub(crate) before: &'a [Vec3],
    pub(crate) means: &'a [Vec3],
    pub(crate) radii: &'a [f32],
    pub(crate) anchors: &'a [KeyframeId],
}

/// A Gaussian in the order of cells: neighbours in space are neighbours in memory.
#[derive(Clone, Copy)]
struct Member {
    mean: Vec3,
    /// How the correction has moved it, metres.
    moved: Vec3,
    anchor: KeyframeId,
    index: u32,
}

/// All Gaussians by cells.
struct Grid {
    cells: Vec<u64>,
    members: Vec<Member>,
}

impl Corrected<'_> {
    /// Pairs of Gaussians of one surface, by the later one.
    pub(crate) fn doubles(&self) -> Vec<Double> {
        let grid = self.grid();
        let min_apart = if self.has_joined_parts() { 1 } else { MIN_KEYFRAMES_APART };
        let mut cells = Vec::new();
        let mut start = 0;
        for cell in grid.cells.chunk_by(|one, other| one == other) {
            cells.push(start..start + cell.len());
            start += cell.len();
        }
        let of_cell = |cell: &Range<usize>| self.doubles_in_cell(&grid, cell, min_apart);
        let mut doubles: Vec<Double> = cells.par_iter().with_min_len(32).flat_map_iter(of_cell).collect();
        doubles.par_sort_unstable_by_key(|double| double.later);
        doubles
    }

    fn grid(&self) -> Grid {
        let cells = self.means.par_iter().enumerate().with_min_len(1024);
        let mut order: Vec<(u64, u32)> = cells.map(|(index, mean)| (cell(*mean), index as u32)).collect();
        order.par_sort_unstable();
        let member = |(_, index): &(u64, u32)| {
            let place = *index as usize;
            let (mean, before) = (self.means[place], self.before[place]);
            Member { mean, moved: mean - before, anchor: self.anchors[place], index: *index }
        };
        let members = order.par_iter().with_min_len(1024).map(member).collect();
        Grid { cells: order.into_iter().map(|(cell, _)| cell).collect(), members }
    }

    /// True if something has moved so far that it was in another part of the map.
    fn has_joined_parts(&self) -> bool {
        let far = PARTS_APART * 0.5;
        self.means.par_iter().zip(self.before).with_min_len(1024).any(|(now, before)| now.distance(*before) >= far)
    }

    fn doubles_in_cell(&self, grid: &Grid, cell: &Range<usize>, min_apart: KeyframeId) -> Vec<Double> {
        let around = grid.around(grid.cells[cell.start]);
        let all = || around.iter().copied().flatten();
        let least = all().fold(Vec3::INFINITY, |least, member| least.min(member.moved));
        let most = all().fold(Vec3::NEG_INFINITY, |most, member| most.max(member.moved));
        if most.distance(least) < MIN_APPROACH {
            // Everything has moved alike: nothing has come closer.
            return Vec::new();
        }
        let earliest = all().map(|member| member.anchor).min().unwrap_or(0).saturating_add(min_apart);
        let later = grid.members[cell.clone()].iter().filter(|member| member.anchor >= earliest);
        later.filter_map(|later| self.nearest_earlier(later, &around, min_apart)).collect()
    }

    /// The nearest of the Gaussians around that shows the surface of a later one.
    fn nearest_earlier(&self, later: &Member, around: &[&[Member]; 9], min_apart: KeyframeId) -> Option<Double> {
        let mut nearest: Option<&Member> = None;
        let mut least = DISTANCE_LIMITS.1 * DISTANCE_LIMITS.1;
        for earlier in around.iter().copied().flatten() {
            let squared = earlier.mean.distance_squared(later.mean);
            let may_be = squared < least && earlier.anchor.saturating_add(min_apart) <= later.anchor;
            if may_be && self.is_double(later, earlier, squared.sqrt()) {
                (nearest, least) = (Some(earlier), squared);
            }
        }
        nearest.map(|earlier| Double { later: later.index as usize, earlier: earlier.index as usize })
    }

    /// True if a correction says that two Gaussians, at this distance, show the same surface.
    fn is_double(&self, later: &Member, earlier: &Member, distance: f32) -> bool {
        let (one, other) = (later.index as usize, earlier.index as usize);
        let spacing = self.radii[one].max(self.radii[other]) / RADIUS_PER_SPACING;
        let limit = (MAX_DISTANCE_PER_SPACING * spacing).clamp(DISTANCE_LIMITS.0, DISTANCE_LIMITS.1);
        let were_never_apart = earlier.anchor.saturating_add(MIN_KEYFRAMES_APART) > later.anchor;
        let least_approach = if were_never_apart { PARTS_APART } else { MIN_APPROACH };
        distance <= limit && self.before[one].distance(self.before[other]) - distance >= least_approach
    }
}

impl Grid {
    /// The Gaussians in a cell and its 26 neighbours: three cells in a row follow each other.
    fn around(&self, cell: u64) -> [&[Member]; 9] {
        std::array::from_fn(|number| {
            let (row, layer) = (number as i64 % 3 - 1, number as i64 / 3 - 1);
            let middle = cell.saturating_add_signed((layer << (2 * CELL_BITS)) + (row << CELL_BITS));
            let start = self.cells.partition_point(|other| *other < middle - 1);
            let length = self.cells[start..].iter().take_while(|other| **other <= middle + 1).count();
            &self.members[start..start + length]
        })
    }
}

/// Number of the cell of a place. Cells are as wide as the largest distance between doubles. Beyond 80 km, cells share
/// numbers.
fn cell(place: Vec3) -> u64 {
    let half = 1i64 << (CELL_BITS - 1);
    let [x, y, z] = (place / DISTANCE_LIMITS.1).floor().to_array().map(|part| {
        let number = (part as i64).saturating_add(half).clamp(1, 2 * half - 2);
        number as u64
    });
    (z << (2 * CELL_BITS)) | (y << CELL_BITS) | x
}

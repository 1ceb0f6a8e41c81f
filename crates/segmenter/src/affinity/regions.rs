//! The initial regions for merging, and the edges between them.
//!
//! Inside an object nearly all log-odds are high, and the order in which its pixels are merged does not matter. So
//! pixels are first united within cells of [`CELL`] × [`CELL`] pixels, along confident edges to direct neighbours. A
//! region never leaves its cell, so it cannot leak far through a gap in a border. The cells lie on the [`Grid`].

use super::grid::Grid;
use super::weights::Offset;
use rayon::prelude::*;
use splatseg_kernels::feature_map::FeatureMap;

/// Side of a cell, pixels of the half-size image. With 1, every pixel is a region and merging is exact.
const CELL: usize = 8;
/// Log-odds above which direct neighbours in a cell are united.
const SURE: f32 = 1.5;
/// Log-odds are clamped to ± this. Larger values only express more confidence.
const LARGEST: f32 = 6.0;
/// Log-odds are stored as integer multiples of 1 / `UNIT`, so that sums do not depend on their order.
const UNIT: f32 = 4096.0;
/// Number of regions whose edges are collected by one job.
const REGIONS_PER_JOB: usize = 128;

/// The edges between two regions, or inside one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edges {
    /// The other region.
    pub other: u32,
    pub count: u32,
    /// Sum of the log-odds, in units.
    pub sum: i64,
}

impl Edges {
    /// The mean log-odds, bit-identical in both directions.
    #[inline]
    pub fn mean(&self) -> f64 {
        self.sum as f64 / (f64::from(self.count) * f64::from(UNIT))
    }
}

/// Regions and the edges between them.
pub(super) struct RegionGraph {
    pub width: usize,
    /// Region of each pixel, row-major. Regions are numbered in the order of their first pixels.
    pub labels: Vec<u32>,
    /// For each region, its edges to others, in up to two entries per other region.
    pub edges: Vec<Vec<Edges>>,
    /// For each region, the edges inside it.
    pub inner: Vec<Edges>,
}

impl RegionGraph {
    /// Builds the regions of an image from log-odds `[offsets, height, width]`.
    pub fn from_log_odds(log_odds: &FeatureMap, offsets: &[Offset], grid: Grid) -> Self {
        Self::with_cells(log_odds, offsets, CELL, grid.first_cell(CELL))
    }

    /// Like [`Self::from_log_odds`], with cells of `cell` × `cell` pixels, one of which begins at row and column
    /// `first`.
    pub fn with_cells(log_odds: &FeatureMap, offsets: &[Offset], cell: usize, first: [usize; 2]) -> Self {
        let image = PixelEdges::new(log_odds, offsets);
        let labels = image.regions(cell, first);
        let count = labels.iter().max().map_or(0, |last| *last as usize + 1);
        let pixels = PixelsByRegion::new(&labels, count);
        let jobs: Vec<usize> = (0..count).step_by(REGIONS_PER_JOB).collect();
        let found: Vec<Vec<(Vec<Edges>, Edges)>> = jobs
            .into_par_iter()
            .map(|first| {
                let mut slots = Slots::new(count);
                let regions = first..count.min(first + REGIONS_PER_JOB);
                regions.map(|region| image.edges_from(region as u32, pixels.of(region), &labels, &mut slots)).collect()
            })
            .collect();
        let (mut edges, inner): (Vec<_>, Vec<_>) = found.into_iter().flatten().unzip();
        let found: Vec<usize> = edges.iter().map(Vec::len).collect();
        for (region, found) in found.into_iter().enumerate() {
            for index in 0..found {
                let edge = edges[region][index];
                edges[edge.other as usize].push(Edges { other: region as u32, ..edge });
            }
        }
        Self { width: image.width, labels, edges, inner }
    }
}

/// The log-odds of all pixel pairs, in units.
struct PixelEdges {
    width: usize,
    height: usize,
    /// For each offset, its log-odds, row-major.
    planes: Vec<(Offset, Vec<i16>)>,
}

impl PixelEdges {
    fn new(log_odds: &FeatureMap, offsets: &[Offset]) -> Self {
        let (width, height) = (log_odds.width(), log_odds.height());
        let plane = |channel: usize| {
            let mut plane = Vec::with_capacity(width * height);
            for row in 0..height {
                let values = log_odds.row(channel, row).iter();
                plane.extend(values.map(|value| (value.clamp(-LARGEST, LARGEST) * UNIT) as i16));
            }
            plane
        };
        let planes = (0..offsets.len()).into_par_iter().map(|channel| (offsets[channel], plane(channel))).collect();
        Self { width, height, planes }
    }

    /// Unites direct neighbours within cells. Returns the region of each pixel.
    fn regions(&self, cell: usize, first: [usize; 2]) -> Vec<u32> {
        // True if the next row or column is in another cell, or none.
        let is_last = |place: usize, axis: usize, size: usize| {
            place + 1 == size || (place + 1 + cell - first[axis]).is_multiple_of(cell)
        };
        let sure = (SURE * UNIT) as i16;
        let mut parents: Vec<u32> = (0..(self.width * self.height) as u32).collect();
        for (offset, values) in &self.planes {
            let step = match (offset.down, offset.right) {
                (0, 1) => 1,
                (1, 0) => self.width,
                _ => continue,
            };
            for (row, values) in values.chunks_exact(self.width).enumerate() {
                if offset.down == 1 && is_last(row, 0, self.height) {
                    continue;
                }
                for (column, value) in values.iter().enumerate() {
                    if *value > sure && !(offset.right == 1 && is_last(column, 1, self.width)) {
                        let pixel = row * self.width + column;
                        let (a, b) = (root(&mut parents, pixel as u32), root(&mut parents, (pixel + step) as u32));
                        // The root of a region is its first pixel.
                        parents[a.max(b) as usize] = a.min(b);
                    }
                }
            }
        }
        numbered(parents)
    }

    /// Returns the edges from a region's pixels to each other region, and the edges inside it.
    fn edges_from(&self, region: u32, pixels: &[u32], labels: &[u32], slots: &mut Slots) -> (Vec<Edges>, Edges) {
        let mut edges: Vec<Edges> = Vec::with_capacity(4 * self.planes.len());
        let mut inner = Edges { other: region, count: 0, sum: 0 };
        slots.begin();
        for (offset, values) in &self.planes {
            let step = offset.down as isize * self.width as isize + offset.right as isize;
            // Successive pixels mostly have partners in the same region.
            let mut run = Edges { other: region, count: 0, sum: 0 };
            for pixel in pixels {
                let pixel = *pixel as usize;
                let column = (pixel % self.width) as i32 + offset.right;
                let partner = pixel.wrapping_add_signed(step);
                if column < 0 || column >= self.width as i32 || partner >= labels.len() {
                    continue;
                }
                let other = labels[partner];
                if other != run.other {
                    close(run, region, &mut edges, &mut inner, slots);
                    run = Edges { other, count: 0, sum: 0 };
                }
                run.count += 1;
                run.sum += i64::from(values[pixel]);
            }
            close(run, region, &mut edges, &mut inner, slots);
        }
        (edges, inner)
    }
}

/// Adds a run of edges of `region` to `inner` if they end in the same region, else to `edges`.
#[inline]
fn close(run: Edges, region: u32, edges: &mut Vec<Edges>, inner: &mut Edges, slots: &mut Slots) {
    if run.other == region {
        inner.count += run.count;
        inner.sum += run.sum;
    } else {
        slots.add(edges, run);
    }
}

/// Numbers the trees of a union-find forest in the order of their first nodes, which must be their roots. Returns the
/// number for each node.
fn numbered(mut parents: Vec<u32>) -> Vec<u32> {
    let mut count = 0;
    let mut labels = vec![0; parents.len()];
    for node in 0..parents.len() {
        let root = root(&mut parents, node as u32) as usize;
        if root == node {
            labels[node] = count;
            count += 1;
        } else {
            labels[node] = labels[root];
        }
    }
    labels
}

/// Returns the root of a node in a union-find forest.
#[inline]
pub(super) fn root(parents: &mut [u32], mut node: u32) -> u32 {
    while parents[node as usize] != node {
        let above = parents[parents[node as usize] as usize];
        parents[node as usize] = above;
        node = above;
    }
    node
}

/// The pixels of each region.
struct PixelsByRegion {
    starts: Vec<u32>,
    pixels: Vec<u32>,
}

impl PixelsByRegion {
    fn new(labels: &[u32], count: usize) -> Self {
        let mut starts = vec![0; count + 1];
        labels.iter().for_each(|label| starts[*label as usize + 1] += 1);
        (0..count).for_each(|region| starts[region + 1] += starts[region]);
        let mut next = starts.clone();
        let mut pixels = vec![0; labels.len()];
        for (pixel, label) in labels.iter().enumerate() {
            let place = &mut next[*label as usize];
            pixels[*place as usize] = pixel as u32;
            *place += 1;
        }
        Self { starts, pixels }
    }

    fn of(&self, region: usize) -> &[u32] {
        &self.pixels[self.starts[region] as usize..self.starts[region + 1] as usize]
    }
}

/// Index of each region in the current list of edges, for lists in which each other region occurs once.
pub(super) struct Slots {
    /// For each region, the list to which it was last added and its index there.
    places: Vec<(u32, u32)>,
    list: u32,
}

impl Slots {
    pub fn new(regions: usize) -> Self {
        Self { places: vec![(0, 0); regions], list: 0 }
    }

    /// Begins a new list.
    #[inline]
    pub fn begin(&mut self) {
        self.list += 1;
    }

    /// Adds edges to a list, combined with the existing entry for the same region if there is one.
    #[inline]
    pub fn add(&mut self, edges: &mut Vec<Edges>, more: Edges) {
        let (list, place) = &mut self.places[more.other as usize];
        if *list == self.list {
            let known = &mut edges[*place as usize];
            known.count += more.count;
            known.sum += more.sum;
        } else {
            (*list, *place) = (self.list, edges.len() as u32);
            edges.push(more);
        }
    }
}

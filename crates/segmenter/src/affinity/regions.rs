//! The initial regions for merging, and the edges between them.
//!
//! Inside an object nearly all log-odds are high, and the order in which its pixels are merged does not matter. So
//! pixels are first united within cells of [`CELL`] × [`CELL`] pixels, along confident edges to direct neighbours. A
//! region never leaves its cell, so it cannot leak far through a gap in a border. The cells lie on the [`Grid`].

use super::grid::Grid;
use super::weights::Offset;
use rayon::prelude::*;
use splatseg_kernels::Instructions;
use splatseg_kernels::feature_map::FeatureMap;
use std::cmp::Ordering;
use std::ops::Range;

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

    /// Compares the means, without a division.
    #[inline]
    pub fn compare_means(&self, other: Self) -> Ordering {
        let product = |sum: i64, count: u32| i128::from(sum) * i128::from(count);
        product(self.sum, other.count).cmp(&product(other.sum, self.count))
    }

    /// Adds other edges to the same region.
    #[inline]
    pub fn add(&mut self, more: Self) {
        self.count += more.count;
        self.sum += more.sum;
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
        let runs = RunsByRegion::new(&labels, image.width, count);
        let jobs: Vec<usize> = (0..count).step_by(REGIONS_PER_JOB).collect();
        let found: Vec<Vec<(Vec<Edges>, Edges)>> = jobs
            .into_par_iter()
            // Slots are as many as regions, so that new ones for each job would take time with their square.
            .map_init(
                || Slots::new(count),
                |slots, first| {
                    let regions = first..count.min(first + REGIONS_PER_JOB);
                    regions.map(|region| image.edges_from(region as u32, runs.of(region), &labels, slots)).collect()
                },
            )
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
        let instructions = Instructions::best();
        let plane = |channel: usize| {
            let mut plane = vec![0; width * height];
            for (row, out) in plane.chunks_exact_mut(width.max(1)).enumerate() {
                let values = log_odds.row(channel, row);
                instructions.run(
                    #[inline(always)]
                    || {
                        for (out, value) in out.iter_mut().zip(values) {
                            *out = (value.clamp(-LARGEST, LARGEST) * UNIT) as i32 as i16;
                        }
                    },
                );
            }
            plane
        };
        let planes = (0..offsets.len()).into_par_iter().map(|channel| (offsets[channel], plane(channel))).collect();
        Self { width, height, planes }
    }

    /// Unites direct neighbours within cells. Returns the region of each pixel.
    fn regions(&self, cell: usize, first: [usize; 2]) -> Vec<u32> {
        let width = self.width.max(1);
        // Regions stay in their row of cells, so every row of cells is numbered by itself.
        let mut bands = Vec::new();
        let mut labels = vec![0; self.width * self.height];
        let (upper, rest) = labels.split_at_mut((first[0] % cell).min(self.height) * self.width);
        let mut row = 0;
        for band in [upper].into_iter().chain(rest.chunks_mut(cell * width)).filter(|band| !band.is_empty()) {
            let rows = row..row + band.len() / width;
            row = rows.end;
            bands.push((rows, band));
        }
        let is_last =
            |column: usize| column + 1 == self.width || (column + 1 + cell - first[1] % cell).is_multiple_of(cell);
        let is_last: Vec<bool> = (0..self.width).map(is_last).collect();
        let counts: Vec<u32> =
            bands.par_iter_mut().map(|(rows, labels)| self.unite(rows.clone(), &is_last, labels)).collect();
        let mut before = 0;
        for ((_, labels), count) in bands.into_iter().zip(counts) {
            labels.iter_mut().for_each(|label| *label += before);
            before += count;
        }
        labels
    }

    /// Unites direct neighbours in some rows, and numbers their regions. Returns the number of regions. `is_last` is true
    /// where the next column is in another cell, or none.
    fn unite(&self, rows: Range<usize>, is_last: &[bool], labels: &mut [u32]) -> u32 {
        let sure = (SURE * UNIT) as i16;
        let start = rows.start * self.width;
        let mut parents: Vec<u32> = (0..labels.len() as u32).collect();
        let mut unite = |a: usize, b: usize| {
            let (a, b) = (root(&mut parents, a as u32), root(&mut parents, b as u32));
            // The root of a region is its first pixel.
            parents[a.max(b) as usize] = a.min(b);
        };
        for (offset, values) in &self.planes {
            let values = &values[start..][..labels.len()];
            match (offset.down, offset.right) {
                (0, 1) => {
                    for (row, values) in values.chunks_exact(self.width).enumerate() {
                        for (column, (value, is_last)) in values.iter().zip(is_last).enumerate() {
                            if *value > sure && !is_last {
                                unite(row * self.width + column, row * self.width + column + 1);
                            }
                        }
                    }
                }
                (1, 0) => {
                    for (pixel, value) in values[..values.len() - self.width].iter().enumerate() {
                        if *value > sure {
                            unite(pixel, pixel + self.width);
                        }
                    }
                }
                _ => {}
            }
        }
        number(&mut parents, labels)
    }

    /// Returns the edges from a region's pixels to each other region, and the edges inside it.
    fn edges_from(&self, region: u32, runs: &[Run], labels: &[u32], slots: &mut Slots) -> (Vec<Edges>, Edges) {
        let mut edges: Vec<Edges> = Vec::with_capacity(4 * self.planes.len());
        let mut inner = Edges { other: region, count: 0, sum: 0 };
        slots.begin();
        for (offset, values) in &self.planes {
            // Successive pixels mostly have partners in the same region.
            let mut found = Edges { other: region, count: 0, sum: 0 };
            for run in runs {
                let Some((pixels, partners)) = self.pairs(*run, *offset) else { continue };
                for (other, value) in labels[partners].iter().zip(&values[pixels]) {
                    if *other != found.other {
                        close(found, region, &mut edges, &mut inner, slots);
                        found = Edges { other: *other, count: 0, sum: 0 };
                    }
                    found.count += 1;
                    found.sum += i64::from(*value);
                }
            }
            close(found, region, &mut edges, &mut inner, slots);
        }
        (edges, inner)
    }

    /// The pixels of a run that have partners at an offset, and these partners.
    #[inline]
    fn pairs(&self, run: Run, offset: Offset) -> Option<(Range<usize>, Range<usize>)> {
        let row = usize::try_from(run.row as i32 + offset.down).ok().filter(|row| *row < self.height)?;
        let first = (run.columns.0 as i32).max(-offset.right);
        let end = (run.columns.1 as i32).min(self.width as i32 - offset.right);
        if first >= end {
            return None;
        }
        let (pixel, partner) = (run.row as usize * self.width, row * self.width);
        let right = |column: i32| (column + offset.right) as usize;
        Some((pixel + first as usize..pixel + end as usize, partner + right(first)..partner + right(end)))
    }
}

/// Adds edges of `region` to `inner` if they end in the same region, else to `edges`.
#[inline]
fn close(found: Edges, region: u32, edges: &mut Vec<Edges>, inner: &mut Edges, slots: &mut Slots) {
    if found.other == region {
        inner.add(found);
        return;
    }
    match slots.place(found.other, edges.len()) {
        Some(place) => edges[place].add(found),
        None => edges.push(found),
    }
}

/// Numbers the trees of a union-find forest in the order of their first nodes, which must be their roots. Writes the
/// number of each node, and returns that of the trees.
fn number(parents: &mut [u32], labels: &mut [u32]) -> u32 {
    let mut count = 0;
    for node in 0..parents.len() {
        let root = root(parents, node as u32) as usize;
        if root == node {
            labels[node] = count;
            count += 1;
        } else {
            labels[node] = labels[root];
        }
    }
    count
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

/// Neighbouring pixels of one row and one region.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    row: u32,
    /// The first column and the one after the last.
    columns: (u32, u32),
}

/// The pixels of each region.
struct RunsByRegion {
    starts: Vec<u32>,
    runs: Vec<Run>,
}

impl RunsByRegion {
    fn new(labels: &[u32], width: usize, count: usize) -> Self {
        let mut found: Vec<(u32, Run)> = Vec::with_capacity(3 * count);
        let mut starts = vec![0; count + 1];
        for (row, labels) in labels.chunks_exact(width.max(1)).enumerate() {
            let mut column = 0;
            for same in labels.chunk_by(|one, next| one == next) {
                let columns = (column, column + same.len() as u32);
                column = columns.1;
                starts[same[0] as usize + 1] += 1;
                found.push((same[0], Run { row: row as u32, columns }));
            }
        }
        (0..count).for_each(|region| starts[region + 1] += starts[region]);
        let mut next = starts.clone();
        let mut runs = vec![Run::default(); found.len()];
        for (region, run) in found {
            let place = &mut next[region as usize];
            runs[*place as usize] = run;
            *place += 1;
        }
        Self { starts, runs }
    }

    fn of(&self, region: usize) -> &[Run] {
        &self.runs[self.starts[region] as usize..self.starts[region + 1] as usize]
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

    /// Returns the place of a region in the current list. If it has none yet, remembers that it is `next`.
    #[inline]
    pub fn place(&mut self, region: u32, next: usize) -> Option<usize> {
        let (list, place) = &mut self.places[region as usize];
        if *list == self.list {
            return Some(*place as usize);
        }
        (*list, *place) = (self.list, next as u32);
        None
    }
}

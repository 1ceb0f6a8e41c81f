//! The regions that merging starts with, and the edges between them.
//!
//! Inside an object nearly all log-odds are high, and the order in which its pixels are merged does not matter. So pixels
//! are first united within cells of [`CELL`] × [`CELL`] pixels, along edges to direct neighbours that are sure. A region
//! never leaves its cell, so nothing can leak through a gap in a border.

use super::weights::Offset;
use rayon::prelude::*;
use splatseg_kernels::feature_map::FeatureMap;

/// Side of a cell, pixels of the half-size image. 1 makes every pixel a region, and merging exact.
const CELL: usize = 4;
/// Log-odds above which direct neighbours in a cell are united.
const SURE: f32 = 2.0;
/// Log-odds are cut off here: beyond, they say how sure the network is, not what it sees.
const LARGEST: f32 = 6.0;
/// Log-odds are added as whole multiples of 1 / 4096, so that sums do not depend on the order.
const UNIT: f32 = 4096.0;
/// Regions whose edges are collected by one job.
const REGIONS_PER_JOB: usize = 128;

/// All edges between a region and another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edges {
    /// The other region.
    pub other: u32,
    pub count: u32,
    /// Sum of the log-odds, in units.
    pub sum: i64,
}

impl Edges {
    /// The mean log-odds: the same bits from both sides.
    pub fn mean(&self) -> f64 {
        self.sum as f64 / (f64::from(self.count) * f64::from(UNIT))
    }
}

/// Regions and the edges between them.
pub(super) struct RegionGraph {
    pub width: usize,
    /// Region of each pixel, row-major. Regions are numbered in the order of their first pixels.
    pub labels: Vec<u32>,
    /// For each region, its edges to others, and those inside it.
    pub edges: Vec<Vec<Edges>>,
    pub inner: Vec<Edges>,
}

impl RegionGraph {
    /// The regions of an image with log-odds `[offsets, height, width]`.
    pub fn from_log_odds(log_odds: &FeatureMap, offsets: &[Offset]) -> Self {
        Self::with_cells(log_odds, offsets, CELL)
    }

    /// As [`Self::from_log_odds`], with cells of `cell` × `cell` pixels.
    pub fn with_cells(log_odds: &FeatureMap, offsets: &[Offset], cell: usize) -> Self {
        let image = PixelEdges::new(log_odds, offsets);
        let labels = image.regions(cell);
        let count = labels.iter().max().map_or(0, |last| *last as usize + 1);
        let pixels = PixelsByRegion::new(&labels, count);
        let jobs: Vec<usize> = (0..count).step_by(REGIONS_PER_JOB).collect();
        let edges: Vec<Vec<(Vec<Edges>, Edges)>> = jobs
            .into_par_iter()
            .map(|first| {
                let mut slots = Slots::new(count);
                let regions = first..count.min(first + REGIONS_PER_JOB);
                regions.map(|region| image.edges_of(region as u32, pixels.of(region), &labels, &mut slots)).collect()
            })
            .collect();
        let (edges, inner) = edges.into_iter().flatten().unzip();
        Self { width: image.width, labels, edges, inner }
    }
}

/// The log-odds of all pixel pairs, in units.
struct PixelEdges {
    width: usize,
    height: usize,
    offsets: Vec<Offset>,
    /// `[height, width, offsets]`.
    values: Vec<i16>,
}

impl PixelEdges {
    fn new(log_odds: &FeatureMap, offsets: &[Offset]) -> Self {
        let (width, height, channels) = (log_odds.width(), log_odds.height(), offsets.len());
        let mut values = vec![0; width * height * channels];
        values.par_chunks_mut((width * channels).max(1)).enumerate().for_each(|(row, out)| {
            for channel in 0..channels {
                let log_odds = log_odds.row(channel, row);
                for (out, value) in out.iter_mut().skip(channel).step_by(channels).zip(log_odds) {
                    *out = (value.clamp(-LARGEST, LARGEST) * UNIT) as i16;
                }
            }
        });
        Self { width, height, offsets: offsets.to_vec(), values }
    }

    /// Index of the pixel at `offset` from `(column, row)`, if there is one.
    fn partner(&self, (column, row): (usize, usize), offset: Offset, sign: i32) -> Option<usize> {
        let column = column as i32 + sign * offset.right;
        let row = row as i32 + sign * offset.down;
        let inside = column >= 0 && row >= 0 && (column as usize) < self.width && (row as usize) < self.height;
        inside.then(|| row as usize * self.width + column as usize)
    }

    /// Unites direct neighbours within cells; returns the region of each pixel.
    fn regions(&self, cell: usize) -> Vec<u32> {
        let sure = (SURE * UNIT) as i16;
        let mut parents: Vec<u32> = (0..(self.width * self.height) as u32).collect();
        for (channel, offset) in self.offsets.iter().enumerate() {
            if offset.down.abs() + offset.right.abs() != 1 {
                continue;
            }
            for pixel in 0..self.width * self.height {
                let (column, row) = (pixel % self.width, pixel / self.width);
                let Some(other) = self.partner((column, row), *offset, 1) else { continue };
                let same_cell = column / cell == other % self.width / cell && row / cell == other / self.width / cell;
                if same_cell && self.values[pixel * self.offsets.len() + channel] > sure {
                    let (a, b) = (root(&mut parents, pixel as u32), root(&mut parents, other as u32));
                    // The first pixel of a region is its root.
                    parents[a.max(b) as usize] = a.min(b);
                }
            }
        }
        let mut count = 0;
        let mut labels = vec![0; parents.len()];
        for pixel in 0..parents.len() {
            let root = root(&mut parents, pixel as u32) as usize;
            if root == pixel {
                labels[pixel] = count;
                count += 1;
            } else {
                labels[pixel] = labels[root];
            }
        }
        labels
    }

    /// The edges of a region to each other one, and those inside it.
    fn edges_of(&self, region: u32, pixels: &[u32], labels: &[u32], slots: &mut Slots) -> (Vec<Edges>, Edges) {
        let channels = self.offsets.len();
        let mut edges: Vec<Edges> = Vec::new();
        let mut inner = Edges { other: region, count: 0, sum: 0 };
        slots.begin();
        for pixel in pixels {
            let pixel = *pixel as usize;
            let place = (pixel % self.width, pixel / self.width);
            for (channel, offset) in self.offsets.iter().enumerate() {
                for (sign, partner) in [1, -1].map(|sign| (sign, self.partner(place, *offset, sign))) {
                    let Some(partner) = partner else { continue };
                    let first = if sign > 0 { pixel } else { partner };
                    let sum = i64::from(self.values[first * channels + channel]);
                    let other = labels[partner];
                    if other != region {
                        slots.add(&mut edges, Edges { other, count: 1, sum });
                    } else if sign > 0 {
                        inner.count += 1;
                        inner.sum += sum;
                    }
                }
            }
        }
        (edges, inner)
    }
}

/// The root of a tree of a union-find structure.
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

/// For lists of edges in which each other region occurs once: the place of every region in the current list.
pub(super) struct Slots {
    /// Place of a region in the list of this round.
    places: Vec<(u32, u32)>,
    round: u32,
}

impl Slots {
    pub fn new(regions: usize) -> Self {
        Self { places: vec![(0, 0); regions], round: 0 }
    }

    /// Begins a new list.
    pub fn begin(&mut self) {
        self.round += 1;
    }

    /// Adds edges to a list: to those with the same region, if there are any.
    pub fn add(&mut self, list: &mut Vec<Edges>, edges: Edges) {
        let (round, place) = &mut self.places[edges.other as usize];
        if *round == self.round {
            let known = &mut list[*place as usize];
            known.count += edges.count;
            known.sum += edges.sum;
        } else {
            (*round, *place) = (self.round, list.len() as u32);
            list.push(edges);
        }
    }
}

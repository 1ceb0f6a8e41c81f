//! Merges regions by the mean log-odds of all edges between two of them, the highest mean first: GASP with average
//! linkage (Bailoni et al., *GASP, a generalized framework for agglomerative clustering of signed graphs*, CVPR 2022).
//!
//! A merge combines the edges to each neighbour, and their mean never exceeds the higher of the two means before. So
//! mutual nearest neighbours are merged sooner or later in any order, and can be found without a queue of all edges:
//! follow each region's nearest neighbour until two are each other's nearest (nearest-neighbour chain; Murtagh, *A
//! survey of recent advances in hierarchical clustering algorithms*, 1983). The tree is the same as in greedy order.

use super::regions::{Edges, RegionGraph, Slots, root};

/// Small regions of an image and the order in which they were merged: a hierarchy of segments.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeTree {
    width: usize,
    /// Region of each pixel of the half-size image, row-major.
    labels: Vec<u32>,
    /// Edges inside each region.
    inner: Vec<Edges>,
    merges: Vec<Merge>,
}

/// An inner node of the tree: merges the two regions that contain `region` and `edges.other` at that time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Merge {
    region: u32,
    /// The edges between the two regions.
    edges: Edges,
}

/// The segments of an image, from a cut through a [`MergeTree`].
#[derive(Clone, Debug, PartialEq)]
pub struct Partition {
    /// Segment of each of the tree's regions.
    pub segment_of_region: Vec<u32>,
    /// For each segment, the probability that two of its pixels belong together, from the mean log-odds of its edges.
    pub scores: Vec<f32>,
}

impl MergeTree {
    /// Merges regions until no edges are left.
    pub(super) fn new(graph: RegionGraph) -> Self {
        let RegionGraph { width, labels, edges, inner } = graph;
        let mut merging = Merging {
            slots: Slots::new(edges.len()),
            parents: (0..edges.len() as u32).collect(),
            merges: Vec::with_capacity(edges.len()),
            edges,
        };
        for region in 0..merging.edges.len() as u32 {
            merging.merge_from(region);
        }
        Self { width, labels, inner, merges: merging.merges }
    }

    /// Returns the regions of the pixels in one row of the half-size image.
    ///
    /// # Panics
    /// If `row` is out of range.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.labels[row * self.width..][..self.width]
    }

    /// Returns the segments after all merges with a mean above `threshold`.
    pub fn cut(&self, threshold: f32) -> Partition {
        let mut parents: Vec<u32> = (0..self.inner.len() as u32).collect();
        let mut inner = self.inner.clone();
        for Merge { region, edges } in self.merges.iter().filter(|merge| merge.edges.mean() > f64::from(threshold)) {
            let (a, b) = (root(&mut parents, *region), root(&mut parents, edges.other));
            let (first, second) = (a.min(b) as usize, a.max(b) as usize);
            parents[second] = first as u32;
            inner[first].count += inner[second].count + edges.count;
            inner[first].sum += inner[second].sum + edges.sum;
        }
        let mut scores = Vec::new();
        let mut segment_of_region = vec![0; parents.len()];
        for region in 0..parents.len() {
            let root = root(&mut parents, region as u32) as usize;
            if root == region {
                segment_of_region[region] = scores.len() as u32;
                let mean = if inner[root].count > 0 { inner[root].mean() } else { 0.0 };
                scores.push((1.0 / (1.0 + (-mean).exp())) as f32);
            } else {
                segment_of_region[region] = segment_of_region[root];
            }
        }
        Partition { segment_of_region, scores }
    }
}

struct Merging {
    /// The edges of each region that is not part of another. Their `other` regions may have been merged since.
    edges: Vec<Vec<Edges>>,
    /// Union-find parent of each region.
    parents: Vec<u32>,
    slots: Slots,
    merges: Vec<Merge>,
}

impl Merging {
    /// Merges all regions reached by the nearest-neighbour chain from `region`.
    fn merge_from(&mut self, region: u32) {
        let mut chain = vec![region];
        while let Some(region) = chain.pop() {
            if self.parents[region as usize] != region {
                continue;
            }
            let before = chain.last().copied();
            let Some(preferred) = self.preferred(region, before) else { continue };
            if before == Some(preferred.other) {
                chain.pop();
                let merged = self.merge(region, preferred);
                if chain.is_empty() {
                    chain.push(merged);
                }
            } else {
                chain.push(region);
                chain.push(preferred.other);
            }
        }
    }

    /// Returns a region's edges with the highest mean. Ties go to `before`, then to the lowest region number.
    fn preferred(&mut self, region: u32, before: Option<u32>) -> Option<Edges> {
        let edges = &mut self.edges[region as usize];
        self.slots.begin();
        // Entries of regions that are one by now are combined in place.
        let mut kept = 0;
        for index in 0..edges.len() {
            let edge = edges[index];
            let other = root(&mut self.parents, edge.other);
            if other == region {
                continue;
            }
            match self.slots.place(other, kept) {
                Some(place) => edges[place].add(edge),
                None => {
                    edges[kept] = Edges { other, ..edge };
                    kept += 1;
                }
            }
        }
        edges.truncate(kept);
        let (mut best, rest) = (edges.first().copied()?, &edges[1..]);
        let rank = |edges: &Edges| (Some(edges.other) != before, edges.other);
        for edges in rest {
            let order = edges.compare_means(best);
            if order.is_gt() || (order.is_eq() && rank(edges) < rank(&best)) {
                best = *edges;
            }
        }
        Some(best)
    }

    /// Merges a region with `edges.other`. Returns the number of the merged region.
    fn merge(&mut self, region: u32, edges: Edges) -> u32 {
        self.merges.push(Merge { region, edges });
        let (mut kept, mut gone) = (region, edges.other);
        if self.edges[kept as usize].len() < self.edges[gone as usize].len() {
            (kept, gone) = (gone, kept);
        }
        self.parents[gone as usize] = kept;
        let moved = std::mem::take(&mut self.edges[gone as usize]);
        self.edges[kept as usize].extend(moved);
        kept
    }
}

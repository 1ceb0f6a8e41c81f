//! Greedy merging of regions, the pair most likely to be one object first, while any border is more likely to be inside
//! an object than between two.

use super::borders::{Border, Region, Regions};
use super::settings::GraphSettings;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Regions after merging.
pub(super) struct Merged {
    /// Region of each patch.
    pub region_of_patch: Vec<u32>,
    /// Confidence in the outline of each region, in [0, 1].
    pub scores: Vec<f32>,
}

/// A pair that may be merged. Ordered by log-odds, then by the regions' numbers to break ties deterministically.
struct Candidate {
    log_odds: f64,
    pair: (u32, u32),
    /// How often each region had been merged when the log-odds were computed. The candidate is stale if that changed.
    versions: (u32, u32),
}

/// Merges regions until no border is more likely to be inside an object than between two.
pub(super) fn merge(mut regions: Regions, settings: &GraphSettings) -> Merged {
    let count = regions.regions.len();
    let mut parent: Vec<u32> = (0..count as u32).collect();
    let mut versions = vec![0u32; count];
    let mut queue = BinaryHeap::new();
    for first in 0..count as u32 {
        for (second, border) in regions.borders[first as usize].range(first + 1..) {
            queue.extend(candidate((first, *second), border, &regions, (&versions, settings)));
        }
    }
    while let Some(Reverse(Candidate { pair: (first, second), versions: expected, .. })) = queue.pop() {
        if (versions[first as usize], versions[second as usize]) != expected {
            continue;
        }
        regions.unite(first, second);
        parent[second as usize] = first;
        versions[first as usize] += 1;
        versions[second as usize] += 1;
        for (near, border) in &regions.borders[first as usize] {
            let pair = (first.min(*near), first.max(*near));
            queue.extend(candidate(pair, border, &regions, (&versions, settings)));
        }
    }
    // A region only joins one with a smaller number, so parents are final before their children are read.
    for index in 0..count {
        parent[index] = parent[parent[index] as usize];
    }
    numbered(parent, &regions, settings)
}

fn candidate(
    pair: (u32, u32),
    border: &Border,
    regions: &Regions,
    (versions, settings): (&[u32], &GraphSettings),
) -> Option<Reverse<Candidate>> {
    let (first, second) = (pair.0 as usize, pair.1 as usize);
    let log_odds = log_odds(border, &regions.regions[first], &regions.regions[second], settings);
    let versions = (versions[first], versions[second]);
    (log_odds < 0.0).then_some(Reverse(Candidate { log_odds, pair, versions }))
}

/// The terms of a border's log-odds, in the order of the weights of [`BorderWeights`](super::BorderWeights) after the
/// bias.
fn evidence(border: &Border, first: &Region, second: &Region, settings: &GraphSettings) -> [f64; 9] {
    let known = border.known.max(1.0);
    let smaller = if first.area <= second.area { first } else { second };
    let off_plane = first.off_plane(second).unwrap_or(0.0) / f64::from(settings.surface.noise);
    [
        border.stepped / known,
        border.concave / known,
        border.convex / known,
        first.color_difference(second, settings.lightness).min(50.0) / 10.0,
        (border.color / border.length).min(50.0) / 10.0,
        off_plane.min(5.0),
        1.0 - border.known / border.length,
        (smaller.area / 100.0).log2(),
        border.length / smaller.outline.max(1.0),
    ]
}

/// Log-odds that a border separates two objects.
fn log_odds(border: &Border, first: &Region, second: &Region, settings: &GraphSettings) -> f64 {
    let weights = &settings.borders;
    let factors = [
        weights.step,
        weights.concave,
        weights.convex,
        weights.color_mean,
        weights.color_border,
        weights.off_plane,
        weights.unknown,
        weights.area,
        weights.enclosure,
    ];
    let evidence = evidence(border, first, second, settings);
    f64::from(weights.bias)
        + factors.iter().zip(evidence).map(|(factor, value)| f64::from(*factor) * value).sum::<f64>()
}

fn numbered(parent: Vec<u32>, regions: &Regions, settings: &GraphSettings) -> Merged {
    let mut numbers = vec![0u32; parent.len()];
    let mut scores = Vec::new();
    for (index, root) in parent.iter().enumerate() {
        if *root as usize == index {
            numbers[index] = scores.len() as u32;
            scores.push(score(index, regions, settings));
        }
    }
    Merged { region_of_patch: parent.iter().map(|root| numbers[*root as usize]).collect(), scores }
}

/// The probability that a region's outline separates objects, averaged along the outline.
fn score(index: usize, regions: &Regions, settings: &GraphSettings) -> f32 {
    let (mut sum, mut length) = (0.0, 0.0);
    for (near, border) in &regions.borders[index] {
        let log_odds = log_odds(border, &regions.regions[index], &regions.regions[*near as usize], settings);
        sum += border.length / (1.0 + (-log_odds).exp());
        length += border.length;
    }
    if length > 0.0 { (sum / length) as f32 } else { 1.0 }
}

impl Regions {
    /// Adds region `second` to region `first`.
    fn unite(&mut self, first: u32, second: u32) {
        let absorbed = std::mem::take(&mut self.borders[second as usize]);
        let shared = self.borders[first as usize].remove(&second).map_or(0.0, |border| border.length);
        let other = self.regions[second as usize];
        self.regions[first as usize].add(&other, shared);
        for (near, border) in absorbed {
            if near != first {
                self.borders[near as usize].remove(&second);
                let united = self.borders[first as usize].entry(near).or_default();
                united.add(&border);
                let united = *united;
                self.borders[near as usize].insert(first, united);
            }
        }
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.log_odds
            .total_cmp(&other.log_odds)
            .then(self.pair.cmp(&other.pair))
            .then(self.versions.cmp(&other.versions))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

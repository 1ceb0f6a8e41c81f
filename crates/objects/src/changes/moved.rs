//! Recognises things that were moved: of those that are gone and those that are new, the ones of the same colours and size.

use glam::Vec3;
use splatseg_geometry::{Candidate, Ratio, best_assignment};
use std::collections::BTreeMap;

/// Side of the bins of chromaticities, the shares of red and green in the sum of the channels.
const BIN: f32 = 0.03;

/// The histograms of the same thing share at least this, 0 to 1. They are not equal: parts are hidden, and Gaussians of
/// other things, e.g. of the floor, become part of a thing that is put there.
const MIN_SHARED: f32 = 0.53;

/// Deviation of a side of a box: share of the longer one, and metres. Two sides must agree; a part of the third may be
/// hidden.
const SIDE: (f32, f32) = (0.15, 0.05);
/// See [`SIDE`]; in these units.
const MAX_DEVIATION: f32 = 1.2;

/// Appearance of a thing, independent of its place.
#[derive(Clone, Debug, Default)]
pub(super) struct Appearance {
    /// Shares of chromaticities, by bin. They do not change with brightness.
    chroma: BTreeMap<(u32, u32), f32>,
    /// Sides of its box, metres.
    size: Vec3,
}

impl Appearance {
    /// `colors` are sRGB colours of parts of the surface with their areas, `size` the sides of the box, metres.
    pub fn new(colors: impl Iterator<Item = ([u8; 3], f32)>, size: Vec3) -> Self {
        let (mut chroma, mut total) = (BTreeMap::<(u32, u32), f32>::new(), 0.0);
        for (color, area) in colors {
            let color = Vec3::from(color.map(f32::from)) + 1.0;
            let sum = color.element_sum();
            let (red, green) = (color.x / sum / BIN, color.y / sum / BIN);
            let ([left, low], [across, up]) = ([red.floor(), green.floor()], [red.fract(), green.fract()]);
            // Each colour is shared by the four bins around it.
            for (column, weight) in [(left, 1.0 - across), (left + 1.0, across)] {
                for (row, other) in [(low, 1.0 - up), (low + 1.0, up)] {
                    *chroma.entry((column as u32, row as u32)).or_default() += area * weight * other;
                }
            }
            total += area;
        }
        chroma.values_mut().for_each(|share| *share /= total);
        Self { chroma, size }
    }

    /// Share of the colours that two things have in common, 0 to 1; `None` if they are different things.
    fn likeness(&self, other: &Self) -> Option<f32> {
        let shares = self.chroma.iter().filter_map(|(bin, share)| Some(share.min(*other.chroma.get(bin)?)));
        let shared: f32 = shares.sum();
        (shared >= MIN_SHARED && self.has_size_of(other)).then_some(shared.min(1.0))
    }

    /// True if two sides of the boxes agree, in some order of the sides.
    fn has_size_of(&self, other: &Self) -> bool {
        const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        ORDERS.iter().any(|order| {
            let agrees = |(side, place): (usize, &usize)| {
                let (one, other) = (self.size[side], other.size[*place]);
                (one - other).abs() <= MAX_DEVIATION * (SIDE.0 * one.max(other) + SIDE.1)
            };
            order.iter().enumerate().filter(|pair| agrees(*pair)).count() >= 2
        })
    }
}

/// Pairs of things that are gone and new, by index, with the largest likeness in all.
pub(super) fn pairs(gone: &[&Appearance], new: &[&Appearance]) -> Vec<(usize, usize)> {
    let mut candidates = Vec::new();
    for (row, one) in gone.iter().enumerate() {
        for (column, other) in new.iter().enumerate() {
            if let Some(likeness) = one.likeness(other) {
                let value = Ratio { numerator: (f64::from(likeness) * 1e6) as u64, denominator: 1_000_000 };
                candidates.push(Candidate::new(row as u64, column as u64, value, None));
            }
        }
    }
    let chosen = best_assignment(&candidates).into_iter().map(|index| candidates[index]);
    chosen.map(|pair| (pair.row as usize, pair.column as usize)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thing(colors: &[([u8; 3], f32)], size: [f32; 3]) -> Appearance {
        Appearance::new(colors.iter().copied(), Vec3::from(size))
    }

    #[test]
    fn a_thing_is_recognised_darker_partly_hidden_and_with_some_of_the_floor() {
        let (red, blue, floor) = ([180, 60, 50], [60, 70, 200], [120, 118, 110]);
        let before = thing(&[(red, 2.0), (blue, 1.0)], [0.3, 0.4, 0.9]);
        let darker = red.map(|channel: u8| (f32::from(channel) * 0.7) as u8);
        let after = thing(&[(darker, 2.0), (blue, 1.0), (floor, 0.8)], [0.4, 0.4, 0.31]);
        let other = thing(&[([60, 160, 50], 3.0)], [0.3, 0.4, 0.9]);
        let larger = thing(&[(red, 2.0), (blue, 1.0)], [0.8, 1.0, 0.9]);
        assert!(before.likeness(&after).is_some() && before.likeness(&other).is_none());
        assert!(before.likeness(&larger).is_none());
        assert_eq!(pairs(&[&other, &before], &[&larger, &after]), [(1, 1)]);
    }
}

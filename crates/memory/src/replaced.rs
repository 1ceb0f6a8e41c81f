//! Things that are replaced by others at the same place: depth cannot tell them apart, colour can.
//!
//! A frame is labelled, with its predictions or with what it showed. Where a label covers a segment that the map expects,
//! the colours of all Gaussians there are compared with the frame. If they differ, the label is not that segment
//! ([`Replacements`]). Gaussians for which several frames in a row say so become those of the thing that is there now.

use crate::SplatMemory;
use crate::map::{RADIUS_PER_SPACING, SplatMap};
use crate::recall::Recall;
use crate::removal::Visibility;
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// Colours of Gaussians that cover fewer pixels are not compared.
const MIN_PIXELS: f32 = 25.0;

/// Colours differ if their [`distance`] is more than this, that of two greys 42 apart, and [`USUAL_DISTANCES`] times that of
/// most Gaussians in the frame: exposure and white balance change.
const MIN_DISTANCE: f32 = 14.0;
const USUAL_DISTANCES: f32 = 5.0;

/// Brightness counts a third of what hue does: shadows change it.
const BRIGHTNESS_WEIGHT: f32 = 1.0 / 3.0;

/// A thing that has been moved covers at least this part of the pixels that it covered before, and the other way round.
const MIN_RELATIVE_SIZE: f32 = 0.5;

/// Share of the frame in the colour of a Gaussian that it sees.
const COLOR_RATE: f32 = 0.25;

/// Pixels that a Gaussian stands for at most: growth never makes larger blocks.
const MAX_BLOCK: f32 = 64.0;

/// Of Gaussians that cover fewer pixels than this, one of [`SMALL_PER_SAMPLE`] is compared, to save time, if there are more
/// than [`ENOUGH`] in all.
const SMALL: f32 = 4.0;
const SMALL_PER_SAMPLE: usize = 4;
const ENOUGH: usize = 10_000;

/// Labels that are not the segments expected at their place, because colours differ.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replacements {
    /// By label and expected segment.
    pairs: BTreeMap<(u32, SegmentId), PairColors>,
}

/// Colours where a label covers a segment: sums over the pixels that Gaussians cover.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct PairColors {
    pixels: f32,
    /// Of the Gaussians.
    remembered: [f32; 3],
    /// Of the pixels near them that fit best.
    fitting: [f32; 3],
    /// Of the pixels at which they lie.
    observed: [f32; 3],
}

/// A Gaussian and the pixel that sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SeenGaussian {
    pub gaussian: usize,
    pub pixel: usize,
    /// Depth of the Gaussian, metres.
    pub depth: f32,
}

/// Replaced segments, and the Gaussians that show them.
#[derive(Default)]
pub(crate) struct FoundReplacements {
    pub replacements: Replacements,
    /// All Gaussians that the frame sees.
    pub seen: Vec<SeenGaussian>,
    /// Those of replaced segments.
    pub replaced: Vec<SeenGaussian>,
}

impl PairColors {
    fn add(&mut self, sample: &Sample) {
        self.pixels += sample.pixels;
        let sums = [&mut self.remembered, &mut self.fitting, &mut self.observed];
        for (sum, color) in sums.into_iter().zip([sample.remembered, sample.fitting, sample.observed]) {
            sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += sample.pixels * value);
        }
    }

    fn mean(&self, sum: [f32; 3]) -> [f32; 3] {
        sum.map(|sum| sum / self.pixels)
    }

    fn differ(&self, usual: f32) -> bool {
        self.pixels >= MIN_PIXELS
            && distance(self.mean(self.remembered), self.mean(self.fitting)) > MIN_DISTANCE + USUAL_DISTANCES * usual
    }

    /// True if what is here now may be what was at another place.
    fn looks_like(&self, other: &Self) -> bool {
        let (less, more) = (self.pixels.min(other.pixels), self.pixels.max(other.pixels));
        less >= MIN_RELATIVE_SIZE * more
            && distance(self.mean(self.observed), other.mean(other.remembered)) < MIN_DISTANCE
    }
}

impl Replacements {
    /// True if no segment was replaced.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// True if a label cannot be a segment.
    pub fn excludes(&self, label: u32, segment: SegmentId) -> bool {
        self.pairs.contains_key(&(label, segment))
    }

    /// True if a label is at the place of another segment.
    pub fn has_replaced(&self, label: u32) -> bool {
        self.pairs.range((label, 0)..=(label, SegmentId::MAX)).next().is_some()
    }

    /// Returns the replaced segment that looks like what a label shows, except those `taken`: it may have been moved there.
    pub fn moved_here(&self, label: u32, taken: &BTreeSet<SegmentId>) -> Option<SegmentId> {
        let most = |pairs: &mut dyn Iterator<Item = (&(u32, SegmentId), &PairColors)>| {
            let most = pairs.max_by(|(_, one), (_, other)| one.pixels.total_cmp(&other.pixels));
            most.map(|(key, colors)| (*key, *colors))
        };
        let (_, own) = most(&mut self.pairs.range((label, 0)..=(label, SegmentId::MAX)))?;
        let mut others = self.pairs.iter().filter(|((other, segment), colors)| {
            *other != label && !taken.contains(segment) && !self.excludes(label, *segment) && own.looks_like(colors)
        });
        most(&mut others).map(|((_, segment), _)| segment)
    }
}

/// Finds predictions that are not the segments expected at their place: see [`SplatMemory::find_replacements`].
pub(crate) fn find(memory: &SplatMemory, recall: &mut Recall<'_>, labels: &SegmentMap) -> Replacements {
    let uncertain = &memory.anchor.uncertain;
    let is_certain = |gaussian: usize| uncertain.is_empty() || !uncertain.contains(&memory.map.anchors[gaussian]);
    let found = compared_colors(memory, recall, labels, is_certain);
    for seen in &found.replaced {
        recall.visibility[seen.gaussian] = Visibility::Replaced;
    }
    let is_due = |seen: &SeenGaussian| {
        memory.map.seen_through[seen.gaussian].saturating_add(1) >= memory.settings.removal_frames
    };
    recall.replaced = found.replaced.into_iter().filter(is_due).collect();
    recall.seen = found.seen;
    found.replacements
}

/// Compares colours where the rules and settings say so. Gaussians for which `is_certain` returns false are left out.
pub(crate) fn compared_colors(
    memory: &SplatMemory,
    recall: &Recall<'_>,
    labels: &SegmentMap,
    is_certain: impl Fn(usize) -> bool,
) -> FoundReplacements {
    let removes = !memory.rules.is_papers_map() && memory.settings.removal_frames > 0;
    if !removes || !memory.rules.judges_predictions || !memory.settings.compare_colors {
        return FoundReplacements::default();
    }
    find_replacements(&memory.map, recall, labels, is_certain)
}

/// Gives Gaussians of things that were replaced to the predictions that are there now.
pub(crate) fn replace(memory: &mut SplatMemory, recall: &mut Recall<'_>, predicted: &SegmentMap) {
    let id = |seen: &SeenGaussian| (seen.gaussian, predicted.pixels()[seen.pixel]);
    let replaced: Vec<(usize, SegmentId)> = recall.replaced.iter().map(id).collect();
    memory.store.replace(&replaced);
    memory.patches.forget(replaced.iter().map(|(gaussian, _)| *gaussian));
    remember_colors(&mut memory.map, recall, predicted);
    for seen in &recall.replaced {
        memory.map.colors[seen.gaussian] = recall.frame.color().pixels()[seen.pixel];
        recall.visibility[seen.gaussian] = Visibility::Seen;
    }
}

/// A Gaussian that a frame sees, with colours: sRGB, 0 to 255, at the map's exposure.
struct Sample {
    seen: SeenGaussian,
    /// Pixels that the Gaussian covers.
    pixels: f32,
    remembered: [f32; 3],
    /// Of the pixel that fits best among nine, as poses may be off by one.
    fitting: [f32; 3],
    observed: [f32; 3],
}

/// Compares the colours of the map with those of the frame. `labels` has the label of each pixel, `[height, width]`, 0 for
/// none. Gaussians for which `is_certain` returns false are left out.
fn find_replacements(
    map: &SplatMap,
    recall: &Recall<'_>,
    labels: &SegmentMap,
    is_certain: impl Fn(usize) -> bool,
) -> FoundReplacements {
    if recall.visibility.is_empty() || recall.contradicts_map {
        return FoundReplacements::default();
    }
    let seen: Vec<SeenGaussian> = (0..map.len())
        .filter(|gaussian| recall.visibility[*gaussian] == Visibility::Seen && is_certain(*gaussian))
        .filter_map(|gaussian| seen_gaussian(map, recall, gaussian))
        .collect();
    let small_per_sample = if seen.len() > ENOUGH { SMALL_PER_SAMPLE } else { 1 };
    let rules = (gains(map, recall, &seen), small_per_sample);
    let samples: Vec<Sample> = seen.iter().filter_map(|seen| Sample::of(map, recall, *seen, rules)).collect();
    let key = |seen: SeenGaussian| {
        let (label, segment) = (labels.pixels()[seen.pixel], recall.belief.segments.pixels()[seen.pixel]);
        (label != 0 && segment != 0).then_some((label, segment))
    };
    let mut pairs: BTreeMap<(u32, SegmentId), PairColors> = BTreeMap::new();
    // Gaussians that were added together mostly lie in one pair.
    for run in samples.chunk_by(|one, next| key(one.seen) == key(next.seen)) {
        if let Some(key) = key(run[0].seen) {
            let colors = pairs.entry(key).or_default();
            run.iter().for_each(|sample| colors.add(sample));
        }
    }
    let usual = median(samples.iter().map(|sample| distance(sample.remembered, sample.fitting)).collect());
    pairs.retain(|_, colors| colors.differ(usual));
    let is_replaced = |seen: &SeenGaussian| key(*seen).is_some_and(|key| pairs.contains_key(&key));
    let replaced = if pairs.is_empty() { Vec::new() } else { seen.iter().copied().filter(is_replaced).collect() };
    FoundReplacements { replacements: Replacements { pairs }, seen, replaced }
}

/// Takes the frame's part in the colours of Gaussians where it shows what was expected. `predicted` contains the id of each
/// pixel, `[height, width]`, 0 for none.
fn remember_colors(map: &mut SplatMap, recall: &Recall<'_>, predicted: &SegmentMap) {
    let is_expected = |pixel: usize| predicted.pixels()[pixel] == recall.belief.segments.pixels()[pixel];
    for SeenGaussian { gaussian, pixel, .. } in recall.seen.iter().copied().filter(|seen| is_expected(seen.pixel)) {
        let observed = recall.frame.color().pixels()[pixel];
        for (color, observed) in map.colors[gaussian].iter_mut().zip(observed) {
            let old = f32::from(*color);
            *color = (old + COLOR_RATE * (f32::from(observed) - old)).round() as u8;
        }
    }
}

/// Distance of two colours, sRGB 0 to 255: of their hues, and of a third of their brightness.
fn distance(one: [f32; 3], other: [f32; 3]) -> f32 {
    squared_distance(one, other).sqrt()
}

fn squared_distance(one: [f32; 3], other: [f32; 3]) -> f32 {
    let [red, green, blue] = [0, 1, 2].map(|channel| one[channel] - other[channel]);
    // Y'CbCr of ITU-R BT.601.
    let brightness = 0.299 * red + 0.587 * green + 0.114 * blue;
    let (blueness, redness) = (0.564 * (blue - brightness), 0.713 * (red - brightness));
    blueness * blueness + redness * redness + (BRIGHTNESS_WEIGHT * brightness).powi(2)
}

/// The upper median; 0 of nothing.
fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

/// A Gaussian with the pixel at which it lies.
fn seen_gaussian(map: &SplatMap, recall: &Recall<'_>, gaussian: usize) -> Option<SeenGaussian> {
    let center = recall.view.camera().to_camera(map.balls.means[gaussian]);
    let place = recall.frame.intrinsics().project(center)?;
    let pixel = place.y.round() as usize * recall.frame.width() + place.x.round() as usize;
    Some(SeenGaussian { gaussian, pixel, depth: center.z })
}

/// Factors from the frame's exposure and white balance to those of the map, one per channel.
fn gains(map: &SplatMap, recall: &Recall<'_>, seen: &[SeenGaussian]) -> [f32; 3] {
    let mut counts = [[[0usize; 256]; 3]; 2];
    for seen in seen {
        let colors = [map.colors[seen.gaussian], recall.frame.color().pixels()[seen.pixel]];
        for (counts, color) in counts.iter_mut().zip(colors) {
            counts.iter_mut().zip(color).for_each(|(counts, value)| counts[usize::from(value)] += 1);
        }
    }
    let median = |counts: &[usize; 256]| {
        let mut sum = 0;
        let is_middle = |count: &usize| {
            sum += count;
            2 * sum > seen.len()
        };
        counts.iter().position(is_middle).unwrap_or(0)
    };
    // A few levels are added to both, so that dark images do not make large factors.
    let gain = |channel: usize| (median(&counts[0][channel]) + 8) as f32 / (median(&counts[1][channel]) + 8) as f32;
    [0, 1, 2].map(|channel| gain(channel).clamp(0.5, 2.0))
}

impl Sample {
    /// `None` for a small Gaussian that another one of `small_per_sample` stands for.
    fn of(
        map: &SplatMap,
        recall: &Recall<'_>,
        seen: SeenGaussian,
        (gains, small_per_sample): ([f32; 3], usize),
    ) -> Option<Self> {
        let frame = recall.frame;
        let side = map.balls.radii[seen.gaussian] / RADIUS_PER_SPACING * frame.intrinsics().fx / seen.depth;
        let mut pixels = (side * side).clamp(1.0, MAX_BLOCK);
        if pixels < SMALL {
            if !seen.gaussian.is_multiple_of(small_per_sample) {
                return None;
            }
            pixels *= small_per_sample as f32;
        }
        let color_at = |pixel: usize| {
            let color = frame.color().pixels()[pixel];
            [0, 1, 2].map(|channel| f32::from(color[channel]) * gains[channel])
        };
        let (remembered, observed) = (map.colors[seen.gaussian].map(f32::from), color_at(seen.pixel));
        let rows = [seen.pixel - frame.width(), seen.pixel, seen.pixel + frame.width()];
        let around = rows.into_iter().flat_map(|center| center - 1..=center + 1).map(color_at);
        let differences = around.map(|color| (squared_distance(color, remembered), color));
        let fitting = differences.min_by(|one, other| one.0.total_cmp(&other.0)).map_or(observed, |(_, color)| color);
        Some(Self { seen, pixels, remembered, fitting, observed })
    }
}

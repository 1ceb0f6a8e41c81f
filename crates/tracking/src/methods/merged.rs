//! Masks that cover a remembered object besides their own (`docs/METHOD.md`, "FastSAM-Splat").
//!
//! A segmenter takes two things for one in some frames: a cushion for part of its sofa. The mask matches one of them,
//! and its votes would erase the other. How often the other was seen by itself says which of the two views is right.
//!
//! This is not in the paper, and is not applied to the paper's memory of features.

use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{ABSTAIN, Appearances, MemoryError, Recall, SplatMemory};
use std::collections::BTreeMap;

/// Smaller expected segments are left alone, pixels: they are rests along borders.
const MIN_AREA: usize = 50;

/// A segment is seen by itself if it and the prediction that has its id have at least this F-score.
const MIN_F_SCORE: f64 = 0.5;

/// A prediction covers a segment if it has at least this fraction of its pixels.
const MIN_COVERED: f64 = 0.9;

/// A segment that was seen by itself in fewer frames may be an error itself.
const MIN_APART: usize = 2;

/// Sightings by itself count up to this number, so that nothing is kept apart for more frames in a row than these allow.
const MAX_APART: usize = 10;

/// A segment is gone where the frame's surface lies in the mean farther behind it than this, metres...
const MIN_GAP: f64 = 0.05;

/// ...and than this fraction of its distance.
const MIN_GAP_RELATIVE: f64 = 0.02;

/// What a frame shows of an expected segment.
#[derive(Default)]
struct ExpectedSegment {
    area: usize,
    /// Pixels by the prediction that is seen there.
    seen_as: BTreeMap<SegmentId, usize>,
    /// Pixels with a rendered and an observed depth.
    measured: usize,
    /// Sum of the rendered depths there, metres.
    depth: f64,
    /// Sum of how far the frame's surface lies behind the rendered one there, metres.
    gap: f64,
}

impl ExpectedSegment {
    /// Whether the frame sees through it.
    fn is_gone(&self) -> bool {
        self.gap > (MIN_GAP * self.measured as f64).max(MIN_GAP_RELATIVE * self.depth)
    }

    /// Whether the prediction that has its id, of `area` pixels, shows it by itself.
    fn is_apart(&self, id: SegmentId, area: usize) -> bool {
        let shared = self.seen_as.get(&id).copied().unwrap_or(0);
        2.0 * shared as f64 >= MIN_F_SCORE * (self.area + area) as f64
    }

    /// The prediction with another id that covers it.
    fn merged_into(&self, id: SegmentId) -> Option<SegmentId> {
        let covers = |(_, shared): &(&SegmentId, &usize)| **shared as f64 >= MIN_COVERED * self.area as f64;
        self.seen_as.iter().find(covers).map(|(other, _)| *other).filter(|other| *other != id)
    }
}

/// Ignores predictions where they cover an expected segment besides their own, until `merged_per_apart` times as many
/// frames have shown the two as one as have shown that segment by itself. Not where the image shows other colours than
/// before: there a flat thing was taken away. `seen` has the ids of the predictions and gets [`ABSTAIN`] there. The memory
/// keeps the counts. 0 switches the rule off.
pub(super) fn keep_apart(
    memory: &mut SplatMemory,
    recall: &Recall<'_>,
    merged_per_apart: f32,
    seen: &mut SegmentMap,
) -> Result<(), MemoryError> {
    let mut kept = merged_segments(recall, merged_per_apart, memory.appearances_mut(), seen);
    if kept.is_empty() {
        return Ok(());
    }
    let recolored = memory.recolored(recall)?;
    kept.retain(|id, _| !recolored.contains(id));
    for (seen, expected) in seen.pixels_mut().iter_mut().zip(recall.expected().segments.pixels()) {
        if kept.get(expected) == Some(seen) {
            *seen = ABSTAIN;
        }
    }
    Ok(())
}

/// The expected segments that are to be kept apart, each with the prediction that covers it. Counts the frame in
/// `appearances`.
fn merged_segments(
    recall: &Recall<'_>,
    merged_per_apart: f32,
    appearances: &mut BTreeMap<SegmentId, Appearances>,
    seen: &SegmentMap,
) -> BTreeMap<SegmentId, SegmentId> {
    if merged_per_apart == 0.0 {
        return BTreeMap::new();
    }
    let areas = seen.areas();
    let mut kept = BTreeMap::new();
    for (id, found) in expected_segments(recall, seen) {
        if found.area < MIN_AREA || found.is_gone() {
            continue;
        }
        if found.is_apart(id, areas.get(&id).copied().unwrap_or(0)) {
            let counts = appearances.entry(id).or_default();
            counts.apart = (counts.apart + 1).min(MAX_APART);
            counts.merged = counts.merged.min((merged_per_apart * counts.apart as f32) as usize);
        } else if let Some(other) = found.merged_into(id) {
            let counts = appearances.entry(id).or_default();
            counts.merged = counts.merged.saturating_add(1);
            let is_known = counts.apart >= MIN_APART;
            if is_known && (counts.merged as f32) < merged_per_apart * counts.apart as f32 {
                kept.insert(id, other);
            }
        }
    }
    kept
}

fn expected_segments(recall: &Recall<'_>, seen: &SegmentMap) -> BTreeMap<SegmentId, ExpectedSegment> {
    let mut found: BTreeMap<SegmentId, ExpectedSegment> = BTreeMap::new();
    let pixels = recall.expected().segments.pixels().iter().zip(seen.pixels());
    let depths = recall.depth().pixels().iter().zip(recall.frame().depth().pixels());
    let (mut run, mut run_of) = (Run::default(), (0, 0));
    for ((expected, seen), (rendered, observed)) in pixels.zip(depths) {
        if (*expected, *seen) != run_of {
            run.end(run_of, &mut found);
            (run, run_of) = (Run::default(), (*expected, *seen));
        }
        run.area += 1;
        if *rendered > 0.0 && *observed > 0.0 {
            run.measured += 1;
            run.depth += f64::from(*rendered);
            run.gap += f64::from(observed - rendered);
        }
    }
    run.end(run_of, &mut found);
    found
}

/// Successive pixels with one expected segment and one prediction; sums as in [`ExpectedSegment`].
#[derive(Default)]
struct Run {
    area: usize,
    measured: usize,
    depth: f64,
    gap: f64,
}

impl Run {
    /// Adds the pixels to those of their segment.
    fn end(&self, (expected, seen): (SegmentId, SegmentId), found: &mut BTreeMap<SegmentId, ExpectedSegment>) {
        if expected == 0 {
            return;
        }
        let segment = found.entry(expected).or_default();
        segment.area += self.area;
        if seen != 0 && seen != ABSTAIN {
            *segment.seen_as.entry(seen).or_default() += self.area;
        }
        segment.measured += self.measured;
        segment.depth += self.depth;
        segment.gap += self.gap;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame};
    use splatseg_memory::MemorySettings;

    const SIZE: (usize, usize) = (64, 48);

    /// A wall, `depth` metres ahead.
    fn wall(depth: f32) -> RgbdFrame<'static> {
        let (width, height) = SIZE;
        let camera = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width, height };
        let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, depth));
        RgbdFrame::new("0", color, depth, camera, Pose::IDENTITY).unwrap()
    }

    /// Segment 2 to the right of a column, segment 1 to its left.
    fn halves(column: usize) -> SegmentMap {
        SegmentMap::from_fn(SIZE.0, SIZE.1, |x, _| if x < column { 1 } else { 2 })
    }

    /// A memory of the wall 2 m ahead.
    fn memory(segments: &SegmentMap) -> SplatMemory {
        let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
        (0..2).for_each(|_| assert!(memory.new_segment().is_ok()));
        for _ in 0..2 {
            let frame = wall(2.0);
            memory.update(memory.recall(&frame), segments).unwrap();
        }
        memory
    }

    /// Whether each of some frames of the wall at `depth`, which show it as segment 1, keeps segment 2 apart; and how it
    /// was seen after them.
    fn kept(segments: &SegmentMap, depth: f32, before: Appearances, merged_per_apart: f32) -> (Vec<bool>, Appearances) {
        let (mut memory, frame) = (memory(segments), wall(depth));
        memory.appearances_mut().insert(2, before);
        let kept = (0..4).map(|_| {
            let recall = memory.recall(&frame);
            let mut seen = SegmentMap::filled(SIZE.0, SIZE.1, 1);
            keep_apart(&mut memory, &recall, merged_per_apart, &mut seen).unwrap();
            let expected = recall.expected().segments.pixels();
            let is_kept = seen.pixels().contains(&ABSTAIN);
            for (seen, expected) in seen.pixels().iter().zip(expected) {
                assert_eq!(*seen, if is_kept && *expected == 2 { ABSTAIN } else { 1 });
            }
            is_kept
        });
        let kept: Vec<bool> = kept.collect();
        (kept, memory.appearances_mut()[&2])
    }

    #[test]
    fn what_was_seen_by_itself_is_kept_apart_for_so_many_frames() {
        let counts = |apart, merged| Appearances { apart, merged };
        let kept = |segments: &SegmentMap, before, ratio| kept(segments, 2.0, before, ratio);
        assert_eq!(kept(&halves(40), counts(2, 0), 2.0), (vec![true, true, true, false], counts(2, 4)));
        assert_eq!(kept(&halves(40), counts(4, 6), 2.0), (vec![true, false, false, false], counts(4, 10)));
        assert_eq!(kept(&halves(40), counts(1, 0), 100.0), (vec![false; 4], counts(1, 4)), "seen once only");
        assert_eq!(kept(&halves(40), counts(2, 0), 0.0), (vec![false; 4], counts(2, 0)), "switched off");
        assert_eq!(kept(&halves(63), counts(2, 0), 2.0), (vec![false; 4], counts(2, 0)), "48 pixels");
    }

    #[test]
    fn what_the_frame_sees_through_is_not_kept() {
        let before = Appearances { apart: 2, ..Appearances::default() };
        assert_eq!(kept(&halves(40), 2.07, before, 2.0), (vec![false; 4], before));
        assert_eq!(kept(&halves(40), 2.03, before, 2.0).0, [true, true, true, false]);
        assert_eq!(kept(&halves(40), 1.95, before, 2.0).0, [true, true, true, false], "in front of it");
    }

    #[test]
    fn a_prediction_of_most_of_it_shows_it_by_itself() {
        let memory = memory(&halves(40));
        let frame = wall(2.0);
        let recall = memory.recall(&frame);
        let counts_after = |seen: &SegmentMap| {
            let mut appearances = BTreeMap::new();
            merged_segments(&recall, 2.0, &mut appearances, seen);
            appearances.get(&2).copied().unwrap_or_default()
        };
        let apart = Appearances { apart: 1, ..Appearances::default() };
        assert_eq!(counts_after(&halves(40)), apart);
        assert_eq!(counts_after(&halves(55)), apart, "9 of 24 columns");
        assert_eq!(counts_after(&halves(57)), Appearances::default(), "7 of 24 columns");
        assert_eq!(counts_after(&halves(63)), Appearances { apart: 0, merged: 1 }, "another has 23 of 24 columns");
        assert_eq!(counts_after(&SegmentMap::filled(SIZE.0, SIZE.1, 0)), Appearances::default(), "no prediction");
    }
}

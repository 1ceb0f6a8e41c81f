//! The tracker's errors, detected with the memory (`docs/PAPER.md`, "SAM2-Splat", step 2).
//!
//! A track has the same id as the segment that the memory should expect in its place: its **own** segment. Terms:
//!
//! - An expected segment is **trusted** if it is large enough (`min_expected_area`) and its mean confidence is high
//!   enough (`min_confidence`). Other expected segments cause no errors.
//! - A track is **on** the expected segment with which it has the largest F-score, if that is at least `min_f_score`.
//!   Only pixels with an expected segment count: a track may extend into areas that the memory has not seen.
//! - A track's **wrong fraction** is the fraction of its pixels on which the memory expects another segment. As
//!   outlines are never exact, parts that are nowhere thicker than twice `outline_tolerance_px` do not count.
//! - A track in view is **right** if its own segment is trusted, their F-score is at least `min_f_score`, and its wrong
//!   fraction is at most `max_wrong_fraction`. It is **wrong** if its own segment is trusted and it is not right. A
//!   track whose own segment is not expected, or not trusted, is neither: the memory has not learnt it (yet).
//!
//! The errors:
//!
//! - **(a) not tracked**: a trusted segment whose own track is not in view, without another track on it, and with at
//!   most `max_covered_fraction` covered by other tracks. Remedy: clicks on the part that they do not cover. An answer
//!   that shows the object of another track is undone (`max_answer_iou`).
//! - **(b) incorrect track**: a trusted segment whose own track is not in view, but with another track on it; or one
//!   whose own track is wrong (unless that is a duplicate). Remedy: positive clicks on the segment, negative ones on
//!   the part of its track that is on other segments, or on the whole track if no part of it is on its own segment. A
//!   track on this segment whose own segment is not expected is removed: it follows this object under a newer id, or
//!   its object is out of view and will be prompted when it returns.
//! - **(c) duplicated track**: a track is on a segment whose own track is right. If its own segment is trusted, the
//!   track gets positive clicks there and negative ones on the other segment; if it is not expected, the track is
//!   removed.
//!
//! Without `remove_tracks`, such tracks get negative clicks where they are, and positive ones on the expected part of
//! their own segment, if there is any.
//!
//! No remedy claims pixels of a right track, and no right track is ever prompted or removed.

use super::RepromptSettings;
use crate::matching::overlaps;
use rayon::prelude::*;
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_memory::SegmentBelief;
use std::collections::{BTreeMap, BTreeSet};

/// The kinds of errors that a memory can detect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TrackErrorKind {
    /// An expected segment has no track.
    NotTracked,
    /// An expected segment is tracked under another id, or its own track is wrong.
    IncorrectTrack,
    /// An expected segment has several tracks.
    DuplicatedTrack,
}

/// An error of a tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackError {
    /// Kind of the error.
    pub kind: TrackErrorKind,
    /// Track to be corrected.
    pub track: SegmentId,
    /// Correction of the error.
    pub remedy: Remedy,
}

/// The correction of an error.
#[derive(Clone, Debug, PartialEq)]
pub enum Remedy {
    /// Prompt the track.
    Prompt {
        /// Region where the track should be, for positive clicks.
        expected: Mask,
        /// Region where the track should not be, for negative clicks. May be empty.
        wrong: Mask,
    },
    /// Remove the track.
    Remove,
}

/// Numbers of errors of a frame, or summed over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TrackErrorCounts {
    /// Number of [`TrackErrorKind::NotTracked`] errors.
    pub not_tracked: usize,
    /// Number of [`TrackErrorKind::IncorrectTrack`] errors.
    pub incorrect_track: usize,
    /// Number of [`TrackErrorKind::DuplicatedTrack`] errors.
    pub duplicated_track: usize,
}

impl TrackErrorCounts {
    /// Counts the errors of each kind.
    pub fn of(errors: &[TrackError]) -> Self {
        let count = |kind| errors.iter().filter(|error| error.kind == kind).count();
        Self {
            not_tracked: count(TrackErrorKind::NotTracked),
            incorrect_track: count(TrackErrorKind::IncorrectTrack),
            duplicated_track: count(TrackErrorKind::DuplicatedTrack),
        }
    }
}

impl std::ops::AddAssign for TrackErrorCounts {
    fn add_assign(&mut self, other: Self) {
        self.not_tracked += other.not_tracked;
        self.incorrect_track += other.incorrect_track;
        self.duplicated_track += other.duplicated_track;
    }
}

/// Returns the errors of the kinds enabled in `settings`, at most one per track, by increasing track id.
///
/// `tracks` are the tracker's masks of a frame, by increasing id. `expected` contains the segments that the memory
/// expects in the frame.
pub fn find_track_errors(
    expected: &SegmentBelief,
    tracks: &[(SegmentId, Mask)],
    settings: &RepromptSettings,
) -> Vec<TrackError> {
    let comparison = Comparison::new(expected, tracks, settings);
    let mut errors = Vec::new();
    for segment in comparison.trusted.iter().copied() {
        if let Some(error) = comparison.error_of_expected(segment) {
            errors.push(error);
        }
    }
    for id in comparison.tracks.keys().copied() {
        if let Some(error) = comparison.error_of_unexpected(id) {
            errors.push(error);
        }
    }
    errors.retain(|error| match error.kind {
        TrackErrorKind::NotTracked => settings.not_tracked,
        TrackErrorKind::IncorrectTrack => settings.incorrect_track,
        TrackErrorKind::DuplicatedTrack => settings.duplicated_track,
    });
    errors.sort_by_key(|error| error.track);
    errors
}

/// A track in view, compared with the expected segments.
struct ComparedTrack<'a> {
    mask: &'a Mask,
    /// Expected segment that the track is on.
    on_segment: Option<SegmentId>,
    standing: Standing,
}

/// Judgement of a track by the memory; see the terms above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    Right,
    Wrong,
    Unknown,
}

struct Comparison<'a> {
    expected: &'a SegmentMap,
    settings: &'a RepromptSettings,
    trusted: BTreeSet<SegmentId>,
    /// Tracks in view.
    tracks: BTreeMap<SegmentId, ComparedTrack<'a>>,
}

impl<'a> Comparison<'a> {
    fn new(expected: &'a SegmentBelief, tracks: &'a [(SegmentId, Mask)], settings: &'a RepromptSettings) -> Self {
        let segments = &expected.segments;
        let (areas, trusted) = (segments.areas(), trusted(expected, settings));
        let compare = |id: SegmentId, mask: &'a Mask| {
            let overlaps = overlaps(segments, mask);
            let known: usize = overlaps.values().sum();
            let f_score = |segment: &SegmentId| {
                let shared = overlaps.get(segment).copied().unwrap_or(0);
                2.0 * shared as f64 / (known + areas.get(segment).copied().unwrap_or(0)).max(1) as f64
            };
            // Ties go to the first.
            let best =
                overlaps.keys().map(|segment| (f_score(segment), *segment)).rev().max_by(|a, b| a.0.total_cmp(&b.0));
            let is_right = || {
                // If the part with outlines is small enough, so is the part without them.
                let elsewhere = known - overlaps.get(&id).copied().unwrap_or(0);
                let max_wrong = settings.max_wrong_fraction * mask.area() as f64;
                let wrong = || wrong_part(segments, id, mask, settings.outline_tolerance_px).area();
                f_score(&id) >= settings.min_f_score && (elsewhere as f64 <= max_wrong || wrong() as f64 <= max_wrong)
            };
            let standing = match () {
                () if !trusted.contains(&id) => Standing::Unknown,
                () if is_right() => Standing::Right,
                () => Standing::Wrong,
            };
            let on_segment = best.filter(|(score, _)| *score >= settings.min_f_score).map(|(_, segment)| segment);
            ComparedTrack { mask, on_segment, standing }
        };
        let in_view: Vec<&(SegmentId, Mask)> = tracks.iter().filter(|(_, mask)| !mask.is_empty()).collect();
        let compared = in_view.into_par_iter().map(|(id, mask)| (*id, compare(*id, mask)));
        Self { expected: segments, settings, tracks: compared.collect::<Vec<_>>().into_iter().collect(), trusted }
    }

    /// Returns the error of a trusted segment, if any.
    fn error_of_expected(&self, segment: SegmentId) -> Option<TrackError> {
        let own = self.tracks.get(&segment);
        if own.is_some_and(|own| own.standing == Standing::Right) {
            return None;
        }
        let expected = self.expected.mask_of(segment);
        let area = expected.area();
        let left = self.left_by_others(segment, expected);
        if ((area - left.area()) as f64) > self.settings.max_covered_fraction * area as f64 {
            return None;
        }
        let kind = match own {
            Some(own) if own.on_segment.is_some_and(|other| other != segment && self.is_right(other)) => {
                TrackErrorKind::DuplicatedTrack
            }
            None if !self.has_other_track(segment) => TrackErrorKind::NotTracked,
            _ => TrackErrorKind::IncorrectTrack,
        };
        let wrong = own
            .map_or_else(|| Mask::empty(left.width(), left.height()), |own| self.wrongly_labelled(segment, own.mask));
        Some(TrackError { kind, track: segment, remedy: Remedy::Prompt { expected: left, wrong } })
    }

    /// Returns the part of a wrong track that should not be there: the part on other segments, or the whole track if no
    /// part is on its own segment.
    fn wrongly_labelled(&self, segment: SegmentId, mask: &Mask) -> Mask {
        let is_elsewhere = mask.pixel_indices().all(|index| self.expected.pixels()[index] != segment);
        Mask::from_fn(mask.width(), mask.height(), |column, row| {
            let expected = self.expected[(column, row)];
            mask.contains(column, row) && expected != segment && (is_elsewhere || expected != 0)
        })
    }

    /// Returns the error of a track on another segment whose own segment is not trusted, if any.
    fn error_of_unexpected(&self, id: SegmentId) -> Option<TrackError> {
        let track = self.tracks.get(&id).filter(|track| track.standing == Standing::Unknown)?;
        let segment = track.on_segment.filter(|segment| *segment != id && self.trusted.contains(segment))?;
        let kind = if self.is_right(segment) {
            TrackErrorKind::DuplicatedTrack
        } else {
            // The segment's own track is prompted, unless right tracks cover it.
            self.error_of_expected(segment)?;
            TrackErrorKind::IncorrectTrack
        };
        let remedy = if self.settings.remove_tracks {
            Remedy::Remove
        } else {
            let expected = self.left_by_others(id, self.expected.mask_of(id));
            Remedy::Prompt { expected, wrong: self.wrongly_labelled(id, track.mask) }
        };
        Some(TrackError { kind, track: id, remedy })
    }

    fn is_right(&self, id: SegmentId) -> bool {
        self.tracks.get(&id).is_some_and(|track| track.standing == Standing::Right)
    }

    /// True if a track other than its own is on a segment.
    fn has_other_track(&self, segment: SegmentId) -> bool {
        self.tracks.iter().any(|(id, track)| *id != segment && track.on_segment == Some(segment))
    }

    /// Returns the part of a segment that no other track covers, ignoring tracks that are wrong or on this segment.
    fn left_by_others(&self, segment: SegmentId, mut expected: Mask) -> Mask {
        let is_counted = |track: &ComparedTrack| track.standing != Standing::Wrong && track.on_segment != Some(segment);
        for (id, track) in &self.tracks {
            if *id != segment && is_counted(track) {
                expected.subtract(track.mask);
            }
        }
        expected
    }
}

/// Returns the expected segments that are large and certain enough.
fn trusted(expected: &SegmentBelief, settings: &RepromptSettings) -> BTreeSet<SegmentId> {
    let mut sums: BTreeMap<SegmentId, (usize, f64)> = BTreeMap::new();
    for (segment, confidence) in expected.segments.pixels().iter().zip(expected.confidence.pixels()) {
        if *segment != 0 {
            let (area, sum) = sums.entry(*segment).or_default();
            *area += 1;
            *sum += f64::from(*confidence);
        }
    }
    let is_trusted = |(area, sum): &(usize, f64)| {
        *area >= settings.min_expected_area.max(1) && sum / *area as f64 >= f64::from(settings.min_confidence)
    };
    sums.into_iter().filter(|(_, found)| is_trusted(found)).map(|(segment, _)| segment).collect()
}

/// Returns the part of a track on other expected segments, without parts nowhere thicker than twice the tolerance.
fn wrong_part(expected: &SegmentMap, id: SegmentId, mask: &Mask, outline_tolerance_px: usize) -> Mask {
    let is_elsewhere = |segment: SegmentId| segment != 0 && segment != id;
    let elsewhere = Mask::from_fn(mask.width(), mask.height(), |column, row| {
        mask.contains(column, row) && is_elsewhere(expected[(column, row)])
    });
    elsewhere.opened(outline_tolerance_px)
}

//! Finds a tracker's errors and corrects them with clicks (`docs/PAPER.md`, "SAM2-Splat", steps 2 and 3).

mod clicks;
mod track_errors;

pub use clicks::sample_clicks;
pub use track_errors::{Remedy, TrackError, TrackErrorCounts, TrackErrorKind, find_track_errors};

use splatseg_geometry::{Click, Mask, Prompt, SegmentId};
use splatseg_settings::{Allowed, settings};
use std::collections::BTreeSet;

settings! {
    /// Settings for correcting the errors of a tracker. The paper names the errors and the number of clicks; the
    /// thresholds are ours.
    #[derive(Copy)]
    pub struct RepromptSettings in "reprompt" {
        /// Prompt segments that are expected but not tracked.
        not_tracked: bool = true, Allowed::Switch;
        /// Prompt segments that are tracked under another id, or whose track is elsewhere.
        incorrect_track: bool = true, Allowed::Switch;
        /// Correct or remove additional tracks on a segment that its own track follows.
        duplicated_track: bool = true, Allowed::Switch;
        /// Positive clicks per error, and as many negative ones if a region has the wrong label (see
        /// `count_negative_clicks`). The paper: 5.
        clicks: usize = 5, Allowed::between(1.0, 100.0);
        /// Let `clicks` be the total of a track's positive and negative clicks. If both are needed, half are positive,
        /// rounded up. The paper, with 5 clicks per object: true.
        count_negative_clicks: bool = false, Allowed::Switch;
        /// Remove a track on another segment if its own segment is not expected. Otherwise it gets negative clicks
        /// there. The paper, which only clicks: false.
        remove_tracks: bool = true, Allowed::Switch;
        /// A track is on an expected segment if their F-score, over the pixels with an expected segment, is at least
        /// this.
        min_f_score: f64 = 0.5, Allowed::above_up_to(0.0, 1.0);
        /// A track is wrong if the memory expects other segments on more than this fraction of its pixels.
        max_wrong_fraction: f64 = 0.25, Allowed::between(0.0, 1.0);
        /// Parts of a track on other expected segments do not count as wrong if they are nowhere thicker than twice
        /// this, pixels: outlines are never exact.
        outline_tolerance_px: usize = 2, Allowed::between(0.0, 1000.0);
        /// A segment is prompted only if other tracks cover at most this fraction of it.
        max_covered_fraction: f64 = 0.5, Allowed::between(0.0, 1.0);
        /// A prompted segment that was not tracked stays untracked if the answer has a larger IoU than this with
        /// another track, which already follows that object. The paper, which keeps every answer: 1.
        max_answer_iou: f64 = 0.5, Allowed::between(0.0, 1.0);
        /// Expected segments with fewer pixels are not trusted.
        min_expected_area: usize = 100, Allowed::between(0.0, 1e9);
        /// Expected segments with a smaller mean confidence are not trusted.
        min_confidence: f32 = 0.6, Allowed::between(0.0, 1.0);
    }
}

/// Returns the prompts that correct the errors, and the tracks to be removed.
pub(crate) fn corrections(
    errors: &[TrackError],
    settings: &RepromptSettings,
) -> (Vec<(SegmentId, Prompt)>, BTreeSet<SegmentId>) {
    let (mut prompts, mut removed) = (Vec::new(), BTreeSet::new());
    for error in errors {
        match &error.remedy {
            Remedy::Remove => {
                removed.insert(error.track);
            }
            Remedy::Prompt { expected, wrong } => {
                let (positive, negative) = numbers_of_clicks(settings, expected, wrong);
                let mut all = clicks_in(expected, positive, true);
                all.extend(clicks_in(wrong, negative, false));
                prompts.push((error.track, Prompt::Points { bounding_box: None, clicks: all }));
            }
        }
    }
    (prompts, removed)
}

/// Returns the segments that were not tracked and whose prompts were answered with an object that another track already
/// shows. `tracks` are the masks after prompting, by increasing id. Of two answers that show the same object, the
/// smaller id's is kept.
pub(crate) fn repeated_answers(
    errors: &[TrackError],
    tracks: &[(SegmentId, Mask)],
    settings: &RepromptSettings,
) -> BTreeSet<SegmentId> {
    let mut repeated = BTreeSet::new();
    for error in errors.iter().rev().filter(|error| error.kind == TrackErrorKind::NotTracked) {
        let Some((id, answer)) = tracks.iter().find(|(id, _)| *id == error.track) else { continue };
        let mut others = tracks.iter().filter(|(other, _)| other != id && !repeated.contains(other));
        if others.any(|(_, other)| other.iou(answer) > settings.max_answer_iou) {
            repeated.insert(*id);
        }
    }
    repeated
}

/// Returns the numbers of clicks in the region where the track should be and in the region where it should not.
fn numbers_of_clicks(settings: &RepromptSettings, expected: &Mask, wrong: &Mask) -> (usize, usize) {
    let clicks = settings.clicks;
    let share = settings.count_negative_clicks && !expected.is_empty() && !wrong.is_empty();
    if share { (clicks.div_ceil(2), clicks / 2) } else { (clicks, clicks) }
}

/// Returns clicks at pixel centres: the coordinates of a [`Click`] start at the image border.
fn clicks_in(region: &Mask, count: usize, positive: bool) -> Vec<Click> {
    let click = |(column, row): (usize, usize)| Click { x: column as f32 + 0.5, y: row as f32 + 0.5, positive };
    sample_clicks(region, count).into_iter().map(click).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of positive and negative clicks of the only prompt of an error.
    fn clicks(settings: &RepromptSettings, expected: Mask, wrong: Mask) -> (usize, usize) {
        let remedy = Remedy::Prompt { expected, wrong };
        let error = TrackError { kind: TrackErrorKind::IncorrectTrack, track: 4, remedy };
        let (prompts, removed) = corrections(&[error], settings);
        assert!(removed.is_empty());
        let [(4, Prompt::Points { bounding_box: None, clicks })] = prompts.as_slice() else { panic!("{prompts:?}") };
        let positive = clicks.iter().filter(|click| click.positive).count();
        (positive, clicks.len() - positive)
    }

    #[test]
    fn clicks_are_counted_for_each_region_or_for_the_track() {
        let region = |left: bool| Mask::from_fn(60, 30, |column, _| (column < 30) == left);
        let none = || Mask::empty(60, 30);
        let ours = RepromptSettings::default();
        assert_eq!(clicks(&ours, region(true), region(false)), (5, 5));
        assert_eq!(clicks(&ours, region(true), none()), (5, 0));
        let paper = ours.with(|settings| settings.count_negative_clicks = true);
        assert_eq!(clicks(&paper, region(true), region(false)), (3, 2));
        assert_eq!(clicks(&paper, region(true), none()), (5, 0));
        assert_eq!(clicks(&paper, none(), region(false)), (0, 5));
        let one = paper.with(|settings| settings.clicks = 1);
        assert_eq!(clicks(&one, region(true), region(false)), (1, 0));
    }

    #[test]
    fn an_answer_with_the_object_of_another_track_is_repeated() {
        let stripe = |from: usize, to: usize| Mask::from_fn(60, 30, |column, _| (from..to).contains(&column));
        let error = |kind, track| {
            let remedy = Remedy::Prompt { expected: stripe(0, 5), wrong: stripe(0, 0) };
            TrackError { kind, track, remedy }
        };
        let not_tracked = |track| error(TrackErrorKind::NotTracked, track);
        let repeated = |errors: &[TrackError], tracks: &[(SegmentId, Mask)], max_answer_iou: f64| {
            let settings = RepromptSettings::default().with(|settings| settings.max_answer_iou = max_answer_iou);
            repeated_answers(errors, tracks, &settings).into_iter().collect::<Vec<_>>()
        };
        let tracks = [(1, stripe(0, 30)), (2, stripe(10, 30)), (3, stripe(40, 50)), (4, stripe(41, 50))];
        assert_eq!(repeated(&[not_tracked(2)], &tracks, 0.6), [2], "an IoU of two thirds with 1");
        assert_eq!(repeated(&[not_tracked(2)], &tracks, 0.7), [0; 0]);
        assert_eq!(
            repeated(&[error(TrackErrorKind::IncorrectTrack, 2)], &tracks, 0.6),
            [0; 0],
            "another kind of error"
        );
        assert_eq!(repeated(&[not_tracked(3), not_tracked(4)], &tracks, 0.6), [4], "3 is kept, as 4 is not");
        assert_eq!(repeated(&[not_tracked(1), not_tracked(3)], &tracks[..3], 0.6), [1]);
        let same = [(1, stripe(0, 30)), (2, stripe(0, 30))];
        assert_eq!(repeated(&[not_tracked(2)], &same, 1.0), [0; 0], "switched off");
        assert_eq!(repeated(&[not_tracked(2)], &[(1, stripe(0, 0)), (2, stripe(0, 0))], 0.5), [0; 0], "empty masks");
    }
}

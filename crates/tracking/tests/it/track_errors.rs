//! Detection of the tracker's errors, on small maps.

use splatseg_geometry::{Image, Mask, SegmentId, SegmentMap};
use splatseg_memory::SegmentBelief;
use splatseg_tracking::{Remedy, RepromptSettings, TrackErrorCounts, TrackErrorKind, find_track_errors};

const SIZE: (usize, usize) = (60, 10);

fn stripe(from: usize, to: usize) -> Mask {
    Mask::from_fn(SIZE.0, SIZE.1, |column, _| (from..to).contains(&column))
}

/// Segments 1, 2, 3 in stripes of ten columns, then nothing.
fn expected() -> SegmentBelief {
    let segments = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| match column / 10 {
        stripe @ 0..3 => stripe as u32 + 1,
        _ => 0,
    });
    SegmentBelief { segments, confidence: Image::filled(SIZE.0, SIZE.1, 1.0) }
}

type Found = (TrackErrorKind, SegmentId, Option<(Mask, Mask)>);

fn errors_in(expected: &SegmentBelief, tracks: &[(SegmentId, Mask)]) -> Vec<Found> {
    errors_by(&RepromptSettings::default(), expected, tracks)
}

fn errors_by(settings: &RepromptSettings, expected: &SegmentBelief, tracks: &[(SegmentId, Mask)]) -> Vec<Found> {
    let found = find_track_errors(expected, tracks, settings);
    let parts = |remedy: Remedy| match remedy {
        Remedy::Prompt { expected, wrong } => Some((expected, wrong)),
        Remedy::Remove => None,
    };
    found.into_iter().map(|error| (error.kind, error.track, parts(error.remedy))).collect()
}

fn errors(tracks: &[(SegmentId, Mask)]) -> Vec<Found> {
    errors_in(&expected(), tracks)
}

#[test]
fn tracks_where_they_are_expected_are_right() {
    assert!(errors(&[(1, stripe(0, 10)), (2, stripe(10, 20)), (3, stripe(20, 30))]).is_empty());
    // Slightly off, extending into the unknown, and a track of something new.
    assert!(errors(&[(1, stripe(0, 9)), (2, stripe(11, 21)), (3, stripe(20, 45)), (4, stripe(50, 60))]).is_empty());
    // Something new in front of a known segment.
    let small = Mask::from_fn(SIZE.0, SIZE.1, |column, row| (2..5).contains(&column) && row < 6);
    assert!(errors(&[(1, stripe(0, 10)), (2, stripe(10, 20)), (3, stripe(20, 30)), (9, small)]).is_empty());
}

#[test]
fn expected_segments_without_a_track_are_not_tracked() {
    let nothing = stripe(0, 0);
    let not_tracked = |from, to| (TrackErrorKind::NotTracked, 2, Some((stripe(from, to), nothing.clone())));
    assert_eq!(errors(&[(1, stripe(0, 10)), (3, stripe(20, 30))]), [not_tracked(10, 20)]);
    assert_eq!(errors(&[(1, stripe(0, 10)), (2, nothing.clone()), (3, stripe(20, 30))]), [not_tracked(10, 20)]);
    assert_eq!(
        errors(&[(1, stripe(0, 12)), (3, stripe(20, 30))]),
        [not_tracked(12, 20)],
        "except what other tracks cover"
    );
    let others = [(1, stripe(0, 10)), (3, stripe(20, 30)), (7, stripe(10, 13)), (8, stripe(13, 16))];
    assert!(errors(&others).is_empty(), "other tracks cover most of it");
}

#[test]
fn swapped_tracks_are_prompted_back() {
    let found = errors(&[(1, stripe(10, 20)), (2, stripe(0, 10)), (3, stripe(20, 30))]);
    let incorrect = |id, expected, wrong| (TrackErrorKind::IncorrectTrack, id, Some((expected, wrong)));
    let expected = [incorrect(1, stripe(0, 10), stripe(10, 20)), incorrect(2, stripe(10, 20), stripe(0, 10))];
    assert_eq!(found, expected);
}

#[test]
fn a_track_away_from_its_segment_is_wrong_where_nothing_is_expected_too() {
    let found = errors(&[(1, stripe(28, 50)), (2, stripe(10, 20)), (3, stripe(20, 28))]);
    assert_eq!(found, [(TrackErrorKind::IncorrectTrack, 1, Some((stripe(0, 10), stripe(28, 50))))]);
    let grown = Mask::from_fn(SIZE.0, SIZE.1, |column, _| (0..19).contains(&column) || column >= 56);
    let on_others = (TrackErrorKind::IncorrectTrack, 1, Some((stripe(0, 10), stripe(10, 19))));
    assert_eq!(
        errors(&[(1, grown), (3, stripe(20, 30))])[0],
        on_others,
        "another part is right, so the part on unseen ground may be right as well"
    );
}

#[test]
fn a_segment_tracked_under_another_id_gets_its_own_back() {
    let found = errors(&[(1, stripe(0, 10)), (3, stripe(20, 30)), (7, stripe(11, 20))]);
    let own = (TrackErrorKind::IncorrectTrack, 2, Some((stripe(10, 20), stripe(0, 0))));
    assert_eq!(found, [own, (TrackErrorKind::IncorrectTrack, 7, None)]);
}

#[test]
fn duplicates_are_prompted_back_or_removed() {
    let found = errors(&[(1, stripe(0, 10)), (2, stripe(0, 10)), (3, stripe(20, 30))]);
    assert_eq!(found, [(TrackErrorKind::DuplicatedTrack, 2, Some((stripe(10, 20), stripe(0, 10))))]);
    let found = errors(&[(1, stripe(0, 10)), (2, stripe(10, 20)), (3, stripe(20, 30)), (7, stripe(0, 9))]);
    assert_eq!(found, [(TrackErrorKind::DuplicatedTrack, 7, None)]);
}

#[test]
fn without_removal_a_track_on_another_segment_is_clicked_away() {
    let clicks_alone = RepromptSettings::default().with(|settings| settings.remove_tracks = false);
    let tracks = [(1, stripe(0, 10)), (2, stripe(10, 20)), (3, stripe(20, 30)), (7, stripe(0, 9))];
    let found = errors_by(&clicks_alone, &expected(), &tracks);
    assert_eq!(found, [(TrackErrorKind::DuplicatedTrack, 7, Some((stripe(0, 0), stripe(0, 9))))]);
    let tracks = [(1, stripe(0, 10)), (3, stripe(20, 30)), (7, stripe(11, 20))];
    let found = errors_by(&clicks_alone, &expected(), &tracks);
    assert_eq!(found[1], (TrackErrorKind::IncorrectTrack, 7, Some((stripe(0, 0), stripe(11, 20)))));
}

#[test]
fn a_mask_that_grows_over_another_segment_is_cut_back() {
    let found = errors(&[(1, stripe(0, 17)), (3, stripe(20, 30))]);
    let grown = (TrackErrorKind::IncorrectTrack, 1, Some((stripe(0, 10), stripe(10, 17))));
    assert_eq!(found[0], grown);
}

#[test]
fn a_mask_that_grows_under_a_smaller_track_is_cut_back_too() {
    let found = errors(&[(1, stripe(0, 17)), (2, stripe(12, 20)), (3, stripe(20, 30))]);
    assert_eq!(found, [(TrackErrorKind::IncorrectTrack, 1, Some((stripe(0, 10), stripe(10, 17))))]);
}

#[test]
fn thin_parts_are_outlines() {
    // Beside its segment, and along the border of the image far away from it.
    let wide = |rows: usize| {
        let mask = Mask::from_fn(SIZE.0, SIZE.1, |column, row| column < 10 || (column < 30 && row < rows));
        errors(&[(1, mask), (2, stripe(10, 20)), (3, stripe(20, 30))]).len()
    };
    assert_eq!([4, 5].map(wide), [0, 1], "80 of 180 and 100 of 200 pixels");
    assert!(errors(&[(1, stripe(0, 14)), (2, stripe(10, 20)), (3, stripe(20, 30))]).is_empty(), "4 of 14 columns");
}

#[test]
fn small_or_uncertain_segments_cause_no_errors() {
    let tracks = [(1, stripe(0, 10)), (3, stripe(20, 30))];
    let mut uncertain = expected();
    for (segment, confidence) in uncertain.segments.pixels().iter().zip(uncertain.confidence.pixels_mut()) {
        *confidence = if *segment == 2 { 0.5 } else { 1.0 };
    }
    assert!(errors_in(&uncertain, &tracks).is_empty());
    let mut small = expected();
    small.segments.pixels_mut().iter_mut().enumerate().for_each(|(index, segment)| {
        if *segment == 2 && index / SIZE.0 == 0 {
            *segment = 0;
        }
    });
    assert!(errors_in(&small, &tracks).is_empty(), "90 pixels");
}

#[test]
fn each_category_can_be_switched_off() {
    // Segment 3 is lost, and track 2 follows the object of track 1, which is right.
    let tracks = [(1, stripe(0, 10)), (2, stripe(0, 10))];
    let count = |settings: &RepromptSettings| TrackErrorCounts::of(&find_track_errors(&expected(), &tracks, settings));
    let all = count(&RepromptSettings::default());
    assert_eq!(all, TrackErrorCounts { not_tracked: 1, incorrect_track: 0, duplicated_track: 1 });
    let without = RepromptSettings::default().with(|settings| settings.not_tracked = false);
    assert_eq!(count(&without), TrackErrorCounts { not_tracked: 0, ..all });
    let without = RepromptSettings::default().with(|settings| settings.duplicated_track = false);
    assert_eq!(count(&without), TrackErrorCounts { duplicated_track: 0, ..all });
}

#[test]
fn a_segment_is_prompted_up_to_the_fraction_that_others_may_cover() {
    let nothing = stripe(0, 0);
    let not_tracked = (TrackErrorKind::NotTracked, 2, Some((stripe(13, 18), nothing)));
    // Right tracks cover half of it, then more.
    assert_eq!(errors(&[(1, stripe(0, 13)), (3, stripe(18, 30))]), [not_tracked]);
    assert_eq!(errors(&[(1, stripe(0, 13)), (3, stripe(17, 30))]), []);
}

#[test]
fn a_track_on_a_segment_that_is_not_trusted_is_left_alone() {
    let mut expected = expected();
    expected.confidence = Image::filled(SIZE.0, SIZE.1, 0.5);
    assert_eq!(errors_in(&expected, &[(9, stripe(0, 10)), (8, stripe(10, 20))]), []);
}

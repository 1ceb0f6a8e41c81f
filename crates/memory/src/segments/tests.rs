use super::*;

fn predicted(ids: &[SegmentId]) -> SegmentMap {
    SegmentMap::from_pixels(ids.len(), 1, ids.to_vec()).unwrap()
}

fn segments() -> Segments {
    Segments::new(MAX_SEGMENT_ID)
}

/// Gives out `count` ids that the memory loses after one frame.
fn flash(segments: &mut Segments, count: usize) -> Vec<SegmentId> {
    let ids: Vec<SegmentId> = (0..count).map(|_| segments.add()).collect();
    segments.record_sightings(&predicted(&ids));
    segments.release_ids();
    ids
}

/// Gives out an id that is predicted in two frames and that Gaussians show.
fn confirm(segments: &mut Segments) -> SegmentId {
    let id = segments.add();
    (0..2).for_each(|_| drop(segments.record_sightings(&predicted(&[id]))));
    segments.set_holds(&[(id, SegmentHold::Shown)]);
    segments.release_ids();
    id
}

fn restored(segments: &Segments) -> Segments {
    let saved = segments.saved_ids();
    let mut restored = Segments::restored(&segments.saved_live(), saved, segments.limit).unwrap();
    // As a loaded map does.
    let holds: Vec<_> = segments.live.iter().map(|(id, segment)| (*id, segment.hold)).collect();
    restored.set_holds(&holds);
    restored
}

#[test]
fn ids_count_up_and_are_new_when_a_prediction_has_them_for_the_first_time() {
    let mut segments = segments();
    assert_eq!([(); 3].map(|()| segments.add()), [1, 2, 3]);
    assert_eq!(segments.record_sightings(&predicted(&[0, 2, 2])), [2]);
    assert_eq!(segments.record_sightings(&predicted(&[3, 2])), [3]);
    assert_eq!((segments.given(), segments.highest()), (3, 3));
}

#[test]
fn an_id_is_forgotten_when_it_was_carried_and_is_not_any_more() {
    let mut segments = segments();
    let ids = [(); 2].map(|()| confirm(&mut segments));
    assert_eq!(segments.release_ids(), LostIds::default());
    segments.set_holds(&[(ids[0], SegmentHold::Votes), (ids[1], SegmentHold::Nothing)]);
    segments.set_held(BTreeSet::from([ids[1]]));
    assert_eq!(segments.release_ids(), LostIds { forgotten: vec![ids[0]], lost: vec![] }, "the other is held");
    segments.set_held(BTreeSet::new());
    assert_eq!(segments.release_ids(), LostIds { forgotten: vec![ids[1]], lost: vec![ids[1]] });
    segments.set_holds(&[(ids[0], SegmentHold::Nothing)]);
    assert_eq!(segments.release_ids(), LostIds { forgotten: vec![], lost: vec![ids[0]] });
    assert!(segments.live.is_empty() && !segments.is_tentative(ids[0]));
    assert_eq!(segments.add(), 3, "an id seen twice is not reused");
}

#[test]
fn ids_that_fit_16_bits_are_given_first_then_released_ones_and_only_then_larger_ones() {
    let mut segments = segments();
    for id in 1..=MAX_16_BIT_ID {
        assert_eq!(segments.add(), id);
        let keep = id != 7 && id != 9;
        (0..1 + usize::from(keep)).for_each(|_| drop(segments.record_sightings(&predicted(&[id]))));
        segments.set_holds(&[(id, SegmentHold::Shown)]);
    }
    segments.release_ids();
    // 9 is lost before 7.
    for id in [9, 7] {
        segments.set_holds(&[(id, SegmentHold::Nothing)]);
        assert_eq!(segments.release_ids(), LostIds { forgotten: vec![id], lost: vec![id] });
        assert!(segments.is_tentative(id));
    }
    assert_eq!([segments.add(), segments.add(), segments.add()], [9, 7, 65_536]);
    assert_eq!(segments.record_sightings(&predicted(&[7])), [7], "another object");
    assert!(segments.is_tentative(7));
}

#[test]
fn an_id_is_not_given_again_while_votes_for_it_are_left_or_after_it_was_seen_again() {
    let mut segments = segments();
    for id in flash(&mut segments, 3) {
        assert!(segments.is_tentative(id));
    }
    assert_eq!(segments.record_sightings(&predicted(&[2])), [0; 0], "a track shows it again");
    assert!(!segments.is_tentative(2));
    segments.given = u64::from(MAX_16_BIT_ID);
    let id = segments.add();
    assert_eq!(id, 1);
    segments.record_sightings(&predicted(&[id]));
    segments.set_holds(&[(id, SegmentHold::Votes)]);
    segments.release_ids();
    assert_eq!([segments.add(), segments.add()], [3, 65_536]);
}

#[test]
fn after_the_largest_id_come_those_that_nothing_holds() {
    let mut segments = Segments::new(5);
    let ids = [(); 5].map(|()| confirm(&mut segments));
    assert_eq!(ids, [1, 2, 3, 4, 5]);
    segments.set_holds(&[(2, SegmentHold::Nothing), (4, SegmentHold::Nothing)]);
    segments.release_ids();
    assert_eq!([segments.add(), segments.add()], [2, 4]);
    // With more objects than ids, two share an id, and nothing fails.
    assert!((1..=5).contains(&segments.add()));
}

/// Runs a part of the two weeks. `SPLATSEG_ID_FRAMES=36288000` runs all of them at 30 Hz and takes minutes.
#[test]
fn two_weeks_of_new_ids_keep_nothing_but_what_is_released() {
    let mut segments = segments();
    let mut largest = 0;
    let frames = std::env::var("SPLATSEG_ID_FRAMES").ok().and_then(|text| text.parse().ok()).unwrap_or(12_000);
    for frame in 0..frames {
        largest = flash(&mut segments, 12).into_iter().chain([largest]).max().unwrap();
        assert!(segments.live.is_empty() && segments.changed.is_empty(), "frame {frame}");
    }
    assert_eq!(largest, MAX_16_BIT_ID);
    assert_eq!(segments.saved_ids().released.len(), MAX_16_BIT_ID as usize);
}

#[test]
fn restored_ids_continue_unchanged() {
    let mut segments = segments();
    segments.given = u64::from(MAX_16_BIT_ID) - 20;
    let mut held: Vec<SegmentId> = Vec::new();
    for frame in 0..200_usize {
        let mut again = restored(&segments);
        let steps = [&mut segments, &mut again].map(|segments| {
            let ids: Vec<SegmentId> = (0..1 + frame % 4).map(|_| segments.add()).collect();
            let mut shown = ids[..ids.len().min(2)].to_vec();
            shown.extend(held.iter().copied().step_by(3));
            let new = segments.record_sightings(&predicted(&shown));
            let mut holds: Vec<_> = shown.iter().map(|id| (*id, SegmentHold::Shown)).collect();
            holds.extend(held.first().map(|id| (*id, [SegmentHold::Votes, SegmentHold::Nothing][frame % 2])));
            holds.reverse();
            segments.set_holds(&holds);
            (ids, new, shown, segments.release_ids(), segments.saved_live(), segments.saved_ids())
        });
        assert_eq!(steps[0], steps[1], "frame {frame}");
        held = segments.live().collect();
        let turn = frame % held.len().max(1);
        held.rotate_left(turn);
    }
    assert!(segments.given() > u64::from(MAX_16_BIT_ID) && !held.is_empty());
}

#[test]
fn impossible_saved_ids_are_refused() {
    let live = [SavedSegment { id: 4, sightings: 2, carried: true }];
    let refused = |released: &[(u32, u32)]| {
        let released = released.iter().map(|(id, sightings)| SavedRelease(*id, *sightings)).collect();
        Segments::restored(&live, SavedIds { given: 9, released }, MAX_SEGMENT_ID).is_err()
    };
    assert!(!refused(&[(3, 1), (1, 0)]));
    for wrong in [&[(10, 1)][..], &[(4, 1)], &[(0, 1)], &[(3, 1), (3, 1)], &[(3, 2)]] {
        assert!(refused(wrong), "{wrong:?}");
    }
}

#[test]
fn an_id_that_one_frame_shows_in_the_end_is_tentative() {
    let mut segments = segments();
    let (fewer, more) = (confirm(&mut segments), segments.add());
    segments.record_sightings(&predicted(&[more]));
    segments.recount(fewer, u32::MAX, 1);
    segments.recount(more, 1, 2);
    assert_eq!((segments.is_tentative(fewer), segments.is_tentative(more)), (true, false));
    // Sightings of an earlier session, before these two, stay.
    segments.recount(more, 0, 1);
    segments.recount(more, 1, 0);
    assert!(!segments.is_tentative(more));
    segments.recount(99, 0, 2);
    assert!(segments.is_tentative(99), "an id that was never given out is not counted");
}

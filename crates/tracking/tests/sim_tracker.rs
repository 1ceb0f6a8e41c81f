//! The simulated tracker: how it understands prompts, and that it errs as it is told to.

use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_models::sam2::{Click, Prompt};
use splatseg_tracking::{SimTracker, SimTrackerSettings, Tracker, TrackerError};

const SIZE: (usize, usize) = (60, 10);

fn frame(index: usize) -> RgbdFrame<'static> {
    let (width, height) = SIZE;
    let camera = Intrinsics { fx: 10.0, fy: 10.0, cx: 1.0, cy: 1.0, width, height };
    let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, 1.0));
    RgbdFrame::new(index.to_string(), color, depth, camera, Pose::IDENTITY).unwrap()
}

/// Objects 1 to 4 in stripes of ten columns, then nothing; object 4 is away in frames 3 to 5.
fn truth(frame: &RgbdFrame) -> SegmentMap {
    let index: usize = frame.name().parse().unwrap();
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| match column / 10 {
        3 if (3..6).contains(&index) => 0,
        stripe @ 0..4 => stripe as u32 + 1,
        _ => 0,
    })
}

fn stripes(from: usize, to: usize) -> Mask {
    Mask::from_fn(SIZE.0, SIZE.1, |column, _| (from..to).contains(&column))
}

fn tracker(settings: SimTrackerSettings, seed: u64) -> SimTracker {
    SimTracker::new(|frame: &RgbdFrame| Ok(truth(frame)), settings, seed).unwrap()
}

/// A tracker at frame 0 whose tracks 1 to 4 follow the objects 1 to 4.
fn following(settings: SimTrackerSettings, seed: u64) -> SimTracker {
    let mut tracker = tracker(settings, seed);
    tracker.track(&frame(0)).unwrap();
    let prompts: Vec<(SegmentId, Prompt)> = (0..4)
        .map(|stripe| (stripe + 1, Prompt::Mask(stripes(stripe as usize * 10, stripe as usize * 10 + 10))))
        .collect();
    tracker.prompt(&prompts).unwrap();
    tracker
}

fn clicks(places: &[(f32, bool)]) -> Prompt {
    let clicks = places.iter().map(|(x, positive)| Click { x: *x, y: 5.0, positive: *positive }).collect();
    Prompt::Points { bounding_box: None, clicks }
}

fn followed(tracker: &SimTracker, track: SegmentId) -> Vec<SegmentId> {
    tracker.followed(track).map(|objects| objects.iter().copied().collect()).unwrap_or_default()
}

/// Objects that each of the tracks 1 to 4 follows, frame by frame.
fn history(settings: SimTrackerSettings, seed: u64, frames: usize) -> Vec<Vec<Vec<SegmentId>>> {
    let mut tracker = following(settings, seed);
    let next = |index: usize| {
        tracker.track(&frame(index)).unwrap();
        (1..5).map(|track| followed(&tracker, track)).collect()
    };
    (1..frames).map(next).collect()
}

#[test]
fn prompts_are_understood() {
    let mut tracker = tracker(SimTrackerSettings::PERFECT, 0);
    assert!(matches!(tracker.prompt(&[(1, clicks(&[(5.0, true)]))]), Err(TrackerError::NoFrame)));
    assert!(tracker.track(&frame(0)).unwrap().is_empty());
    let prompts = [
        (7, Prompt::Mask(stripes(4, 22))),  // most of the objects 1 and 2, a bit of 3
        (8, Prompt::Mask(stripes(24, 27))), // too little of object 3
        (9, clicks(&[(35.0, true)])),       // object 4
        (10, Prompt::bounding_box([9.0, 0.0, 31.0, 10.0])), // objects 2 and 3
        (11, clicks(&[(55.0, true)])),      // nothing
    ];
    let masks = tracker.prompt(&prompts).unwrap();
    let expected = [stripes(0, 20), stripes(24, 27), stripes(30, 40), stripes(10, 30), stripes(0, 0)];
    assert_eq!(masks, [7, 8, 9, 10, 11].into_iter().zip(expected).collect::<Vec<_>>());
    assert_eq!((followed(&tracker, 7), followed(&tracker, 8)), (vec![1, 2], vec![]));

    let tracked = tracker.track(&frame(1)).unwrap();
    assert_eq!(
        tracked.iter().map(|(id, mask)| (*id, mask.area())).collect::<Vec<_>>(),
        [(7, 200), (8, 0), (9, 100), (10, 200), (11, 0)]
    );
    let corrected = [
        (7, clicks(&[(15.0, false), (25.0, true)])),
        (8, Prompt::MoreClicks(vec![Click { x: 0.0, y: 0.0, positive: true }])),
        (9, clicks(&[(35.0, false)])),
        (10, clicks(&[(15.0, false)])),
    ];
    tracker.prompt(&corrected).unwrap();
    assert_eq!([7, 8, 9, 10].map(|track| followed(&tracker, track)), [vec![3], vec![1], vec![], vec![3]]);
    tracker.remove(7);
    tracker.remove(77);
    assert_eq!(tracker.track(&frame(2)).unwrap().len(), 4);
}

/// What track 2, which follows object 2, follows after a prompt.
fn after(prompt: Prompt) -> Vec<SegmentId> {
    let mut tracker = following(SimTrackerSettings::PERFECT, 0);
    tracker.prompt(&[(2, prompt)]).unwrap();
    followed(&tracker, 2)
}

#[test]
fn clicks_that_disagree_ask_for_the_object_of_most_of_them() {
    let (on_1, on_3, on_4, on_nothing) = ((5.0, true), (25.0, true), (35.0, true), (55.0, true));
    assert_eq!(after(clicks(&[on_1, on_3, (22.0, true)])), [3], "never the union, nor what it was before");
    assert_eq!(after(clicks(&[on_3, on_1])), [3], "a tie is decided by the first");
    assert_eq!(after(clicks(&[on_1, on_3, (22.0, true), (27.0, false), (29.0, false)])), [1]);
    assert_eq!(after(clicks(&[on_4, (31.0, false)])), [4], "as many for it as against it");
    assert!(after(clicks(&[on_4, (31.0, false), (32.0, false)])).is_empty());
    assert_eq!(after(clicks(&[on_nothing, on_3, on_nothing])), [3], "unlabelled ground says nothing");
    assert!(after(clicks(&[on_nothing])).is_empty());
    let boxed = Prompt::Points {
        bounding_box: Some([0.0, 0.0, 30.0, 10.0]),
        clicks: vec![Click { x: 5.0, y: 5.0, positive: false }, Click { x: 35.0, y: 5.0, positive: true }],
    };
    assert_eq!(after(boxed), [2, 3, 4]);
}

#[test]
fn prompts_that_make_no_sense_change_nothing() {
    let mut tracker = following(SimTrackerSettings::PERFECT, 0);
    let outside = tracker.prompt(&[(1, clicks(&[(15.0, true)])), (2, clicks(&[(61.0, true)]))]);
    assert!(matches!(outside, Err(TrackerError::ClickOutside { track: 2, .. })));
    assert!(tracker.prompt(&[(1, clicks(&[(f32::NAN, true)]))]).is_err());
    let wrong_size = tracker.prompt(&[(1, Prompt::Mask(Mask::empty(3, 3)))]);
    assert!(matches!(wrong_size, Err(TrackerError::MaskSize { track: 1, found: (3, 3), expected: SIZE })));
    assert_eq!(followed(&tracker, 1), [1]);
    assert!(
        SimTracker::new(
            |frame: &RgbdFrame| Ok(truth(frame)),
            SimTrackerSettings { loss_rate: 2.0, ..SimTrackerSettings::PERFECT },
            0
        )
        .is_err()
    );
}

#[test]
fn a_perfect_tracker_stays_with_its_objects() {
    for objects in history(SimTrackerSettings::PERFECT, 0, 12) {
        assert_eq!(objects, [[1], [2], [3], [4]]);
    }
}

#[test]
fn objects_that_return_are_lost_for_good_or_for_a_while() {
    let shown = |settings: SimTrackerSettings| -> Vec<bool> {
        let mut tracker = following(settings, 0);
        (1..40).map(|index| !tracker.track(&frame(index)).unwrap()[3].1.is_empty()).collect()
    };
    let for_good = SimTrackerSettings { loss_rate: 1.0, lasting_loss_share: 1.0, ..SimTrackerSettings::PERFECT };
    let found = shown(for_good);
    assert!(found[..2].iter().all(|shown| *shown) && found[2..].iter().all(|shown| !shown), "{found:?}");
    let while_long = SimTrackerSettings { loss_rate: 1.0, loss_frames: 4.0, ..SimTrackerSettings::PERFECT };
    let found = shown(while_long);
    let lost = found[5..].iter().take_while(|shown| !**shown).count();
    assert!(lost >= 1 && found[5 + lost..].iter().all(|shown| *shown), "{found:?}");
    // A prompt ends a loss.
    let mut tracker = following(for_good, 0);
    (1..9).for_each(|index| drop(tracker.track(&frame(index)).unwrap()));
    assert_eq!(tracker.prompt(&[(4, clicks(&[(33.0, true)]))]).unwrap(), [(4, stripes(30, 40))]);
    assert_eq!(tracker.track(&frame(9)).unwrap()[3].1, stripes(30, 40));
}

#[test]
fn swaps_exchange_objects_and_duplicates_share_them() {
    let swaps = SimTrackerSettings { swap_rate: 0.2, ..SimTrackerSettings::PERFECT };
    let mut exchanged = 0;
    for mut objects in history(swaps, 1, 20) {
        exchanged += usize::from(objects != [[1], [2], [3], [4]]);
        objects.sort();
        assert_eq!(objects, [[1], [2], [3], [4]], "every object keeps one track");
    }
    assert!(exchanged > 3);
    let duplicates = SimTrackerSettings { duplicate_rate: 0.2, ..SimTrackerSettings::PERFECT };
    let mut last = history(duplicates, 1, 20).pop().unwrap();
    last.sort();
    last.dedup();
    assert!(last.len() < 4 && last.iter().all(|objects| objects.len() == 1), "{last:?}");
}

#[test]
fn drifting_masks_grow_into_one_neighbour() {
    let drifts = SimTrackerSettings { drift_rate: 1.0, drift_px_per_frame: 2.0, ..SimTrackerSettings::PERFECT };
    let mut tracker = following(drifts, 0);
    let first: Vec<Mask> = (1..4).map(|index| tracker.track(&frame(index)).unwrap().remove(0).1).collect();
    assert_eq!(first, [stripes(0, 12), stripes(0, 14), stripes(0, 16)]);
    let corrected = tracker.prompt(&[(1, clicks(&[(5.0, true), (15.0, false)]))]).unwrap();
    assert_eq!(corrected, [(1, stripes(0, 10))]);
}

#[test]
fn errors_hang_on_the_seed_and_on_nothing_else() {
    let errors = SimTrackerSettings {
        loss_rate: 0.5,
        swap_rate: 0.1,
        duplicate_rate: 0.1,
        drift_rate: 0.1,
        ..SimTrackerSettings::default()
    };
    assert_eq!(history(errors, 4, 20), history(errors, 4, 20));
    assert_ne!(history(errors, 4, 20), history(errors, 5, 20));
    // More of one error leaves the others where they are.
    let swaps_at = |settings| history(settings, 4, 3);
    let no_drift = SimTrackerSettings { drift_rate: 0.0, ..errors };
    assert_eq!(swaps_at(errors), swaps_at(no_drift));
}

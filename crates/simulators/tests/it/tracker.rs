//! The simulated tracker: its responses to prompts, and its errors.

use splatseg_geometry::{CameraFrame, Click, Mask, Pose, Prompt, RgbdFrame, SegmentId, SegmentMap};
use splatseg_simulators::{SimTracker, SimTrackerSettings};
use splatseg_test_scenes::{camera, wall};
use splatseg_tracking::{Tracker, TrackerError};

const SIZE: (usize, usize) = (60, 10);

fn frame(index: usize) -> RgbdFrame<'static> {
    wall(index.to_string(), camera(SIZE.0, SIZE.1, 10.0), 1.0, Pose::IDENTITY)
}

/// Objects 1 to 4 in stripes of ten columns, then nothing; object 4 is absent in frames 3 to 5.
fn truth(frame: &CameraFrame) -> SegmentMap {
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
    SimTracker::new(|frame: &CameraFrame| Ok(truth(frame)), settings, seed).unwrap()
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

/// The objects followed by each of the tracks 1 to 4, frame by frame.
fn history(settings: SimTrackerSettings, seed: u64, frames: usize) -> Vec<Vec<Vec<SegmentId>>> {
    let mut tracker = following(settings, seed);
    let next = |index: usize| {
        tracker.track(&frame(index)).unwrap();
        (1..5).map(|track| followed(&tracker, track)).collect()
    };
    (1..frames).map(next).collect()
}

#[test]
fn prompts_select_objects() {
    let mut tracker = tracker(SimTrackerSettings::PERFECT, 0);
    assert!(matches!(tracker.prompt(&[(1, clicks(&[(5.0, true)]))]), Err(TrackerError::NoFrame)));
    assert!(tracker.track(&frame(0)).unwrap().is_empty());
    let prompts = [
        (7, Prompt::Mask(stripes(4, 22))),  // objects 1 and 2 and a small part of 3
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

/// The objects followed after a prompt by track 2, which follows object 2 before.
fn after(prompt: Prompt) -> Vec<SegmentId> {
    let mut tracker = following(SimTrackerSettings::PERFECT, 0);
    tracker.prompt(&[(2, prompt)]).unwrap();
    followed(&tracker, 2)
}

#[test]
fn conflicting_clicks_are_a_vote() {
    let (on_1, on_3, on_4, on_nothing) = ((5.0, true), (25.0, true), (35.0, true), (55.0, true));
    assert_eq!(after(clicks(&[on_1, on_3, (22.0, true)])), [3], "not the union, and not the object before");
    assert_eq!(after(clicks(&[on_3, on_1])), [3], "a tie is decided by the first");
    assert_eq!(after(clicks(&[on_1, on_3, (22.0, true), (27.0, false), (29.0, false)])), [1]);
    assert_eq!(after(clicks(&[on_4, (31.0, false)])), [4], "as many positive as negative clicks");
    assert!(after(clicks(&[on_4, (31.0, false), (32.0, false)])).is_empty());
    assert_eq!(after(clicks(&[on_nothing, on_3, on_nothing])), [3], "clicks on unlabelled pixels are ignored");
    assert!(after(clicks(&[on_nothing])).is_empty());
    let boxed = Prompt::Points {
        bounding_box: Some([0.0, 0.0, 30.0, 10.0]),
        clicks: vec![Click { x: 5.0, y: 5.0, positive: false }, Click { x: 35.0, y: 5.0, positive: true }],
    };
    assert_eq!(after(boxed), [2, 3, 4]);
}

#[test]
fn invalid_prompts_change_nothing() {
    let mut tracker = following(SimTrackerSettings::PERFECT, 0);
    let outside = tracker.prompt(&[(1, clicks(&[(15.0, true)])), (2, clicks(&[(61.0, true)]))]);
    assert!(matches!(outside, Err(TrackerError::ClickOutside { track: 2, .. })));
    assert!(tracker.prompt(&[(1, clicks(&[(f32::NAN, true)]))]).is_err());
    let wrong_size = tracker.prompt(&[(1, Prompt::Mask(Mask::empty(3, 3)))]);
    assert!(matches!(wrong_size, Err(TrackerError::MaskSize { track: 1, found: (3, 3), expected: SIZE })));
    assert_eq!(followed(&tracker, 1), [1]);
    assert!(
        SimTracker::new(
            |frame: &CameraFrame| Ok(truth(frame)),
            SimTrackerSettings::PERFECT.with(|settings| settings.loss_rate = 2.0),
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
fn returning_objects_are_lost_for_good_or_for_some_frames() {
    let shown = |settings: SimTrackerSettings| -> Vec<bool> {
        let mut tracker = following(settings, 0);
        (1..40).map(|index| !tracker.track(&frame(index)).unwrap()[3].1.is_empty()).collect()
    };
    let for_good = SimTrackerSettings::PERFECT.with(|settings| {
        settings.loss_rate = 1.0;
        settings.lasting_loss_fraction = 1.0;
    });
    let found = shown(for_good);
    assert!(found[..2].iter().all(|shown| *shown) && found[2..].iter().all(|shown| !shown), "{found:?}");
    let some_frames = SimTrackerSettings::PERFECT.with(|settings| {
        settings.loss_rate = 1.0;
        settings.loss_frames = 4.0;
    });
    let found = shown(some_frames);
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
    let swaps = SimTrackerSettings::PERFECT.with(|settings| settings.swap_rate = 0.2);
    let mut exchanged = 0;
    for mut objects in history(swaps, 1, 20) {
        exchanged += usize::from(objects != [[1], [2], [3], [4]]);
        objects.sort();
        assert_eq!(objects, [[1], [2], [3], [4]], "every object keeps one track");
    }
    assert!(exchanged > 3);
    let duplicates = SimTrackerSettings::PERFECT.with(|settings| settings.duplicate_rate = 0.2);
    let mut last = history(duplicates, 1, 20).pop().unwrap();
    last.sort();
    last.dedup();
    assert!(last.len() < 4 && last.iter().all(|objects| objects.len() == 1), "{last:?}");
}

#[test]
fn drifting_masks_grow_into_one_neighbour() {
    let drifts = SimTrackerSettings::PERFECT.with(|settings| {
        settings.drift_rate = 1.0;
        settings.drift_px_per_frame = 2.0;
    });
    let mut tracker = following(drifts, 0);
    let first: Vec<Mask> = (1..4).map(|index| tracker.track(&frame(index)).unwrap().remove(0).1).collect();
    assert_eq!(first, [stripes(0, 12), stripes(0, 14), stripes(0, 16)]);
    let corrected = tracker.prompt(&[(1, clicks(&[(5.0, true), (15.0, false)]))]).unwrap();
    assert_eq!(corrected, [(1, stripes(0, 10))]);
}

#[test]
fn errors_depend_on_the_seed_alone() {
    let errors = SimTrackerSettings::default().with(|settings| {
        settings.loss_rate = 0.5;
        settings.swap_rate = 0.1;
        settings.duplicate_rate = 0.1;
        settings.drift_rate = 0.1;
    });
    assert_eq!(history(errors, 4, 20), history(errors, 4, 20));
    assert_ne!(history(errors, 4, 20), history(errors, 5, 20));
    // Changing the rate of one error does not change the others.
    let swaps_at = |settings| history(settings, 4, 3);
    let no_drift = errors.with(|settings| settings.drift_rate = 0.0);
    assert_eq!(swaps_at(errors), swaps_at(no_drift));
}

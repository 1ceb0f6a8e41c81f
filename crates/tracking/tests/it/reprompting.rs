//! Each kind of tracker error alone, with both kinds of memory: it is found and corrected, right tracks are left alone,
//! and the error remains if its category is switched off.

use crate::watched::{ROOM, Report, baseline, splat, tracker, watch};
use splatseg_geometry::{Mask, SegmentId};
use splatseg_memory::MemoryKind;
use splatseg_simulators::SimTrackerSettings;
use splatseg_tracking::{Method, RepromptSettings, TrackErrorCounts};

/// Settings with all categories of errors switched off.
fn off() -> RepromptSettings {
    RepromptSettings::default().with(|settings| {
        settings.not_tracked = false;
        settings.incorrect_track = false;
        settings.duplicated_track = false;
        settings.min_expected_area = 30;
    })
}

const KINDS: [MemoryKind; 2] = [MemoryKind::Evidence, MemoryKind::Features];

/// Runs SAM2-Splat with these settings and a tracker that makes errors over the room.
fn report(errors: SimTrackerSettings, kind: MemoryKind, reprompt: RepromptSettings) -> Report {
    let tracker = tracker(errors);
    let mut method = splat(tracker.clone(), kind, reprompt);
    watch(&ROOM, &tracker, &mut method, 0.6)
}

/// Asserts that errors are corrected within two frames if their category is on, and remain if it is off. `of_kind`
/// counts them.
fn assert_repaired(
    kind: MemoryKind,
    errors: SimTrackerSettings,
    on: RepromptSettings,
    of_kind: impl Fn(TrackErrorCounts) -> usize,
) {
    let repaired = report(errors, kind, on);
    let left = report(errors, kind, off());
    assert_eq!(left.found, TrackErrorCounts::default(), "{kind:?}");
    assert!(left.wrong > 20, "{kind:?}: the tracker makes errors, in {} frames", left.wrong);
    assert!(of_kind(repaired.found) >= 2, "{kind:?}: {:?}", repaired.found);
    assert!(repaired.longest <= 2, "{kind:?}: an error lasted {} frames", repaired.longest);
    assert!(repaired.wrong * 3 < left.wrong, "{kind:?}: {} of {} wrong frames remain", repaired.wrong, left.wrong);
}

#[test]
fn lost_tracks_are_found_again() {
    let errors = SimTrackerSettings::PERFECT.with(|settings| {
        settings.loss_rate = 1.0;
        settings.lasting_loss_fraction = 1.0;
    });
    for kind in KINDS {
        assert_repaired(kind, errors, off().with(|settings| settings.not_tracked = true), |found| found.not_tracked);
    }
}

#[test]
fn swapped_tracks_are_swapped_back() {
    let errors = SimTrackerSettings::PERFECT.with(|settings| settings.swap_rate = 0.02);
    for kind in KINDS {
        assert_repaired(kind, errors, off().with(|settings| settings.incorrect_track = true), |found| {
            found.incorrect_track
        });
    }
}

#[test]
fn duplicates_are_sent_back_to_their_objects() {
    let errors = SimTrackerSettings::PERFECT.with(|settings| settings.duplicate_rate = 0.02);
    for kind in KINDS {
        assert_repaired(kind, errors, off().with(|settings| settings.duplicated_track = true), |found| {
            found.duplicated_track
        });
    }
}

#[test]
fn drifting_masks_are_cut_back() {
    let errors = SimTrackerSettings::PERFECT.with(|settings| {
        settings.drift_rate = 0.1;
        settings.drift_px_per_frame = 4.0;
    });
    for kind in KINDS {
        assert_repaired(kind, errors, off().with(|settings| settings.incorrect_track = true), |found| {
            found.incorrect_track
        });
    }
}

#[test]
fn errors_of_a_category_that_is_off_remain() {
    for kind in KINDS {
        let swaps = SimTrackerSettings::PERFECT.with(|settings| settings.swap_rate = 0.02);
        let others = RepromptSettings::default().with(|settings| settings.incorrect_track = false);
        assert!(report(swaps, kind, others).wrong > 50, "{kind:?}");
        let losses = SimTrackerSettings::PERFECT.with(|settings| {
            settings.loss_rate = 1.0;
            settings.lasting_loss_fraction = 1.0;
        });
        let others = RepromptSettings::default().with(|settings| settings.not_tracked = false);
        assert!(report(losses, kind, others).wrong > 50, "{kind:?}");
    }
}

#[test]
fn right_tracks_are_left_alone() {
    let shared = tracker(SimTrackerSettings::PERFECT);
    let alone = watch(&ROOM, &shared, &mut baseline(shared.clone()), 1.0);
    for kind in KINDS {
        let shared = tracker(SimTrackerSettings::PERFECT);
        let watched = watch(&ROOM, &shared, &mut splat(shared.clone(), kind, RepromptSettings::default()), 1.0);
        assert_eq!((watched.found, watched.wrong), (TrackErrorCounts::default(), 0), "{kind:?}");
        assert!(watched.masks == alone.masks, "{kind:?}: without errors the memory changes nothing");
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let errors = SimTrackerSettings::PERFECT.with(|settings| {
        settings.loss_rate = 0.5;
        settings.lasting_loss_fraction = 0.5;
        settings.loss_frames = 4.0;
        settings.swap_rate = 0.02;
        settings.duplicate_rate = 0.02;
        settings.drift_rate = 0.02;
        settings.drift_px_per_frame = 1.5;
    });
    let with_threads = |kind: MemoryKind, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tracker = tracker(errors);
            let mut method = splat(tracker.clone(), kind, RepromptSettings::default());
            let masks = watch(&ROOM[..20], &tracker, &mut method, 0.5).masks;
            let file = tempfile::NamedTempFile::new().unwrap();
            method.memory().unwrap().save(file.path()).unwrap();
            (masks, std::fs::read(file.path()).unwrap())
        })
    };
    for kind in KINDS {
        assert!(with_threads(kind, 1) == with_threads(kind, 3), "{kind:?}");
    }
}

/// Number of frames with two tracks on the same object, if only segments that are not tracked are prompted.
fn frames_with_copies(kind: MemoryKind, max_answer_iou: f64) -> usize {
    let errors = SimTrackerSettings::PERFECT.with(|settings| {
        settings.swap_rate = 0.05;
        settings.loss_rate = 0.2;
        settings.lasting_loss_fraction = 0.5;
    });
    let reprompt = off().with(|settings| {
        settings.not_tracked = true;
        settings.max_answer_iou = max_answer_iou;
    });
    let has_copies = |masks: &[(SegmentId, Mask)]| {
        let mut pairs = masks
            .iter()
            .enumerate()
            .flat_map(|(index, (_, one))| masks[..index].iter().map(move |(_, other)| (one, other)));
        pairs.any(|(one, other)| one.iou(other) > 0.5)
    };
    report(errors, kind, reprompt).masks.iter().filter(|masks| has_copies(masks)).count()
}

#[test]
fn an_object_that_is_tracked_is_not_prompted_under_another_id() {
    for kind in KINDS {
        let copies = frames_with_copies(kind, 1.0);
        assert!(copies > 10, "{kind:?}: the tracker answers with what it tracks already, in {copies} frames");
        assert_eq!(frames_with_copies(kind, 0.5), 0, "{kind:?}");
    }
}

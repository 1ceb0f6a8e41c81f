//! Wrong poses, missing depth and odd sizes neither panic nor empty the map.

use super::run::{Run, agreement, evidence, features, kinds};
use super::scene::{SIZE, Scene, Shot, pose};
use splatseg_geometry::Pose;
use splatseg_memory::MemorySettings;

/// Shows the boxes five times, disturbs the run, and asserts that nearly all Gaussians are left and that the boxes are
/// expected as well as before.
fn survives(settings: MemorySettings, disturb: impl Fn(&mut Run, &Shot)) -> Run {
    let kind = settings.kind;
    let shot = Scene::boxes().seen_from_origin();
    let expected_rightly = |run: &Run| agreement(&run.expected(&shot), &shot.truth);
    let before = expected_rightly(&run_that_knows_boxes(settings.clone()).0);
    let run = keeps_gaussians(settings, disturb);
    let after = expected_rightly(&run);
    assert!(after > before - 0.01, "{kind:?}: {after} of the pixels are expected correctly, {before} before");
    run
}

/// As [`survives`], but only asserts that nearly all Gaussians are left.
fn keeps_gaussians(settings: MemorySettings, disturb: impl Fn(&mut Run, &Shot)) -> Run {
    let kind = settings.kind;
    let (mut run, shot) = run_that_knows_boxes(settings);
    let known = run.positions();
    disturb(&mut run, &shot);
    let left = kept(&run, &known);
    assert!(left * 10 >= known.len() * 9, "{kind:?}: {left} of {} Gaussians are left", known.len());
    run
}

fn run_that_knows_boxes(settings: MemorySettings) -> (Run, Shot) {
    let shot = Scene::boxes().seen_from_origin();
    let mut run = Run::new(settings);
    run.show_times(&shot, 5);
    (run, shot)
}

/// Number of Gaussians at `known` that are still there, up to rounding. Removal keeps the order of the others.
fn kept(run: &Run, known: &[glam::Vec3]) -> usize {
    let mut known = known.iter().peekable();
    let mut count = 0;
    for mean in &run.positions() {
        let mut rest = known.clone();
        if rest.any(|other| other.distance(*mean) < 1e-4) {
            known = rest;
            count += 1;
        }
    }
    count
}

/// Disturbs a run with one frame with a wrong pose, then ten with the right one.
fn survives_wrong_pose(wrong: Pose) {
    survives(evidence(), |run, shot| {
        run.show(&shot.clone().with_pose(wrong));
        run.show_times(shot, 10);
    });
}

#[test]
fn poses_that_jump_far_away_and_back() {
    for settings in kinds() {
        survives(settings, |run, shot| {
            for _ in 0..5 {
                run.show(&shot.clone().with_pose(pose([100.0, 0.0, 0.0], 0.0)));
                run.show(shot);
            }
        });
    }
}

#[test]
fn poses_that_turn_round() {
    for settings in kinds() {
        survives(settings, |run, shot| {
            for _ in 0..5 {
                run.show(&shot.clone().with_pose(pose([0.0; 3], 180.0)));
                run.show(shot);
            }
        });
    }
}

#[test]
fn one_pose_too_far_ahead() {
    survives_wrong_pose(pose([0.0, 0.0, 0.5], 0.0));
}

#[test]
fn one_pose_too_far_back() {
    survives_wrong_pose(pose([0.0, 0.0, -0.5], 0.0));
}

#[test]
fn one_pose_too_far_aside() {
    survives_wrong_pose(pose([0.5, 0.0, 0.0], 0.0));
    survives_wrong_pose(pose([-0.5, 0.0, 0.0], 0.0));
}

#[test]
fn one_pose_too_high_or_low() {
    survives_wrong_pose(pose([0.0, -0.5, 0.0], 0.0));
    survives_wrong_pose(pose([0.0, 0.5, 0.0], 0.0));
}

#[test]
fn many_poses_too_far_ahead() {
    survives(evidence(), |run, shot| {
        let wrong = shot.clone().with_pose(pose([0.0, 0.0, 0.5], 0.0));
        run.show_times(&wrong, 10);
        run.show_times(shot, 10);
    });
}

#[test]
fn frames_without_any_depth() {
    for settings in kinds() {
        survives(settings, |run, shot| {
            let mut blind = shot.clone();
            blind.depth.pixels_mut().fill(0.0);
            for step in run.show_times(&blind, 20) {
                assert_eq!((step.update.grown, step.update.removed), (0, 0));
            }
        });
    }
}

#[test]
fn a_memory_that_starts_without_depth() {
    for settings in kinds() {
        let mut run = Run::new(settings);
        let shot = Scene::boxes().seen_from_origin();
        let mut blind = shot.clone();
        blind.depth.pixels_mut().fill(0.0);
        let step = run.show(&blind);
        assert!(run.means().iter().all(|mean| mean.length() > 40.0), "any Gaussians are far away");
        assert_eq!(step.fused, shot.truth, "predictions are shown unchanged");
        assert!(run.show(&shot).update.grown > 0);
    }
}

#[test]
fn depth_that_is_no_number() {
    for settings in kinds() {
        let run = survives(settings, |run, shot| {
            let mut broken = shot.clone();
            for (index, depth) in broken.depth.pixels_mut().iter_mut().enumerate() {
                *depth = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, *depth][index % 5];
            }
            run.show_times(&broken, 10);
        });
        assert!(run.means().iter().all(|mean| mean.is_finite()));
    }
}

#[test]
fn depth_from_a_micrometre_to_a_light_second() {
    for settings in kinds() {
        let (mut run, shot) = run_that_knows_boxes(settings);
        let known = run.means().to_vec();
        let mut odd = shot.clone();
        for (index, depth) in odd.depth.pixels_mut().iter_mut().enumerate() {
            *depth = [1e-6, 3e8, f32::MIN_POSITIVE, 1e30, *depth][index % 5];
        }
        run.show_times(&odd, 2);
        assert!(run.means().iter().all(|mean| mean.is_finite()));
        assert!(kept(&run, &known) * 10 >= known.len() * 9);
    }
}

#[test]
fn frames_that_see_nothing_known() {
    for settings in kinds() {
        survives(settings, |run, _| {
            let elsewhere = Scene::room().seen_from(pose([0.0, 0.0, 0.0], 90.0)).with_pose(pose([500.0; 3], 0.0));
            let steps = run.show_times(&elsewhere, 20);
            assert!(steps[0].expected.areas().is_empty(), "nothing is known there");
        });
    }
}

#[test]
fn frames_that_see_nothing_at_all() {
    for settings in kinds() {
        survives(settings, |run, _| {
            let nothing = Scene(Vec::new()).seen_from(pose([0.0; 3], 180.0));
            run.show_times(&nothing, 20);
        });
    }
}

#[test]
fn a_resolution_that_changes() {
    let sizes = [(48, 36), (131, 97), (192, 144), SIZE, (17, 72)];
    let change = |run: &mut Run, shot: &Shot| {
        for size in sizes {
            run.show_times(&Scene::boxes().seen_at_size(shot.pose, size), 2);
        }
    };
    survives(evidence(), change);
    // The paper's rule adds balls as large as the pixels of the coarse frames, so the expected segments do change.
    keeps_gaussians(features(), change);
}

#[test]
fn frames_of_few_pixels() {
    for size in [(1, 1), (3, 2), (1, 7), (5, 1)] {
        let tiny = Scene::boxes().seen_at_size(Pose::IDENTITY, size);
        let show = |run: &mut Run, _: &Shot| drop(run.show_times(&tiny, 2));
        survives(evidence(), show);
        keeps_gaussians(features(), show);
        for settings in kinds() {
            let mut run = Run::new(settings);
            let step = run.show_times(&tiny, 5).pop().unwrap();
            assert!(run.memory.gaussian_count() > 0, "{size:?}");
            assert_eq!(step.fused, tiny.truth, "{size:?}");
        }
    }
}

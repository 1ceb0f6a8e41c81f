//! Errors of trajectories equal those of `evo`. `tools/make_trajectory_test_data.py` makes the data.

use glam::{DQuat, DVec3};
use serde_json::Value;
use splatseg_geometry::{Pose, StampedPose};
use splatseg_metrics::{ErrorStatistics, MetricsError, TrajectorySettings, score_trajectory};

/// Parses a trajectory from TUM lines.
fn trajectory(lines: &Value) -> Vec<StampedPose> {
    let pose = |line: &Value| {
        let numbers: Vec<f64> = line.as_str().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
        let rotation = DQuat::from_slice(&numbers[4..]);
        let world_from_camera = Pose::from_quaternion(DVec3::from_slice(&numbers[1..4]), rotation).unwrap();
        StampedPose { seconds: numbers[0], world_from_camera }
    };
    lines.as_array().unwrap().iter().map(pose).collect()
}

/// Checks a count and statistics; both may be missing.
fn check(found: Option<(usize, ErrorStatistics)>, expected: &Value, (tolerance, what): (f64, &str)) {
    let Some((count, found)) = found else {
        assert!(expected.is_null(), "{what}: found nothing, expected {expected}");
        return;
    };
    assert_eq!(Some(count as u64), expected["count"].as_u64(), "{what}");
    let Value::Object(found) = serde_json::to_value(found).unwrap() else { unreachable!() };
    for (statistic, found) in found {
        let (found, expected) = (found.as_f64().unwrap(), expected[&statistic].as_f64().unwrap());
        assert!((found - expected).abs() <= tolerance * expected.max(1.0), "{what}: {statistic} {found} {expected}");
    }
}

#[test]
fn errors_equal_those_of_evo() {
    let cases: Value = serde_json::from_str(include_str!("../data/trajectories.json")).unwrap();
    for case in cases.as_array().unwrap() {
        let name = case["name"].as_str().unwrap();
        let rpe_frames = case["rpe_frames"].as_u64().unwrap() as usize;
        let settings = TrajectorySettings { rpe_frames, ..TrajectorySettings::default() };
        let score = score_trajectory(&trajectory(&case["truth"]), &trajectory(&case["estimate"]), &settings);
        if let Err(error) = score {
            assert!(matches!(error, MetricsError::NoPosePairs { .. }), "{error}");
            assert!(case["ate_m"].is_null() && case["rpe_m"].is_null(), "{name}: {error}");
            continue;
        }
        let score = score.unwrap();
        // Coordinates of millions of metres are rounded to a nanometre.
        let tolerance = if name == "map projection" { 1e-8 } else { 1e-11 };
        let ate = score.ate.map(|ate| (score.pairs, ate.distance_m));
        check(ate, &case["ate_m"], (tolerance, &format!("{name}: ATE")));
        let rpe = |statistics: ErrorStatistics| score.rpe.map(|rpe| (rpe.motions, statistics));
        let (translation, rotation) =
            score.rpe.map_or_else(Default::default, |rpe| (rpe.translation_m, rpe.rotation_deg));
        check(rpe(translation), &case["rpe_m"], (tolerance, &format!("{name}: RPE")));
        check(rpe(rotation), &case["rpe_deg"], (1e-9, &format!("{name}: rotational RPE")));
    }
}

#[test]
fn trajectories_without_common_times_are_refused() {
    let pose = |seconds: f64| StampedPose { seconds, world_from_camera: Pose::IDENTITY };
    let settings = TrajectorySettings::default();
    for (truth, estimate) in [(vec![], vec![]), (vec![pose(1.0)], vec![]), (vec![pose(1.0)], vec![pose(1.5)])] {
        let error = score_trajectory(&truth, &estimate, &settings).unwrap_err();
        assert!(matches!(error, MetricsError::NoPosePairs { .. }));
        assert!(error.to_string().contains("within 0.01 s"), "{error}");
        let from = |poses: &[StampedPose]| {
            poses
                .first()
                .map_or("no time".to_owned(), |StampedPose { seconds, .. }| format!("{seconds:.3} to {seconds:.3} s"))
        };
        let ranges = format!("they are from {}, the true ones from {}", from(&estimate), from(&truth));
        assert!(error.to_string().ends_with(&ranges), "{error}");
    }
}

#[test]
fn the_length_of_the_path_is_that_of_the_paired_true_poses() {
    let pose = |seconds: f64| StampedPose {
        seconds,
        world_from_camera: Pose::from_translation(DVec3::new(2.0 * seconds, 0.0, 0.0)),
    };
    let truth: Vec<StampedPose> = (0..10).map(|second| pose(f64::from(second))).collect();
    let settings = TrajectorySettings { rpe_frames: 1, ..TrajectorySettings::default() };
    let score = score_trajectory(&truth, &truth[2..5], &settings).unwrap();
    assert_eq!((score.pairs, score.path_length_m, score.ate), (3, 4.0, None));
    assert_eq!(score.rpe.map(|rpe| rpe.translation_m.max), Some(0.0));
}

#[test]
fn a_path_of_another_scale_is_scaled() {
    let pose = |seconds: f64, factor: f64| {
        let position = DVec3::new(seconds.sin(), 0.3 * seconds * seconds, seconds.cos()) * factor;
        let world_from_camera = Pose::from_quaternion(position, DQuat::from_rotation_z(seconds)).unwrap();
        StampedPose { seconds, world_from_camera }
    };
    let path = |factor: f64| (0..60).map(|frame| pose(f64::from(frame) / 30.0, factor)).collect::<Vec<_>>();
    let settings = TrajectorySettings { corrects_scale: true, ..TrajectorySettings::default() };
    let found = score_trajectory(&path(1.0), &path(1.25), &settings).unwrap();
    assert!((found.scale - 0.8).abs() < 1e-9 && found.ate.unwrap().distance_m.rmse < 1e-9, "{found:?}");
    assert!(found.rpe.unwrap().translation_m.max < 1e-9);
    let unscaled = score_trajectory(&path(1.0), &path(1.25), &TrajectorySettings::default()).unwrap();
    assert!(unscaled.scale == 1.0 && unscaled.ate.unwrap().distance_m.rmse > 0.05);
}

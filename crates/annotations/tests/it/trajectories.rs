//! Trajectory files: written ones are read back, damaged ones are refused.

use glam::{DQuat, DVec3};
use splatseg_annotations::{TRAJECTORY_HEADER, frame_time, read_trajectory, trajectory_line};
use splatseg_geometry::{Pose, StampedPose};
use std::fs;
use std::time::Duration;

fn read(text: impl AsRef<[u8]>) -> Result<Vec<StampedPose>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses.txt");
    fs::write(&path, text).unwrap();
    let name = format!("{}: ", path.display());
    read_trajectory(&path).map_err(|error| error.to_string().replace(&name, ""))
}

fn pose(position: [f64; 3], rotation: [f64; 4]) -> Pose {
    Pose::from_quaternion(DVec3::from(position), DQuat::from_array(rotation)).unwrap()
}

#[test]
fn a_written_trajectory_is_read_back() {
    let written = [
        (Duration::new(0, 33_333_333), pose([0.1, -2.0, 1e-17], [0.0, 0.0, 0.0, 1.0])),
        (Duration::new(1_305_031_102, 175_304_001), pose([5e5, 5.4e6, 1.0 / 3.0], [0.5, -0.1, 0.7, -0.2])),
        (Duration::new(1_305_031_103, 0), pose([-0.0, 0.0, 3.0], [-1.0, 0.0, 0.0, 0.0])),
    ];
    let lines: String = written.iter().map(|(time, pose)| trajectory_line(*time, pose)).collect();
    let found = read(format!("{TRAJECTORY_HEADER}{lines}")).unwrap();
    assert_eq!(found.len(), written.len());
    for (found, (time, pose)) in found.iter().zip(written) {
        assert_eq!(found.seconds, time.as_secs_f64());
        assert_eq!(found.world_from_camera.translation(), pose.translation());
        assert!(found.world_from_camera.rotation().abs_diff_eq(pose.rotation(), 1e-15));
    }
}

#[test]
fn lines_have_exact_times_and_normal_quaternions() {
    let line = |pose: Pose| trajectory_line(Duration::new(1_305_031_102, 175_304_001), &pose);
    let time = "1305031102.175304001";
    let upright = line(pose([0.5, -0.0, 1e-9], [-0.0, -0.0, -0.0, -2.0]));
    assert_eq!(upright, format!("{time} 0.5 0.0 1e-9 0.0 0.0 0.0 1.0\n"));
    let turned = line(pose([0.0; 3], [0.6, 0.0, 0.0, -0.8]));
    let numbers: Vec<f64> = turned.split_whitespace().skip(4).map(|word| word.parse().unwrap()).collect();
    assert!((numbers[0] + 0.6).abs() < 1e-15 && (numbers[3] - 0.8).abs() < 1e-15, "{turned}");
}

#[test]
fn frames_without_a_timestamp_are_a_thirtieth_of_a_second_apart() {
    let nanoseconds = [0, 1, 2, 29, 30, 31, 599].map(|index| frame_time(None, index).as_nanos());
    let expected = [0, 33_333_333, 66_666_666, 966_666_666, 1_000_000_000, 1_033_333_333, 19_966_666_666];
    assert_eq!(nanoseconds, expected);
    assert_eq!(frame_time(Some(Duration::from_secs(7)), 30), Duration::from_secs(7));
    assert!(frame_time(None, usize::MAX).as_secs() == (usize::MAX / 30) as u64);
}

#[test]
fn trajectories_of_other_programs_are_read() {
    let text = "# a comment\r\n\n 12.5 1 2 3 0 0 0 0.9999\r\n1305031102175304000,1,2,3,0,0,0,1\n-3 nan 0 0 0 0 0 1\n-2 0 0 0 0 0 0 1";
    let found = read(text).unwrap();
    let times: Vec<f64> = found.iter().map(|pose| pose.seconds).collect();
    assert_eq!(times, [12.5, 1_305_031_102.175_304, -2.0]);
    assert_eq!(found[0].world_from_camera, pose([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]));
    assert_eq!(read("").unwrap(), []);
}

#[test]
fn damaged_trajectories_are_refused_with_their_line() {
    let good = "0 0 0 0 0 0 0 1\n";
    for (text, message) in [
        (format!("{good}1 2 3\n"), "line 2: found \"1 2 3\", expected 8 numbers"),
        (format!("{good}# x\n1 2 3 4 5 6 7 eight\n"), "line 3: found"),
        (format!("{good}1 0 0 0 0 0 0 0.5\n"), "quaternion qx qy qz qw of length 1"),
        (format!("{good}nan 0 0 0 0 0 0 1\n"), "line 2: found"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n".to_owned(), "line 1: found a matrix, expected 8 numbers"),
        ("1 2 3\n".to_owned(), "line 1: found"),
    ] {
        let error = read(&text).unwrap_err();
        assert!(error.contains(message), "{text}: {error}");
    }
    let not_text = read(b"\xff 1 2").unwrap_err();
    assert!(not_text.contains("not text"), "{not_text}");
    let missing = read_trajectory("/nonexistent/poses.txt".as_ref()).unwrap_err().to_string();
    assert!(missing.contains("/nonexistent/poses.txt"), "{missing}");
}

//! Camera trajectories in the format of TUM RGB-D (Sturm et al., IROS 2012): a text file with one pose per line, `time tx ty
//! tz qx qy qz qw`. Times are in seconds, positions in metres in world coordinates, quaternions from camera to world
//! axes. Lines that start with `#` are comments.

use crate::AnnotationError;
use glam::DQuat;
use splatseg_dataset::{DatasetError, read_pose_list};
use splatseg_geometry::{Pose, StampedPose};
use std::path::Path;
use std::time::Duration;

/// The comment at the start of a trajectory file: the names of its columns.
pub const TRAJECTORY_HEADER: &str = "# timestamp tx ty tz qx qy qz qw\n";

/// Frames per second of a source without timestamps.
const ASSUMED_RATE: usize = 30;

/// Returns the time of a frame in a trajectory: its timestamp, or else `index` / 30 s. `index` is the frame's index in
/// its source, from 0, so the time does not depend on the frames that a run selects or skips.
pub fn frame_time(timestamp: Option<Duration>, index: usize) -> Duration {
    timestamp.unwrap_or_else(|| {
        let thirtieths = (index % ASSUMED_RATE) as u32;
        Duration::from_secs((index / ASSUMED_RATE) as u64) + Duration::from_secs(1) * thirtieths / ASSUMED_RATE as u32
    })
}

/// Returns a pose as a line of a trajectory file, with its line break. Times are exact to the nanosecond, and numbers have
/// as many digits as it takes to read the same bits again. The quaternion has length 1 and `qw` is not negative.
pub fn trajectory_line(time: Duration, world_from_camera: &Pose) -> String {
    let turn = DQuat::from_mat3(&world_from_camera.rotation()).normalize();
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let numbers = world_from_camera.translation().to_array().into_iter().chain(turn.to_array());
    let mut line = format!("{}.{:09}", time.as_secs(), time.subsec_nanos());
    for number in numbers {
        // Adding 0 removes the sign of a zero.
        line.push_str(&format!(" {:?}", number + 0.0));
    }
    line.push('\n');
    line
}

/// Reads a trajectory file, in the order of its lines. Words may be separated by spaces, tabs or commas, and quaternions
/// may be rounded. A time without a decimal point and with 19 digits is in nanoseconds. Lines with a position or rotation
/// that is not finite, as written where tracking was lost, are left out.
///
/// # Errors
/// [`DatasetError`] with the file and the line if it cannot be read, is too large, or a line is not a pose with a time.
pub fn read_trajectory(path: &Path) -> Result<Vec<StampedPose>, AnnotationError> {
    let mut poses = Vec::new();
    for listed in read_pose_list(path)? {
        let seconds = listed.seconds.ok_or_else(|| DatasetError::Field {
            path: path.to_owned(),
            field: format!("line {}", listed.line),
            found: "a matrix".to_owned(),
            expected: "8 numbers (time tx ty tz qx qy qz qw)".to_owned(),
        })?;
        let pose = listed.world_from_camera;
        poses.extend(pose.map(|world_from_camera| StampedPose { seconds, world_from_camera }));
    }
    Ok(poses)
}

//! `poses.txt`: the camera's pose in every frame, in the format of TUM RGB-D.

use crate::error::saved_state;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use serde::{Deserialize, Serialize};
use splatseg_annotations::{TRAJECTORY_HEADER, frame_time, trajectory_line};
use splatseg_geometry::Pose;
use splatseg_odometry::PoseState;
use std::time::Duration;

/// Writes the camera's poses: a line per frame, with the frame's timestamp, or else its index in its source / 30 s. Frames
/// without a known pose have no line. Poses are final: they include corrections made after their frame.
#[derive(Debug, Default)]
pub struct PosesFile {
    frames: Vec<Option<TimedPose>>,
}

/// The pose of a frame, as it was found.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct TimedPose {
    /// Since the start of the clock of the timestamps.
    time: Duration,
    world_from_camera: Pose,
}

impl PosesFile {
    /// Name of the file.
    pub const FILE: &'static str = "poses.txt";
}

/// Returns a frame's time and pose, `None` if its pose is not known.
fn pose_of(record: &FrameRecord) -> Option<TimedPose> {
    let time = frame_time(record.frame.timestamp(), record.index);
    let world_from_camera = *record.frame.world_from_camera();
    (record.pose_state != PoseState::Lost).then_some(TimedPose { time, world_from_camera })
}

impl RunOutput for PosesFile {
    fn name(&self) -> &'static str {
        "poses"
    }

    fn add_frame(&mut self, record: &FrameRecord, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.frames.push(pose_of(record));
        Ok(())
    }

    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError> {
        saved_state(Self::FILE, &pose_of(record))
    }

    fn save(&mut self, _: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        saved_state(Self::FILE, &())
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let () = serde_json::from_slice(saved)?;
        self.frames = frames.iter().map(|frame| serde_json::from_str(frame)).collect::<serde_json::Result<_>>()?;
        Ok(())
    }

    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let mut text = TRAJECTORY_HEADER.to_owned();
        for (position, frame) in self.frames.iter().enumerate() {
            let line =
                |frame: &TimedPose| trajectory_line(frame.time, &end.final_pose(position, &frame.world_from_camera));
            text.extend(frame.as_ref().map(line));
        }
        folder.write(Self::FILE, text.as_bytes())
    }
}

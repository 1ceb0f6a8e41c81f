//! `poses.txt`: the camera's pose in every frame, in the format of TUM RGB-D.

use crate::error::saved_state;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use splatseg_annotations::{TRAJECTORY_HEADER, frame_time, trajectory_line};
use splatseg_odometry::PoseState;

/// Writes the camera's poses: a line per frame, with the frame's timestamp, or else its index in its source / 30 s. Frames
/// without a known pose have no line.
#[derive(Debug, Default)]
pub struct PosesFile {
    lines: String,
}

impl PosesFile {
    /// Name of the file.
    pub const FILE: &'static str = "poses.txt";
}

/// Returns a frame's line, `None` if its pose is not known.
fn line_of(record: &FrameRecord) -> Option<String> {
    let time = frame_time(record.frame.timestamp(), record.index);
    (record.pose_state != PoseState::Lost).then(|| trajectory_line(time, record.frame.world_from_camera()))
}

impl RunOutput for PosesFile {
    fn name(&self) -> &'static str {
        "poses"
    }

    fn add_frame(&mut self, record: &FrameRecord, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.lines.extend(line_of(record));
        Ok(())
    }

    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError> {
        saved_state(Self::FILE, &line_of(record))
    }

    fn save(&mut self, _: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        saved_state(Self::FILE, &())
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let () = serde_json::from_slice(saved)?;
        let mut lines = String::new();
        for frame in frames {
            lines.extend(serde_json::from_str::<Option<String>>(frame)?);
        }
        self.lines = lines;
        Ok(())
    }

    fn finish(&mut self, _: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        folder.write(Self::FILE, format!("{TRAJECTORY_HEADER}{}", self.lines).as_bytes())
    }
}

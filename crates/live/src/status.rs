//! The state of a session, for people and for `/diagnostics`.

use splatseg_dataset::MatchCounts;
use splatseg_odometry::PoseState;
use splatseg_ros::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};
use std::fmt;
use std::time::Duration;

/// Age of the results from which a diagnosis is a warning.
const OLD: Duration = Duration::from_secs(1);

/// The state of a session.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct LiveStatus {
    /// Frames with a result.
    pub frames: usize,
    /// Frames that were given but could not be used.
    pub skipped: usize,
    /// Frames left out while paused.
    pub paused_frames: usize,
    /// True while paused.
    pub is_paused: bool,
    /// Why frames are not used, or none come.
    pub problem: Option<String>,
    /// Frames with a result in the last second.
    pub rate_hz: f32,
    /// Time for the latest frame, from its receipt to its result.
    pub age: Duration,
    /// Time for the latest frame without waiting.
    pub frame_time: Duration,
    /// Objects in the latest frame.
    pub visible_objects: usize,
    /// All objects so far.
    pub objects: usize,
    /// Gaussians of the map.
    pub gaussians: usize,
    /// State of the latest pose; `None` before the first frame.
    pub pose: Option<PoseState>,
    /// Counts of messages, by use or reason for dropping.
    pub counts: MatchCounts,
}

impl LiveStatus {
    /// Returns the message for `/diagnostics`.
    pub fn diagnostics(&self, header: Header) -> DiagnosticArray {
        let (level, message) = match (&self.problem, self.pose) {
            (Some(problem), _) => (DiagnosticStatus::ERROR, problem.clone()),
            (None, None) => (DiagnosticStatus::STALE, "waiting for frames".to_owned()),
            _ if self.is_paused => (DiagnosticStatus::STALE, "paused".to_owned()),
            (None, Some(PoseState::Lost)) => (DiagnosticStatus::WARN, "the camera's pose is lost".to_owned()),
            _ if self.age > OLD => (DiagnosticStatus::WARN, "results are old".to_owned()),
            _ => (DiagnosticStatus::OK, "running".to_owned()),
        };
        let dropped = self.counts.dropped;
        let values = [
            ("frames", self.frames.to_string()),
            ("skipped", self.skipped.to_string()),
            ("rate (Hz)", format!("{:.1}", self.rate_hz)),
            ("age (ms)", milliseconds(self.age)),
            ("frame time (ms)", milliseconds(self.frame_time)),
            ("visible objects", self.visible_objects.to_string()),
            ("objects", self.objects.to_string()),
            ("gaussians", self.gaussians.to_string()),
            ("messages", self.counts.messages.to_string()),
            ("messages damaged", self.counts.damaged.to_string()),
            ("images dropped: busy", dropped.busy.to_string()),
            ("images dropped: unpaired", dropped.unpaired.to_string()),
            ("images dropped: late", dropped.late.to_string()),
            ("images dropped: other", (dropped.total() - dropped.busy - dropped.unpaired - dropped.late).to_string()),
            ("frames without a pose", self.counts.without_pose.to_string()),
        ];
        let values = values.map(|(key, value)| KeyValue { key: key.to_owned(), value }).to_vec();
        let name = "splatseg".to_owned();
        let status = DiagnosticStatus { level, name, message, hardware_id: String::new(), values };
        DiagnosticArray { header, status: vec![status] }
    }
}

fn milliseconds(time: Duration) -> String {
    format!("{:.0}", time.as_secs_f64() * 1e3)
}

impl fmt::Display for LiveStatus {
    /// Writes one line for a terminal.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(problem) = &self.problem {
            return write!(formatter, "{problem}");
        }
        let Some(pose) = self.pose else { return write!(formatter, "waiting for frames; {}", self.counts) };
        let (visible, objects) = (self.visible_objects, self.objects);
        write!(
            formatter,
            "{:.1} frames/s, {} ms old; {visible} objects visible, ",
            self.rate_hz,
            milliseconds(self.age)
        )?;
        write!(formatter, "{objects} in all; {} Gaussians", self.gaussians)?;
        if pose == PoseState::Lost {
            write!(formatter, "; the camera's pose is lost")?;
        }
        if self.is_paused {
            write!(formatter, "; paused")?;
        }
        write!(formatter, "; {}", self.counts)
    }
}

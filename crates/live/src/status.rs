//! The state of a session, for people and for `/diagnostics`.

use splatseg_dataset::MatchCounts;
use splatseg_odometry::PoseState;
use splatseg_ros::{DiagnosticArray, DiagnosticStatus, Header, KeyValue};
use std::fmt;
use std::time::Duration;

/// Age of the results from which a diagnosis is a warning.
const OLD: Duration = Duration::from_secs(1);
/// Time without a frame after which the camera is taken to have stopped.
const SILENCE: Duration = Duration::from_secs(3);

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
    /// Whether the map is on the disk; `None` if it is not to be saved.
    pub saving: Option<SaveStatus>,
    /// Why the stream is not recorded any more, and what is in the file; `None` if it is, or is not to be.
    pub recording_problem: Option<String>,
    /// Contradictions between what came with the frames and what they show, a sentence each.
    pub doubts: Vec<String>,
    /// Frames with a result in the last second.
    pub rate_hz: f32,
    /// Time for the latest frame, from its receipt to its result.
    pub age: Duration,
    /// Time for the latest frame without waiting.
    pub frame_time: Duration,
    /// How long the session has waited for a frame. Zero if a recording is played without drops.
    pub silence: Duration,
    /// Frames of the source that were not used: their images are in [`Self::counts`].
    pub dropped_frames: u64,
    /// Objects in the latest frame.
    pub visible_objects: usize,
    /// Objects so far: those that count.
    pub objects: usize,
    /// Gaussians of the map.
    pub gaussians: usize,
    /// Summary of the latest plan of the map, or the reason why there is none; `None` before the first.
    pub places: Option<String>,
    /// State of the latest pose; `None` before the first frame.
    pub pose: Option<PoseState>,
    /// Counts of messages, by use or reason for dropping.
    pub counts: MatchCounts,
}

/// Whether a session's map is on the disk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SaveStatus {
    /// Frames with a result when the map and its objects were last saved; `None` if this session has saved nothing.
    pub saved_frames: Option<usize>,
    /// Why the latest attempt has failed; `None` if it has not.
    pub problem: Option<String>,
}

impl LiveStatus {
    /// Everything that is wrong now: the problem with the frames, and those of saving the map and recording the stream.
    pub fn problems(&self) -> Vec<String> {
        let unsaved = self.saving.as_ref().and_then(|saving| saving.problem.as_ref());
        let unsaved = unsaved.map(|problem| format!("the map is not saved: {problem}"));
        self.problem.iter().cloned().chain(unsaved).chain(self.recording_problem.clone()).collect()
    }

    fn silence_text(&self) -> String {
        format!("no new frame for {} s", self.silence.as_secs())
    }

    /// Returns the message for `/diagnostics`.
    pub fn diagnostics(&self, header: Header) -> DiagnosticArray {
        let problems = self.problems();
        let (level, message) = match self.pose {
            _ if !problems.is_empty() => (DiagnosticStatus::ERROR, problems.join("; ")),
            None => (DiagnosticStatus::STALE, "waiting for frames".to_owned()),
            _ if self.is_paused => (DiagnosticStatus::STALE, "paused".to_owned()),
            _ if self.silence > SILENCE => (DiagnosticStatus::STALE, self.silence_text()),
            _ if !self.doubts.is_empty() => (DiagnosticStatus::WARN, self.doubts.join("; ")),
            Some(PoseState::Lost) => (DiagnosticStatus::WARN, "the camera's pose is lost".to_owned()),
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
            ("waiting for a frame (ms)", milliseconds(self.silence)),
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
        let saved = self
            .saving
            .as_ref()
            .map(|saving| ("frames in the saved map", saving.saved_frames.unwrap_or(0).to_string()));
        let places = self.places.as_ref().map(|places| ("plan", places.clone()));
        let values = values.into_iter().chain(saved).chain(places);
        let values = values.map(|(key, value)| KeyValue { key: key.to_owned(), value }).collect();
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
        let problems = self.problems();
        if self.problem.is_some() {
            return formatter.write_str(&problems.join("; "));
        }
        problems.iter().try_for_each(|problem| write!(formatter, "{problem}; "))?;
        let Some(pose) = self.pose else { return write!(formatter, "waiting for frames; {}", self.counts) };
        let (visible, objects) = (self.visible_objects, self.objects);
        write!(
            formatter,
            "{:.1} frames/s, {} ms old; {visible} objects visible, ",
            self.rate_hz,
            milliseconds(self.age)
        )?;
        write!(formatter, "{objects} in all; {} Gaussians", self.gaussians)?;
        if self.silence > SILENCE && !self.is_paused {
            write!(formatter, "; {}", self.silence_text())?;
        }
        if pose == PoseState::Lost {
            write!(formatter, "; the camera's pose is lost")?;
        }
        if self.is_paused {
            write!(formatter, "; paused")?;
        }
        for doubt in &self.doubts {
            write!(formatter, "; warning: {doubt}")?;
        }
        write!(formatter, "; {}", self.counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level_and_message(status: &LiveStatus) -> (u8, String) {
        let diagnostics = status.diagnostics(Header { stamp: Default::default(), frame_id: String::new() });
        (diagnostics.status[0].level, diagnostics.status[0].message.clone())
    }

    #[test]
    fn a_camera_that_has_stopped_is_not_running() {
        let mut status = LiveStatus { frames: 9, pose: Some(PoseState::Given), ..Default::default() };
        status.silence = Duration::from_millis(2900);
        assert_eq!(level_and_message(&status), (DiagnosticStatus::OK, "running".to_owned()));
        status.silence = Duration::from_millis(12_400);
        assert_eq!(level_and_message(&status), (DiagnosticStatus::STALE, "no new frame for 12 s".to_owned()));
        assert!(status.to_string().contains("; no new frame for 12 s; "), "{status}");
        let diagnostics = status.diagnostics(Header { stamp: Default::default(), frame_id: String::new() });
        let waiting = diagnostics.status[0].values.iter().find(|value| value.key == "waiting for a frame (ms)");
        assert_eq!(waiting.map(|value| value.value.as_str()), Some("12400"));
        status.is_paused = true;
        assert_eq!(level_and_message(&status), (DiagnosticStatus::STALE, "paused".to_owned()));
        assert!(!status.to_string().contains("no new frame"), "{status}");
    }

    #[test]
    fn no_problem_hides_another() {
        let full = SaveStatus { saved_frames: Some(3), problem: Some("home.ply: no space".to_owned()) };
        let unsaved = "the map is not saved: home.ply: no space";
        let mut status =
            LiveStatus { frames: 9, pose: Some(PoseState::Given), saving: Some(full), ..Default::default() };
        assert_eq!(level_and_message(&status), (DiagnosticStatus::ERROR, unsaved.to_owned()));
        assert!(status.to_string().starts_with(&format!("{unsaved}; 0.0 frames/s")), "{status}");
        status.problem = Some("frame 7 is damaged".to_owned());
        assert_eq!(level_and_message(&status).1, format!("frame 7 is damaged; {unsaved}"));
        assert_eq!(status.to_string(), format!("frame 7 is damaged; {unsaved}"));
        status.is_paused = true;
        status.problem = None;
        assert_eq!(level_and_message(&status).1, unsaved);
        status.saving = Some(SaveStatus { saved_frames: Some(9), problem: None });
        assert_eq!(level_and_message(&status), (DiagnosticStatus::STALE, "paused".to_owned()));
        let cut = "used.mcap: the recording ends early, with 7 messages: no space";
        status.recording_problem = Some(cut.to_owned());
        assert_eq!(level_and_message(&status), (DiagnosticStatus::ERROR, cut.to_owned()));
        assert!(status.to_string().starts_with(&format!("{cut}; 0.0 frames/s")), "{status}");
    }
}

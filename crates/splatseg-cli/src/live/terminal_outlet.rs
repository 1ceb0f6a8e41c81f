//! The state of a live session on the terminal.

use crate::terminal::{escape, is_quiet, shows_progress};
use indicatif::{ProgressBar, ProgressStyle};
use splatseg_live::{LiveStatus, Outlet, Output};
use std::time::{Duration, Instant};

/// Time between two lines, if standard error is not a terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Shows the state: one line that changes on a terminal, otherwise a line every ten seconds. That the map cannot be saved
/// any more is said at once, and that it can be again, and so is the early end of a recording.
pub struct TerminalOutlet {
    bar: ProgressBar,
    latest: Option<Instant>,
    is_terminal: bool,
    /// Why the map is not saved, as it was said last.
    unsaved: Option<String>,
    /// True once the early end of the recording was said.
    has_told_recording: bool,
}

impl TerminalOutlet {
    pub fn new() -> Self {
        let style = ProgressStyle::with_template("{wide_msg}").unwrap_or_else(|_| ProgressStyle::default_spinner());
        let bar = if is_quiet() { ProgressBar::hidden() } else { ProgressBar::no_length() };
        let bar = bar.with_style(style);
        Self { bar, latest: None, is_terminal: shows_progress(), unsaved: None, has_told_recording: false }
    }
}

impl Outlet for TerminalOutlet {
    fn wants(&self, _: Output) -> bool {
        false
    }

    fn publish(&mut self, _: Output, _: Vec<u8>) {}

    fn show(&mut self, status: &LiveStatus) {
        let unsaved = status.saving.as_ref().and_then(|saving| saving.problem.clone());
        if unsaved != self.unsaved {
            self.bar.suspend(|| match &unsaved {
                Some(problem) => say_error!("warning: the map is not saved: {problem}"),
                None => inform!("the map is saved again"),
            });
            self.unsaved = unsaved;
        }
        if let Some(problem) = status.recording_problem.as_ref().filter(|_| !self.has_told_recording) {
            self.bar.suspend(|| say_error!("warning: {problem}"));
            self.has_told_recording = true;
        }
        if self.is_terminal {
            self.bar.set_message(escape(&status.to_string()).into_owned());
        } else if self.latest.is_none_or(|latest| latest.elapsed() >= BETWEEN_LINES) {
            self.latest = Some(Instant::now());
            inform!("{status}");
        }
    }
}

impl Drop for TerminalOutlet {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

//! Progress of a run: a bar on a terminal, otherwise a line from time to time.

use super::super::terminal::{counted, is_quiet, shows_progress};
use indicatif::{ProgressBar, ProgressStyle};
use std::time::{Duration, Instant};

/// Time between two lines.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Shows the progress of a run.
pub struct Progress {
    /// Not drawn if standard error is not a terminal.
    bar: ProgressBar,
    lines: Option<ProgressLines>,
}

impl Progress {
    /// Creates the display for a run of this many frames; `None` if the end is not known.
    pub fn new(frames: Option<usize>) -> Self {
        let lines = (!shows_progress() && !is_quiet()).then(|| ProgressLines::new(frames, Instant::now()));
        let bar = match frames {
            _ if is_quiet() => ProgressBar::hidden(),
            Some(frames) => {
                ProgressBar::new(frames as u64).with_style(style("{bar:40} {pos}/{len} frames, {per_sec}, {eta} left"))
            }
            None => ProgressBar::no_length().with_style(style("{spinner} {pos} frames, {per_sec}")),
        };
        Self { bar, lines }
    }

    /// Creates the display for the final pass over this many frames.
    pub fn again(frames: usize) -> Self {
        let progress = Self::new(Some(frames));
        progress.bar.set_style(style("final pass {bar:29} {pos}/{len} frames, {per_sec}, {eta} left"));
        progress
    }

    /// Counts a processed frame.
    pub fn frame_done(&mut self) {
        self.bar.inc(1);
        if let Some(line) = self.lines.as_mut().and_then(|lines| lines.frame_done(Instant::now())) {
            inform!("{line}");
        }
    }

    /// Prints a warning above the bar.
    pub fn warn(&self, text: &str) {
        self.bar.suspend(|| say_error!("warning: {text}"));
    }

    /// Prints a message above the bar.
    pub fn say(&self, text: &str) {
        self.bar.suspend(|| inform!("{text}"));
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Returns the progress bar for computing a codebook, in percent.
pub fn codebook_bar() -> ProgressBar {
    let bar = if is_quiet() { ProgressBar::hidden() } else { ProgressBar::new(100) };
    bar.with_style(style("codebook {bar:30} {percent}%"))
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Lines about the progress, for log files.
struct ProgressLines {
    frames: Option<usize>,
    done: usize,
    started: Instant,
    latest: Instant,
}

impl ProgressLines {
    fn new(frames: Option<usize>, now: Instant) -> Self {
        Self { frames, done: 0, started: now, latest: now }
    }

    /// Counts a frame. Returns a line if it is time for one.
    fn frame_done(&mut self, now: Instant) -> Option<String> {
        self.done += 1;
        if now.duration_since(self.latest) < BETWEEN_LINES || self.frames.is_some_and(|frames| self.done >= frames) {
            return None;
        }
        self.latest = now;
        let rate = self.done as f64 / now.duration_since(self.started).as_secs_f64();
        let Some(frames) = self.frames else {
            return Some(format!("{}, {rate:.2} per second", counted(self.done, "frame")));
        };
        let left = duration_in_words((frames - self.done) as f64 / rate);
        Some(format!("{} of {}, {rate:.2} per second, about {left} left", self.done, counted(frames, "frame")))
    }
}

/// Formats a time to the nearest second, minute or tenth of an hour.
fn duration_in_words(seconds: f64) -> String {
    match seconds {
        ..=99.5 => format!("{seconds:.0} s"),
        ..=5970.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_run_has_a_line_every_ten_seconds() {
        let start = Instant::now();
        let mut lines = ProgressLines::new(Some(300), start);
        let printed: Vec<String> =
            (1..=300).filter_map(|frame| lines.frame_done(start + Duration::from_millis(100 * frame))).collect();
        assert_eq!(
            printed,
            [
                "100 of 300 frames, 10.00 per second, about 20 s left",
                "200 of 300 frames, 10.00 per second, about 10 s left"
            ]
        );
    }

    #[test]
    fn durations_have_a_fitting_unit() {
        assert_eq!([7.4, 99.6, 600.0, 9000.0].map(duration_in_words), ["7 s", "2 min", "10 min", "2.5 h"]);
    }
}

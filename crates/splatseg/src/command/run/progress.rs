//! How far a run is: a bar on a terminal, a line now and then elsewhere.

use super::super::terminal::counted;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// The time between two lines.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Shows how far a run is.
pub struct Progress {
    /// Not drawn where standard error is not a terminal.
    bar: ProgressBar,
    lines: Option<ProgressLines>,
}

impl Progress {
    /// Progress through this many frames.
    pub fn of_frames(frames: usize) -> Self {
        let style = style("{bar:40} {pos}/{len} frames, {per_sec}, {eta} left");
        let lines = (!std::io::stderr().is_terminal()).then(|| ProgressLines::new(frames, Instant::now()));
        Self { bar: ProgressBar::new(frames as u64).with_style(style), lines }
    }

    /// A frame is done.
    pub fn frame_done(&mut self) {
        self.bar.inc(1);
        if let Some(line) = self.lines.as_mut().and_then(|lines| lines.frame_done(Instant::now())) {
            say_error!("{line}");
        }
    }

    /// Prints a warning above the bar.
    pub fn warn(&self, text: &str) {
        self.bar.suspend(|| say_error!("warning: {text}"));
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// The bar that is shown while a codebook is made, in percent.
pub fn codebook_bar() -> ProgressBar {
    ProgressBar::new(100).with_style(style("codebook {bar:30} {percent}%"))
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Lines about the progress, for log files.
struct ProgressLines {
    frames: usize,
    done: usize,
    started: Instant,
    latest: Instant,
}

impl ProgressLines {
    fn new(frames: usize, now: Instant) -> Self {
        Self { frames, done: 0, started: now, latest: now }
    }

    /// Counts a frame. Returns a line if it is time for one.
    fn frame_done(&mut self, now: Instant) -> Option<String> {
        self.done += 1;
        if now.duration_since(self.latest) < BETWEEN_LINES || self.done >= self.frames {
            return None;
        }
        self.latest = now;
        let rate = self.done as f64 / now.duration_since(self.started).as_secs_f64();
        let left = (self.frames - self.done) as f64 / rate;
        let all = counted(self.frames, "frame");
        Some(format!("{} of {all}, {rate:.2} per second, about {} left", self.done, duration_in_words(left)))
    }
}

/// A time to the nearest second, minute or tenth of an hour.
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
        let mut lines = ProgressLines::new(300, start);
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

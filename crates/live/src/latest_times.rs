//! Times of the latest frames.

use std::collections::VecDeque;
use std::fmt;
use std::time::{Duration, Instant};

/// Number of frames that are kept.
const KEPT: usize = 1000;

/// Times of the latest frames, 1000 at most.
#[derive(Clone, Debug, Default)]
pub struct LatestTimes {
    frames: VecDeque<FrameTimes>,
}

#[derive(Clone, Copy, Debug)]
struct FrameTimes {
    done: Instant,
    frame_time: Duration,
    age: Duration,
}

impl LatestTimes {
    /// Adds a frame that is done now.
    pub(crate) fn record(&mut self, frame_time: Duration, age: Duration) {
        if self.frames.len() == KEPT {
            self.frames.pop_front();
        }
        self.frames.push_back(FrameTimes { done: Instant::now(), frame_time, age });
    }

    /// Number of frames that were done within an interval before now.
    pub(crate) fn since(&self, interval: Duration) -> usize {
        self.frames.iter().rev().take_while(|frame| frame.done.elapsed() < interval).count()
    }

    /// Time for a frame without waiting that a share of the frames do not exceed: 0.5 gives the median. Zero without
    /// frames.
    pub fn frame_time(&self, share: f64) -> Duration {
        quantile(self.frames.iter().map(|frame| frame.frame_time).collect(), share)
    }

    /// Time from the receipt of a frame to its result that a share of the frames do not exceed. Zero without frames.
    pub fn age(&self, share: f64) -> Duration {
        quantile(self.frames.iter().map(|frame| frame.age).collect(), share)
    }
}

fn quantile(mut times: Vec<Duration>, share: f64) -> Duration {
    times.sort_unstable();
    let last = times.len().saturating_sub(1);
    times.get((last as f64 * share.clamp(0.0, 1.0)).round() as usize).copied().unwrap_or_default()
}

impl fmt::Display for LatestTimes {
    /// Writes the medians and the times that 95 % of the frames do not exceed.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let [frame_times, ages] = [Self::frame_time, Self::age].map(|of| [0.5, 0.95].map(|share| ms(of(self, share))));
        write!(
            formatter,
            "time per frame: median {:.0} ms, 95 % {:.0} ms; from receipt to result: median {:.0} ms, 95 % {:.0} ms",
            frame_times[0], frame_times[1], ages[0], ages[1]
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_latest_frames_count() {
        let mut times = LatestTimes::default();
        assert_eq!(times.frame_time(0.5), Duration::ZERO);
        for frame in 0..1200 {
            times.record(Duration::from_millis(frame), Duration::from_millis(2 * frame));
        }
        assert_eq!(times.frame_time(0.0), Duration::from_millis(200));
        assert_eq!(times.frame_time(1.0), Duration::from_millis(1199));
        assert_eq!(times.age(0.5), Duration::from_millis(1400));
        assert!(times.to_string().starts_with("time per frame: median 700 ms, 95 % 1149 ms"), "{times}");
    }
}

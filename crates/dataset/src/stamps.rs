//! Times in text files and file names: seconds, or milliseconds, microseconds or nanoseconds, of any clock.
//!
//! Data sets have times in seconds, with a fraction. Loggers and drivers write whole numbers of smaller units, since 1970
//! or since they were started. A file's unit follows from the size of its times and from the steps between them: a video
//! has steps of at most some seconds, and no recording is from after 2038. It is said once, if it is not seconds.

use crate::DatasetError;
use crate::plausibility::warn_once;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The last second of a time in ROS 2's messages, in 2038.
const LAST_SECOND: f64 = i32::MAX as f64;

/// Times in seconds since 1970 are above this: the year 1985.
const EPOCH: f64 = 5e8;

/// Longest plausible step in a list of times in seconds: of photographs taken every ten minutes.
const LONGEST_STEP: f64 = 600.0;

/// Longest plausible step in a list of times in other units, seconds. From here on, seconds may be milliseconds.
const LONG_STEP: f64 = 10.0;

/// Numbers below this are not taken for times since 1970 in milliseconds; microseconds and nanoseconds have three and six
/// digits more. The year 1973.
const FIRST_MILLISECOND: f64 = 1e11;

/// A time as it is written, finite, in any unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stamp {
    value: f64,
    /// The number itself, if it is whole: `f64` has too few digits for nanoseconds.
    whole: Option<i128>,
}

impl Stamp {
    /// Parses a time. `None` if the text is not a finite number.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let value: f64 = text.parse().ok().filter(|value: &f64| value.is_finite())?;
        Some(Self { value, whole: text.parse().ok() })
    }

    /// The time in seconds.
    pub(crate) fn seconds(self, unit: TimeUnit) -> f64 {
        let per_second = unit.per_second();
        match self.whole.and_then(|whole| u64::try_from(whole).ok()) {
            Some(whole) if per_second > 1 => {
                let nanoseconds = (whole % per_second) * (NANOSECONDS / per_second);
                Duration::new(whole / per_second, nanoseconds as u32).as_secs_f64()
            }
            _ => self.value / per_second as f64,
        }
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.whole {
            Some(whole) => write!(formatter, "{whole}"),
            // With an exponent if it is long.
            None => write!(formatter, "{:?}", self.value),
        }
    }
}

const NANOSECONDS: u64 = 1_000_000_000;

/// Unit of times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TimeUnit {
    Seconds,
    Milliseconds,
    Microseconds,
    Nanoseconds,
}

impl TimeUnit {
    /// From the longest to the shortest.
    const ALL: [Self; 4] = [Self::Seconds, Self::Milliseconds, Self::Microseconds, Self::Nanoseconds];

    fn per_second(self) -> u64 {
        match self {
            Self::Seconds => 1,
            Self::Milliseconds => 1000,
            Self::Microseconds => 1_000_000,
            Self::Nanoseconds => NANOSECONDS,
        }
    }

    /// The name of the unit.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Seconds => "seconds",
            Self::Milliseconds => "milliseconds",
            Self::Microseconds => "microseconds",
            Self::Nanoseconds => "nanoseconds",
        }
    }

    /// Returns the unit of a number that can only be a time since 1970 in this unit; `None` for smaller and larger ones.
    pub(crate) fn since_1970(stamp: Stamp) -> Option<Self> {
        let value = stamp.value.abs();
        let [_, shorter @ ..] = Self::ALL;
        shorter.into_iter().rev().find(|unit| {
            let seconds = value / unit.per_second() as f64;
            (FIRST_MILLISECOND / 1000.0..=LAST_SECOND).contains(&seconds)
        })
    }
}

/// The times of a list: their unit, and the range of the numbers as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimeScale {
    pub(crate) unit: TimeUnit,
    low: f64,
    high: f64,
    /// A step that is long for seconds, in equal steps of whole numbers.
    long_step: Option<f64>,
}

impl TimeScale {
    /// Finds the unit of a list of times. `like` are those of a list that belongs to it: where the numbers overlap, the
    /// units are the same.
    pub(crate) fn of(stamps: &[Stamp], like: Option<&Self>) -> Self {
        let mut values: Vec<f64> = stamps.iter().map(|stamp| stamp.value).collect();
        values.sort_by(f64::total_cmp);
        let (low, high) = (values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(0.0));
        let mut steps: Vec<f64> = values.array_windows().map(|[one, next]| next - one).collect();
        steps.retain(|step| *step > 0.0);
        steps.sort_by(f64::total_cmp);
        // The lower one of two in the middle: one wrong time makes one long step.
        let step = steps.get(steps.len().saturating_sub(1) / 2).copied();
        let middle = values.get(values.len() / 2).map_or(0.0, |value| value.abs());
        let scale = Self { unit: TimeUnit::Seconds, low, high, long_step: None };
        if let Some(like) = like.filter(|like| like.low <= high && low <= like.high) {
            return Self { unit: like.unit, ..scale };
        }
        let fits = |unit: &TimeUnit| {
            let seconds = middle / unit.per_second() as f64;
            let longest = if *unit == TimeUnit::Seconds { LONGEST_STEP } else { LONG_STEP };
            seconds <= LAST_SECOND && step.is_none_or(|step| step / unit.per_second() as f64 <= longest)
        };
        let unit = TimeUnit::ALL.into_iter().find(fits).unwrap_or(TimeUnit::Seconds);
        let is_long = unit == TimeUnit::Seconds && middle <= EPOCH && step.is_some_and(|step| step >= LONG_STEP);
        let is_whole = stamps.iter().all(|stamp| stamp.whole.is_some());
        if !(is_long && is_whole) {
            return Self { unit, ..scale };
        }
        // Numbers of frames have equal steps, times of a camera in milliseconds hardly ever.
        match steps.first() == steps.last() {
            true => Self { long_step: step, ..scale },
            false => Self { unit: TimeUnit::Milliseconds, ..scale },
        }
    }

    /// The times of a list whose unit is known.
    pub(crate) fn known(unit: TimeUnit) -> Self {
        Self { unit, low: 0.0, high: 0.0, long_step: None }
    }

    /// Returns the time in seconds. The number may also be a time since 1970 in another unit, which it tells by its size.
    /// `place` is the file and line, for errors.
    ///
    /// # Errors
    /// If the time is not before 2038 in any unit.
    pub(crate) fn seconds(&self, stamp: Stamp, place: (&Path, &str)) -> Result<f64, DatasetError> {
        let seconds = stamp.seconds(self.unit);
        if seconds.abs() <= LAST_SECOND {
            return Ok(seconds);
        }
        let (path, field) = place;
        let unit = TimeUnit::since_1970(stamp).ok_or_else(|| DatasetError::Field {
            path: path.to_owned(),
            field: field.to_owned(),
            found: format!("the time {stamp}, which is after 2038 in {}", self.unit.name()),
            expected: "a time in seconds, or in milliseconds, microseconds or nanoseconds since 1970".to_owned(),
        })?;
        Ok(stamp.seconds(unit))
    }

    /// Says once what the unit of a file's times is, if it is not seconds, or may not be. `example` is one of them.
    pub(crate) fn tell(&self, path: &Path, example: &Stamp) {
        let path = path.display();
        match (self.unit, self.long_step) {
            (TimeUnit::Seconds, None) => {}
            (TimeUnit::Seconds, Some(step)) => warn_once(format!(
                "{path}: the times are whole numbers in equal steps of {step}: they are read as seconds; if they are \
                 milliseconds, divide them by 1000"
            )),
            (unit, _) => warn_once(format!("{path}: the times are read as {}, e.g. {example}", unit.name())),
        }
    }
}

/// Returns the first and last of some times in seconds, for messages.
pub(crate) fn time_range(seconds: &[f64]) -> String {
    if seconds.is_empty() {
        return "no times".to_owned();
    }
    let [low, high] = [f64::min, f64::max].map(|end| seconds.iter().copied().reduce(end).unwrap_or(0.0));
    format!("{low:.3} to {high:.3} s")
}

/// Returns the error for colour and depth images, none of which were taken at the same time. Both lists of times are in
/// seconds, with their files.
pub(crate) fn no_pairs(color: (&Path, &[f64]), depth: (&Path, &[f64]), max_seconds: f64) -> DatasetError {
    DatasetError::Field {
        path: depth.0.to_owned(),
        field: "times of the depth images".to_owned(),
        found: time_range(depth.1),
        expected: format!(
            "times less than {max_seconds} s from those of the colour images, {} ({})",
            time_range(color.1),
            color.0.display()
        ),
    }
}

/// Checks the time of a frame, which a scene may have from another source than a text.
///
/// # Errors
/// If it is after 2038: ROS 2's messages end there. `place` names the frame.
pub(crate) fn require_possible(time: Option<Duration>, place: impl FnOnce() -> PathBuf) -> Result<(), DatasetError> {
    match time.filter(|time| time.as_secs_f64() > LAST_SECOND) {
        None => Ok(()),
        Some(time) => Err(DatasetError::Field {
            path: place(),
            field: "time".to_owned(),
            found: format!("{:e} s", time.as_secs_f64()),
            expected: "seconds before 2038: it may be in another unit".to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const START: u64 = 1_305_031_102_175_304_000;
    const STEP: u64 = 33_366_700;

    fn scale(texts: &[String]) -> TimeScale {
        TimeScale::of(&texts.iter().map(|text| Stamp::parse(text).unwrap()).collect::<Vec<_>>(), None)
    }

    fn seconds(texts: &[String]) -> Vec<f64> {
        let scale = scale(texts);
        let of = |text: &String| scale.seconds(Stamp::parse(text).unwrap(), (Path::new("a"), "line 1")).unwrap();
        texts.iter().map(of).collect()
    }

    #[test]
    fn units_follow_from_size_and_steps() {
        let at = |start: u64, per_second: u64| -> Vec<String> {
            let nanoseconds = (0..9).map(|frame| start + frame * STEP + frame * frame % 7 * 100_000);
            nanoseconds.map(|time| (time / (NANOSECONDS / per_second)).to_string()).collect()
        };
        // Since 1970, since the start of a machine hours ago, or since the start of the recording.
        for start in [START, 20_000_000_000_000, 123_456_789_000, 0] {
            let exact: Vec<f64> = at(start, NANOSECONDS)
                .iter()
                .map(|time| Duration::from_nanos(time.parse().unwrap()).as_secs_f64())
                .collect();
            for unit in [TimeUnit::Milliseconds, TimeUnit::Microseconds, TimeUnit::Nanoseconds] {
                let texts = at(start, unit.per_second());
                assert_eq!(scale(&texts).unit, unit, "{texts:?}");
                let most = 1.0 / unit.per_second() as f64 + 1e-6;
                let found = seconds(&texts);
                assert!(found.iter().zip(&exact).all(|(found, exact)| (found - exact).abs() <= most), "{texts:?}");
            }
            let texts: Vec<String> = exact.iter().map(|seconds| format!("{seconds:.6}")).collect();
            assert_eq!(scale(&texts).unit, TimeUnit::Seconds, "{texts:?}");
        }
    }

    #[test]
    fn numbers_of_frames_and_photographs_are_seconds() {
        let texts = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>();
        for (numbers, is_doubtful) in [
            (&[0.0, 1.0, 2.0, 3.0][..], false),
            (&[0.0, 10.0, 20.0, 30.0], true),
            (&[0.0, 33.0, 66.0, 99.0], true),
            (&[0.5, 13.2, 29.9], false),
            (&[1.7e9, 1.7e9 + 60.0, 1.7e9 + 125.0], false),
            (&[7.0], false),
            (&[], false),
            (&[-2.0, 12.5, -3.0, 12.6], false),
            (&[-10.0, 0.0, 10.0], true),
        ] {
            let scale = scale(&texts(numbers));
            assert_eq!((scale.unit, scale.long_step.is_some()), (TimeUnit::Seconds, is_doubtful), "{numbers:?}");
        }
    }

    #[test]
    fn lists_that_overlap_have_one_unit() {
        let stamps = |texts: &[&str]| texts.iter().map(|text| Stamp::parse(text).unwrap()).collect::<Vec<_>>();
        let images = TimeScale::of(&stamps(&["-1", "33", "67", "100"]), None);
        assert_eq!(images.unit, TimeUnit::Milliseconds);
        let poses = stamps(&["0", "1", "2", "3", "4", "5"]);
        assert_eq!(TimeScale::of(&poses, None).unit, TimeUnit::Seconds);
        assert_eq!(TimeScale::of(&poses, Some(&images)).unit, TimeUnit::Milliseconds);
        let of_another_clock = stamps(&["1305031102.1", "1305031102.2"]);
        assert_eq!(TimeScale::of(&of_another_clock, Some(&images)).unit, TimeUnit::Seconds);
    }

    #[test]
    fn impossible_times_are_refused_with_their_value() {
        let scale = scale(&["1".to_owned(), "2".to_owned()]);
        let of = |text: &str| {
            let found = scale.seconds(Stamp::parse(text).unwrap(), (Path::new("rgb.txt"), "line 7"));
            found.map_err(|error| error.to_string())
        };
        assert_eq!(of("1305031102175304000"), Ok(1_305_031_102.175_304));
        assert_eq!(of("1305031102175304"), Ok(1_305_031_102.175_304));
        assert_eq!(of("1305031102175"), Ok(1_305_031_102.175));
        for impossible in ["3000000000.0", "5000000000000000000", "-1e300"] {
            let told = of(impossible).unwrap_err();
            let expected = format!("rgb.txt: line 7: found the time {impossible}, which is after 2038 in seconds");
            assert!(told.starts_with(&expected), "{told}");
        }
        assert_eq!((Stamp::parse("nan"), Stamp::parse("now"), Stamp::parse("inf")), (None, None, None));
        let told = require_possible(Some(Duration::from_secs(START)), || "frame 3".into()).unwrap_err().to_string();
        assert!(
            told.starts_with("frame 3: time: found 1.305031102175304e18 s, expected seconds before 2038"),
            "{told}"
        );
    }

    proptest! {
        #[test]
        fn nanoseconds_are_exact(time in 0..2_000_000_000_000_000_000u64) {
            let stamp = Stamp::parse(&time.to_string()).unwrap();
            prop_assert_eq!(stamp.seconds(TimeUnit::Nanoseconds), Duration::from_nanos(time).as_secs_f64());
        }

        #[test]
        fn any_numbers_have_a_unit(values in prop::collection::vec(any::<f64>(), 0..9)) {
            let stamps: Vec<Stamp> = values.iter().filter_map(|value| Stamp::parse(&value.to_string())).collect();
            let scale = TimeScale::of(&stamps, None);
            for stamp in stamps {
                let found = scale.seconds(stamp, (Path::new("a"), "line"));
                prop_assert!(found.is_err() || found.unwrap().abs() <= LAST_SECOND);
            }
        }
    }
}

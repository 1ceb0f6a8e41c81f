//! The text files of a TUM RGB-D sequence.

use crate::DatasetError;
use crate::stamps::{Stamp, TimeScale};
use crate::text::{not_text, read_lines_of_text, require_decimal_points, shortened};
use glam::{DQuat, DVec3};
use splatseg_files::{MemoryLimit, TextError, display_bytes};
use std::path::{Component, Path, PathBuf};

/// Maximum file size: a day at 120 poses per second has 10 million lines.
const MAX_LIST_BYTES: u64 = 1 << 30;

/// Memory per line of a list, including its file name and its place in the pairing.
const BYTES_PER_LINE: u64 = 512;

/// An image and its time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ListedFile {
    pub(super) seconds: f64,
    /// File name without its extension.
    pub(super) stem: String,
    pub(super) path: PathBuf,
}

/// A pose and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TimedPose {
    pub(super) seconds: f64,
    /// Camera position, metres.
    pub(super) position: DVec3,
    /// Rotation from camera to world axes, of the length that is written.
    pub(super) rotation: DQuat,
    /// Number of its line, from 1, for messages.
    pub(super) line: usize,
}

impl TimedPose {
    /// Returns false if tracking was lost.
    pub(super) fn is_finite(&self) -> bool {
        self.position.is_finite() && self.rotation.is_finite()
    }
}

/// A list of images.
#[derive(Debug)]
pub(super) struct FileList {
    /// Sorted by time.
    pub(super) files: Vec<ListedFile>,
    /// Number of lines skipped because they are not UTF-8.
    pub(super) unreadable: usize,
    pub(super) times: TimeScale,
}

/// Reads a list of images. Of several with the same time the last is kept, as in `associate.py`. `like` are the times of
/// another list of the same recording.
pub(super) fn read_file_list(
    folder: &Path,
    name: &str,
    what: &'static str,
    like: Option<&TimeScale>,
) -> Result<FileList, DatasetError> {
    let path = folder.join(name);
    let parse = |line: Line<'_>| {
        let file = Path::new(line.words.get(1)?);
        // A list must not refer to files outside its folder.
        let inside = file.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        let stem = file.file_stem()?.to_str()?.to_owned();
        inside.then(|| ListedFile { seconds: 0.0, stem, path: folder.join(file) })
    };
    let (lines, unreadable) = read_lines(&path, what, "a time in seconds and a file inside the folder", parse)?;
    let (mut files, times) = timed(&path, lines, like, |file, seconds| file.seconds = seconds)?;
    sort_by_time(&mut files, |file| file.seconds);
    Ok(FileList { files, unreadable, times })
}

/// Reads a trajectory, sorted by time. Of several poses with the same time the last is kept. `like` are the times of the
/// images.
pub(super) fn read_trajectory(path: &Path, like: &TimeScale) -> Result<Vec<TimedPose>, DatasetError> {
    let parse = |line: Line<'_>| {
        let numbers: Vec<f64> = line.words.iter().map(|word| word.parse().ok()).collect::<Option<_>>()?;
        let [_, tx, ty, tz, qx, qy, qz, qw] = numbers.as_slice().try_into().ok()?;
        let (position, rotation) = (DVec3::new(tx, ty, tz), DQuat::from_xyzw(qx, qy, qz, qw));
        Some(TimedPose { seconds: 0.0, position, rotation, line: line.number })
    };
    let (lines, _) = read_lines(path, "camera trajectory", "time tx ty tz qx qy qz qw", parse)?;
    let (mut poses, _) = timed(path, lines, Some(like), |pose, seconds| pose.seconds = seconds)?;
    sort_by_time(&mut poses, |pose| pose.seconds);
    Ok(poses)
}

/// A line that is not a comment.
struct Line<'a> {
    /// From 1.
    number: usize,
    words: Vec<&'a str>,
}

/// The content of a line, with its time as written.
struct StampedLine<T> {
    /// From 1.
    number: usize,
    stamp: Stamp,
    content: T,
}

/// Sets the times of a list once all are known, because only together they tell their unit.
fn timed<T>(
    path: &Path,
    lines: Vec<StampedLine<T>>,
    like: Option<&TimeScale>,
    set: impl Fn(&mut T, f64),
) -> Result<(Vec<T>, TimeScale), DatasetError> {
    let stamps: Vec<Stamp> = lines.iter().map(|line| line.stamp).collect();
    let times = TimeScale::of(&stamps, like);
    if let Some(first) = stamps.first() {
        times.tell(path, first);
    }
    let content = lines.into_iter().map(|mut line| {
        let seconds = times.seconds(line.stamp, (path, &format!("line {}", line.number)))?;
        set(&mut line.content, seconds);
        Ok(line.content)
    });
    Ok((content.collect::<Result<_, DatasetError>>()?, times))
}

/// Parses the lines that are UTF-8, each with a time as its first word. Also returns the number of lines that are not.
fn read_lines<T>(
    path: &Path,
    what: &'static str,
    expected: &str,
    parse: impl Fn(Line<'_>) -> Option<T>,
) -> Result<(Vec<StampedLine<T>>, usize), DatasetError> {
    let text = read_lines_of_text(path, what, MAX_LIST_BYTES)?;
    require_memory_for_lines(path, &text)?;
    let (mut parsed, mut unreadable) = (Vec::new(), 0);
    for (index, line) in text.split(|byte| *byte == b'\n').enumerate() {
        let Ok(line) = std::str::from_utf8(line) else {
            unreadable += 1;
            continue;
        };
        if line.trim().is_empty() || line.trim_start().starts_with('#') {
            continue;
        }
        require_decimal_points(path, index, line)?;
        // A few more words than any format has are enough to detect extra ones.
        let words: Vec<&str> =
            line.split([' ', '\t', ',']).map(str::trim).filter(|word| !word.is_empty()).take(16).collect();
        let number = index + 1;
        let stamp = words.first().and_then(|word| Stamp::parse(word));
        let read = stamp.zip(parse(Line { number, words })).ok_or_else(|| DatasetError::Field {
            path: path.to_owned(),
            field: format!("line {number}"),
            found: shortened(line),
            expected: expected.to_owned(),
        })?;
        let (stamp, content) = read;
        parsed.push(StampedLine { number, stamp, content });
    }
    if parsed.is_empty() && unreadable > 0 {
        return Err(not_text(path, what, TextError::NotUtf8));
    }
    Ok((parsed, unreadable))
}

/// Checks that the parsed lines of a list fit in the memory limit.
fn require_memory_for_lines(path: &Path, text: &[u8]) -> Result<(), DatasetError> {
    let lines = text.iter().filter(|byte| **byte == b'\n').count() as u64;
    let limit = MemoryLimit::in_force();
    if lines.saturating_mul(BYTES_PER_LINE) <= limit {
        return Ok(());
    }
    Err(DatasetError::Field {
        path: path.to_owned(),
        field: "lines".to_owned(),
        found: lines.to_string(),
        expected: format!(
            "at most {}, as each takes up to {BYTES_PER_LINE} bytes and the memory limit is {}: raise --memory-limit",
            limit / BYTES_PER_LINE,
            display_bytes(limit)
        ),
    })
}

fn sort_by_time<T>(items: &mut Vec<T>, seconds: impl Fn(&T) -> f64) {
    // Among equal times the latest line comes first, so that deduplication keeps the last one in the file.
    items.reverse();
    items.sort_by(|left, right| seconds(left).total_cmp(&seconds(right)));
    items.dedup_by(|later, earlier| seconds(later) == seconds(earlier));
}

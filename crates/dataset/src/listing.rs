//! Folders with numbered files.

use crate::error::NAMES_IN_MESSAGES;
use crate::recorded_poses::PoseCoverage;
use crate::{DatasetError, LeftOut};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A file named with its frame's number.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct NumberedFile {
    pub(crate) number: u64,
    /// The name up to the end of the number, e.g. `frame-000150` or `42`.
    pub(crate) stem: String,
    pub(crate) path: PathBuf,
}

/// Pattern of the file names in a folder: `<prefix><number><one of suffixes>`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NamePattern {
    pub(crate) prefix: &'static str,
    /// If a frame has several files, the first suffix wins.
    pub(crate) suffixes: &'static [&'static str],
}

impl NamePattern {
    /// Returns the number and stem of a matching file name, and the index of its suffix.
    fn parse(&self, name: &str) -> Option<(u64, String, usize)> {
        let rest = name.strip_prefix(self.prefix)?;
        let (rank, digits) =
            self.suffixes.iter().enumerate().find_map(|(rank, suffix)| Some((rank, rest.strip_suffix(suffix)?)))?;
        let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
        is_number.then(|| Some((digits.parse().ok()?, format!("{}{digits}", self.prefix), rank)))?
    }
}

/// Returns the names in a folder, sorted. Empty if the folder cannot be read.
pub(crate) fn all_names_in(folder: &Path) -> Vec<OsString> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<OsString> = entries.filter_map(|entry| Some(entry.ok()?.file_name())).collect();
    names.sort();
    names
}

/// Returns the names in a folder that are valid UTF-8, sorted. Empty if the folder cannot be read.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    all_names_in(folder).into_iter().filter_map(|name| name.into_string().ok()).collect()
}

/// Returns the error for a folder without a file that is `expected`. It names the files that are there, if there are any.
pub(crate) fn no_frames_in(folder: &Path, expected: &'static str) -> DatasetError {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for name in all_names_in(folder) {
        let ending = Path::new(&name).extension().map(|ending| format!(".{}", ending.to_string_lossy()));
        *counts.entry(ending.unwrap_or_else(|| "without an extension".to_owned())).or_default() += 1;
    }
    // The most frequent first.
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| Reverse(*count));
    let found: Vec<String> =
        counts.iter().take(NAMES_IN_MESSAGES).map(|(ending, count)| format!("{count} {ending}")).collect();
    match found.is_empty() {
        true => DatasetError::NoFrames { path: folder.to_owned(), expected },
        false => DatasetError::OtherFiles { path: folder.to_owned(), found: found.join(", "), expected },
    }
}

/// Returns true if any name in a folder matches the pattern.
pub(crate) fn has_numbered_files(folder: &Path, pattern: NamePattern) -> bool {
    names_in(folder).iter().any(|name| fits(name, pattern))
}

/// Counts skipped files and frames: files in `color_folder` whose names are not UTF-8, and frames that have one of
/// `others` but no colour image in `frames`.
pub(crate) fn left_out_beside(
    frames: &[NumberedFile],
    color_folder: &Path,
    others: &[(PathBuf, NamePattern)],
) -> Vec<LeftOut> {
    let unreadable = all_names_in(color_folder).iter().filter(|name| name.to_str().is_none()).count();
    let with_color: BTreeSet<u64> = frames.iter().map(|file| file.number).collect();
    let numbers = others.iter().flat_map(|(folder, pattern)| {
        let numbers = names_in(folder).into_iter().filter_map(|name| Some(pattern.parse(&name)?.0));
        numbers.collect::<Vec<_>>()
    });
    let without_color: BTreeSet<u64> = numbers.filter(|number| !with_color.contains(number)).collect();
    LeftOut::list([
        (unreadable, format!("with names that are not UTF-8 in {}", color_folder.display())),
        (without_color.len(), "without a colour image".to_owned()),
    ])
}

/// Returns the coverage of frames whose poses are files in `folder`, named like them.
pub(crate) fn pose_coverage(frames: &[NumberedFile], folder: &Path, pattern: NamePattern) -> PoseCoverage {
    let stems = names_in(folder).into_iter().filter_map(|name| Some(pattern.parse(&name)?.1));
    let with_pose: BTreeSet<String> = stems.collect();
    let missing = frames.iter().filter(|frame| !with_pose.contains(&frame.stem)).count();
    if missing == frames.len() {
        return PoseCoverage::NONE;
    }
    PoseCoverage::new(frames.len(), [(missing, "without a pose file".to_owned())])
}

/// Lists the files of a folder whose names match, one per stem, sorted by number.
pub(crate) fn numbered_files(folder: &Path, pattern: NamePattern) -> Result<Vec<NumberedFile>, DatasetError> {
    // Read here only for the error: an unreadable folder must not look like an empty one.
    std::fs::read_dir(folder).map_err(|source| DatasetError::Io { path: folder.to_owned(), source })?;
    let mut found: Vec<(u64, String, usize, String)> = names_in(folder)
        .into_iter()
        .filter_map(|name| pattern.parse(&name).map(|(number, stem, rank)| (number, stem, rank, name)))
        .collect();
    found.sort();
    found.dedup_by(|later, earlier| later.1 == earlier.1);
    Ok(found
        .into_iter()
        .map(|(number, stem, _, name)| NumberedFile { number, stem, path: folder.join(name) })
        .collect())
}

/// Returns true if a name matches the pattern.
pub(crate) fn fits(name: &str, pattern: NamePattern) -> bool {
    pattern.parse(name).is_some()
}

/// Returns the last component of a path, as a scene's name.
pub(crate) fn folder_name(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    full.file_name().map_or_else(|| "scene".to_owned(), |name| name.to_string_lossy().into_owned())
}

//! Folders with numbered files.

use crate::DatasetError;
use std::path::{Path, PathBuf};

/// A file that carries its frame's number.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct NumberedFile {
    pub(crate) number: u64,
    /// The name without what follows the number, e.g. `frame-000150` or `42`.
    pub(crate) stem: String,
    pub(crate) path: PathBuf,
}

/// What the names of a folder's frames look like: `<prefix><number><one of suffixes>`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NamePattern {
    pub(crate) prefix: &'static str,
    /// Where several files of a frame exist, the first suffix wins.
    pub(crate) suffixes: &'static [&'static str],
}

impl NamePattern {
    /// The number and stem of a file name that fits, and the position of its suffix in the list.
    fn parse(&self, name: &str) -> Option<(u64, String, usize)> {
        let rest = name.strip_prefix(self.prefix)?;
        let (rank, digits) =
            self.suffixes.iter().enumerate().find_map(|(rank, suffix)| Some((rank, rest.strip_suffix(suffix)?)))?;
        let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
        is_number.then(|| Some((digits.parse().ok()?, format!("{}{digits}", self.prefix), rank)))?
    }
}

/// The names in a folder that are text, sorted; empty if it cannot be read.
pub(crate) fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .collect();
    names.sort();
    names
}

/// The files of a folder whose names fit, one for each stem, sorted by number.
pub(crate) fn numbered_files(folder: &Path, pattern: NamePattern) -> Result<Vec<NumberedFile>, DatasetError> {
    // Read here for its error: an unreadable folder must not look like an empty one.
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

/// Whether a name fits the pattern.
pub(crate) fn fits(name: &str, pattern: NamePattern) -> bool {
    pattern.parse(name).is_some()
}

/// The last part of a path, as a scene's name.
pub(crate) fn folder_name(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    full.file_name().map_or_else(|| "scene".to_owned(), |name| name.to_string_lossy().into_owned())
}

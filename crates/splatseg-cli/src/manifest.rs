//! The list of the files that a run wrote.
//!
//! The first line of `manifest.jsonl` describes the program. Each further line is a JSON string with the path of a file
//! inside the folder. A file is listed before it is moved into place, so the list also covers the files of a killed run.
//! `--overwrite` removes the listed files and no others.

use super::Failure;
use serde::{Deserialize, Serialize};
use splatseg_files::{remove_leftovers, write_atomically};
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Result, Write};
use std::path::{Path, PathBuf};

/// Name of the list.
pub const MANIFEST: &str = "manifest.jsonl";
/// Name of the file that describes the run.
pub const SUMMARY: &str = "summary.json";
/// Folders with a file for each frame, and the extension of their files.
pub const RESULT_FOLDERS: [(&str, &str); 2] = [("segments", "png"), ("overlay", "jpg")];
/// Folders with further results, and the extension of their files.
pub const EXTRA_FOLDERS: [(&str, &str); 3] = [("objects", "jpg"), ("pictures", "jpg"), ("viewer", "js")];
/// Results beside these folders.
pub const RESULT_FILES: [&str; 6] = [SUMMARY, "objects.json", "objects.csv", "changes.json", "poses.txt", "index.html"];

/// Largest part of a list that is read, bytes. The list of a real run is shorter.
const MAX_BYTES: u64 = 1 << 30;

/// First line of the list.
#[derive(Serialize, Deserialize)]
struct Header {
    /// Version of the program.
    splatseg: String,
}

/// Writer of the list.
#[derive(Debug)]
pub struct Manifest {
    file: File,
    listed: BTreeSet<String>,
}

impl Manifest {
    /// Starts a new list in a folder, replacing any earlier one.
    pub fn start(folder: &Path) -> Result<Self> {
        Self::with(folder, BTreeSet::new())
    }

    /// Continues the list of a folder, in which these files are listed. It is written again without repetitions and without
    /// the line that a killed process has left incomplete.
    pub fn resume(folder: &Path, listed: &BTreeSet<String>) -> Result<Self> {
        Self::with(folder, listed.clone())
    }

    fn with(folder: &Path, listed: BTreeSet<String>) -> Result<Self> {
        let path = folder.join(MANIFEST);
        let header = Header { splatseg: env!("CARGO_PKG_VERSION").to_owned() };
        let text = format!("{}\n{}", serde_json::to_string(&header)?, lines(listed.iter())?);
        remove_leftovers(&path);
        write_atomically(&path, text.as_bytes())?;
        Ok(Self { file: OpenOptions::new().append(true).open(path)?, listed })
    }

    /// Lists files, those that are not listed yet. They may be moved into place only after this.
    pub fn add(&mut self, files: &[&str]) -> Result<()> {
        let is_new = |file: &&&str| !self.listed.contains(**file);
        let new: Vec<String> = files.iter().filter(is_new).map(|file| (*file).to_owned()).collect();
        self.file.write_all(lines(new.iter())?.as_bytes())?;
        self.listed.extend(new);
        Ok(())
    }
}

/// A line for each file.
fn lines<'a>(files: impl Iterator<Item = &'a String>) -> Result<String> {
    let mut lines = String::new();
    for file in files {
        lines += &serde_json::to_string(file)?;
        lines.push('\n');
    }
    Ok(lines)
}

/// Returns the files that a folder's manifest lists, or none if there is no manifest. Lines that are not paths of results,
/// e.g. paths outside the folder, are ignored.
pub fn listed_files(folder: &Path) -> std::result::Result<BTreeSet<String>, Failure> {
    listed(folder, is_result)
}

/// Returns the files that a folder's manifest lists and for which `is_ours` returns true.
pub fn listed(folder: &Path, is_ours: fn(&str) -> bool) -> std::result::Result<BTreeSet<String>, Failure> {
    let path = folder.join(MANIFEST);
    let wrong = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
    match std::fs::symlink_metadata(&path) {
        Ok(metadata) if metadata.is_file() => {}
        Ok(_) => return Err(wrong(&"not a file: move it away, or choose another --out")),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(BTreeSet::new()),
        Err(error) => return Err(wrong(&error)),
    }
    let file = File::open(&path).map_err(|error| wrong(&error))?;
    let mut lines = BufReader::new(file.take(MAX_BYTES)).lines();
    let header = lines.next().transpose().map_err(|error| wrong(&error))?.unwrap_or_default();
    if serde_json::from_str::<Header>(&header).is_err() {
        return Err(wrong(&"not a list of splatseg results: move it away, or choose another --out"));
    }
    let mut files = BTreeSet::new();
    for line in lines {
        let line = line.map_err(|error| wrong(&error))?;
        files.extend(serde_json::from_str(&line).ok().filter(|file: &String| is_ours(file)));
    }
    Ok(files)
}

/// Returns true if a run may have written a file with this path.
fn is_result(path: &str) -> bool {
    let in_folder = |(folder, file): (&str, &str)| {
        let mut folders = RESULT_FOLDERS.into_iter().chain(EXTRA_FOLDERS);
        let extension = folders.find(|(name, _)| *name == folder).map(|(_, extension)| extension);
        let named = |extension| Path::new(file).extension().is_some_and(|found| found == extension);
        !file.contains(['/', '\\', '\0']) && extension.is_some_and(named)
    };
    RESULT_FILES.contains(&path) || path.split_once('/').is_some_and(in_folder)
}

/// Returns the path of a listed file.
pub fn place(folder: &Path, file: &str) -> PathBuf {
    file.split('/').fold(folder.to_owned(), |path, part| path.join(part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_results_in_the_folder_count_as_listed() {
        let folder = tempfile::tempdir().unwrap();
        assert!(listed_files(folder.path()).unwrap().is_empty());
        let mut manifest = Manifest::start(folder.path()).unwrap();
        manifest.add(&["segments/0.png", "overlay/a b\n.jpg"]).unwrap();
        manifest.add(&["../a.png", "segments/../../a.png", "segments/notes.txt", "/etc/passwd", "notes.png"]).unwrap();
        manifest.add(&["segments/..", "segments/.png", "overlay/0.png", "summary.json"]).unwrap();
        // A process may be killed in the middle of a line.
        manifest.file.write_all(b"\"segments/1.pn").unwrap();
        let listed: Vec<String> = listed_files(folder.path()).unwrap().into_iter().collect();
        assert_eq!(listed, ["overlay/a b\n.jpg", "segments/0.png", "summary.json"]);
    }

    #[test]
    fn a_resumed_list_has_each_file_once_and_no_part_of_a_line() {
        let folder = tempfile::tempdir().unwrap();
        let mut manifest = Manifest::start(folder.path()).unwrap();
        manifest.add(&["segments/0.png", "segments/1.png"]).unwrap();
        manifest.add(&["segments/1.png", "index.html"]).unwrap();
        manifest.file.write_all(b"\"segments/2.pn").unwrap();
        drop(manifest);
        let mut manifest = Manifest::resume(folder.path(), &listed_files(folder.path()).unwrap()).unwrap();
        manifest.add(&["segments/1.png", "segments/2.png"]).unwrap();
        let text = std::fs::read_to_string(folder.path().join(MANIFEST)).unwrap();
        let lines: Vec<&str> = text.lines().skip(1).collect();
        assert_eq!(lines, ["\"index.html\"", "\"segments/0.png\"", "\"segments/1.png\"", "\"segments/2.png\""]);
    }

    #[test]
    fn other_files_of_that_name_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(MANIFEST), "{\"mine\": 1}\n\"summary.json\"\n").unwrap();
        let error = listed_files(folder.path()).unwrap_err().to_string();
        assert!(error.contains("manifest.jsonl: not a list of splatseg results"), "{error}");
    }
}

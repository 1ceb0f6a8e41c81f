//! Scenes stored in a single file, or in a folder with one.

use crate::DatasetError;
use crate::listing::all_names_in;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A type of recording file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RecordingFile {
    /// File extension.
    pub(crate) extension: &'static str,
    /// Expected content of a folder, for messages.
    pub(crate) expected: &'static str,
}

impl RecordingFile {
    /// Returns true if a path is a recording or a folder containing some.
    pub(crate) fn looks_like(&self, path: &Path) -> bool {
        if path.is_dir() { !self.recordings(path).is_empty() } else { self.is_recording(path) }
    }

    /// Finds the recording at a path: the file itself, or the only one in the folder.
    ///
    /// # Errors
    /// If the folder contains no recording, or several.
    pub(crate) fn find(&self, path: &Path) -> Result<PathBuf, DatasetError> {
        if !path.is_dir() {
            return Ok(path.to_owned());
        }
        let sequences = self.recordings(path);
        match sequences.as_slice() {
            [] => Err(DatasetError::NoFrames { path: path.to_owned(), expected: self.expected }),
            [only] => Ok(path.join(only)),
            _ => Err(DatasetError::SeveralSequences {
                path: path.to_owned(),
                sequences: sequences.iter().map(|name| name.to_string_lossy().into_owned()).collect(),
            }),
        }
    }

    fn is_recording(&self, path: &Path) -> bool {
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(self.extension))
    }

    fn recordings(&self, folder: &Path) -> Vec<OsString> {
        all_names_in(folder)
            .into_iter()
            .filter(|name| self.is_recording(Path::new(name)) && folder.join(name).is_file())
            .collect()
    }
}

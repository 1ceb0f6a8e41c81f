//! Scenes that are a single file, or a folder with one.

use crate::DatasetError;
use crate::listing::all_names_in;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A kind of recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RecordingFile {
    /// The extension of its files.
    pub(crate) extension: &'static str,
    /// What a folder should hold, for messages.
    pub(crate) expected: &'static str,
}

impl RecordingFile {
    /// Whether a path is a recording, or a folder that holds some.
    pub(crate) fn looks_like(&self, path: &Path) -> bool {
        if path.is_dir() { !self.recordings(path).is_empty() } else { self.is_recording(path) }
    }

    /// The recording at a path: the file itself, or the only one in the folder.
    ///
    /// # Errors
    /// If the folder holds none, or several.
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

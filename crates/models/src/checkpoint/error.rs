//! Errors of checkpoints.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// Maximum number of characters from a file in an error message.
const SHOWN_CHARS: usize = 80;

/// Errors reading, converting or using a checkpoint. Each message is one line and contains the path.
#[derive(Debug, Error)]
pub enum CheckpointError {
    /// An I/O error.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Action that failed, e.g. "open".
        action: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// The file is not a checkpoint.
    #[error("{}: {found}, expected a checkpoint (.pt of PyTorch 1.6 or later, .safetensors)", path.display())]
    NotACheckpoint {
        /// The file.
        path: PathBuf,
        /// The kind of file, or its first bytes.
        found: String,
    },
    /// A part of the file is damaged or malformed.
    #[error("{}: {part}: found {found}, expected {expected}", path.display())]
    Part {
        /// The file.
        path: PathBuf,
        /// The part: an entry of the archive, a byte of the pickle, a field.
        part: String,
        /// Actual contents.
        found: String,
        /// Expected contents.
        expected: String,
    },
    /// A tensor is missing, has another shape or type, or its description does not match its data.
    #[error("{}: tensor {tensor}: found {found}, expected {expected}", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// Actual contents.
        found: String,
        /// Expected contents.
        expected: String,
    },
    /// The output file already exists.
    #[error("{}: already exists and is not overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
}

/// An error without the path, which [`Fault::at`] adds.
#[derive(Debug)]
pub(super) struct Fault {
    /// The part or tensor.
    pub subject: Subject,
    pub found: String,
    pub expected: String,
}

/// Subject of a fault.
#[derive(Debug)]
pub(super) enum Subject {
    Part(String),
    Tensor(String),
}

impl Fault {
    pub fn part(part: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { subject: Subject::Part(part.into()), found: found.into(), expected: expected.into() }
    }

    pub fn tensor(name: &str, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { subject: Subject::Tensor(name.to_owned()), found: found.into(), expected: expected.into() }
    }

    pub fn at(self, path: &Path) -> CheckpointError {
        let (path, found, expected) = (path.to_owned(), printable(&self.found), self.expected);
        match self.subject {
            Subject::Part(part) => CheckpointError::Part { path, part: printable(&part), found, expected },
            Subject::Tensor(tensor) => CheckpointError::Tensor { path, tensor: printable(&tensor), found, expected },
        }
    }
}

impl CheckpointError {
    /// For `map_err`: converts an I/O error at `path`.
    pub(super) fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), action, source }
    }
}

/// Makes text from a file safe to print: one line of at most 80 characters. Control characters, invisible characters
/// and characters that change the writing direction are escaped as in Rust strings, e.g. `\u{1b}`.
pub fn printable(text: &str) -> String {
    let is_hidden = |character: char| {
        character.is_control()
            || matches!(character, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
    };
    let mut characters = text.chars();
    let mut short = String::new();
    for character in characters.by_ref().take(SHOWN_CHARS) {
        if is_hidden(character) {
            short.extend(character.escape_default());
        } else {
            short.push(character);
        }
    }
    if characters.next().is_some() {
        short.push('…');
    }
    short
}

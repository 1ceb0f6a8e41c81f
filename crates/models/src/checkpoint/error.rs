//! What can be wrong with a checkpoint.

use std::path::{Path, PathBuf};
use thiserror::Error;

/// How much of a text from a file an error shows.
const SHOWN_CHARS: usize = 80;

/// A checkpoint that cannot be read, converted or used; each message is one line that names the file.
#[derive(Debug, Error)]
pub enum CheckpointError {
    /// The file system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done.
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// A file of another kind.
    #[error("{}: {found}, expected a checkpoint (.pt of PyTorch 1.6 or later, .safetensors)", path.display())]
    NotACheckpoint {
        /// The file.
        path: PathBuf,
        /// What it is, or how it begins.
        found: String,
    },
    /// A part of the file is damaged, or not as such files are.
    #[error("{}: {part}: found {found}, expected {expected}", path.display())]
    Part {
        /// The file.
        path: PathBuf,
        /// The part: an entry of the archive, a byte of the pickle, a field.
        part: String,
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// A tensor is missing, has another shape or type, or lies about its data.
    #[error("{}: tensor {tensor}: found {found}, expected {expected}", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// The tensor's name.
        tensor: String,
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// A converted file would replace another.
    #[error("{}: exists already, and is not overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
}

/// What is wrong, before it is known in which file.
#[derive(Debug)]
pub(super) struct Fault {
    /// The part or tensor.
    pub subject: Subject,
    pub found: String,
    pub expected: String,
}

/// What a fault is about.
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
    /// For `map_err`: an error of the file system at `path`.
    pub(super) fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), action, source }
    }
}

/// A text from a file for people: on one line and at most 80 characters long. Control characters, and characters that
/// change the direction of writing or are invisible, are written as Rust writes them in a string, like `\u{1b}`.
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

//! The labels that objects can get, with other words for each.

use splatseg_files::{read_file, text_of};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

static BUILT_IN: &str = include_str!("vocabulary.txt");

/// Maximum size of a file, bytes, and of what is in it.
const MAX_BYTES: u64 = 1 << 20;
const MAX_LABELS: usize = 10_000;
const MAX_WORDS: usize = 32;
const MAX_WORD_BYTES: usize = 200;

/// A vocabulary that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VocabularyError {
    /// The file cannot be read.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error.
        source: io::Error,
    },
    /// A line cannot be used.
    #[error("{}, line {line}: found {found}, expected {expected}", .path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The value found.
        found: String,
        /// The values allowed.
        expected: String,
    },
    /// The file has no labels, or too many.
    #[error("{}: found {found} labels, expected 1 to {MAX_LABELS}", .path.display())]
    Size {
        /// The file.
        path: PathBuf,
        /// Number of labels.
        found: usize,
    },
}

/// Labels, with other words for each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Vocabulary {
    /// The words of each label; the first is the label itself.
    words: Vec<Vec<String>>,
}

impl Vocabulary {
    /// The built-in vocabulary: about 670 things of homes, offices and workshops.
    pub fn built_in() -> Self {
        Self { words: BUILT_IN.lines().filter_map(words_of).collect() }
    }

    /// Reads a file: one label in each line, then other words for it, with commas between, as in a CSV file. Lines that
    /// begin with `#` are comments. Of a label that occurs twice, the words are joined.
    ///
    /// # Errors
    /// [`VocabularyError`]: the file cannot be read or is too large, or a line is too long.
    pub fn read(path: &Path) -> Result<Self, VocabularyError> {
        let io = |source| VocabularyError::Io { path: path.to_owned(), source };
        let bytes = read_file(path, MAX_BYTES).map_err(io)?;
        let text = text_of(bytes).map_err(|error| io(io::Error::new(io::ErrorKind::InvalidData, error)))?;
        Self::parse(text.lines(), path)
    }

    fn parse<'t>(lines: impl Iterator<Item = &'t str>, path: &Path) -> Result<Self, VocabularyError> {
        let mut words: Vec<Vec<String>> = Vec::new();
        for (index, line) in lines.enumerate() {
            let Some(found) = words_of(line) else { continue };
            check(&found).map_err(|(found, expected)| VocabularyError::Line {
                path: path.to_owned(),
                line: index + 1,
                found,
                expected,
            })?;
            match words.iter_mut().find(|known| known[0] == found[0]) {
                Some(known) => known.extend(found.into_iter().skip(1)),
                None => words.push(found),
            }
            if words.len() > MAX_LABELS {
                break;
            }
        }
        match words.len() {
            1..=MAX_LABELS => Ok(Self { words }),
            found => Err(VocabularyError::Size { path: path.to_owned(), found }),
        }
    }

    /// A vocabulary of these lines: each has a label, then other words for it, with commas between.
    ///
    /// # Errors
    /// [`VocabularyError`]: there are no lines or too many, or one is too long.
    pub fn of(lines: impl IntoIterator<Item = String>) -> Result<Self, VocabularyError> {
        let lines: Vec<String> = lines.into_iter().collect();
        Self::parse(lines.iter().map(String::as_str), Path::new("vocabulary"))
    }

    /// Number of labels.
    pub fn len(&self) -> usize {
        self.words.len()
    }

    /// Never true: a vocabulary has at least one label.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The labels.
    pub fn labels(&self) -> impl Iterator<Item = &str> {
        self.words.iter().map(|words| words[0].as_str())
    }

    /// The words of each label, the label first.
    pub fn words(&self) -> impl Iterator<Item = &[String]> {
        self.words.iter().map(Vec::as_slice)
    }

    /// Labels for which a word stands: that label itself, or those that have it among their other words.
    pub fn labels_of(&self, word: &str) -> impl Iterator<Item = &str> {
        let word = word.to_lowercase();
        let has = move |words: &&Vec<String>| words.iter().any(|other| other.to_lowercase() == word);
        self.words.iter().filter(has).map(|words| words[0].as_str())
    }
}

/// The words of a line; `None` for one without any.
fn words_of(line: &str) -> Option<Vec<String>> {
    let line = line.trim();
    if line.starts_with('#') {
        return None;
    }
    let cells = line.split([',', ';', '\t']).map(|cell| cell.trim().trim_matches('"').trim());
    let words: Vec<String> = cells.filter(|cell| !cell.is_empty()).map(str::to_owned).collect();
    (!words.is_empty()).then_some(words)
}

/// A problem with words: the value found, and the values allowed.
fn check(words: &[String]) -> Result<(), (String, String)> {
    if words.len() > MAX_WORDS {
        return Err((format!("{} words", words.len()), format!("at most {MAX_WORDS}")));
    }
    let long = words.iter().find(|word| word.len() > MAX_WORD_BYTES);
    if let Some(long) = long {
        return Err((format!("a word of {} bytes", long.len()), format!("at most {MAX_WORD_BYTES}")));
    }
    match words.iter().find(|word| word.chars().any(char::is_control)) {
        Some(word) => Err((format!("{word:?}"), "no control characters".to_owned())),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_built_in_labels_are_many_and_differ() {
        let vocabulary = Vocabulary::built_in();
        assert!(vocabulary.len() > 500);
        let words: Vec<&String> = vocabulary.words().flatten().collect();
        assert_eq!(words.iter().collect::<BTreeSet<_>>().len(), words.len());
        assert!(vocabulary.words().all(|words| check(words).is_ok()));
        assert_eq!(vocabulary.labels_of("Coffee Cup").collect::<Vec<_>>(), ["mug"]);
    }

    #[test]
    fn files_are_text_or_csv() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("things.csv");
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Vocabulary::read(&path)
        };
        let vocabulary = read(b"\xef\xbb\xbf# mine\nmug, cup\r\n\n\"tea pot\";pot\nmug,beaker\n").unwrap();
        assert_eq!(vocabulary.labels().collect::<Vec<_>>(), ["mug", "tea pot"]);
        assert_eq!(vocabulary.labels_of("beaker").count(), 1);
        let message = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
        assert!(message(b"# nothing\n").ends_with("found 0 labels, expected 1 to 10000"));
        assert!(message(format!("mug\n{}", "x".repeat(300)).as_bytes()).contains("line 2: found a word of 300 bytes"));
        assert!(message(b"mug\x1b").contains("control characters"));
        assert!(message("a,".repeat(40).as_bytes()).contains("found 40 words"));
        assert!(read(b"\xff\xfe\xff").is_err());
    }
}

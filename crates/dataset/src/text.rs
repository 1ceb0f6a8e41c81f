//! Text files: numbers, such as camera poses and intrinsics, and JSON.

use crate::DatasetError;
use crate::files::read_file;
use crate::plausibility::warn_once;
use crate::recorded_poses::tracked;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer};
use splatseg_files::{TextError, has_decimal_commas, is_number_with_comma, text_of, utf8_bytes};
use splatseg_geometry::{Intrinsics, Pose};
use std::path::{Path, PathBuf};

/// Larger files are not matrices.
const MAX_TEXT_BYTES: u64 = 64 << 10;

/// Reads a 4x4 camera-to-world matrix, 16 numbers row by row. Returns `None` if there is no such file, or tracking was
/// lost.
pub(crate) fn read_pose(path: &Path) -> Result<Option<Pose>, DatasetError> {
    let what = "camera pose";
    let numbers = match read_numbers(path, what) {
        Err(DatasetError::MissingFile { .. }) => return Ok(None),
        numbers => numbers?,
    };
    let matrix: [f64; 16] = numbers.as_slice().try_into().map_err(|_| DatasetError::Text {
        path: path.to_owned(),
        what,
        found: format!("{} numbers", numbers.len()),
        expected: "16, a 4x4 matrix",
    })?;
    tracked(Pose::from_row_major(matrix), || path.to_owned())
}

/// The four numbers of a pinhole camera, without an image size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PinholeMatrix {
    pub(crate) fx: f32,
    pub(crate) fy: f32,
    pub(crate) cx: f32,
    pub(crate) cy: f32,
}

impl PinholeMatrix {
    /// Reads a 3x3 or 4x4 camera matrix, row by row.
    pub(crate) fn read(path: &Path) -> Result<Self, DatasetError> {
        let what = "camera intrinsics file";
        Self::from_numbers(&read_numbers(path, what)?, path, what)
    }

    /// Parses a 3x3 or 4x4 camera matrix, row by row. `path` and `what` are named in errors.
    pub(crate) fn from_numbers(numbers: &[f64], path: &Path, what: &'static str) -> Result<Self, DatasetError> {
        let wrong = |found: String, expected| DatasetError::Text { path: path.to_owned(), what, found, expected };
        let columns = match numbers.len() {
            9 => 3,
            16 => 4,
            other => return Err(wrong(format!("{other} numbers"), "9 or 16, a 3x3 or 4x4 matrix")),
        };
        let at = |row: usize, column: usize| numbers[row * columns + column];
        let last_row = [at(2, 0), at(2, 1), at(2, 2)];
        if last_row != [0.0, 0.0, 1.0] || at(1, 0) != 0.0 {
            return Err(wrong(
                format!("{} in row 2, column 1 and {last_row:?} as row 3", at(1, 0)),
                "rows fx 0 cx, 0 fy cy, 0 0 1",
            ));
        }
        if at(0, 1) != 0.0 {
            warn_once(format!(
                "{}: {what}: the skew of {} in row 1, column 2 is ignored: the image's axes are assumed to be perpendicular",
                path.display(),
                at(0, 1)
            ));
        }
        let [fx, fy, cx, cy] = [at(0, 0), at(1, 1), at(0, 2), at(1, 2)].map(|number| number as f32);
        let matrix = Self { fx, fy, cx, cy };
        // The size is checked once the image is known.
        matrix.for_size((1, 1), path)?;
        Ok(matrix)
    }

    /// Returns the intrinsics for an image of `size` `(width, height)`. `path` is named in errors.
    pub(crate) fn for_size(&self, size: (usize, usize), path: &Path) -> Result<Intrinsics, DatasetError> {
        Intrinsics { fx: self.fx, fy: self.fy, cx: self.cx, cy: self.cy, width: size.0, height: size.1 }
            .validated()
            .map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })
    }
}

fn read_numbers(path: &Path, what: &'static str) -> Result<Vec<f64>, DatasetError> {
    let expected = "numbers separated by spaces";
    let wrong = |found: String| DatasetError::Text { path: path.to_owned(), what, found, expected };
    read_text_with_numbers(path, what, MAX_TEXT_BYTES)?
        .split_whitespace()
        .map(|word| word.parse().map_err(|_| wrong(shortened(word))))
        .collect()
}

/// Reads a text file with numbers, of at most `limit` bytes. `what` names its content in errors.
///
/// # Errors
/// Also if the numbers have decimal commas, since commas may separate numbers.
pub(crate) fn read_text_with_numbers(path: &Path, what: &'static str, limit: u64) -> Result<String, DatasetError> {
    let text = text_of(read_file(path, what, limit)?).map_err(|error| not_text(path, what, error))?;
    text.lines().enumerate().try_for_each(|(index, line)| require_decimal_points(path, index, line))?;
    Ok(text)
}

/// Reads a file of at most `limit` bytes as UTF-8, which lines may violate. `what` names its content in errors.
pub(crate) fn read_lines_of_text(path: &Path, what: &'static str, limit: u64) -> Result<Vec<u8>, DatasetError> {
    utf8_bytes(read_file(path, what, limit)?).map_err(|error| not_text(path, what, error))
}

/// Reads a JSON file of at most `limit` bytes. `what` names its content in errors.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, what: &'static str, limit: u64) -> Result<T, DatasetError> {
    let text = text_of(read_file(path, what, limit)?).map_err(|error| not_text(path, what, error))?;
    parse_json(path, &text)
}

/// Parses the text of a JSON file.
pub(crate) fn parse_json<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, DatasetError> {
    serde_json::from_str(text).map_err(|source| {
        let index = source.line().saturating_sub(1);
        let line = text.lines().nth(index).unwrap_or_default();
        let is_separator = |letter: char| letter.is_whitespace() || "{}[]:".contains(letter);
        let mut words = line.split(is_separator).map(|word| word.trim_end_matches(','));
        match source.is_syntax() && words.any(is_number_with_comma) {
            true => decimal_commas(path, index, line),
            false => DatasetError::Json { path: path_of_value(path, text, &source), source },
        }
    })
}

/// Reads a list; `null` is an empty one, as some programs write it.
pub(crate) fn none_if_null<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or_default())
}

/// Returns the place of a wrong value in a JSON text: the file, and the last key before the value. A whole file may be one
/// line.
fn path_of_value(path: &Path, text: &str, error: &serde_json::Error) -> PathBuf {
    let line_start = text.split_inclusive('\n').take(error.line().saturating_sub(1)).map(str::len).sum::<usize>();
    let end = text.floor_char_boundary(line_start.saturating_add(error.column()));
    let key_before = |(colon, _): (usize, &str)| {
        let name = text[..colon].trim_end().strip_suffix('"')?;
        name.rfind('"').map(|quote| shortened(&name[quote + 1..]))
    };
    // A field that is missing is named by the error.
    let is_of_value = error.is_data() && !error.to_string().starts_with("missing field");
    let key = text[..end].rmatch_indices(':').find_map(key_before).filter(|_| is_of_value);
    key.map_or_else(|| path.to_owned(), |key| format!("{}: at {key}", path.display()).into())
}

/// Refuses a line with decimal commas. `index` is its number from 0.
pub(crate) fn require_decimal_points(path: &Path, index: usize, line: &str) -> Result<(), DatasetError> {
    let is_comment = || line.trim_start().starts_with('#');
    if has_decimal_commas(line) && !is_comment() { Err(decimal_commas(path, index, line)) } else { Ok(()) }
}

fn decimal_commas(path: &Path, index: usize, line: &str) -> DatasetError {
    DatasetError::Field {
        path: path.to_owned(),
        field: format!("line {}", index + 1),
        found: format!("decimal commas in {}", shortened(line.trim())),
        expected: "decimal points".to_owned(),
    }
}

/// Returns the error for a file that is not text. `what` names its content.
pub(crate) fn not_text(path: &Path, what: &'static str, error: TextError) -> DatasetError {
    DatasetError::Text { path: path.to_owned(), what, found: error.to_string(), expected: "UTF-8" }
}

/// Returns the beginning of a text, in quotes, for messages.
pub(crate) fn shortened(text: &str) -> String {
    format!("{:?}", text.chars().take(40).collect::<String>())
}

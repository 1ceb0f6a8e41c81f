//! JSON files with COCO annotations.

use super::check_size;
use crate::SegmenterError;
use serde::Deserialize;
use serde_json::Value;
use splatseg_geometry::{RunLengths, ScoredMask};
use std::io::Read as _;
use std::path::Path;

/// Largest annotation file that is read into memory.
const MAX_BYTES: u64 = 1 << 28;

/// The parts of a COCO annotation that are used.
#[derive(Deserialize)]
struct Annotation {
    segmentation: Value,
    #[serde(default = "certain")]
    score: f32,
}

fn certain() -> f32 {
    1.0
}

/// Reads the masks and scores of a file, in the file's order.
pub(super) fn read(path: &Path) -> Result<Vec<ScoredMask>, SegmenterError> {
    let read_error = |source| SegmenterError::Read { path: path.to_owned(), source };
    let mut text = Vec::new();
    let file = std::fs::File::open(path).map_err(read_error)?;
    let length = file.take(MAX_BYTES + 1).read_to_end(&mut text).map_err(read_error)?;
    let place = Place { path };
    if length as u64 > MAX_BYTES {
        return Err(place.wrong("file", "more than 256 MiB", "at most 256 MiB of JSON"));
    }
    let mut document: Value =
        serde_json::from_slice(&text).map_err(|error| place.wrong("file", error.to_string(), "JSON"))?;
    let list = match document.get_mut("annotations") {
        Some(list) => list.take(),
        None => document,
    };
    let Value::Array(list) = list else {
        return Err(place.wrong("file", kind(&list), "a list of annotations, or an object with the key annotations"));
    };
    list.into_iter().enumerate().map(|(index, value)| place.annotation(index, value)).collect()
}

/// The file that is being read, for error messages.
struct Place<'a> {
    path: &'a Path,
}

impl Place<'_> {
    fn wrong(&self, field: impl Into<String>, found: impl Into<String>, expected: &'static str) -> SegmenterError {
        SegmenterError::Annotation { path: self.path.to_owned(), field: field.into(), found: found.into(), expected }
    }

    fn annotation(&self, index: usize, value: Value) -> Result<ScoredMask, SegmenterError> {
        let field = |name: &str| format!("annotation {index}{name}");
        let annotation: Annotation = serde_json::from_value(value).map_err(|error| {
            self.wrong(
                field(""),
                error.to_string(),
                "an object with the key segmentation and, if any, a number as score",
            )
        })?;
        let score = annotation.score;
        if !(0.0..=1.0).contains(&score) {
            return Err(self.wrong(field(", score"), score.to_string(), "a number from 0 to 1"));
        }
        let Some([height, width]) = annotation.segmentation.get("size").and_then(pair) else {
            let found = annotation.segmentation.get("size").unwrap_or(&annotation.segmentation);
            return Err(self.wrong(
                field(", segmentation"),
                kind(found),
                "an RLE object with size [height, width] and counts (polygons are not read)",
            ));
        };
        check_size(self.path, (width, height))?;
        let rle_error = |source| SegmenterError::Rle { path: self.path.to_owned(), index, source };
        let runs = match annotation.segmentation.get("counts") {
            Some(Value::String(text)) => RunLengths::from_compressed(width, height, text).map_err(rle_error)?,
            Some(counts @ Value::Array(_)) => {
                let counts = Vec::<u32>::deserialize(counts)
                    .map_err(|error| self.wrong(field(", counts"), error.to_string(), "a list of run lengths"))?;
                RunLengths { width, height, counts }
            }
            other => {
                let found = other.map_or("nothing".to_owned(), kind);
                return Err(self.wrong(field(", counts"), found, "a compressed string or a list of run lengths"));
            }
        };
        Ok(ScoredMask { mask: runs.decode().map_err(rle_error)?, score })
    }
}

/// `[height, width]` as two whole numbers.
fn pair(value: &Value) -> Option<[usize; 2]> {
    <[usize; 2]>::deserialize(value).ok()
}

/// What a JSON value is, short enough for one line.
fn kind(value: &Value) -> String {
    match value {
        Value::Null => "null".to_owned(),
        Value::Bool(value) => value.to_string(),
        Value::Number(number) => number.to_string(),
        Value::String(_) => "a string".to_owned(),
        Value::Array(list) => format!("a list of {}", list.len()),
        Value::Object(_) => "an object".to_owned(),
    }
}

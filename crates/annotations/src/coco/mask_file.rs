//! Mask files: the COCO annotations of one frame.
//!
//! Annotations are processed one by one while the file is parsed, so they are never all in memory at once. The first
//! invalid one ends parsing.

use super::part::Part;
use super::segmentation::{Counts, Segmentation};
use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use splatseg_files::without_mark;
use splatseg_geometry::{RleError, RunLengths};
use std::borrow::Cow;
use std::fmt;
use thiserror::Error;

/// Expected content of a file, for error messages.
const LIST: &str = "a list of annotations, or an object with the key annotations";

/// A defect of a mask file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MaskFileError {
    /// The file is damaged or incomplete.
    #[error("{field}: found {found}, expected {expected}")]
    Field {
        /// Location in the file, e.g. `annotation 3, score`.
        field: String,
        /// The value found, or the parser's message.
        found: String,
        /// The expected value.
        expected: &'static str,
    },
    /// A run-length encoded mask is damaged.
    #[error("annotation {index}, segmentation: {source}")]
    Rle {
        /// Index of the annotation in its list, from 0.
        index: usize,
        /// The RLE error.
        source: RleError,
    },
    /// The file declares masks without pixels, or with too many.
    #[error("declares masks of {}x{} pixels, expected 1 to {limit} pixels in all", size.0, size.1)]
    ImpossibleSize {
        /// Declared size, `(width, height)`.
        size: (usize, usize),
        /// Maximum number of pixels.
        limit: usize,
    },
}

/// Callback for an annotation: its index in the list, its mask and its score.
type Take<'a, E> = &'a mut dyn FnMut(usize, &RunLengths, f32) -> Result<(), E>;

/// Reads the masks of one frame: a JSON list of COCO annotations, or an object with the list under the key `annotations`. Passes
/// each mask and its score in [0, 1], by default 1, to `take`, in the file's order, until `take` fails. Masks of more than
/// `max_pixels` pixels are refused. `wrap` converts a defect of the file.
///
/// # Errors
/// The first defect, or the error of `take`.
pub fn read_mask_file<E>(
    text: &[u8],
    max_pixels: usize,
    wrap: &dyn Fn(MaskFileError) -> E,
    take: Take<'_, E>,
) -> Result<(), E> {
    let mut list = List { max_pixels, wrap, take, next: None, failure: None };
    match list.parse(text) {
        _ if list.failure.is_some() => list.failure.map_or(Ok(()), Err),
        Ok(None) => Ok(()),
        Ok(Some(found)) => Err(wrap(wrong("file", found, LIST))),
        Err(error) if error.is_data() => Err(wrap(match list.next {
            Some(index) => wrong(format!("annotation {index}"), error.to_string(), "an annotation"),
            None => wrong("file", error.to_string(), LIST),
        })),
        Err(error) => Err(wrap(wrong("file", error.to_string(), "JSON"))),
    }
}

/// Parser of the list of annotations, or of the object that contains it.
struct List<'a, E> {
    max_pixels: usize,
    wrap: &'a dyn Fn(MaskFileError) -> E,
    take: Take<'a, E>,
    /// Index of the annotation being read; `None` outside the list.
    next: Option<usize>,
    /// Error of an annotation, as opposed to a parser error.
    failure: Option<E>,
}

impl<E> List<'_, E> {
    /// Parses a file. If it contains no list, returns a description of its content.
    fn parse(&mut self, text: &[u8]) -> Result<Option<String>, serde_json::Error> {
        let text = without_mark(text);
        let mut parser = serde_json::Deserializer::from_slice(text);
        let begins_list_or_object = matches!(text.trim_ascii_start().first(), Some(b'[' | b'{') | None);
        let found = if begins_list_or_object {
            let has_list = self.deserialize(&mut parser)?;
            (!has_list).then(|| "an object".to_owned())
        } else {
            let part: Part = serde::Deserialize::deserialize(&mut parser)?;
            Some(part.to_string())
        };
        parser.end().map(|()| found)
    }
}

impl<'de, E> DeserializeSeed<'de> for &mut List<'_, E> {
    /// True if a list was found.
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<bool, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de, E> Visitor<'de> for &mut List<'_, E> {
    type Value = bool;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut annotations: A) -> Result<bool, A::Error> {
        for index in 0.. {
            self.next = Some(index);
            let Some(annotation) = annotations.next_element::<Part>()? else { break };
            let read = read_annotation(index, annotation, self.max_pixels).map_err(self.wrap);
            if let Err(failure) = read.and_then(|(runs, score)| (self.take)(index, &runs, score)) {
                self.failure = Some(failure);
                return Err(A::Error::custom("this annotation cannot be used"));
            }
        }
        self.next = None;
        Ok(true)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<bool, A::Error> {
        let mut has_list = false;
        while let Some(key) = entries.next_key::<Cow<'de, str>>()? {
            if key == "annotations" && !has_list {
                has_list = entries.next_value_seed(&mut *self)?;
            } else {
                entries.next_value::<IgnoredAny>()?;
            }
        }
        Ok(has_list)
    }
}

fn wrong(field: impl Into<String>, found: impl Into<String>, expected: &'static str) -> MaskFileError {
    MaskFileError::Field { field: field.into(), found: found.into(), expected }
}

/// Returns the mask and score of an annotation. The run lengths are not yet checked against the mask's size.
fn read_annotation(index: usize, annotation: Part, max_pixels: usize) -> Result<(RunLengths, f32), MaskFileError> {
    let field = |name: &str| format!("annotation {index}{name}");
    let Part::Object(mut annotation) = annotation else {
        return Err(wrong(field(""), annotation.to_string(), "an object"));
    };
    let score = match annotation.score.take() {
        None => 1.0,
        Some(Part::Number(score)) if (0.0..=1.0).contains(&score) => score as f32,
        Some(other) => return Err(wrong(field(", score"), other.to_string(), "a number from 0 to 1")),
    };
    let segmentation = annotation.segmentation.take().ok_or_else(|| {
        wrong(field(", segmentation"), "nothing", "an RLE object with size [height, width] and counts")
    })?;
    let (size, counts) = match segmentation {
        Part::Object(mut fields) => (fields.size.take(), fields.counts.take()),
        other => (Some(other), None),
    };
    let Some((height, width)) = size.as_ref().and_then(Part::pair) else {
        let found = size.map_or_else(|| "nothing".to_owned(), |size| size.to_string());
        let expected = "an RLE object with size [height, width] and counts (polygons are not read)";
        return Err(wrong(field(", segmentation"), found, expected));
    };
    if width.checked_mul(height).is_none_or(|pixels| pixels == 0 || pixels > max_pixels) {
        return Err(MaskFileError::ImpossibleSize { size: (width, height), limit: max_pixels });
    }
    let counts = match counts {
        Some(Part::Text(text)) => Counts::Compressed(text),
        Some(Part::Counts(counts)) => Counts::Lengths(counts),
        other => {
            let found = other.map_or_else(|| "nothing".to_owned(), |other| other.to_string());
            return Err(wrong(field(", counts"), found, "a compressed string or a list of run lengths"));
        }
    };
    let runs = Segmentation { size: [height, width], counts }.into_runs();
    Ok((runs.map_err(|source| MaskFileError::Rle { index, source })?, score))
}

//! JSON files with COCO annotations.
//!
//! Annotations are handed on one by one while the file is parsed, so that memory is not taken for all of them at once,
//! and the first one that cannot be used ends it.

mod part;

use crate::SegmenterError;
use part::Part;
use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use splatseg_geometry::RunLengths;
use std::borrow::Cow;
use std::fmt;
use std::path::Path;

/// What a file has to hold.
const LIST: &str = "a list of annotations, or an object with the key annotations";

/// Takes an annotation: its place in the list, its mask and its score.
type Take<'a> = &'a mut dyn FnMut(usize, &RunLengths, f32) -> Result<(), SegmenterError>;

/// Passes the masks and scores in `text` to `take`, in the file's order, until it fails. `path` is for messages.
pub(super) fn read(path: &Path, text: &[u8], take: Take<'_>) -> Result<(), SegmenterError> {
    let place = Place { path };
    let mut list = List { place: &place, take, next: None, failure: None };
    match list.parse(text) {
        _ if list.failure.is_some() => list.failure.map_or(Ok(()), Err),
        Ok(None) => Ok(()),
        Ok(Some(found)) => Err(place.wrong("file", found, LIST)),
        Err(error) if error.is_data() => match list.next {
            Some(index) => Err(place.wrong(format!("annotation {index}"), error.to_string(), "an annotation")),
            None => Err(place.wrong("file", error.to_string(), LIST)),
        },
        Err(error) => Err(place.wrong("file", error.to_string(), "JSON")),
    }
}

/// The list of annotations, or the object that holds it.
struct List<'a> {
    place: &'a Place<'a>,
    take: Take<'a>,
    /// The annotation that is being read.
    next: Option<usize>,
    /// Why reading was given up, if it was not the parser that said so.
    failure: Option<SegmenterError>,
}

impl List<'_> {
    /// Parses a file. Returns what was found in place of a list.
    fn parse(&mut self, text: &[u8]) -> Result<Option<String>, serde_json::Error> {
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

impl<'de> DeserializeSeed<'de> for &mut List<'_> {
    /// Whether there is a list.
    type Value = bool;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<bool, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for &mut List<'_> {
    type Value = bool;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut annotations: A) -> Result<bool, A::Error> {
        for index in 0.. {
            self.next = Some(index);
            let Some(annotation) = annotations.next_element::<Part>()? else { break };
            let read = self.place.annotation(index, annotation);
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

/// The file that is being read, for error messages.
struct Place<'a> {
    path: &'a Path,
}

impl Place<'_> {
    fn wrong(&self, field: impl Into<String>, found: impl Into<String>, expected: &'static str) -> SegmenterError {
        SegmenterError::Annotation { path: self.path.to_owned(), field: field.into(), found: found.into(), expected }
    }

    /// The mask of an annotation, which may not fit its size, and its score.
    fn annotation(&self, index: usize, annotation: Part) -> Result<(RunLengths, f32), SegmenterError> {
        let field = |name: &str| format!("annotation {index}{name}");
        let Part::Object(mut annotation) = annotation else {
            return Err(self.wrong(field(""), annotation.to_string(), "an object"));
        };
        let score = match annotation.score.take() {
            None => 1.0,
            Some(Part::Number(score)) if (0.0..=1.0).contains(&score) => score as f32,
            Some(other) => return Err(self.wrong(field(", score"), other.to_string(), "a number from 0 to 1")),
        };
        let segmentation = annotation.segmentation.take().ok_or_else(|| {
            self.wrong(field(", segmentation"), "nothing", "an RLE object with size [height, width] and counts")
        })?;
        let (size, counts) = match segmentation {
            Part::Object(mut fields) => (fields.size.take(), fields.counts.take()),
            other => (Some(other), None),
        };
        let Some((height, width)) = size.as_ref().and_then(Part::pair) else {
            let found = size.map_or_else(|| "nothing".to_owned(), |size| size.to_string());
            let expected = "an RLE object with size [height, width] and counts (polygons are not read)";
            return Err(self.wrong(field(", segmentation"), found, expected));
        };
        super::check_size(self.path, (width, height))?;
        let runs = match counts {
            Some(Part::Text(text)) => RunLengths::from_compressed(width, height, &text)
                .map_err(|source| SegmenterError::Rle { path: self.path.to_owned(), index, source })?,
            Some(Part::Counts(counts)) => RunLengths { width, height, counts },
            other => {
                let found = other.map_or_else(|| "nothing".to_owned(), |other| other.to_string());
                return Err(self.wrong(field(", counts"), found, "a compressed string or a list of run lengths"));
            }
        };
        Ok((runs, score))
    }
}

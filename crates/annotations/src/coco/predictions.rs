//! Reads JSON files of run-length encoded masks: COCO annotations with frames and ids, or YouTube-VIS tracks.

use super::segmentation::{Counts, Segmentation};
use crate::{AnnotationError, PredictionChoice, SelectedFrames};
use serde::Deserialize;
use serde_json::Value;
use splatseg_files::{MemoryLimit, display_bytes, read_file, without_mark};
use splatseg_geometry::{RunLengths, SegmentId};
use std::collections::BTreeMap;
use std::path::Path;

/// Largest file that is read, bytes.
const MAX_BYTES: u64 = 1_000_000_000;

/// Upper bound for the memory of one parsed JSON value besides its text, bytes. Includes the spare capacity of lists.
const BYTES_PER_VALUE: u64 = 80;

/// Extensions that are stripped from image file names to get a frame's name.
const IMAGE_ENDINGS: [&str; 4] = [".jpg", ".jpeg", ".png", ".color"];

/// A mask as stored in the file.
#[derive(Clone, Debug)]
pub struct EncodedMask {
    /// The segment's id, above 0.
    pub id: SegmentId,
    /// Its pixels.
    pub runs: RunLengths,
}

/// Masks by frame name.
pub type MasksByFrame = BTreeMap<String, Vec<EncodedMask>>;

/// Reads a JSON file, within the limits on file size and memory.
pub fn read_document(path: &Path) -> Result<Value, AnnotationError> {
    let wrong = |text: String| AnnotationError::at(path, text);
    let text = read_file(path, MAX_BYTES).map_err(|error| wrong(error.to_string()))?;
    check_memory(&text, MemoryLimit::in_force()).map_err(wrong)?;
    serde_json::from_slice(without_mark(&text)).map_err(|error| wrong(format!("is not JSON: {error}")))
}

/// Reads the masks of a document, by frame name. A track lists one mask for each selected frame, in order.
pub fn read_masks(
    document: Value,
    frames: &SelectedFrames,
    choice: &PredictionChoice<'_>,
) -> Result<MasksByFrame, String> {
    Document { frames, choice }.read(document)
}

/// Checks that the parsed document will fit in memory: a list of numbers takes many times the memory of its text.
fn check_memory(text: &[u8], limit: u64) -> Result<(), String> {
    let values = text.iter().filter(|byte| b",:[{".contains(byte)).count() as u64;
    let needed = 2 * text.len() as u64 + BYTES_PER_VALUE * values;
    if needed <= limit {
        return Ok(());
    }
    let (needed, limit) = (display_bytes(needed), display_bytes(limit));
    Err(format!(
        "takes up to {needed} in memory, and {limit} are available: split it, or write counts as compressed text"
    ))
}

/// A track or a single mask.
#[derive(Deserialize)]
struct Annotation {
    id: Option<Value>,
    track_id: Option<Value>,
    segmentations: Option<Vec<Value>>,
    segmentation: Option<Value>,
    frame: Option<Value>,
    file_name: Option<Value>,
    image: Option<Value>,
    image_id: Option<Value>,
    score: Option<Value>,
}

/// An entry of COCO's list `images`.
#[derive(Deserialize)]
struct CocoImage {
    id: Value,
    file_name: String,
}

/// A parser for documents with predictions for these frames.
struct Document<'a> {
    frames: &'a SelectedFrames,
    choice: &'a PredictionChoice<'a>,
}

impl Document<'_> {
    fn read(&self, mut document: Value) -> Result<MasksByFrame, String> {
        let mut masks = MasksByFrame::new();
        let images = self.images(document.get_mut("images").map(Value::take))?;
        masks.extend(images.values().map(|name| (name.clone(), Vec::new())));
        if let Some(names) = document.get_mut("frames").map(Value::take) {
            let names =
                <Vec<Value>>::deserialize(names).map_err(|_| "key frames: expected a list of names".to_owned())?;
            for name in &names {
                masks.entry(self.frame_name(name)?).or_default();
            }
        }
        let videos = document.get_mut("videos").map(Value::take).unwrap_or_default();
        let list = document.get_mut("annotations").map(Value::take).unwrap_or(document);
        let Value::Array(list) = list else {
            return Err("expected a list of annotations, or an object with the key annotations".to_owned());
        };
        let list = self.choice.select_video(list, &videos)?;
        for (place, value) in list {
            let at = |text: String| format!("annotation {place}: {text}");
            let annotation = Annotation::deserialize(value)
                .map_err(|_| at("expected an object; segmentations, if present, must be a list of masks".to_owned()))?;
            if !self.choice.takes(annotation.score.as_ref()).map_err(at)? {
                continue;
            }
            self.add(annotation, place, &images, &mut masks).map_err(at)?;
        }
        Ok(masks)
    }

    /// Frame names of COCO's `images`, by image id.
    fn images(&self, list: Option<Value>) -> Result<BTreeMap<String, String>, String> {
        let Some(list) = list else {
            return Ok(BTreeMap::new());
        };
        let list = <Vec<CocoImage>>::deserialize(list)
            .map_err(|_| "key images: expected a list of objects with id and file_name".to_owned())?;
        let named = |image: CocoImage| Ok((image.id.to_string(), self.frame_name(&Value::String(image.file_name))?));
        list.into_iter().map(named).collect()
    }

    fn add(
        &self,
        annotation: Annotation,
        place: usize,
        images: &BTreeMap<String, String>,
        masks: &mut MasksByFrame,
    ) -> Result<(), String> {
        let id = annotation.track_id.as_ref().or(annotation.id.as_ref()).map(segment_id).transpose()?;
        if let Some(segmentations) = annotation.segmentations {
            let id = id.map_or_else(|| segment_id(&Value::from(place + 1)), Ok)?;
            return self.add_track(id, &segmentations, masks);
        }
        let segmentation = annotation.segmentation.ok_or("expected the key segmentation or segmentations")?;
        let name = match (annotation.frame.or(annotation.file_name).or(annotation.image), annotation.image_id) {
            (Some(name), _) => self.frame_name(&name)?,
            (None, Some(image)) => match images.get(&image.to_string()) {
                Some(name) => name.clone(),
                None => self.frame_name(&image)?,
            },
            (None, None) => return Err("expected the key frame, file_name, image or image_id".to_owned()),
        };
        let of_frame = masks.entry(name).or_default();
        // A mask without an id gets its position in the frame.
        let id = id.map_or_else(|| segment_id(&Value::from(of_frame.len() + 1)), Ok)?;
        if let Some(runs) = run_lengths(&segmentation)? {
            of_frame.push(EncodedMask { id, runs });
        }
        Ok(())
    }

    fn add_track(&self, id: SegmentId, segmentations: &[Value], masks: &mut MasksByFrame) -> Result<(), String> {
        let selected = self.frames.selected();
        if segmentations.len() > selected.len() {
            return Err(format!(
                "{} masks, expected at most {}, one (or null) for each scored frame",
                segmentations.len(),
                selected.len()
            ));
        }
        for (segmentation, (_, name)) in segmentations.iter().zip(selected) {
            let of_frame = masks.entry(name.clone()).or_default();
            if let Some(runs) = run_lengths(segmentation).map_err(|error| format!("frame {name}: {error}"))? {
                of_frame.push(EncodedMask { id, runs });
            }
        }
        Ok(())
    }

    fn frame_name(&self, value: &Value) -> Result<String, String> {
        frame_name(self.frames, value)
    }
}

/// Resolves a frame's name, number or image path to the frame's name in the scene. Unknown names are returned as they
/// are, without folder and extension.
pub fn frame_name(frames: &SelectedFrames, value: &Value) -> Result<String, String> {
    let text = match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.to_string(),
        _ => return Err("expected a frame's name".to_owned()),
    };
    if frames.contains(&text) {
        return Ok(text);
    }
    let mut name = text.rsplit(['/', '\\']).next().unwrap_or(&text);
    for ending in IMAGE_ENDINGS {
        name = name.strip_suffix(ending).unwrap_or(name);
    }
    Ok(frames.resolve(name).unwrap_or(name).to_owned())
}

fn segment_id(value: &Value) -> Result<SegmentId, String> {
    let id = value.as_u64().and_then(|id| SegmentId::try_from(id).ok()).filter(|id| *id > 0);
    id.ok_or_else(|| format!("id: found {value}, expected an integer from 1 to {}", SegmentId::MAX))
}

/// Parses a COCO RLE, compressed or not. Returns `None` for null.
fn run_lengths(value: &Value) -> Result<Option<RunLengths>, String> {
    if value.is_null() {
        return Ok(None);
    }
    let expected = "expected an RLE with size [height, width] and counts (polygons are not supported)";
    let size = value.get("size").and_then(|size| <[usize; 2]>::deserialize(size).ok());
    let ([height, width], Some(counts)) = (size.ok_or(expected)?, value.get("counts")) else {
        return Err(expected.to_owned());
    };
    let counts = match counts {
        Value::String(text) => Counts::Compressed(text.clone()),
        counts => Counts::Lengths(
            <Vec<u32>>::deserialize(counts)
                .map_err(|_| format!("counts: expected whole numbers from 0 to {}", u32::MAX))?,
        ),
    };
    Segmentation { size: [height, width], counts }.into_runs().map(Some).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documents_that_would_take_too_much_memory_are_refused() {
        let text = format!("[{}]", "[],".repeat(100_000));
        check_memory(text.as_bytes(), 20_000_000).unwrap();
        let error = check_memory(text.as_bytes(), 10_000_000).unwrap_err();
        assert!(error.starts_with("takes up to 17 MB in memory, and 10 MB"), "{error}");
    }
}

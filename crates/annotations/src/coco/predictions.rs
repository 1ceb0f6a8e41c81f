//! Reads JSON files of run-length encoded masks: COCO annotations with frames and ids, or YouTube-VIS tracks.

use super::one_video::{OneVideo, VideoLists};
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
    let lists = video_lists(document)?;
    let video = lists.select(frames, choice)?;
    Reader { frames, choice, masks: MasksByFrame::new(), has_tracks: false }.read(video)
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

/// Splits a document into its lists.
fn video_lists(mut document: Value) -> Result<VideoLists, String> {
    let images = document.get_mut("images").map(Value::take);
    let frames = document.get_mut("frames").map(Value::take).map_or(Ok(Vec::new()), <Vec<Value>>::deserialize);
    let frames = frames.map_err(|_| "key frames: expected a list of names".to_owned())?;
    let videos = document.get_mut("videos").map(Value::take).unwrap_or_default();
    match document.get_mut("annotations").map(Value::take).unwrap_or(document) {
        Value::Array(annotations) => Ok(VideoLists { images, annotations, frames, videos }),
        _ => Err("expected a list of annotations, or an object with the key annotations".to_owned()),
    }
}

/// A track or a single mask.
#[derive(Deserialize)]
struct Annotation {
    id: Option<Value>,
    track_id: Option<Value>,
    /// The track in CocoVID, the format of mmtracking, where `id` is unique to the mask.
    instance_id: Option<Value>,
    segmentations: Option<Vec<Value>>,
    segmentation: Option<Value>,
    image_id: Option<Value>,
    score: Option<Value>,
}

/// A reader of the masks of one video.
struct Reader<'a> {
    frames: &'a SelectedFrames,
    choice: &'a PredictionChoice<'a>,
    masks: MasksByFrame,
    /// True if an id was stated for a whole track, or assigned here.
    has_tracks: bool,
}

impl Reader<'_> {
    fn read(mut self, mut video: OneVideo) -> Result<MasksByFrame, String> {
        self.masks.extend(video.images.values().map(|name| (name.clone(), Vec::new())));
        for name in &video.frames {
            let name = frame_name(self.frames, name)?;
            self.masks.entry(name).or_default();
        }
        // Each annotation is dropped once it is read: masks take much memory.
        for (place, value) in std::mem::take(&mut video.annotations) {
            let at = |text: String| format!("annotation {place}: {text}");
            let name = image_name(&value).cloned();
            let annotation = Annotation::deserialize(value)
                .map_err(|_| at("expected an object; segmentations, if present, must be a list of masks".to_owned()))?;
            if self.choice.takes(annotation.score.as_ref()).map_err(at)? {
                self.add(annotation, place, name, &video).map_err(at)?;
            }
        }
        if !self.choice.per_frame_ids && !self.has_tracks && has_unique_ids(&self.masks) {
            return Err("no id of a mask occurs in two frames, so ids do not follow objects over time: \
                 expected the key track_id or instance_id, or --no-ids"
                .to_owned());
        }
        Ok(self.masks)
    }

    fn add(
        &mut self,
        annotation: Annotation,
        place: usize,
        name: Option<Value>,
        video: &OneVideo,
    ) -> Result<(), String> {
        let Annotation { id, track_id, instance_id, segmentations, segmentation, image_id, .. } = annotation;
        let of_track = [("track_id", track_id), ("instance_id", instance_id)];
        let of_track = of_track.into_iter().find_map(|(key, id)| Some((key, id?)));
        self.has_tracks |= of_track.is_some() || id.is_none() || segmentations.is_some();
        let id = of_track.or(id.map(|id| ("id", id))).map(|(key, id)| segment_id(key, &id)).transpose()?;
        if let Some(segmentations) = segmentations {
            let id = id.map_or_else(|| segment_id("id", &Value::from(place + 1)), Ok)?;
            return self.add_track(id, &segmentations);
        }
        let segmentation = segmentation.ok_or("expected the key segmentation or segmentations")?;
        let name = match (name, image_id) {
            (Some(name), _) => frame_name(self.frames, &name)?,
            (None, Some(image)) => self.frame_of_image(&image, video)?,
            (None, None) => return Err("expected the key frame, file_name, image or image_id".to_owned()),
        };
        let of_frame = self.masks.entry(name).or_default();
        // A mask without an id gets its position in the frame.
        let id = id.map_or_else(|| segment_id("id", &Value::from(of_frame.len() + 1)), Ok)?;
        if let Some(runs) = run_lengths(&segmentation)? {
            of_frame.push(EncodedMask { id, runs });
        }
        Ok(())
    }

    fn frame_of_image(&self, image: &Value, video: &OneVideo) -> Result<String, String> {
        let id = image.to_string();
        match video.images.get(&id) {
            Some(name) => Ok(name.clone()),
            None if video.other_images.contains(&id) => Err(format!("image_id {id} is of another video")),
            None => frame_name(self.frames, image),
        }
    }

    fn add_track(&mut self, id: SegmentId, segmentations: &[Value]) -> Result<(), String> {
        let selected = self.frames.selected();
        if segmentations.len() > selected.len() {
            return Err(format!(
                "{} masks, expected at most {}, one (or null) for each scored frame",
                segmentations.len(),
                selected.len()
            ));
        }
        for (segmentation, (_, name)) in segmentations.iter().zip(selected) {
            let of_frame = self.masks.entry(name.clone()).or_default();
            if let Some(runs) = run_lengths(segmentation).map_err(|error| format!("frame {name}: {error}"))? {
                of_frame.push(EncodedMask { id, runs });
            }
        }
        Ok(())
    }
}

/// Returns true if several frames have masks, and no id is in two of them.
fn has_unique_ids(masks: &MasksByFrame) -> bool {
    let mut frame_of_id: BTreeMap<SegmentId, &str> = BTreeMap::new();
    let mut is_unique = |id, frame| *frame_of_id.entry(id).or_insert(frame) == frame;
    masks.values().filter(|of_frame| !of_frame.is_empty()).count() > 1
        && masks.iter().all(|(frame, of_frame)| of_frame.iter().all(|mask| is_unique(mask.id, frame.as_str())))
}

/// The name or path of its image that an annotation states.
pub(super) fn image_name(annotation: &Value) -> Option<&Value> {
    ["frame", "file_name", "image"].into_iter().find_map(|key| annotation.get(key).filter(|name| !name.is_null()))
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

fn segment_id(key: &str, value: &Value) -> Result<SegmentId, String> {
    let id = value.as_u64().and_then(|id| SegmentId::try_from(id).ok()).filter(|id| *id > 0);
    id.ok_or_else(|| format!("{key}: found {value}, expected an integer from 1 to {}", SegmentId::MAX))
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

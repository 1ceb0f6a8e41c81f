//! Predictions in COCO's panoptic format: an RGB image per frame whose colours encode ids, and a JSON file that lists the
//! segments of each image. Video panoptic segmentation systems write this format (VIPSeg, Cityscapes-VPS).

use crate::coco::frame_name;
use crate::{PredictionChoice, SelectedFrames};
use serde::Deserialize;
use serde_json::Value;
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// Folders beside the JSON file where its images may be. A folder with the file's own name is searched too.
const IMAGE_FOLDERS: [&str; 4] = ["", "pan_pred", "panomasksRGB", "panoptic"];

/// The images of a video and the segments in them.
#[derive(Clone, Debug, Default)]
pub struct PanopticFrames {
    /// Frames by name.
    pub frames: BTreeMap<String, PanopticFrame>,
}

/// The prediction of one frame.
#[derive(Clone, Debug)]
pub struct PanopticFrame {
    /// Path of the image.
    pub path: PathBuf,
    /// Predicted id of each id in the image, 0 for segments that are left out.
    ids: BTreeMap<u32, SegmentId>,
}

/// An entry of `annotations`: a frame or a video.
#[derive(Deserialize)]
struct Entry {
    /// The frames, if the entry is a video.
    annotations: Option<Vec<Frame>>,
}

/// An image and its segments.
#[derive(Deserialize)]
struct Frame {
    file_name: String,
    segments_info: Vec<Segment>,
}

/// A segment of an image.
#[derive(Deserialize)]
struct Segment {
    id: u32,
    /// Id over the whole video, for images whose ids are per frame.
    track_id: Option<u32>,
    score: Option<Value>,
}

/// Returns true if a document is in COCO's panoptic format.
pub fn is_panoptic(document: &Value) -> bool {
    let has_segments = |frame: &Value| frame.get("segments_info").is_some();
    let first_frame =
        |entry: &Value| entry.get("annotations").and_then(|frames| frames.get(0)).is_some_and(has_segments);
    let mut entries = document.get("annotations").and_then(Value::as_array).into_iter().flatten();
    entries.any(|entry| has_segments(entry) || first_frame(entry))
}

/// Reads a document in COCO's panoptic format, and finds its images.
pub fn read(
    mut document: Value,
    path: &Path,
    frames: &SelectedFrames,
    choice: &PredictionChoice<'_>,
) -> Result<PanopticFrames, String> {
    let Some(Value::Array(list)) = document.get_mut("annotations").map(Value::take) else {
        return Err("expected the key annotations with a list".to_owned());
    };
    let videos = document.get_mut("videos").map(Value::take).unwrap_or_default();
    let mut listed = Vec::new();
    for (place, value) in choice.select_video(list, &videos)? {
        let wrong = |_| {
            let expected = "expected file_name and segments_info, a list of objects with a whole number as id";
            format!("annotation {place}: {expected}, or a list annotations of such objects")
        };
        match Entry::deserialize(&value).map_err(wrong)?.annotations {
            Some(of_video) => listed.extend(of_video),
            None => listed.push(Frame::deserialize(value).map_err(wrong)?),
        }
    }
    let mut found = PanopticFrames::default();
    let mut folder = None;
    for Frame { file_name, segments_info } in listed {
        let name = frame_name(frames, &Value::String(file_name.clone()))?;
        let at = |problem: String| format!("image {file_name}: {problem}");
        let folder = match &folder {
            Some(folder) => folder,
            None => folder.insert(find_image_folder(path, &file_name, choice.folder()).map_err(at)?),
        };
        let ids = predicted_ids(&segments_info, choice).map_err(at)?;
        found.frames.insert(name, PanopticFrame { path: folder.join(&file_name), ids });
    }
    Ok(found)
}

fn predicted_ids(segments: &[Segment], choice: &PredictionChoice<'_>) -> Result<BTreeMap<u32, SegmentId>, String> {
    let mut ids = BTreeMap::new();
    for segment in segments {
        let id = if choice.takes(segment.score.as_ref())? { segment.track_id.unwrap_or(segment.id) } else { 0 };
        if ids.insert(segment.id, id).is_some() {
            return Err(format!("segments_info lists the id {} twice", segment.id));
        }
    }
    Ok(ids)
}

/// Finds the folder that contains an image, among several places beside the file.
fn find_image_folder(path: &Path, image: &str, video: &str) -> Result<PathBuf, String> {
    let is_inside = Path::new(image).components().all(|part| matches!(part, Component::Normal(_)));
    if !is_inside {
        return Err("leads out of the folder of the predictions".to_owned());
    }
    let beside = path.parent().unwrap_or(Path::new("."));
    let own = path.file_stem().map(|stem| beside.join(stem));
    let folders = IMAGE_FOLDERS.iter().map(|folder| beside.join(folder)).chain(own);
    let mut places = folders.flat_map(|folder| [folder.join(video), folder]);
    places.find(|place| place.join(image).is_file()).ok_or_else(|| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        format!(
            "not found beside the file, nor in {stem}/ or {} there, with or without {video}/",
            IMAGE_FOLDERS[1..].join("/, ")
        )
    })
}

impl PanopticFrame {
    /// Maps the ids of an image to predicted ids.
    ///
    /// # Errors
    /// If the image has an id that `segments_info` does not list.
    pub fn ids(&self, image: &SegmentMap) -> Result<SegmentMap, String> {
        if let Some(id) = image.areas().into_keys().find(|id| !self.ids.contains_key(id)) {
            return Err(format!("id: found {id}, expected one of the segments_info of the image"));
        }
        Ok(image.map(|id| self.ids.get(id).copied().unwrap_or(0)))
    }
}

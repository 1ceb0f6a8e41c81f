//! Predictions in COCO's panoptic format: an RGB image per frame whose colours encode ids, and a JSON file that lists the
//! segments of each image. Video panoptic segmentation systems write this format (VIPSeg, Cityscapes-VPS).

use crate::choice::{ChosenVideo, Origin, listed_twice};
use crate::coco::frame_name;
use crate::{PredictionChoice, SelectedFrames};
use serde::Deserialize;
use serde_json::Value;
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};
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
    /// Predicted id of each id in the image, `None` for segments that are left out.
    ids: BTreeMap<u32, Option<SegmentId>>,
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

/// A frame of a list, and its video.
struct ListedFrame {
    /// Position in `annotations`.
    place: usize,
    origin: Origin,
    frame: Frame,
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
    let listed = listed_frames(list)?;
    let origins: Vec<&Origin> = listed.iter().map(|entry| &entry.origin).collect();
    let chosen = choice.choose_video(&origins, frames, &videos)?;
    let mut of_video = Vec::new();
    for ListedFrame { place, origin, frame } in listed {
        if chosen.has_prediction(&origin).map_err(|problem| format!("annotation {place}: {problem}"))? {
            of_video.push(frame);
        }
    }
    let track_zero = free_id(&of_video);
    let mut found = PanopticFrames::default();
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    let mut folder = None;
    for Frame { file_name, segments_info } in of_video {
        let name = frame_name(frames, &Value::from(file_name.as_str()))?;
        let at = |problem: String| format!("image {file_name}: {problem}");
        if let Some(other) = files.get(&name) {
            return Err(listed_twice(&name, other, &file_name));
        }
        let folder = match &folder {
            Some(folder) => folder,
            None => folder.insert(find_image_folder(path, &file_name, choice.folder(), &chosen)?),
        };
        let ids = predicted_ids(&segments_info, choice, track_zero).map_err(at)?;
        found.frames.insert(name.clone(), PanopticFrame { path: folder.join(&file_name), ids });
        files.insert(name, file_name);
    }
    Ok(found)
}

/// All frames of a document, in one list.
fn listed_frames(list: Vec<Value>) -> Result<Vec<ListedFrame>, String> {
    let mut listed = Vec::new();
    for (place, value) in list.into_iter().enumerate() {
        let wrong = |_| {
            let expected = "expected file_name and segments_info, a list of objects with a whole number as id";
            format!("annotation {place}: {expected}, or a list annotations of such objects")
        };
        let videos = Origin::videos_of(&value);
        let frames = match Entry::deserialize(&value).map_err(wrong)?.annotations {
            Some(of_video) => of_video,
            None => vec![Frame::deserialize(value).map_err(wrong)?],
        };
        for frame in frames {
            check_inside(&frame.file_name)?;
            let origin = Origin { videos: videos.clone(), path: Some(frame.file_name.clone()) };
            listed.push(ListedFrame { place, origin, frame });
        }
    }
    Ok(listed)
}

/// Returns the smallest id that no segment uses. Track 0 gets it, because 0 means "no segment" in an id image.
fn free_id(frames: &[Frame]) -> SegmentId {
    let segments = frames.iter().flat_map(|frame| &frame.segments_info);
    let used: BTreeSet<SegmentId> = segments.map(|segment| segment.track_id.unwrap_or(segment.id)).collect();
    let mut free = 1;
    while used.contains(&free) {
        free += 1;
    }
    free
}

fn predicted_ids(
    segments: &[Segment],
    choice: &PredictionChoice<'_>,
    track_zero: SegmentId,
) -> Result<BTreeMap<u32, Option<SegmentId>>, String> {
    let mut ids = BTreeMap::new();
    for segment in segments {
        let id = match (segment.track_id, segment.id) {
            // Pixels of the id 0 are without a segment in COCO's format.
            (None | Some(0), 0) => None,
            (Some(0), _) => Some(track_zero),
            (track, id) => Some(track.unwrap_or(id)),
        };
        let id = if choice.takes(segment.score.as_ref())? { id } else { None };
        if ids.insert(segment.id, id).is_some() {
            return Err(format!("segments_info lists the id {} twice", segment.id));
        }
    }
    Ok(ids)
}

/// Checks that the path of an image does not lead out of the folder of the images.
fn check_inside(image: &str) -> Result<(), String> {
    let is_inside = Path::new(image).components().all(|part| matches!(part, Component::Normal(_)));
    if is_inside { Ok(()) } else { Err(format!("image {image}: leads out of the folder of the predictions")) }
}

/// Finds the folder that contains an image, among several places beside the file. If a video was asked for and the file
/// does not have it, the folder must be named like the video.
fn find_image_folder(path: &Path, image: &str, video: &str, chosen: &ChosenVideo) -> Result<PathBuf, String> {
    let beside = path.parent().unwrap_or(Path::new("."));
    let own = path.file_stem().map(|stem| beside.join(stem));
    let folders = IMAGE_FOLDERS.iter().map(|folder| beside.join(folder)).chain(own);
    let places = folders.flat_map(|folder| [folder.join(video), folder]).filter(|place| place.join(image).is_file());
    let places: Vec<PathBuf> = places.collect();
    match (places.first(), chosen) {
        (Some(_), ChosenVideo::Unlisted(problem)) => {
            places.into_iter().find(|place| place.ends_with(video)).ok_or_else(|| problem.clone())
        }
        (Some(place), _) => Ok(place.clone()),
        (None, _) => {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            Err(format!(
                "image {image}: not found beside the file, nor in {stem}/ or {} there, with or without {video}/",
                IMAGE_FOLDERS[1..].join("/, ")
            ))
        }
    }
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
        Ok(image.map(|id| self.ids.get(id).copied().flatten().unwrap_or(0)))
    }
}

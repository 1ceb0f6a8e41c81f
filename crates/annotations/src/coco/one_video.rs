//! Selects the images and masks of one video in a document with COCO's lists.

use super::predictions::{frame_name, image_name};
use crate::choice::{ChosenVideo, Origin, listed_twice, scalar_text};
use crate::{PredictionChoice, SelectedFrames};
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// The lists of a document, of all its videos.
pub(super) struct VideoLists {
    /// COCO's list `images`.
    pub images: Option<Value>,
    /// Tracks and masks.
    pub annotations: Vec<Value>,
    /// Names of frames, with masks or without.
    pub frames: Vec<Value>,
    /// The list `videos`, or null.
    pub videos: Value,
}

/// The parts of a document that are about one video.
pub(super) struct OneVideo {
    /// Frame name of each image, by image id.
    pub images: BTreeMap<String, String>,
    /// Ids of images of other videos only.
    pub other_images: BTreeSet<String>,
    /// Tracks and masks, with their positions in the document.
    pub annotations: Vec<(usize, Value)>,
    /// Names of frames, with masks or without.
    pub frames: Vec<Value>,
}

/// An entry of COCO's list `images`.
#[derive(Deserialize)]
struct CocoImage {
    id: Value,
    file_name: String,
}

/// An image and its video.
struct Image {
    id: String,
    file_name: String,
    origin: Origin,
}

impl VideoLists {
    /// Selects the chosen video. An annotation without a video is of that of its image, and the reverse.
    pub fn select(self, frames: &SelectedFrames, choice: &PredictionChoice<'_>) -> Result<OneVideo, String> {
        let mut images = parse_images(self.images)?;
        let origins = origins(&self.annotations, &mut images)?;
        let listed: Vec<Origin> =
            self.frames.iter().map(|name| Origin { videos: Vec::new(), path: scalar_text(name) }).collect();
        let all: Vec<&Origin> = images.iter().map(|image| &image.origin).chain(&origins).chain(&listed).collect();
        let chosen = choice.choose_video(&all, frames, &self.videos)?;
        if let ChosenVideo::Unlisted(problem) = &chosen {
            return Err(problem.clone());
        }
        let mut annotations = Vec::new();
        for ((place, annotation), origin) in self.annotations.into_iter().enumerate().zip(&origins) {
            if chosen.has_prediction(origin).map_err(|problem| format!("annotation {place}: {problem}"))? {
                annotations.push((place, annotation));
            }
        }
        let names = self.frames.into_iter().zip(&listed).filter(|(_, origin)| chosen.contains(origin));
        let names = names.map(|(name, _)| name).collect();
        let (of_video, others): (Vec<Image>, _) = images.into_iter().partition(|image| chosen.contains(&image.origin));
        let images = frames_of_images(&of_video, frames)?;
        let others = others.into_iter().map(|image| image.id).filter(|id| !images.contains_key(id)).collect();
        Ok(OneVideo { images, other_images: others, annotations, frames: names })
    }
}

fn parse_images(list: Option<Value>) -> Result<Vec<Image>, String> {
    let wrong = || "key images: expected a list of objects with id and file_name".to_owned();
    let Some(list) = list else { return Ok(Vec::new()) };
    let list = list.as_array().ok_or_else(wrong)?;
    let parsed = list.iter().map(|entry| {
        let CocoImage { id, file_name } = CocoImage::deserialize(entry).map_err(|_| wrong())?;
        let origin = Origin { videos: Origin::videos_of(entry), path: Some(file_name.clone()) };
        Ok(Image { id: id.to_string(), file_name, origin })
    });
    parsed.collect()
}

/// Returns the origin of each annotation. Images without a video get those of their annotations.
fn origins(annotations: &[Value], images: &mut [Image]) -> Result<Vec<Origin>, String> {
    let mut by_id: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (index, image) in images.iter().enumerate() {
        by_id.entry(image.id.clone()).or_default().push(index);
    }
    let mut origins = Vec::with_capacity(annotations.len());
    let mut videos_of_annotations: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for (place, annotation) in annotations.iter().enumerate() {
        let own = Origin { videos: Origin::videos_of(annotation), path: image_name(annotation).and_then(scalar_text) };
        let with_id = annotation.get("image_id").and_then(|id| by_id.get(&id.to_string()));
        let origin = match with_id.map_or(&[][..], Vec::as_slice) {
            [image] => {
                if images[*image].origin.videos.is_empty() {
                    let videos = videos_of_annotations.entry(*image).or_default();
                    let new = own.videos.iter().filter(|id| !videos.contains(id)).cloned().collect::<Vec<_>>();
                    videos.extend(new);
                }
                own.in_image(&images[*image].origin)
            }
            [first, second, ..] if own.videos.is_empty() && own.path.is_none() => {
                let (first, second) = (&images[*first], &images[*second]);
                return Err(format!(
                    "annotation {place}: image_id {} is of the images {} and {}, expected the key video_id",
                    first.id, first.file_name, second.file_name
                ));
            }
            _ => own,
        };
        origins.push(origin);
    }
    for (image, videos) in videos_of_annotations {
        images[image].origin.videos = videos;
    }
    Ok(origins)
}

/// Frame name of each image, by image id.
fn frames_of_images(images: &[Image], frames: &SelectedFrames) -> Result<BTreeMap<String, String>, String> {
    let mut names = BTreeMap::new();
    let mut of_frame: BTreeMap<String, &Image> = BTreeMap::new();
    for image in images {
        let name = frame_name(frames, &Value::from(image.file_name.as_str()))?;
        match of_frame.insert(name.clone(), image) {
            Some(other) if (&other.id, &other.file_name) != (&image.id, &image.file_name) => {
                return Err(listed_twice(&name, &other.file_name, &image.file_name));
            }
            _ => {}
        }
        if names.insert(image.id.clone(), name.clone()).is_some_and(|other| other != name) {
            return Err(format!("key images: id {} is listed twice", image.id));
        }
    }
    Ok(names)
}

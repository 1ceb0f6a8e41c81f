//! Selects the predictions of a file to score, by video and score.

use crate::SelectedFrames;
use crate::coco::frame_name;
use serde_json::Value;
use std::collections::BTreeMap;

/// Maximum number of videos listed in an error.
const LISTED_VIDEOS: usize = 5;

/// A selection among predictions for several videos, or with scores.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PredictionChoice<'a> {
    /// The video's id or name in the predictions. `None` selects the video named like the scene, or the only one.
    pub video: Option<&'a str>,
    /// Predictions with a lower score are left out. Predictions without a score are kept.
    pub min_score: f64,
    /// The scene's name.
    pub scene: &'a str,
    /// True if predicted ids are not compared between frames. Otherwise a file whose ids cannot be those of objects over
    /// time is refused.
    pub per_frame_ids: bool,
}

/// The video and the image that an entry of a file states.
#[derive(Clone, Debug, Default)]
pub(crate) struct Origin {
    /// The video's number and name, where stated.
    pub videos: Vec<String>,
    /// Name or path of the image, if stated.
    pub path: Option<String>,
}

/// The video whose entries are scored.
#[derive(Clone, Debug)]
pub(crate) enum ChosenVideo {
    /// The only video of the file.
    Only,
    /// The video with this number or name.
    Named(String),
    /// The video whose images are in this folder.
    Folder(String),
    /// A video was asked for, and the file does not have it. The text says what the file has.
    Unlisted(String),
}

impl PredictionChoice<'_> {
    /// Folder name of the video, where folders are named after videos.
    pub(crate) fn folder(&self) -> &str {
        self.video.unwrap_or(self.scene)
    }

    /// Chooses a video of a file whose entries have these origins. If no entry states its video, folders that contain
    /// images of the same frame are videos, and with `--video` any folders. `videos` is the document's list of videos. It
    /// maps names to the numeric ids that entries refer to, as in the YouTube-VIS data sets.
    ///
    /// # Errors
    /// If the file has several videos and none is chosen, or no video of the chosen number.
    pub(crate) fn choose_video(
        &self,
        origins: &[&Origin],
        frames: &SelectedFrames,
        videos: &Value,
    ) -> Result<ChosenVideo, String> {
        let mut found: Vec<&str> = Vec::new();
        for id in origins.iter().flat_map(|origin| &origin.videos) {
            if !found.contains(&id.as_str()) {
                found.push(id);
            }
        }
        if found.is_empty() {
            return self.choose_folder(origins, frames);
        }
        let named = |name: &str| {
            let number =
                videos.as_array().into_iter().flatten().find(|video| video_names(video).any(|known| known == name));
            number.and_then(|video| scalar_text(video.get("id")?)).unwrap_or_else(|| name.to_owned())
        };
        let mut firsts = origins.iter().filter_map(|origin| origin.videos.first());
        let several = firsts.any(|id| found.first() != Some(&id.as_str()));
        let of_scene = || Some(named(self.scene)).filter(|id| found.contains(&id.as_str()));
        let chosen = match self.video {
            Some(video) => Some(named(video))
                .filter(|id| found.contains(&id.as_str()))
                .ok_or_else(|| format!("has no video {video}; its first videos are {}", listed(&found)))?,
            None if several => of_scene().ok_or_else(|| several_videos(&found))?,
            None => return Ok(ChosenVideo::Only),
        };
        Ok(if several { ChosenVideo::Named(chosen) } else { ChosenVideo::Only })
    }

    /// As [`Self::choose_video`], for a file without numbers and names of videos.
    fn choose_folder(&self, origins: &[&Origin], frames: &SelectedFrames) -> Result<ChosenVideo, String> {
        let mut folders: Vec<&str> = Vec::new();
        let mut folder_of_frame: BTreeMap<String, &str> = BTreeMap::new();
        let mut several = false;
        for path in origins.iter().filter_map(|origin| origin.path.as_deref()) {
            let Some(folder) = folder_of(path) else { continue };
            if !folders.contains(&folder) {
                folders.push(folder);
            }
            let frame = frame_name(frames, &Value::from(path))?;
            several |= *folder_of_frame.entry(frame).or_insert(folder) != folder;
        }
        let has = |video: &str| folders.iter().any(|folder| is_in(folder, video));
        match self.video {
            Some(video) if has(video) => Ok(ChosenVideo::Folder(video.to_owned())),
            Some(_) if folders.is_empty() => Ok(ChosenVideo::Unlisted(
                "has no videos to choose from: it has neither video_id nor folders in file names; leave out --video"
                    .to_owned(),
            )),
            Some(video) => {
                Ok(ChosenVideo::Unlisted(format!("has no video {video}; its first folders are {}", listed(&folders))))
            }
            None if several && has(self.scene) => Ok(ChosenVideo::Folder(self.scene.to_owned())),
            None if several => Err(several_videos(&folders)),
            None => Ok(ChosenVideo::Only),
        }
    }

    /// Returns true if a prediction with this score is selected.
    pub(crate) fn takes(&self, score: Option<&Value>) -> Result<bool, String> {
        let Some(score) = score.filter(|score| !score.is_null()) else { return Ok(true) };
        let number = score.as_f64().ok_or_else(|| format!("score: found {score}, expected a number"))?;
        Ok(number >= self.min_score)
    }
}

impl Origin {
    /// The number and the name of the video that an entry states.
    pub fn videos_of(entry: &Value) -> Vec<String> {
        ["video_id", "video_name"].into_iter().filter_map(|key| scalar_text(entry.get(key)?)).collect()
    }

    /// The origin of a mask in an image. The image's video comes first, so that all masks begin with the same.
    pub fn in_image(self, image: &Self) -> Self {
        let path = self.path.filter(|path| folder_of(path).is_some()).or_else(|| image.path.clone());
        Self { videos: image.videos.iter().cloned().chain(self.videos).collect(), path }
    }
}

impl ChosenVideo {
    /// Returns true if the video contains an entry of this origin.
    pub fn contains(&self, origin: &Origin) -> bool {
        match self {
            Self::Only | Self::Unlisted(_) => true,
            Self::Named(video) => origin.videos.contains(video),
            Self::Folder(video) => {
                origin.path.as_deref().and_then(folder_of).is_some_and(|folder| is_in(folder, video))
            }
        }
    }

    /// As [`Self::contains`], for a prediction.
    ///
    /// # Errors
    /// If nothing says which video the prediction is of, though the file has several.
    pub fn has_prediction(&self, origin: &Origin) -> Result<bool, String> {
        let is_told = match self {
            Self::Only | Self::Unlisted(_) => true,
            Self::Named(_) => !origin.videos.is_empty(),
            Self::Folder(_) => origin.path.as_deref().and_then(folder_of).is_some(),
        };
        let expected = "expected the key video_id, as the file has several videos";
        if is_told { Ok(self.contains(origin)) } else { Err(expected.to_owned()) }
    }
}

/// The error about a frame that two images of a file stand for.
pub(crate) fn listed_twice(frame: &str, first: &str, second: &str) -> String {
    format!(
        "frame {frame} is listed twice, as {first} and {second}: if they are of several videos, choose one with --video"
    )
}

/// Names of a video in a list of videos: its own, and the folder of its images.
fn video_names(video: &Value) -> impl Iterator<Item = &str> {
    let own = ["name", "video_name"].into_iter().filter_map(|key| video.get(key)?.as_str());
    let image = video.get("file_names").and_then(|files| files.get(0)?.as_str());
    own.chain(image.and_then(|file| file.rsplit_once('/')).map(|(folder, _)| folder))
}

/// The folder of an image, if its path has one.
fn folder_of(path: &str) -> Option<&str> {
    path.rsplit_once(['/', '\\']).map(|(folder, _)| folder)
}

/// Returns true if a video has this folder: it is named like the video, or a folder around it is.
fn is_in(folder: &str, video: &str) -> bool {
    folder == video || folder.split(['/', '\\']).any(|part| part == video)
}

/// The text of a name or a number.
pub(crate) fn scalar_text(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

fn several_videos(videos: &[&str]) -> String {
    format!("has several videos ({}): choose one with --video", listed(videos))
}

fn listed(videos: &[&str]) -> String {
    let first = videos.iter().take(LISTED_VIDEOS).copied().collect::<Vec<_>>().join(", ");
    if videos.len() > LISTED_VIDEOS { format!("{first}, …") } else { first }
}

//! Selects the predictions of a file to score, by video and score.

use serde_json::Value;

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
}

impl PredictionChoice<'_> {
    /// Folder name of the video, where folders are named after videos.
    pub(crate) fn folder(&self) -> &str {
        self.video.unwrap_or(self.scene)
    }

    /// Returns the entries of the chosen video, with their positions in the list. `videos` is the document's list of
    /// videos. It maps names to the numeric ids that entries refer to, as in the YouTube-VIS data sets.
    pub(crate) fn select_video(&self, list: Vec<Value>, videos: &Value) -> Result<Vec<(usize, Value)>, String> {
        let mut found: Vec<String> = Vec::new();
        for id in list.iter().flat_map(video_ids) {
            if !found.contains(&id) {
                found.push(id);
            }
        }
        let named = |name: &str| {
            let number =
                videos.as_array().into_iter().flatten().find(|video| video_names(video).any(|known| known == name));
            number.and_then(|video| scalar_text(video.get("id")?)).unwrap_or_else(|| name.to_owned())
        };
        let of_scene = || Some(named(self.scene)).filter(|id| found.contains(id));
        let several = list.iter().filter_map(|entry| video_ids(entry).next()).any(|id| found.first() != Some(&id));
        let chosen = match self.video.map(named) {
            Some(_) if found.is_empty() => None,
            Some(video) if found.contains(&video) => Some(video),
            Some(_) => {
                let video = self.video.unwrap_or_default();
                return Err(format!("has no video {video}; its first videos are {}", listed(&found)));
            }
            None if several => match of_scene() {
                Some(video) => Some(video),
                None => return Err(format!("has several videos ({}): choose one with --video", listed(&found))),
            },
            None => None,
        };
        let is_chosen = |entry: &Value| chosen.as_ref().is_none_or(|chosen| video_ids(entry).any(|id| id == *chosen));
        Ok(list.into_iter().enumerate().filter(|(_, entry)| is_chosen(entry)).collect())
    }

    /// Returns true if a prediction with this score is selected.
    pub(crate) fn takes(&self, score: Option<&Value>) -> Result<bool, String> {
        let Some(score) = score.filter(|score| !score.is_null()) else { return Ok(true) };
        let number = score.as_f64().ok_or_else(|| format!("score: found {score}, expected a number"))?;
        Ok(number >= self.min_score)
    }
}

/// Ids of an entry's video: its number, then its name, where present.
fn video_ids(entry: &Value) -> impl Iterator<Item = String> {
    ["video_id", "video_name"].into_iter().filter_map(|key| scalar_text(entry.get(key)?))
}

/// Names of a video in a list of videos: its own, and the folder of its images.
fn video_names(video: &Value) -> impl Iterator<Item = &str> {
    let own = ["name", "video_name"].into_iter().filter_map(|key| video.get(key)?.as_str());
    let image = video.get("file_names").and_then(|files| files.get(0)?.as_str());
    own.chain(image.and_then(|file| file.rsplit_once('/')).map(|(folder, _)| folder))
}

fn scalar_text(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

fn listed(videos: &[String]) -> String {
    let first = videos.iter().take(LISTED_VIDEOS).cloned().collect::<Vec<_>>().join(", ");
    if videos.len() > LISTED_VIDEOS { format!("{first}, …") } else { first }
}

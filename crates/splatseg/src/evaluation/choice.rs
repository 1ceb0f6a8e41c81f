//! Which of the predictions in a file are scored: those of one video, and sure enough.

use serde_json::Value;

/// At most this many videos are listed in an error.
const LISTED_VIDEOS: usize = 5;

/// What is taken of predictions for several videos, or with scores.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PredictionChoice<'a> {
    /// The video's id or name in the predictions. Without it, the one that is named like the scene, or the only one.
    pub video: Option<&'a str>,
    /// Predictions with a lower score are left out; those without a score count.
    pub min_score: f64,
    /// The scene's name.
    pub scene: &'a str,
}

impl PredictionChoice<'_> {
    /// The video's name where folders are named after videos.
    pub(super) fn folder(&self) -> &str {
        self.video.unwrap_or(self.scene)
    }

    /// The entries of the chosen video, with their places in the list. `videos` is a document's list of videos, by which
    /// entries that have a number of theirs are found by name, as in the data sets of YouTube-VIS.
    pub(super) fn of_video(&self, list: Vec<Value>, videos: &Value) -> Result<Vec<(usize, Value)>, String> {
        let mut found: Vec<String> = Vec::new();
        for id in list.iter().flat_map(ids_of) {
            if !found.contains(&id) {
                found.push(id);
            }
        }
        let named = |name: &str| {
            let number =
                videos.as_array().into_iter().flatten().find(|video| names_of(video).any(|known| known == name));
            number.and_then(|video| text_of(video.get("id")?)).unwrap_or_else(|| name.to_owned())
        };
        let of_scene = || Some(named(self.scene)).filter(|id| found.contains(id));
        let several = list.iter().filter_map(|entry| ids_of(entry).next()).any(|id| found.first() != Some(&id));
        let chosen = match self.video.map(named) {
            Some(_) if found.is_empty() => None,
            Some(video) if found.contains(&video) => Some(video),
            Some(_) => {
                let video = self.video.unwrap_or_default();
                return Err(format!("has no video {video}; the first are {}", listed(&found)));
            }
            None if several => match of_scene() {
                Some(video) => Some(video),
                None => return Err(format!("has several videos ({}): choose one with --video", listed(&found))),
            },
            None => None,
        };
        let is_chosen = |entry: &Value| chosen.as_ref().is_none_or(|chosen| ids_of(entry).any(|id| id == *chosen));
        Ok(list.into_iter().enumerate().filter(|(_, entry)| is_chosen(entry)).collect())
    }

    /// Whether a prediction with this score is taken.
    pub(super) fn takes(&self, score: Option<&Value>) -> Result<bool, String> {
        let Some(score) = score.filter(|score| !score.is_null()) else { return Ok(true) };
        let number = score.as_f64().ok_or_else(|| format!("score: found {score}, expected a number"))?;
        Ok(number >= self.min_score)
    }
}

/// What an entry calls its video: the number first, if there is one.
fn ids_of(entry: &Value) -> impl Iterator<Item = String> {
    ["video_id", "video_name"].into_iter().filter_map(|key| text_of(entry.get(key)?))
}

/// The names of an entry of a list of videos: its own, and the folder of its images.
fn names_of(video: &Value) -> impl Iterator<Item = &str> {
    let own = ["name", "video_name"].into_iter().filter_map(|key| video.get(key)?.as_str());
    let image = video.get("file_names").and_then(|files| files.get(0)?.as_str());
    own.chain(image.and_then(|file| file.rsplit_once('/')).map(|(folder, _)| folder))
}

fn text_of(value: &Value) -> Option<String> {
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

//! A video of numbered frames, and predictions for it in a folder.

use serde_json::Value;
use splatseg_annotations::{Fit, Prediction, PredictionChoice, Predictions, SelectedFrames};
use splatseg_dataset::{DatasetError, DatasetSettings, Framing, RecordedFrame, Scene};
use splatseg_geometry::{SegmentId, SegmentMap};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Width and height of every frame.
pub const SIZE: (usize, usize) = (4, 3);

/// A scene whose frames are `000`, `001`, … and cannot be read.
#[derive(Debug)]
struct Numbered(usize);

impl Scene for Numbered {
    fn name(&self) -> &str {
        "kitchen"
    }

    fn frame_count(&self) -> usize {
        self.0
    }

    fn frame_name(&self, index: usize) -> String {
        format!("{index:03}")
    }

    fn read_recorded(&self, _: usize) -> Result<RecordedFrame, DatasetError> {
        unreachable!("predictions are opened without the frames")
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }
}

/// Predictions for a video named `kitchen`.
pub struct PredictedVideo {
    folder: TempDir,
    frames: SelectedFrames,
}

impl PredictedVideo {
    /// A video of this many frames without predictions.
    pub fn new(frames: usize) -> Self {
        let frames = SelectedFrames::new(&Numbered(frames), &DatasetSettings::default()).unwrap();
        Self { folder: tempfile::tempdir().unwrap(), frames }
    }

    /// The path of a file, whose folder is made.
    pub fn path(&self, name: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    }

    /// Opens the folder, or a file in it. Errors are without the path.
    pub fn open(&self, name: &str, choice: &PredictionChoice<'_>) -> Result<Predictions, String> {
        let path = if name.is_empty() { self.folder.path().to_owned() } else { self.folder.path().join(name) };
        let before = format!("{}: ", path.display());
        Predictions::open(&path, &self.frames, choice).map_err(|error| error.to_string().replace(&before, ""))
    }

    /// Opens a document with predictions.
    pub fn open_json(&self, document: &Value, video: Option<&str>) -> Result<Predictions, String> {
        fs::write(self.path("pred.json"), document.to_string()).unwrap();
        self.open("pred.json", &PredictionChoice { video, scene: "kitchen", ..Default::default() })
    }
}

/// Frames and ids of predictions: all of one frame, in order, without 0.
pub fn frames_and_ids(predictions: &Predictions) -> Vec<(String, Vec<SegmentId>)> {
    let fit = Fit { framing: Framing::default(), original: SIZE, framed: SIZE };
    let ids = |name: &str| match predictions.read(name, &fit).unwrap() {
        Prediction::Map(map) => map.areas().into_keys().filter(|id| *id != 0).collect(),
        Prediction::Masks(masks) => masks.into_iter().map(|(id, _)| id).collect(),
    };
    predictions.names().map(|name| (name.to_owned(), ids(name))).collect()
}

/// As [`frames_and_ids`] returns them.
pub fn expected(frames: &[(&str, &[SegmentId])]) -> Vec<(String, Vec<SegmentId>)> {
    frames.iter().map(|(name, ids)| ((*name).to_owned(), ids.to_vec())).collect()
}

/// Writes an image with one id per column, from the left.
pub fn write_columns(path: &Path, ids: [SegmentId; SIZE.0]) {
    let map = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| ids[column]);
    splatseg_annotations::write_segments_png(path, &map).unwrap();
}

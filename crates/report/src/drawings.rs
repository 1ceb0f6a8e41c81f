//! Pictures and curves of single runs. They are large, so only the scenes shown on the page have them.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A scene shown in detail on the page.
#[derive(Clone, Debug)]
pub struct SceneDrawings {
    /// Index of the scene.
    pub scene: usize,
    /// Frames of the scene, in order.
    pub pictures: Vec<ScenePicture>,
    /// One run of each variant that has a result, by variant.
    pub runs: Vec<RunDrawings>,
}

/// Pictures and curves of one run.
#[derive(Clone, Debug)]
pub struct RunDrawings {
    /// Index of the variant.
    pub variant: usize,
    /// Curves over the frames.
    pub series: Series,
    /// Results of some frames.
    pub thumbnails: Vec<Thumbnail>,
}

/// A frame of a scene, without any method's results.
#[derive(Clone, Debug)]
pub struct ScenePicture {
    /// Name of the frame.
    pub frame: String,
    /// Its image as `data:` URI.
    pub image: String,
    /// Its ground truth, drawn over the image, as `data:` URI; `None` without ground truth.
    pub ground_truth: Option<String>,
}

/// Numbers for each frame with a result.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Name of each stage and its time in each frame, milliseconds; stages are in the order of the method.
    pub stage_ms: Vec<(String, Vec<f32>)>,
    /// Gaussians in the memory after each frame; empty for methods without memory.
    pub gaussians: Vec<usize>,
}

/// A result drawn over its frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Thumbnail {
    /// Name of the frame.
    pub frame: String,
    /// A JPEG as `data:` URI.
    pub image: String,
}

impl Series {
    /// Adds a frame: the time of each stage, with the same stages in the same order for every frame, and the number of
    /// Gaussians if there is a memory.
    pub fn push<'s>(&mut self, stages: impl IntoIterator<Item = (&'s str, Duration)>, gaussians: Option<usize>) {
        for (index, (stage, time)) in stages.into_iter().enumerate() {
            if index == self.stage_ms.len() {
                self.stage_ms.push((stage.to_owned(), Vec::new()));
            }
            self.stage_ms[index].1.push((time.as_secs_f64() * 1e3) as f32);
        }
        self.gaussians.extend(gaussians);
    }
}

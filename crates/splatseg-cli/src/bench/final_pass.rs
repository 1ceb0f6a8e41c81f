//! The final pass of a benchmark: the map of the end decides the ids of all frames again, and they are scored once more.

use super::job::{FinalScores, JobInputs};
use crate::run::{FrameHistory, SavedFrame, shown_frames};
use splatseg::Pipeline;
use splatseg::pipeline::FrameResult;
use splatseg_dataset::{FrameStream, GroundTruth, Scene};
use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, VideoScorer};
use std::fmt::Display;
use std::io;
use std::sync::Arc;
use std::time::Instant;

/// The frames of a job and what they showed.
#[derive(Default)]
pub struct EarlierFrames {
    history: FrameHistory,
    /// One line for each frame, see [`shown_frames`].
    lines: Vec<Vec<u8>>,
}

impl EarlierFrames {
    /// Adds the next frame, whose index in its scene is `index`.
    ///
    /// # Errors
    /// Never in memory.
    pub fn add(&mut self, index: usize, result: &FrameResult) -> io::Result<()> {
        let frame = SavedFrame {
            index,
            file_name: String::new(),
            world_from_camera: result.pose.world_from_camera,
            pose_state: result.pose.state,
            keyframe: result.anchor.keyframe,
            world_from_keyframe: result.anchor.world_from_keyframe,
            objects: Vec::new(),
            remapped: result.remapped.clone(),
        };
        self.history.add_saved(self.lines.len(), &frame);
        self.lines.push(shown_frames::line(&result.output.segments, result.regions.as_ref())?);
        Ok(())
    }

    /// Decides and scores the frames again. `None` if the method cannot.
    ///
    /// # Errors
    /// If a frame cannot be read again or scored.
    pub fn decide_again(
        &self,
        scene: &Arc<dyn Scene>,
        inputs: &JobInputs,
        pipeline: &mut Pipeline,
    ) -> Result<Option<FinalScores>, String> {
        fn text(error: impl Display) -> String {
            error.to_string()
        }
        let started = Instant::now();
        pipeline.settle();
        let mut depth = pipeline.take_depth_again();
        let Some(hindsight) = pipeline.hindsight() else { return Ok(None) };
        let corrections = self.history.pose_corrections(&pipeline.keyframes());
        let scorer = |protocol| VideoScorer::new(ScoreSettings { protocol, ..inputs.score });
        let mut scorers = [Protocol::Paper, Protocol::Strict].map(scorer);
        let dataset = &inputs.settings.dataset;
        let stream = FrameStream::open(Arc::clone(scene), dataset, GroundTruth::Read).map_err(text)?;
        let mut frames = self.history.written().iter().zip(&self.lines).enumerate().peekable();
        let (mut time, mut started) = (started.elapsed(), Instant::now());
        for streamed in stream {
            let Ok(streamed) = streamed else { continue };
            let next = frames.next_if(|(_, (frame, _))| frame.index == streamed.index);
            let Some((position, (_, line))) = next else { continue };
            let line = String::from_utf8_lossy(line);
            let mut earlier = self.history.earlier(position, (streamed.frame, &line), &corrections).map_err(text)?;
            if let Some(depth) = &mut depth {
                earlier.frame = depth.frame(earlier.frame).map_err(text)?;
            }
            let segments = earlier.decided(&hindsight).map_err(text)?.segments;
            time += started.elapsed();
            if let Some(truth) = &streamed.ground_truth {
                for scorer in &mut scorers {
                    scorer.push(truth, &FramePrediction::Ids(&segments)).map_err(text)?;
                }
            }
            started = Instant::now();
        }
        if frames.next().is_some() {
            return Err("a frame could not be read again".to_owned());
        }
        let [paper, strict] = scorers.map(VideoScorer::finish);
        Ok(Some(FinalScores { paper, strict, seconds: time.as_secs_f64() }))
    }
}

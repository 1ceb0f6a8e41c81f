//! Scores of results that are decided again some frames later, as `live --lag` shows them.

use super::job::{FinalScores, JobInputs};
use splatseg::Pipeline;
use splatseg::pipeline::{FrameResult, WaitingFrames};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, VideoScorer};
use std::time::{Duration, Instant};

/// The frames of a job that wait to be decided again, and the scores of those that were.
pub struct LateResults {
    lag: usize,
    waiting: WaitingFrames<Option<SegmentMap>>,
    scorers: [VideoScorer; 2],
    time: Duration,
}

impl LateResults {
    /// Without frames.
    pub fn new(inputs: &JobInputs) -> Self {
        let scorer = |protocol| VideoScorer::new(ScoreSettings { protocol, ..inputs.score });
        Self {
            lag: inputs.settings.run.late_frames,
            waiting: WaitingFrames::default(),
            scorers: [Protocol::Paper, Protocol::Strict].map(scorer),
            time: Duration::ZERO,
        }
    }

    /// Adds the next frame, and scores those that have waited long enough.
    ///
    /// # Errors
    /// If a frame cannot be decided or scored.
    pub fn add(
        &mut self,
        frame: RgbdFrame<'static>,
        result: FrameResult,
        truth: Option<SegmentMap>,
        pipeline: &mut Pipeline,
    ) -> Result<(), String> {
        self.waiting.add(frame, result, truth);
        let lag = self.lag;
        self.score(pipeline, |after| after >= lag)
    }

    /// Scores the frames that still wait.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn finish(mut self, pipeline: &mut Pipeline) -> Result<FinalScores, String> {
        self.score(pipeline, |_| true)?;
        let [paper, strict] = self.scorers.map(VideoScorer::finish);
        Ok(FinalScores { paper, strict, seconds: self.time.as_secs_f64() })
    }

    /// Scores the frames for which `is_due` returns true, given the number of frames after them.
    fn score(&mut self, pipeline: &mut Pipeline, is_due: impl Fn(usize) -> bool) -> Result<(), String> {
        loop {
            let started = Instant::now();
            let late = self.waiting.next_due(pipeline, |_, after| is_due(after)).map_err(|error| error.to_string())?;
            self.time += started.elapsed();
            let Some(late) = late else { return Ok(()) };
            if let Some(truth) = &late.belongings {
                for scorer in &mut self.scorers {
                    scorer
                        .push(truth, &FramePrediction::Ids(&late.result.output.segments))
                        .map_err(|error| format!("frame {}: {error}", late.frame.name()))?;
                }
            }
        }
    }
}

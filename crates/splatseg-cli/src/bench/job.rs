//! A job of a benchmark: one method on one scene with one seed.

use super::final_pass::EarlierFrames;
use super::input_files::InputFile;
use super::late_results::LateResults;
use super::machine;
use super::mesh_files::MeshFiles;
use super::pictures::{StripFrames, jpeg_data_uri};
use serde::{Deserialize, Serialize};
use splatseg::pipeline::{FrameResult, Pipeline, PipelineError, Processed, StageTimes};
use splatseg::settings::{MethodName, Settings};
use splatseg::summary::{FramesPerSecond, RunCounts};
use splatseg_dataset::{FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{FrameAnchor, MapView, Mask, QuarterTurn, RgbdFrame, SegmentMap};
use splatseg_metrics::{FramePrediction, InstanceScorer, Protocol, ScoreSettings, VideoScore, VideoScorer};
use splatseg_odometry::{CameraPose, InputDoubt};
use splatseg_report::{Series, Thumbnail};
use splatseg_tracking::{FrameOutput, TrackErrorCounts};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Everything that affects a result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobInputs {
    /// Path of the scene as text.
    pub scene: String,
    /// All settings. `threads` is 0, as it does not affect results.
    pub settings: Settings,
    /// Score settings. The protocol is ignored: scores in both protocols are computed.
    pub score: ScoreSettings,
    /// The scene's mesh with true instances, if it has one.
    pub mesh: Option<MeshFiles>,
    /// The input files: scene, mesh, masks, weights.
    pub files: Vec<InputFile>,
    /// Version of splatseg.
    pub version: String,
}

/// The result of a job, as stored in its file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobResult {
    /// Inputs of the result.
    pub inputs: JobInputs,
    /// Fingerprint of the program that measured it. Two builds of one version may give different results.
    pub program: String,
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be read. They are not scored.
    pub skipped_frames: usize,
    /// Frames on which the segmenter failed. They are scored as empty.
    pub failed_frames: usize,
    /// Distinct ids in the results.
    pub segments: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Number of parameters of the memory at the end.
    pub parameters: usize,
    /// Speed, excluding scoring.
    pub fps: FramesPerSecond,
    /// Mean time of each stage per frame, milliseconds.
    pub stage_ms: BTreeMap<String, f64>,
    /// Tracker errors that the method found and corrected.
    pub track_errors: TrackErrorCounts,
    /// Score in the protocol `paper`.
    pub paper: VideoScore,
    /// Score in the protocol `strict`.
    pub strict: VideoScore,
    /// Scores of the frames as the map of the end decides them; `None` with `online`, and if the method cannot.
    pub final_pass: Option<FinalScores>,
    /// Scores of the frames as they are decided `late_frames` later; `None` with 0, and if the method cannot.
    pub late: Option<FinalScores>,
    /// The processor or GPU that it was measured on.
    pub machine: String,
    /// Score of 3D instances on the vertices of the scene's mesh, if the scene has a mesh and the method a memory.
    pub mesh: Option<InstanceScorer>,
    /// Values over the frames, for curves.
    pub series: Series,
    /// Thumbnails of some of the frames.
    pub strip: Vec<Thumbnail>,
}

/// Scores of frames that were decided again: after the final pass, or some frames later.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinalScores {
    /// Score in the protocol `paper`.
    pub paper: VideoScore,
    /// Score in the protocol `strict`.
    pub strict: VideoScore,
    /// Time of that without scoring, seconds.
    pub seconds: f64,
}

impl FinalScores {
    /// The score in a protocol.
    pub fn score(&self, protocol: Protocol) -> &VideoScore {
        match protocol {
            Protocol::Paper => &self.paper,
            Protocol::Strict => &self.strict,
        }
    }
}

impl JobResult {
    /// The score in a protocol.
    pub fn score(&self, protocol: Protocol) -> &VideoScore {
        match protocol {
            Protocol::Paper => &self.paper,
            Protocol::Strict => &self.strict,
        }
    }

    /// Drops the pictures, the curves and the inputs' hashes, which are needed only in the file. A benchmark keeps tens of
    /// thousands of results in memory.
    pub fn without_drawings(mut self) -> Self {
        self.inputs.files = Vec::new();
        Self { series: Series::default(), strip: Vec::new(), ..self }
    }

    /// Formats a short summary for the terminal.
    pub fn short_summary(&self) -> String {
        let scores = self.paper.scores();
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
        let (vsq, stq) = (number(scores.vsq), number(scores.stq));
        let late = self.late.as_ref().map_or_else(String::new, |late| {
            let (frames, scores) = (self.inputs.settings.run.late_frames, late.paper.scores());
            format!("; {frames} frames later VSQ {}, STQ {}", number(scores.vsq), number(scores.stq))
        });
        format!("VSQ {vsq}, STQ {stq} (protocol paper), {:.2} frames per second{late}", self.fps.total)
    }
}

/// Runs a job on the scene at `path`.
pub fn run(path: &Path, inputs: &JobInputs) -> Result<JobResult, String> {
    let text = |error: &dyn std::fmt::Display| error.to_string();
    let settings = &inputs.settings;
    let scene = open_scene(path, &settings.dataset).map_err(|error| text(&error))?;
    if !scene.has_ground_truth() {
        return Err(format!("{}: the scene has no ground truth", inputs.scene));
    }
    let stream =
        FrameStream::open(Arc::clone(&scene), &settings.dataset, GroundTruth::Read).map_err(|error| text(&error))?;
    let mut pipeline = Pipeline::builder(settings).scene(&scene).build().map_err(|error| text(&error))?;
    let mut recorder = Recorder::new(inputs, stream.len());
    let has_final_pass = !settings.run.online && pipeline.hindsight().is_some();
    let mut earlier = has_final_pass.then(EarlierFrames::default);
    let is_late = settings.run.late_frames > 0 && pipeline.hindsight().is_some();
    let mut late = is_late.then(|| LateResults::new(inputs));
    let mut frames = pipeline.run(stream);
    let mut time = Duration::ZERO;
    for position in 0.. {
        let started = Instant::now();
        let Some(item) = frames.next() else {
            break;
        };
        let processed = match item {
            Ok(processed) => processed,
            Err(error) if settings.run.strict_input => return Err(error.to_string()),
            Err(error) => {
                recorder.skip(&error.to_string());
                continue;
            }
        };
        if let (true, Err(error)) = (settings.run.strict_input, &processed.result) {
            return Err(error.to_string());
        }
        let (frame, result) = result_or_empty(processed, &mut recorder)?;
        // The method's time excludes scoring and drawing.
        time += started.elapsed();
        tell(&result.doubts, inputs)?;
        recorder.record(position, &frame, &result, frames.latest_map())?;
        if let Some(frames) = &mut earlier {
            frames.add(frame.index, &result).map_err(|error| text(&error))?;
        }
        if let Some(late) = &mut late {
            late.add(frame.frame, result, frame.ground_truth, frames.pipeline_mut())?;
        }
    }
    let mut doubts = pipeline.finish();
    doubts.retain(|doubt| doubt.kind.is_contradiction());
    tell(&doubts, inputs)?;
    let late = late.map(|late| late.finish(&mut pipeline)).transpose()?;
    let again = |frames: EarlierFrames| frames.decide_again(&scene, inputs, &mut pipeline);
    let final_pass = earlier.map(again).transpose()?.flatten();
    let mesh = inputs.mesh.as_ref().zip(pipeline.map());
    let mesh = mesh.map(|(mesh, map)| mesh.score(&map)).transpose()?;
    Ok(JobResult { mesh, final_pass, late, ..recorder.finish(inputs, pipeline.map(), time)? })
}

/// Warns about input that contradicts itself, which is an error with `strict_input`.
fn tell(doubts: &[InputDoubt], inputs: &JobInputs) -> Result<(), String> {
    for doubt in doubts {
        let text = format!("{}: {}", inputs.scene, doubt.text);
        if inputs.settings.run.strict_input {
            return Err(text);
        }
        tracing::warn!("{text}");
    }
    Ok(())
}

/// A frame to score.
struct ScoredFrame {
    /// Its index in the scene.
    index: usize,
    frame: RgbdFrame<'static>,
    ground_truth: Option<SegmentMap>,
}

/// Returns a frame with its result, or with an empty result if the segmenter failed.
fn result_or_empty(
    Processed { index, frame, ground_truth, result }: Processed,
    recorder: &mut Recorder,
) -> Result<(ScoredFrame, FrameResult), String> {
    let pose = CameraPose::given(*frame.world_from_camera());
    let frame = ScoredFrame { index, frame, ground_truth };
    match result {
        Ok(result) => Ok((frame, result)),
        Err(error @ PipelineError::Segmenter { .. }) => {
            recorder.fail(&error.to_string());
            let segments = SegmentMap::filled(frame.frame.width(), frame.frame.height(), 0);
            let output = FrameOutput::from_segments(segments);
            let (objects, times) = (Vec::new(), StageTimes::default());
            Ok((
                frame,
                FrameResult {
                    output,
                    regions: None,
                    objects,
                    times,
                    pose,
                    anchor: FrameAnchor::default(),
                    turn: QuarterTurn::None,
                    remapped: Vec::new(),
                    events: Vec::new(),
                    doubts: Vec::new(),
                },
            ))
        }
        Err(error) => Err(error.to_string()),
    }
}

/// Form in which a method's results are scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// One id per pixel.
    Ids,
    /// Masks with ids, which may overlap.
    Masks,
    /// Masks without ids, which the evaluation links.
    Unlinked,
}

/// Returns the form in which a method's results are scored. The paper's code itself links the masks of FastSAM and of
/// FastSPAM, whose program writes no ids. According to the paper, FastSPAM's points carry ids from frame to frame, so
/// `strict` uses these ids. A tracker's masks have ids and may overlap.
fn form(method: MethodName, protocol: Protocol) -> Form {
    match (method, protocol) {
        (MethodName::Fastsam, _) | (MethodName::Fastspam, Protocol::Paper) => Form::Unlinked,
        (MethodName::Fastspam, Protocol::Strict) | (MethodName::Sam2 | MethodName::Sam2Splat, _) => Form::Masks,
        _ => Form::Ids,
    }
}

/// Records and scores a method's results.
struct Recorder {
    method: MethodName,
    paper: VideoScorer,
    strict: VideoScorer,
    counts: RunCounts,
    failed_frames: usize,
    first_trouble: Option<String>,
    series: Series,
    strip_frames: StripFrames,
    strip: Vec<Thumbnail>,
}

impl Recorder {
    fn new(inputs: &JobInputs, frames: usize) -> Self {
        let scorer = |protocol| VideoScorer::new(ScoreSettings { protocol, ..inputs.score });
        Self {
            method: inputs.settings.method.name(),
            paper: scorer(Protocol::Paper),
            strict: scorer(Protocol::Strict),
            counts: RunCounts::default(),
            failed_frames: 0,
            first_trouble: None,
            series: Series::default(),
            strip_frames: StripFrames::of(frames),
            strip: Vec::new(),
        }
    }

    fn skip(&mut self, reason: &str) {
        self.counts.skipped_frames += 1;
        tracing::warn!("frame skipped: {reason}");
        self.first_trouble.get_or_insert_with(|| reason.to_owned());
    }

    fn fail(&mut self, reason: &str) {
        self.failed_frames += 1;
        tracing::warn!("frame scored as empty: {reason}");
        self.first_trouble.get_or_insert_with(|| reason.to_owned());
    }

    fn record(
        &mut self,
        position: usize,
        frame: &ScoredFrame,
        result: &FrameResult,
        map: Option<MapView<'_>>,
    ) -> Result<(), String> {
        let gaussians = map.map(|map| map.gaussian_count());
        self.counts.add(result, gaussians.unwrap_or(0));
        self.series.push(result.times.stages().iter().copied(), gaussians);
        let output = &result.output;
        if let Some(truth) = &frame.ground_truth {
            self.score(truth, output).map_err(|error| format!("frame {}: {error}", frame.frame.name()))?;
        }
        if self.strip_frames.contains(position) {
            let image = jpeg_data_uri(frame.frame.color(), Some(&output.segments))?;
            self.strip.push(Thumbnail { frame: frame.frame.name().to_owned(), image });
        }
        Ok(())
    }

    fn score(&mut self, truth: &SegmentMap, output: &FrameOutput) -> Result<(), splatseg_metrics::MetricsError> {
        let confidences = output.segment_confidences();
        for (protocol, scorer) in [(Protocol::Paper, &mut self.paper), (Protocol::Strict, &mut self.strict)] {
            let mut push =
                |prediction, confidences| scorer.push_with_confidences(truth, &prediction, Some(confidences));
            match form(self.method, protocol) {
                Form::Ids => push(FramePrediction::Ids(&output.segments), &confidences)?,
                Form::Masks => push(FramePrediction::Masks(&output.masks), &confidences)?,
                Form::Unlinked => {
                    let masks: Vec<Mask> = output.masks.iter().map(|(_, mask)| mask.clone()).collect();
                    let ids = (1..).zip(&output.masks);
                    let by_index = ids.filter_map(|(index, (id, _))| Some((index, *confidences.get(id)?))).collect();
                    push(FramePrediction::Unlinked(&masks), &by_index)?;
                }
            }
        }
        Ok(())
    }

    fn finish(self, inputs: &JobInputs, map: Option<MapView<'_>>, time: Duration) -> Result<JobResult, String> {
        let useless = |what: &str| {
            let reason = self.first_trouble.as_ref().map(|reason| format!(": {reason}")).unwrap_or_default();
            Err(format!("{}: {what}{reason}", inputs.scene))
        };
        if self.counts.frames == 0 {
            return useless("none of the frames could be used");
        }
        if self.failed_frames == self.counts.frames {
            return useless("the segmenter failed on every frame");
        }
        if self.paper.frames() == 0 {
            return useless("none of the frames has ground truth");
        }
        Ok(JobResult {
            inputs: inputs.clone(),
            program: String::new(),
            frames: self.counts.frames,
            skipped_frames: self.counts.skipped_frames,
            failed_frames: self.failed_frames,
            segments: self.counts.ids.len(),
            gaussians: map.map_or(0, |map| map.gaussian_count()),
            parameters: map.map_or(0, |map| map.parameter_count()),
            fps: self.counts.fps(time),
            stage_ms: self.counts.stage_ms(),
            track_errors: self.counts.track_errors,
            paper: self.paper.finish(),
            strict: self.strict.finish(),
            machine: machine::name(&inputs.settings),
            final_pass: None,
            late: None,
            mesh: None,
            series: self.series,
            strip: self.strip,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_protocol_makes_the_ids_of_methods_that_have_none() {
        assert_eq!(form(MethodName::Fastsam, Protocol::Paper), Form::Unlinked);
        assert_eq!(form(MethodName::Fastspam, Protocol::Paper), Form::Unlinked);
        assert_eq!(form(MethodName::Fastspam, Protocol::Strict), Form::Masks);
        assert_eq!(form(MethodName::FastsamSplat, Protocol::Paper), Form::Ids);
    }
}

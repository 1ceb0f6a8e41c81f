//! The loop over the frames of a run, until the last frame or an early end.

use super::camera_messages::{CameraMessages, misfit};
use super::progress::Progress;
use super::result_writer::{ResultWriter, WriterOutcome};
use super::saved_run::RunState;
use super::skipped_frames::SkippedFrames;
use super::stop_signals::{StopSignal, StopSignals};
use crate::Failure;
use crate::output_folder::file_name;
use crate::system_limits::no_thread;
use splatseg::odometry::InputDoubt;
use splatseg::pipeline::{Frames, PipelineError, Processed};
use splatseg::summary::RunCounts;
use splatseg_dataset::FrameSource;
use splatseg_geometry::MapView;
use splatseg_output::FrameRecord;
use std::path::PathBuf;

/// Options of the frame loop.
pub struct FrameLoop<'a> {
    /// Signals that stop the run.
    pub signals: &'a StopSignals,
    /// If true, the first frame that cannot be used ends the run, and so does input that contradicts itself.
    pub strict_input: bool,
    /// True if the run starts with a saved map.
    pub has_loaded_map: bool,
    /// Options for saving the state of the run, if enabled.
    pub saving: Option<StateSaving>,
}

/// Options for saving the state of the run periodically.
pub struct StateSaving {
    /// Interval between saves, frames of the scene.
    pub every: usize,
    /// The state that the run starts from.
    pub state: RunState,
    /// The folder where the memory is first written.
    pub staging: PathBuf,
}

/// The outcome of the frame loop.
pub struct LoopOutcome {
    /// Counts over the frames.
    pub counts: RunCounts,
    /// The written images and outputs.
    pub written: WriterOutcome,
    /// Reason if the run ended before the last frame.
    pub early: Option<EarlyEnd>,
}

/// Reason why a run ended before the last frame.
pub enum EarlyEnd {
    /// A signal was received.
    Signal(StopSignal),
    /// A frame cannot be used, with `strict_input`.
    UnusableFrame(String),
    /// The poses or calibration that came with the frames contradict their images, with `strict_input`.
    Contradiction(String),
    /// The method failed.
    Method(String),
    /// No more images can be written.
    Unwritable,
}

/// The outcome of one frame.
enum Step {
    /// The frame has a result. `messages` are about the camera, `doubts` about the input.
    Done { messages: Vec<String>, doubts: Vec<InputDoubt> },
    /// The frame was skipped. `message` is set for the first frame with this kind of reason.
    Skipped { message: Option<String>, error: String },
    /// The run ends.
    End(EarlyEnd),
}

/// Messages to the user during the run.
#[derive(Default)]
struct Reports {
    skipped: SkippedFrames,
    camera: CameraMessages,
}

impl FrameLoop<'_> {
    /// Processes every frame and writes its results.
    ///
    /// # Errors
    /// If the thread that writes them cannot be started.
    pub fn run(
        &self,
        mut frames: Frames<'_, impl FrameSource>,
        written: WriterOutcome,
        mut counts: RunCounts,
    ) -> Result<LoopOutcome, Failure> {
        let told_turn = self.saving.as_ref().map(|saving| saving.state.turn).unwrap_or_default();
        let camera = CameraMessages::new(self.has_loaded_map, told_turn);
        let mut reports = Reports { camera, ..Reports::default() };
        let writer = ResultWriter::start(written).map_err(|error| no_thread("writes the results", &error))?;
        let mut done = self.saving.as_ref().map_or(0, |saving| saving.state.next);
        let mut progress = Progress::new(frames.frames_left());
        let early = loop {
            if let Some(signal) = self.signals.received().filter(|_| frames.frames_left() != Some(0)) {
                counts.interrupted = true;
                self.save_state((done, &counts, &reports.camera), &frames, &writer, &progress);
                break Some(EarlyEnd::Signal(signal));
            }
            let Some(item) = frames.next() else { break None };
            let step = match item {
                Ok(processed) => record_result(processed, frames.latest_map(), &writer, &mut counts, &mut reports),
                Err(error) => Step::Skipped { message: reports.skipped.add_unusable(&error), error: error.to_string() },
            };
            match step {
                Step::Done { messages, doubts } => {
                    messages.iter().for_each(|message| progress.say(message));
                    if let Some(contradiction) = self.tell(&doubts, &progress, &mut counts) {
                        break Some(contradiction);
                    }
                }
                Step::Skipped { error, .. } if self.strict_input => break Some(EarlyEnd::UnusableFrame(error)),
                Step::Skipped { message, .. } => {
                    counts.skipped_frames += 1;
                    message.iter().for_each(|message| progress.warn(&format!("frame skipped: {message}")));
                }
                Step::End(early) => break Some(early),
            }
            progress.frame_done();
            done += 1;
            if self.saving.as_ref().is_some_and(|saving| done.is_multiple_of(saving.every)) {
                self.save_state((done, &counts, &reports.camera), &frames, &writer, &progress);
            }
        };
        progress.finish();
        let (contradictions, hints): (Vec<_>, Vec<_>) =
            frames.finish().into_iter().partition(|doubt| doubt.kind.is_contradiction());
        let early = early.or_else(|| self.tell(&contradictions, &progress, &mut counts));
        tell_at_end(&reports, &hints, &progress, &mut counts);
        Ok(LoopOutcome { counts, written: writer.finish(), early })
    }

    /// Warns about input that contradicts itself, which ends the run with `strict_input`.
    fn tell(&self, doubts: &[InputDoubt], progress: &Progress, counts: &mut RunCounts) -> Option<EarlyEnd> {
        for doubt in doubts {
            counts.add_doubt(doubt);
            if self.strict_input {
                return Some(EarlyEnd::Contradiction(doubt.text.clone()));
            }
            progress.warn(&doubt.text);
        }
        None
    }

    /// Saves the state after the first `done` frames of the scene, if enabled.
    fn save_state(
        &self,
        (done, counts, camera): (usize, &RunCounts, &CameraMessages),
        frames: &Frames<'_, impl FrameSource>,
        writer: &ResultWriter,
        progress: &Progress,
    ) {
        let Some(saving) = &self.saving else { return };
        let state = RunState {
            next: done,
            frames: counts.frames,
            skipped_frames: counts.skipped_frames,
            track_errors: counts.track_errors,
            pose_events: counts.pose_events,
            input_doubts: counts.input_doubts.clone(),
            turn: camera.turn(),
            ..saving.state.clone()
        };
        let path = saving.staging.join(state.memory_file());
        match frames.save_memory(&path) {
            Ok(true) => writer.save_state(state, path, frames.saved_poses()),
            Ok(false) => {}
            Err(error) => progress.warn(&format!("the state of the run could not be saved: {error}")),
        }
    }
}

/// Warns about what is known at the end only.
fn tell_at_end(reports: &Reports, hints: &[InputDoubt], progress: &Progress, counts: &mut RunCounts) {
    let not_found = reports.camera.at_end().map(str::to_owned);
    let messages = reports.skipped.messages().chain(not_found).chain(misfit(counts));
    messages.for_each(|message| progress.warn(&message));
    for hint in hints {
        progress.warn(&hint.text);
        counts.add_doubt(hint);
    }
}

/// Counts a frame's result and passes it to the writer.
fn record_result(
    Processed { index, frame, result, .. }: Processed,
    map: Option<MapView<'_>>,
    writer: &ResultWriter,
    counts: &mut RunCounts,
    reports: &mut Reports,
) -> Step {
    let result = match result {
        Ok(result) => result,
        Err(error @ PipelineError::Segmenter { .. }) => {
            return Step::Skipped { message: reports.skipped.add_unsegmented(&error), error: error.to_string() };
        }
        Err(error) => return Step::End(EarlyEnd::Method(error.to_string())),
    };
    let number = counts.frames;
    counts.add(&result, map.map_or(0, |map| map.gaussian_count()));
    let (file_name, pose_state) = (file_name(frame.name()), result.pose.state);
    let mut messages = reports.camera.add(frame.name(), &result.pose, &result.events, result.remapped.len());
    messages.extend(reports.camera.add_turn(frame.name(), result.turn));
    let doubts = result.doubts;
    let (segments, regions, objects) = (result.output.segments, result.regions, result.objects);
    let (anchor, remapped) = (result.anchor, result.remapped);
    let record =
        FrameRecord { number, index, file_name, pose_state, frame, segments, regions, objects, anchor, remapped };
    if writer.write(record) { Step::Done { messages, doubts } } else { Step::End(EarlyEnd::Unwritable) }
}

//! Processes the frames of a run until the last one, or until something ends it early.

use super::progress::Progress;
use super::result_writer::{ResultWriter, Written};
use super::saved_run::RunState;
use super::skipped_frames::SkippedFrames;
use super::stop_signals::{StopSignal, StopSignals};
use crate::command::output_folder::file_name;
use crate::pipeline::{Frames, PipelineError, Processed};
use crate::summary::RunCounts;
use splatseg_dataset::{FrameStream, StreamedFrame};
use splatseg_memory::SplatMemory;
use splatseg_output::FrameRecord;
use std::path::PathBuf;

/// How frames are processed.
pub struct FrameLoop<'a> {
    /// What may ask the run to end.
    pub signals: &'a StopSignals,
    /// Whether the first frame that cannot be used ends the run.
    pub strict_input: bool,
    /// Saves the state of the run, if that is asked for.
    pub saving: Option<StateSaving>,
}

/// Saves the state of the run from time to time.
pub struct StateSaving {
    /// Every how many frames of the scene.
    pub every: usize,
    /// The state that the run starts from.
    pub state: RunState,
    /// The folder where the memory is saved first.
    pub staging: PathBuf,
}

/// What came of the frames.
pub struct Ended {
    /// Counts over the frames.
    pub counts: RunCounts,
    /// Their images.
    pub written: Written,
    /// Why the run ended before the last frame, if it did.
    pub early: Option<EarlyEnd>,
}

/// Why a run ended before the last frame.
pub enum EarlyEnd {
    /// A signal asked for it.
    Signal(StopSignal),
    /// With `strict_input`: a frame cannot be used.
    UnusableFrame(String),
    /// The method failed.
    Method(String),
    /// No more images can be written.
    Unwritable,
}

/// What came of one frame.
enum Step {
    /// It has a result.
    Done,
    /// It was skipped; with a message if it is the first of its kind.
    Skipped { message: Option<String>, error: String },
    /// The run ends.
    End(EarlyEnd),
}

impl FrameLoop<'_> {
    /// Writes the results of every frame.
    pub fn run(&self, mut frames: Frames<'_, FrameStream>, written: Written, mut counts: RunCounts) -> Ended {
        let mut skipped = SkippedFrames::default();
        let writer = ResultWriter::start(written);
        let mut done = self.saving.as_ref().map_or(0, |saving| saving.state.next);
        let mut progress = Progress::of_frames(frames.size_hint().0);
        let early = loop {
            if let Some(signal) = self.signals.received().filter(|_| frames.size_hint().0 > 0) {
                counts.interrupted = true;
                self.save_state(done, &counts, frames.memory(), &writer, &progress);
                break Some(EarlyEnd::Signal(signal));
            }
            let Some(item) = frames.next() else { break None };
            let step = match item {
                Ok(processed) => take_result(processed, frames.memory(), &writer, &mut counts, &mut skipped),
                Err(error) => Step::Skipped { message: skipped.add_unread(&error), error: error.to_string() },
            };
            match step {
                Step::Done => {}
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
                self.save_state(done, &counts, frames.memory(), &writer, &progress);
            }
        };
        progress.finish();
        skipped.messages().for_each(|message| progress.warn(&message));
        Ended { counts, written: writer.finish(), early }
    }

    /// Saves the state after the first `done` frames of the scene, if that is asked for.
    fn save_state(
        &self,
        done: usize,
        counts: &RunCounts,
        memory: Option<&SplatMemory>,
        writer: &ResultWriter,
        progress: &Progress,
    ) {
        let Some((saving, memory)) = self.saving.as_ref().zip(memory) else { return };
        let state = RunState {
            next: done,
            frames: counts.frames,
            skipped_frames: counts.skipped_frames,
            track_errors: counts.track_errors,
            ..saving.state.clone()
        };
        let path = saving.staging.join(state.memory_file());
        match memory.save(&path) {
            Ok(()) => writer.save_state(state, path),
            Err(error) => progress.warn(&format!("the state of the run could not be saved: {error}")),
        }
    }
}

/// Counts a frame's result and hands it to the writer.
fn take_result(
    Processed { frame, result }: Processed<StreamedFrame>,
    memory: Option<&SplatMemory>,
    writer: &ResultWriter,
    counts: &mut RunCounts,
    skipped: &mut SkippedFrames,
) -> Step {
    let frame = frame.frame;
    let result = match result {
        Ok(result) => result,
        Err(error @ PipelineError::Segmenter { .. }) => {
            return Step::Skipped { message: skipped.add_unsegmented(&error), error: error.to_string() };
        }
        Err(error) => return Step::End(EarlyEnd::Method(error.to_string())),
    };
    let number = counts.frames;
    counts.add(&result, memory.map_or(0, SplatMemory::gaussian_count));
    let file_name = file_name(frame.name());
    let record = FrameRecord { number, file_name, frame, segments: result.output.segments, objects: result.objects };
    if writer.write(record) { Step::Done } else { Step::End(EarlyEnd::Unwritable) }
}

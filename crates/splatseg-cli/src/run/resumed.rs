//! The start of a run, which may resume an earlier one.

use super::RunJob;
use super::result_writer::{Saving, Shown, WriterOutcome};
use super::saved_run::{BegunRun, StateWriter};
use super::shown_frames::{SHOWN, ShownFile};
use crate::Failure;
use crate::output_folder::OutputFolder;
use splatseg::summary::{PoseStateCounts, RunCounts, needs_rgb};
use splatseg_files::read_file;
use splatseg_output::{OutputError, RunOutput};
use std::fmt::Display;
use std::io;
use std::path::Path;

/// Largest saved state of an output that is read, bytes.
const MAX_OUTPUT_BYTES: u64 = 1 << 32;

/// The outputs of a run before its first new frame.
#[derive(Default)]
pub struct Outputs {
    /// The active outputs.
    outputs: Vec<Box<dyn RunOutput>>,
    /// Errors of the outputs that failed in the earlier run.
    lost: Vec<OutputError>,
}

/// Returns the writer's state and the counts before the first new frame, taken from the earlier run if there is one.
/// With `has_final_pass`, it is kept what frames show.
///
/// # Errors
/// If the state of the run cannot be written.
pub fn start(
    job: &RunJob,
    folder: OutputFolder,
    Outputs { outputs, lost }: Outputs,
    has_final_pass: bool,
) -> Result<(WriterOutcome, RunCounts), Failure> {
    let is_saved = job.settings.run.save_every > 0;
    let shown = match (has_final_pass, is_saved) {
        (false, _) => Shown::Nowhere,
        (true, true) => Shown::WithState,
        (true, false) => {
            let earlier = job
                .resume
                .as_ref()
                .map(|saved| saved.lines(SHOWN).map_err(|error| wrong_in(&saved.lines_file(SHOWN), &error)));
            let earlier = earlier.transpose()?.unwrap_or_default();
            Shown::File(ShownFile::create(folder.staging(), earlier).map_err(Failure::runtime)?)
        }
    };
    let Some(saved) = &job.resume else {
        let begun = BegunRun { load_memory: job.load_memory.as_ref().map(|path| path.display().to_string()) };
        let saving = if is_saved { Saving::Later(begun) } else { Saving::Off };
        return Ok((WriterOutcome::new(folder, outputs, saving, shown), RunCounts::default()));
    };
    inform!("going on after frame {} of the scene", saved.state.next);
    let saving = match is_saved {
        true => Saving::On(StateWriter::resume(&job.out, saved).map_err(Failure::runtime)?),
        false => Saving::Off,
    };
    let mut written = WriterOutcome::new(folder, outputs, saving, shown);
    written.frames = saved.state.frames;
    written.output_errors = lost;
    saved.frames.iter().enumerate().for_each(|(number, frame)| written.history.add_saved(number, frame));
    let mut pose_states = PoseStateCounts::default();
    saved.frames.iter().for_each(|frame| pose_states.add(frame.pose_state));
    let mut counts = RunCounts {
        pose_states,
        frames: saved.state.frames,
        resumed_frames: saved.state.frames,
        skipped_frames: saved.state.skipped_frames,
        track_errors: saved.state.track_errors,
        pose_events: saved.state.pose_events,
        input_doubts: saved.state.input_doubts.clone(),
        rgb_id_images: saved.frames.iter().filter(|frame| needs_rgb(&frame.objects)).count(),
        ..RunCounts::default()
    };
    for frame in &saved.frames {
        counts.remap(&frame.remapped);
        counts.ids.extend(frame.objects.iter().map(|object| object.id));
    }
    Ok((written, counts))
}

/// Creates an error about a saved file that cannot be used.
fn wrong_in(path: &Path, error: &dyn Display) -> Failure {
    Failure::input(format!("{}: {error}: start the run again with --overwrite", path.display()))
}

/// Restores the state of each output from the earlier run, if there is one.
///
/// # Errors
/// If a saved file is damaged, or images of the earlier run are missing.
pub fn restore(job: &RunJob, outputs: Vec<Box<dyn RunOutput>>) -> Result<Outputs, Failure> {
    let Some(saved) = &job.resume else { return Ok(Outputs { outputs, lost: Vec::new() }) };
    saved.require_images(&job.out, job.settings.run.overlay)?;
    let mut restored = Outputs::default();
    for mut output in outputs {
        let path = saved.output_file(output.name());
        let wrong = |error: &dyn Display| wrong_in(&path, error);
        match read_file(&path, MAX_OUTPUT_BYTES) {
            Ok(state) => {
                let lines = saved.lines(output.name());
                let lines = lines.map_err(|error| wrong_in(&saved.lines_file(output.name()), &error))?;
                output.restore(&lines, &state).map_err(|error| wrong(&error))?;
                restored.outputs.push(output);
            }
            Err(error) if !path.exists() => {
                restored.lost.push(OutputError::Read { path, source: io::Error::other(error) });
            }
            Err(error) => return Err(wrong(&error)),
        }
    }
    Ok(restored)
}

//! The start of a run, which may go on with an earlier one.

use super::Job;
use super::result_writer::{Saving, Written};
use super::saved_run::{SavedFrame, SavedRun, StateWriter, id_image};
use crate::command::Failure;
use crate::command::output_folder::OutputFolder;
use splatseg::summary::RunCounts;
use splatseg_dataset::{Scene, read_segments_png};
use splatseg_output::{FrameRecord, RunOutput};

/// What is written before the first new frame, and the counts up to there: those of the earlier run, if there is one. Its
/// frames are shown to the outputs again.
///
/// # Errors
/// If a frame of the earlier run cannot be read any more.
pub fn start(
    job: &Job,
    folder: OutputFolder,
    outputs: Vec<Box<dyn RunOutput>>,
    scene: &dyn Scene,
) -> Result<(Written, RunCounts), Failure> {
    let is_saved = job.settings.run.save_every > 0;
    let Some(saved) = &job.resume else {
        let saving = if is_saved { Saving::Later } else { Saving::Off };
        return Ok((Written::nothing(folder, outputs, saving), RunCounts::default()));
    };
    say_error!("going on after frame {} of the scene", saved.state.next);
    let saving = match is_saved {
        true => Saving::On(StateWriter::start(&job.out, Some(saved)).map_err(Failure::work)?),
        false => Saving::Off,
    };
    let mut written = Written::nothing(folder, outputs, saving);
    let mut counts = RunCounts {
        frames: saved.state.frames,
        resumed_frames: saved.state.frames,
        skipped_frames: saved.state.skipped_frames,
        track_errors: saved.state.track_errors,
        ..RunCounts::default()
    };
    for (number, frame) in saved.frames.iter().enumerate() {
        let record = record(job, saved, (number, frame), scene)?;
        counts.ids.extend(record.segments.areas().into_keys());
        written.frames += 1;
        written.show_outputs(|output, folder| output.add_frame(&record, folder));
    }
    Ok((written, counts))
}

/// A frame of the earlier run as it was then.
fn record(
    job: &Job,
    saved: &SavedRun,
    (number, frame): (usize, &SavedFrame),
    scene: &dyn Scene,
) -> Result<FrameRecord, Failure> {
    let SavedFrame { index, file_name, objects } = frame.clone();
    let path = id_image(&job.out, &file_name);
    let segments = read_segments_png(&path).map_err(Failure::input)?;
    let read = scene.read_frame(index).and_then(|frame| job.settings.dataset.framing().apply(frame));
    let frame = read.map_err(Failure::input)?;
    if segments.size() != (frame.width(), frame.height()) {
        let problem = format!("{}: does not have the size of its frame", path.display());
        return Err(Failure::input(format!("{problem}: {} of {} cannot go on", number + 1, saved.state.frames)));
    }
    Ok(FrameRecord { number, file_name, frame, segments, objects })
}

//! The summary and the messages at the end of a run.

use super::RunJob;
use super::extra_file::ExtraFile;
use super::frame_loop::{EarlyEnd, LoopOutcome};
use crate::Failure;
use crate::terminal::counted;
use splatseg::Pipeline;
use splatseg::pipeline::MapScale;
use splatseg::summary::{PoseStateCounts, RunCounts, Summary, peak_memory_mb};
use splatseg_dataset::Scene;
use splatseg_objects::ObjectCounts;
use splatseg_output::{ObjectsFile, Page, PosesFile};
use std::time::Duration;

/// Times of a run.
#[derive(Clone, Copy, Debug)]
pub struct RunTimes {
    /// Before the first frame.
    pub start_up: Duration,
    /// From the start until all frames were processed and written, without the final pass.
    pub online: Duration,
    /// The final pass, if it was made.
    pub final_pass: Option<Duration>,
}

/// Saves the memory and writes the summary, even after earlier failures. Returns the summary if the run is complete.
pub fn finish(
    job: &RunJob,
    ended: LoopOutcome,
    times: RunTimes,
    (scene, pipeline): (&dyn Scene, &Pipeline),
    file: Option<&ExtraFile>,
) -> Result<Summary, Failure> {
    let LoopOutcome { counts, written, early } = ended;
    let mut folder = written.folder;
    if counts.frames == 0 {
        return Err(match early {
            Some(early) => early.failure("before the first frame; nothing was written"),
            None => Failure::input(format!("{}: none of the frames could be used", job.scene.display())),
        });
    }
    let mut lost = Vec::new();
    if let Some(error) = written.first_error {
        let images = counted(counts.frames - written.frames, "frame");
        lost.push(format!("images of {images} could not be written, the first error: {error}"));
    }
    lost.extend(written.output_errors.iter().map(ToString::to_string));
    if let Some(file) = file
        && let Err(error) = pipeline.save_memory(file.path())
    {
        lost.push(format!("the memory could not be saved: {error}"));
    }
    let frames = counted(counts.frames, "frame");
    let at = if early.is_some() { format!("after {frames}") } else { format!("at the end of {frames}") };
    let mut summary = summary(job, counts, times, (scene, pipeline));
    summary.error = early.as_ref().map(EarlyEnd::reason).into_iter().chain(lost.iter().cloned()).reduce(joined);
    if folder.has_results() {
        let text = summary.to_json(folder.path()).map_err(Failure::runtime)?;
        if let Err(error) = folder.write_summary(&text) {
            lost.push(format!("the summary could not be written: {error}"));
        }
    }
    let resume = if folder.can_be_resumed() { "; resume it with --resume" } else { "" };
    let kept = match (folder.has_results(), lost.is_empty()) {
        (true, true) => format!("{at}; their results are in {}{resume}", folder.path().display()),
        (true, false) => format!("{at}; everything else is in {}{resume}", folder.path().display()),
        (false, _) => format!("{at}; {} has no results", folder.path().display()),
    };
    match (early, lost.into_iter().reduce(joined)) {
        (None, None) => Ok(summary),
        (Some(early), None) => Err(early.failure(&kept)),
        (None, Some(lost)) => Err(Failure::runtime(format!("{lost} ({kept})"))),
        (Some(early), Some(lost)) => Err(Failure::runtime(format!("{}; {lost} ({kept})", early.reason()))),
    }
}

fn joined(text: String, more: String) -> String {
    format!("{text}; {more}")
}

impl EarlyEnd {
    fn reason(&self) -> String {
        match self {
            Self::Signal(signal) => format!("interrupted by {}", signal.name),
            Self::UnusableFrame(error) | Self::Contradiction(error) => format!("{error} (strict_input ends the run)"),
            Self::Method(error) => error.clone(),
            Self::Unwritable => "ended because no more images can be written".to_owned(),
        }
    }

    fn failure(&self, kept: &str) -> Failure {
        let reason = self.reason();
        match self {
            Self::Signal(signal) => Failure::Interrupted { code: signal.exit_code(), text: format!("{reason} {kept}") },
            Self::UnusableFrame(_) | Self::Contradiction(_) => Failure::input(format!("{reason}, {kept}")),
            Self::Method(_) | Self::Unwritable => Failure::runtime(format!("{reason}: ended {kept}")),
        }
    }
}

fn summary(job: &RunJob, counts: RunCounts, times: RunTimes, (scene, pipeline): (&dyn Scene, &Pipeline)) -> Summary {
    let map = pipeline.map();
    let objects = ObjectCounts::new(pipeline.objects(), map);
    Summary {
        frames: counts.frames,
        resumed_frames: counts.resumed_frames,
        skipped_frames: counts.skipped_frames,
        pose_states: counts.pose_states,
        pose_events: counts.pose_events,
        unjoined_frames: counts.unjoined_frames,
        pose_residual: counts.pose_residual(),
        input_doubts: counts.input_doubts.clone(),
        objects: objects.objects,
        tentative_objects: objects.tentative,
        forgotten_objects: objects.forgotten,
        segments: counts.ids.len(),
        remapped_ids: counts.remapped_ids,
        rgb_id_images: counts.rgb_id_images,
        gaussians: map.map_or(0, |map| map.gaussian_count()),
        parameters: map.map_or(0, |map| map.parameter_count()),
        peak_memory_mb: peak_memory_mb(),
        stage_ms: counts.stage_ms(),
        track_errors: counts.track_errors,
        slowest_frame_ms: counts.slowest.as_secs_f64() * 1e3,
        start_up_s: times.start_up.as_secs_f64(),
        final_pass_s: times.final_pass.map(|time| time.as_secs_f64()),
        scale: pipeline.map_scale(),
        guessed_camera: scene.guessed_camera(),
        fps: counts.fps(times.online),
        curve: counts.curve.into_points(),
        interrupted: counts.interrupted,
        error: None,
        scene: job.scene.display().to_string(),
        paths: None,
        settings: job.settings.clone(),
        seed: job.settings.run.seed,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    }
}

/// Formats the message at the end of a run.
pub fn report(job: &RunJob, summary: &Summary) -> String {
    let skipped = match summary.skipped_frames {
        0 => String::new(),
        count => format!(" ({count} skipped)"),
    };
    let memory = summary.peak_memory_mb.map(|peak| format!("; peak memory {peak:.0} MB")).unwrap_or_default();
    let id_images = match summary.rgb_id_images {
        0 => "16-bit images".to_owned(),
        count => format!("16-bit images, or RGB images for the {} with ids above 65535,", counted(count, "frame")),
    };
    let (tentative, forgotten) = (summary.tentative_objects, summary.forgotten_objects);
    let objects = ObjectCounts { objects: summary.objects, tentative, forgotten };
    let ms_without_segmenter = 1e3 / summary.fps.without_segmenter.max(1e-3);
    let mut text = format!(
        "{}{skipped}, {}, {}\n\
         {:.1} frames per second over the whole run, {:.1} s of it before the first frame; without the segmenter, a frame \
         takes {ms_without_segmenter:.1} ms{memory}\n\
         overlays are in {}\nids are in {}, as {id_images} with the id of the object at each pixel; {} describes the run\n\
         the objects are listed in {}, with a picture of each in {}",
        counted(summary.frames, "frame"),
        objects,
        counted(summary.gaussians, "Gaussian"),
        summary.fps.total,
        summary.start_up_s,
        job.out.join("overlay").display(),
        job.out.join("segments").display(),
        job.out.join("summary.json").display(),
        job.out.join(ObjectsFile::JSON).display(),
        job.out.join("objects").display(),
    );
    if let Some(seconds) = summary.final_pass_s {
        text.push_str(&format!("\nthe map of the end has decided the ids of all frames again, in {seconds:.1} s"));
    }
    match summary.scale {
        None => {}
        Some(MapScale::Metres) => {
            text.push_str("\nall depth is predicted, in metres: the first frames fix the scale of the map")
        }
        Some(_) => {
            text.push_str("\nall depth is predicted, without a unit: the size of the map is a guess");
        }
    }
    match summary.pose_states {
        PoseStateCounts { tracked: 0, lost: 0, .. } => {}
        PoseStateCounts { tracked, lost, .. } => {
            let lost = if lost > 0 { format!(", and lost in {lost}") } else { String::new() };
            let place = job.out.join(PosesFile::FILE);
            text.push_str(&format!(
                "\nthe camera was tracked in {}{lost}; its poses are in {}",
                counted(tracked, "frame"),
                place.display()
            ));
        }
    }
    if summary.unjoined_frames > 0 {
        text.push_str(&format!(
            "\n{} in parts of the map that were never joined with the rest: where they are relative to it is not known",
            counted(summary.unjoined_frames, "frame")
        ));
    }
    if summary.remapped_ids > 0 {
        let remapped = counted(summary.remapped_ids, "id");
        text.push_str(&format!("\n{remapped} turned out to be the same object as an older id, which all results show"));
    }
    if let Some(path) = &job.save_memory {
        text.push_str(&format!("\nthe memory is in {}: open it in any Gaussian-splat viewer", path.display()));
    }
    if let Some(path) = &job.save_coco {
        text.push_str(&format!("\nthe masks are in {}, in COCO's format", path.display()));
    }
    if let Some(path) = &job.save_mcap {
        text.push_str(&format!("\nthe recording is in {}: open it in Foxglove or Rerun", path.display()));
    }
    if job.settings.run.page {
        text.push_str(&format!("\nlook at {}", job.out.join(Page::FILE).display()));
    }
    text
}

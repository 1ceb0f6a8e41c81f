//! `splatseg run`: from a recorded video to id images.

use super::Failure;
use super::arguments::RunArguments;
use super::output_folder::{Existing, OutputFolder};
use super::result_writer::{FrameResult, ResultWriter};
use indicatif::{ProgressBar, ProgressStyle};
use splatseg::pipeline::{Frames, PipelineError, Processed};
use splatseg::summary::{RunCounts, Summary, peak_memory_mb};
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{FrameStream, GroundTruth, Scene, StreamedFrame, open_scene, write_atomically};
use splatseg_memory::SplatMemory;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A run.
pub struct Job {
    /// The scene as it was given.
    pub scene: String,
    /// Folder for the results.
    pub out: PathBuf,
    /// What to do with existing results.
    pub existing: Existing,
    /// All settings.
    pub settings: Settings,
    /// Where to save the memory.
    pub save_memory: Option<PathBuf>,
    /// Where to load a memory from.
    pub load_memory: Option<PathBuf>,
}

/// Executes `splatseg run`.
pub fn run(arguments: &RunArguments) -> Result<(), Failure> {
    let job = Job {
        scene: arguments.scene.clone(),
        out: arguments.out.clone(),
        existing: Existing::from_flag(arguments.overwrite),
        settings: arguments.settings()?,
        save_memory: arguments.save_memory.clone(),
        load_memory: arguments.load_memory.clone(),
    };
    let summary = execute(&job)?;
    say!("{}", report(&job, &summary));
    Ok(())
}

/// Runs a job; writes and returns its summary.
pub fn execute(job: &Job) -> Result<Summary, Failure> {
    OutputFolder::check(&job.out, job.existing)?;
    if let Some(path) = &job.save_memory {
        check_save_path(path, job.existing)?;
    }
    rayon::ThreadPoolBuilder::new().num_threads(job.settings.run.threads).build_global().map_err(Failure::work)?;
    job.settings.run.memory_limit.enforce();
    let stop = stop_on_interrupt()?;
    let scene = open_scene(&job.scene, &job.settings.dataset).map_err(Failure::input)?;
    let stream =
        FrameStream::open(Arc::clone(&scene), &job.settings.dataset, GroundTruth::Skip).map_err(Failure::input)?;
    eprintln!("{}", stream.description());
    let mut pipeline = build_pipeline(job, &scene)?;
    if let (Some(path), None) = (&job.save_memory, pipeline.memory()) {
        let method = pipeline.method_name();
        return Err(Failure::input(format!("{}: the method {method} has no memory to save", path.display())));
    }
    let folder = OutputFolder::create(&job.out, job.existing)?;

    let started = Instant::now();
    let counts = process_frames(pipeline.run(stream), &folder, &stop)?;
    if counts.frames == 0 && !counts.interrupted {
        return Err(Failure::input(format!("{}: none of the frames could be used", job.scene)));
    }
    let fps = counts.fps(started.elapsed());
    let memory = pipeline.memory();
    save_memory(job, memory)?;
    let summary = Summary {
        frames: counts.frames,
        skipped_frames: counts.skipped_frames,
        segments: counts.ids.len(),
        tentative_segments: memory.map_or(0, |memory| counts.ids.iter().filter(|id| memory.is_tentative(**id)).count()),
        gaussians: memory.map_or(0, SplatMemory::gaussian_count),
        parameters: memory.map_or(0, SplatMemory::parameter_count),
        peak_memory_mb: peak_memory_mb(),
        stage_ms: counts.stage_ms(),
        track_errors: counts.track_errors,
        slowest_frame_ms: counts.slowest.as_secs_f64() * 1e3,
        fps,
        curve: counts.curve.into_points(),
        interrupted: counts.interrupted,
        scene: job.scene.clone(),
        settings: job.settings.clone(),
        seed: job.settings.run.seed,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let text = serde_json::to_string_pretty(&summary).map_err(Failure::work)?;
    write_atomically(&folder.summary(), text.as_bytes()).map_err(Failure::work)?;
    if counts.interrupted {
        return Err(Failure::Interrupted(format!(
            "interrupted after {} frames; their results are in {}",
            counts.frames,
            folder.path().display()
        )));
    }
    Ok(summary)
}

/// The pipeline that the settings describe.
fn build_pipeline(job: &Job, scene: &Arc<dyn Scene>) -> Result<Pipeline, Failure> {
    let bar = codebook_bar();
    let mut builder =
        Pipeline::builder(&job.settings).scene(scene).progress(|fraction| bar.set_position((fraction * 100.0) as u64));
    if let Some(path) = &job.load_memory {
        builder = builder.saved_memory(path);
    }
    let pipeline = builder.build().map_err(Failure::input);
    bar.finish_and_clear();
    pipeline
}

/// Writes the results of every frame.
fn process_frames(
    mut frames: Frames<'_, FrameStream>,
    folder: &OutputFolder,
    stop: &AtomicBool,
) -> Result<RunCounts, Failure> {
    let mut counts = RunCounts::default();
    let mut writer = ResultWriter::start(folder.clone());
    let bar = progress_bar(frames.size_hint().0);
    loop {
        if stop.load(Ordering::Relaxed) && frames.size_hint().0 > 0 {
            counts.interrupted = true;
            break;
        }
        let Some(item) = frames.next() else { break };
        let skipped = match item {
            Ok(processed) => take_result(processed, frames.memory(), &mut writer, &mut counts)?,
            Err(error) => Some(error.to_string()),
        };
        if let Some(reason) = skipped {
            counts.skipped_frames += 1;
            bar.suspend(|| eprintln!("warning: frame skipped: {reason}"));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    writer.finish().map_err(Failure::work)?;
    Ok(counts)
}

/// Counts and writes the result of a frame. Returns the reason if the frame has none but the run can continue.
fn take_result(
    Processed { frame, result }: Processed<StreamedFrame>,
    memory: Option<&SplatMemory>,
    writer: &mut ResultWriter,
    counts: &mut RunCounts,
) -> Result<Option<String>, Failure> {
    let frame = frame.frame;
    let result = match result {
        Ok(result) => result,
        Err(error @ PipelineError::Segmenter { .. }) => return Ok(Some(error.to_string())),
        Err(error) => return Err(Failure::work(error)),
    };
    counts.add(&result, memory.map_or(0, SplatMemory::gaussian_count));
    let segments = result.output.segments;
    let result = FrameResult { name: frame.name().to_owned(), color: frame.color().clone().into_owned(), segments };
    writer.write(result).map_err(Failure::work)?;
    Ok(None)
}

fn check_save_path(path: &Path, existing: Existing) -> Result<(), Failure> {
    if path.exists() && existing == Existing::Keep {
        return Err(Failure::input(format!("{}: exists: give --overwrite to replace it", path.display())));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Failure::input(format!("{}: the folder {} does not exist", path.display(), folder.display())));
    }
    Ok(())
}

fn save_memory(job: &Job, memory: Option<&SplatMemory>) -> Result<(), Failure> {
    match (&job.save_memory, memory) {
        (Some(path), Some(memory)) => memory.save(path).map_err(Failure::work),
        _ => Ok(()),
    }
}

/// Ctrl-C stops the run after the current frame; a second one ends the program at once.
fn stop_on_interrupt() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if asked.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(Failure::work)?;
    Ok(stop)
}

fn codebook_bar() -> ProgressBar {
    ProgressBar::new(100).with_style(style("codebook {bar:30} {percent}%"))
}

fn progress_bar(frames: usize) -> ProgressBar {
    ProgressBar::new(frames as u64).with_style(style("{bar:40} {pos}/{len} frames, {per_sec}, {eta} left"))
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// The message at the end of a run.
pub fn report(job: &Job, summary: &Summary) -> String {
    let skipped = match summary.skipped_frames {
        0 => String::new(),
        count => format!(" ({count} skipped)"),
    };
    let memory = summary.peak_memory_mb.map(|peak| format!(", peak memory {peak:.0} MB")).unwrap_or_default();
    let mut text = format!(
        "{} frames{skipped}, {} segments, {} Gaussians; {:.1} frames per second ({:.1} without the segmenter{memory})\n\
         overlays are in {}\nids are in {}, as 16-bit images with one value per segment; {} describes the run",
        summary.frames,
        summary.segments,
        summary.gaussians,
        summary.fps.total,
        summary.fps.without_segmenter,
        job.out.join("overlay").display(),
        job.out.join("segments").display(),
        job.out.join("summary.json").display(),
    );
    if let Some(path) = &job.save_memory {
        text.push_str(&format!("\nthe memory is in {}: open it in any Gaussian-splat viewer", path.display()));
    }
    text
}

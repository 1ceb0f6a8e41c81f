//! `splatseg run`: segments a recorded video into id images.
//!
//! `frame_loop.rs` processes the frames, `result_writer.rs` writes their images, `outputs.rs` lists the other outputs, and
//! `report.rs` reports on the run after its end, regular or early.

mod camera_messages;
#[cfg(test)]
mod corrected_run_tests;
mod extra_file;
mod final_ids;
mod final_pass;
mod frame_history;
mod frame_loop;
mod outputs;
mod progress;
mod report;
mod result_writer;
mod resumed;
pub mod saved_run;
pub mod shown_frames;
mod skipped_frames;
mod stop_signals;

pub use extra_file::ExtraFile;
pub use frame_history::FrameHistory;
pub use report::{RunTimes, report};
pub use saved_run::SavedFrame;
pub use saved_run::SavedRun;
pub use skipped_frames::SkippedFrames;
pub use stop_signals::StopSignals;

use super::arguments::RunArguments;
use super::browser;
use super::default_out::default_out;
use super::file_kind::FileKind;
use super::input_paths::{InputPaths, real_path};
use super::inspect::results::not_opened;
use super::manifest::SUMMARY;
use super::map_changes::{self, MapBefore};
use super::output_folder::{OutputFolder, OverwritePolicy};
use super::system_limits::{no_thread, use_threads};
use super::terminal::counted;
use super::{Failure, devices};
use final_ids::{FrameImages, update_frames};
use final_pass::FinalPass;
use frame_loop::{FrameLoop, LoopOutcome, StateSaving};
use progress::codebook_bar;
use result_writer::WriterOutcome;
use saved_run::{LoadedMap, RunState};
use serde_json::Value;
use splatseg::pipeline::{LoadedNetworks, PredictedDepthUse};
use splatseg::settings::MethodName;
use splatseg::summary::Summary;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{FrameSource, FrameStream, GroundTruth, Scene, open_scene};
use splatseg_files::read_file;
use splatseg_objects::MapChanges;
use splatseg_odometry::StateScope;
use splatseg_output::{ChangesSince, Page, ResultFolder, RunEnd, RunOutput};
use splatseg_places::{FloorPlan, PlanSettings};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// File for what has changed since a loaded map.
const CHANGES: &str = "changes.json";

/// Largest summary that is read, bytes.
const MAX_SUMMARY_BYTES: u64 = 16_000_000;

/// A run to execute.
pub struct RunJob {
    /// The scene as given on the command line.
    pub scene: PathBuf,
    /// Folder for the results.
    pub out: PathBuf,
    /// Policy for existing results.
    pub existing: OverwritePolicy,
    /// All settings.
    pub settings: Settings,
    /// File to save the memory to.
    pub save_memory: Option<PathBuf>,
    /// File to load a memory from.
    pub load_memory: Option<PathBuf>,
    /// The run to resume.
    pub resume: Option<SavedRun>,
    /// File to save all masks to, in COCO's format.
    pub save_coco: Option<PathBuf>,
    /// File to save a recording for viewers to.
    pub save_mcap: Option<PathBuf>,
    /// Networks loaded by earlier jobs of this process.
    pub networks: Arc<LoadedNetworks>,
}

impl RunJob {
    /// The output files outside the folder of results.
    fn extra_files(&self) -> impl Iterator<Item = (FileKind, &PathBuf)> {
        let files = [
            (FileKind::MEMORY, &self.save_memory),
            (FileKind::COCO, &self.save_coco),
            (FileKind::MCAP, &self.save_mcap),
        ];
        files.into_iter().filter_map(|(kind, path)| Some((kind, path.as_ref()?)))
    }
}

/// Executes `splatseg run`.
pub fn run(arguments: &RunArguments, program: &[OsString]) -> Result<(), Failure> {
    let out = arguments.out.clone().unwrap_or_else(|| default_out(&arguments.scene, arguments.resume));
    let resume = if arguments.resume { SavedRun::open(&out)? } else { None };
    if arguments.resume && resume.is_none() && is_complete(&out) {
        report!("{}: the run is complete already", out.display());
        return Ok(());
    }
    let has_only_begun = resume.is_none() && arguments.resume && SavedRun::has_only_begun(&out);
    let existing = match &resume {
        Some(_) => OverwritePolicy::Resume,
        None if has_only_begun => {
            inform!("{}: stopped before its state was saved: it starts anew", out.display());
            OverwritePolicy::Replace
        }
        None => OverwritePolicy::from_flag(arguments.overwrite),
    };
    let load_memory = load_memory(arguments, resume.as_ref(), has_only_begun.then_some(&out))?;
    let mut settings = arguments.settings(&out, load_memory.as_deref())?;
    settings.settle_depth(&arguments.scene).map_err(Failure::input)?;
    let extra_file =
        |given: &Option<PathBuf>, kind: FileKind| given.clone().or_else(|| resume.as_ref()?.extra_file(kind.option));
    let job = RunJob {
        scene: arguments.scene.clone(),
        existing,
        settings,
        out,
        save_memory: extra_file(&arguments.save_memory, FileKind::MEMORY),
        load_memory,
        save_coco: extra_file(&arguments.save_coco, FileKind::COCO),
        save_mcap: extra_file(&arguments.save_mcap, FileKind::MCAP),
        resume,
        networks: Arc::default(),
    };
    check_paths(&job, arguments.options.config.as_deref())?;
    devices::check(job.settings.device(), program)?;
    let summary = execute(&job)?;
    report!("{}", report(&job, &summary));
    if arguments.open {
        browser::open(&job.out.join(Page::FILE));
    }
    Ok(())
}

/// The map to start with: that of `--load-memory`, or of the run in `begun`, which was stopped before its first state. A
/// resumed run has loaded it before.
fn load_memory(
    arguments: &RunArguments,
    resume: Option<&SavedRun>,
    begun: Option<&PathBuf>,
) -> Result<Option<PathBuf>, Failure> {
    let given = arguments.load_memory.as_ref();
    let before = match (resume, begun) {
        (Some(saved), _) => saved.state.loaded_map.as_ref().map(|loaded| loaded.path.clone()),
        (None, Some(out)) => SavedRun::begun(out).load_memory,
        (None, None) => return Ok(given.cloned()),
    };
    match given.filter(|given| before.as_ref() != Some(&given.display().to_string())) {
        Some(given) => {
            let before = before.map_or_else(|| "without --load-memory".to_owned(), |path| format!("with {path}"));
            Err(Failure::input(format!(
                "{}: the run was started {before}: leave --load-memory out, or start it again with --overwrite",
                given.display()
            )))
        }
        None => Ok(before.map(PathBuf::from).filter(|_| resume.is_none())),
    }
}

/// Returns true if a folder contains the results of a complete run.
fn is_complete(out: &Path) -> bool {
    let summary = read_file(&out.join(SUMMARY), MAX_SUMMARY_BYTES).ok();
    let summary: Option<Value> = summary.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    summary.is_some_and(|summary| summary["interrupted"] == false && summary["error"].is_null())
}

/// Checks that no output path is an input, and that outputs have what they need.
fn check_paths(job: &RunJob, config: Option<&Path>) -> Result<(), Failure> {
    if job.save_mcap.is_some() && !job.settings.run.overlay {
        let message = "--save-mcap: the recording shows the overlays: expected overlay = true, without --no-overlay";
        return Err(Failure::input(message.to_owned()));
    }
    let mut inputs = InputPaths::of(&job.settings);
    inputs.add_scene(&job.scene);
    if let Some(config) = config {
        inputs.add("the file of --config", config);
    }
    let mut taken = BTreeMap::new();
    for (kind, path) in job.extra_files() {
        let wrong = |message: String| Err(Failure::input(format!("{}: {message}", path.display())));
        let option = kind.option;
        // The new memory may replace the loaded one, which has been read by then.
        inputs.check_output_file(path)?;
        let real = real_path(path);
        let out = real_path(&job.out);
        if OutputFolder::is_result_place(&out, &real) {
            return wrong(format!("is reserved for other results: choose another file for {option}"));
        }
        if out.starts_with(&real) {
            return wrong(format!("is the folder of --out, or one around it: choose a file for {option}"));
        }
        if let Some(other) = taken.insert(real, option) {
            return wrong(format!("is the file of {other}: choose another file for {option}"));
        }
    }
    if let Some(path) = &job.load_memory {
        inputs.add("the file of --load-memory", path);
    }
    for path in job.save_coco.iter().chain(&job.save_mcap) {
        inputs.check_output_file(path)?;
    }
    inputs.check_output_folder(&job.out)
}

/// Runs a job; writes and returns its summary.
pub fn execute(job: &RunJob) -> Result<Summary, Failure> {
    execute_with(job, build_pipeline)
}

/// As [`execute`], with a pipeline that `build` makes for the scene.
fn execute_with(
    job: &RunJob,
    build: impl FnOnce(&RunJob, &Arc<dyn Scene>) -> Result<Pipeline, Failure>,
) -> Result<Summary, Failure> {
    let started = Instant::now();
    OutputFolder::check(&job.out, job.existing)?;
    let outputs = outputs::of(job);
    check_saving(job, &outputs)?;
    let state = match &job.resume {
        Some(saved) => saved.state.clone(),
        None => RunState::initial(&job.scene, &job.settings, &outputs)?,
    };
    let outputs = resumed::restore(job, outputs)?;
    let memory_file = job.save_memory.as_ref().map(|path| prepare_memory_file(path, job)).transpose()?;
    let prepare = |path: &Option<PathBuf>, kind| {
        path.as_ref().map(|path| ExtraFile::prepare(path, kind, job.existing)).transpose()
    };
    let _folders = (prepare(&job.save_coco, FileKind::COCO)?, prepare(&job.save_mcap, FileKind::MCAP)?);
    use_threads(job.settings.run.threads)?;
    job.settings.run.memory_limit.enforce();
    let signals = StopSignals::listen().map_err(|error| no_thread("listens for signals", &error))?;
    let dataset = &job.settings.dataset;
    let scene = open_job_scene(job)?;
    let stream = FrameStream::open_at(Arc::clone(&scene), dataset, GroundTruth::Skip, state.next);
    let stream = stream.map_err(Failure::input)?;
    let selected = dataset.selected_frames(scene.frame_count()).map_err(Failure::input)?;
    let names: Vec<String> = selected.into_iter().map(|index| scene.frame_name(index)).collect();
    let folder = OutputFolder::prepare(&job.out, job.existing, &names, job.settings.run.overlay)?;
    let mut pipeline = build(job, &scene)?;
    let before = map_before(job)?;
    inform!("{}", stream.description());
    inform!("{}", camera_messages::described(job.settings.run.poses, scene.has_poses()));

    let run = &job.settings.run;
    let mut state = RunState { earlier_ids: pipeline.earlier_ids(), ..state };
    if job.resume.is_none() {
        state.loaded_map = job.load_memory.as_deref().and_then(LoadedMap::of);
    }
    let extra_file = |(kind, path): (FileKind, &PathBuf)| (kind.option.to_owned(), path.display().to_string());
    state.extra_files = job.extra_files().map(extra_file).collect();
    let saving = StateSaving { every: run.save_every, state, staging: folder.staging().to_owned() };
    let saving = (run.save_every > 0).then_some(saving);
    let has_final_pass = !run.online && pipeline.hindsight().is_some();
    let (written, counts) = resumed::start(job, folder, outputs, has_final_pass)?;
    let start_up = started.elapsed();
    let frames = FrameLoop {
        signals: &signals,
        strict_input: run.strict_input,
        has_loaded_map: job.load_memory.is_some(),
        saving,
    };
    let ended = frames.run(pipeline.run(stream), written, counts)?;
    let end = EndOfFrames { job, scene: &scene, signals: &signals, before, has_final_pass, times: (started, start_up) };
    end.finish(&mut pipeline, ended, memory_file.as_ref())
}

/// A run whose frames have ended.
struct EndOfFrames<'a> {
    job: &'a RunJob,
    scene: &'a Arc<dyn Scene>,
    signals: &'a StopSignals,
    /// The map that the run was started with.
    before: Option<MapBefore>,
    has_final_pass: bool,
    /// When it was started, and the time until the first frame.
    times: (Instant, Duration),
}

impl EndOfFrames<'_> {
    /// Writes the results that need all frames, carries out the final pass, and writes and returns the summary.
    fn finish(
        self,
        pipeline: &mut Pipeline,
        mut ended: LoopOutcome,
        memory_file: Option<&ExtraFile>,
    ) -> Result<Summary, Failure> {
        let Self { job, scene, signals, before, has_final_pass, times: (started, start_up) } = self;
        let has_final_pass = |ended: &LoopOutcome| {
            has_final_pass && ended.early.is_none() && ended.written.first_error.is_none() && ended.written.frames > 0
        };
        if !has_final_pass(&ended) {
            name_objects(pipeline)?;
        }
        let changes = before.as_ref().and_then(|before| write_changes(before, pipeline, &mut ended.written));
        match &changes {
            Some(changes) if !has_final_pass(&ended) => tell_changes(changes),
            None if job.resume.is_some() => {
                // That of the run before it was stopped.
                let removed = ended.written.folder.remove(CHANGES);
                ended.written.output_errors.extend(removed.err());
            }
            _ => {}
        }
        let since = before.as_ref().zip(changes.as_ref());
        let since = since.map(|(before, changes)| ChangesSince { before: before.map(), changes });
        let (history, plan) = finish_outputs(job, scene.as_ref(), pipeline, &mut ended, since);
        let online = started.elapsed();
        let final_pass = has_final_pass(&ended).then(|| {
            let pass = FinalPass { job, scene, signals, before: before.as_ref() };
            pass.run(pipeline, (&history, plan), &mut ended).then(|| started.elapsed() - online)
        });
        let times = RunTimes { start_up, online, final_pass: final_pass.flatten() };
        let summary = report::finish(job, ended, times, (scene.as_ref(), pipeline), memory_file)?;
        // The run is complete, so its saved state is no longer needed.
        let _ = saved_run::remove(&job.out);
        Ok(summary)
    }
}

/// Opens the scene of a job. Its depth predictor is checked before and after: the frames of a video are extracted when it is
/// opened, which takes time.
fn open_job_scene(job: &RunJob) -> Result<Arc<dyn Scene>, Failure> {
    let checked = Pipeline::builder(&job.settings).networks(&job.networks);
    checked.check_depth_predictor().map_err(Failure::input)?;
    let scene = open_scene(&job.scene, &job.settings.dataset).map_err(|error| not_opened(&job.scene, error))?;
    checked.scene(&scene).check_depth_predictor().map_err(Failure::input)?;
    Ok(scene)
}

/// Names the objects, if the settings choose a namer that waits for the end of the frames.
fn name_objects(pipeline: &mut Pipeline) -> Result<(), Failure> {
    if pipeline.has_namer() {
        let started = Instant::now();
        let named = pipeline.finish_names().map_err(Failure::runtime)?;
        inform!("{} named from pictures in {:.1} s", counted(named, "object"), started.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Brings the results of earlier frames up to date, and writes the outputs that need the whole run. Returns the frames, and
/// the plan of the map if there is one.
fn finish_outputs(
    job: &RunJob,
    scene: &dyn Scene,
    pipeline: &mut Pipeline,
    ended: &mut LoopOutcome,
    changes: Option<ChangesSince<'_>>,
) -> (FrameHistory, Option<FloorPlan>) {
    let history = std::mem::take(&mut ended.written.history);
    if ended.written.frames == 0 {
        return (history, None);
    }
    let images = FrameImages { scene, framing: job.settings.dataset.framing() };
    update_frames(&mut ended.written, &history, &images, &mut ended.counts);
    let keyframes = pipeline.keyframes();
    let (mut objects, plan) = pipeline.objects_and_plan(PlanSettings::default());
    history.count_remapped(&mut objects);
    ended.counts.unjoined_frames = history.unjoined_frames(&keyframes);
    let end = RunEnd {
        scene: &job.scene.display().to_string(),
        objects: &objects,
        map: pipeline.map(),
        plan: plan.as_ref(),
        pose_corrections: &history.pose_corrections(&keyframes),
        remaps: history.remaps(),
        changes,
    };
    ended.written.for_each_output(|output, folder| output.finish(&end, folder));
    (history, plan)
}

/// The map that the run was started with. `None` if there was none, or it does not tell what was looked at.
fn map_before(job: &RunJob) -> Result<Option<MapBefore>, Failure> {
    let resumed = job.resume.as_ref().map(SavedRun::loaded_map).transpose();
    let path = match resumed {
        Ok(resumed) => job.load_memory.clone().or(resumed.flatten()),
        Err(failure) => {
            say_error!("warning: {failure}: there is no {CHANGES}");
            None
        }
    };
    Ok(path.as_deref().map(MapBefore::load).transpose()?.flatten())
}

/// Writes what has changed since a loaded map. Returns `None` if that is unknown.
fn write_changes(before: &MapBefore, pipeline: &Pipeline, written: &mut WriterOutcome) -> Option<MapChanges> {
    let (map, keyframes) = pipeline.map().zip(pipeline.saved_poses(StateScope::Map))?;
    if written.frames == 0 {
        return None;
    }
    match before.changes(&map, &keyframes).and_then(|changes| Ok((map_changes::json(&changes)?, changes))) {
        Ok((bytes, changes)) => {
            written.output_errors.extend(written.folder.write(CHANGES, &bytes).err());
            Some(changes)
        }
        Err(error) => {
            say_error!("the changes since the loaded map are unknown: {error}");
            None
        }
    }
}

/// Prints how many objects have changed since a loaded map.
fn tell_changes(changes: &MapChanges) {
    if let Some(counts) = map_changes::lines(changes).first() {
        inform!("since the loaded map: {counts}; see {CHANGES}");
    }
}

/// Refuses to save the state of a run that could not be resumed, and to resume a run with different settings.
fn check_saving(job: &RunJob, outputs: &[Box<dyn RunOutput>]) -> Result<(), Failure> {
    let method = job.settings.method.name();
    if job.settings.run.save_every > 0 && method != MethodName::FastsamSplat {
        let reason = "save_every is not used here: it needs method = fastsam-splat, but method is";
        return Err(Failure::input(format!("{reason} {}", method.name())));
    }
    let predicts_all =
        job.settings.depth_predictor.is_some() && job.settings.run.predicted_depth == PredictedDepthUse::All;
    if job.settings.run.save_every > 0 && predicts_all {
        let reason = "save_every is not used here: what the scale of predicted depth is known to be is not saved";
        return Err(Failure::input(format!("{reason}; leave it out, or set predicted_depth = holes")));
    }
    match &job.resume {
        Some(saved) => saved.check(&job.scene, &job.settings, outputs),
        None => Ok(()),
    }
}

/// Prepares the file for the memory. Fails if the method has no memory.
fn prepare_memory_file(path: &Path, job: &RunJob) -> Result<ExtraFile, Failure> {
    if job.settings.method.memory().is_none() {
        let method = job.settings.method.name().name();
        return Err(Failure::input(format!("{}: the method {method} has no memory to save", path.display())));
    }
    ExtraFile::prepare(path, FileKind::MEMORY, job.existing)
}

/// Builds the pipeline of a job.
fn build_pipeline(job: &RunJob, scene: &Arc<dyn Scene>) -> Result<Pipeline, Failure> {
    let bar = codebook_bar();
    let mut builder = Pipeline::builder(&job.settings)
        .scene(scene)
        .networks(&job.networks)
        .progress(|fraction| bar.set_position((fraction * 100.0) as u64));
    if let Some(path) = &job.load_memory {
        builder = builder.saved_memory(path);
    }
    if let Some(saved) = &job.resume {
        builder = builder.saved_memory(saved.memory()).objects(saved.objects()).earlier_ids(saved.state.earlier_ids);
        if let Some(state) = saved.poses()? {
            builder = builder.saved_poses(state);
        }
    }
    let pipeline = builder.build().map_err(Failure::input);
    bar.finish_and_clear();
    pipeline
}

//! Results of a benchmark: the rows of `results.json`, the data of the report, and the files with both.

use super::Outcome;
use super::drawings::drawings;
use super::job::{FinalScores, JobResult};
use super::plan::{Plan, ResultEntry};
use crate::Failure;
use serde::{Serialize, Serializer};
use splatseg::Settings;
use splatseg::pipeline::StageTimes;
use splatseg::summary::FramesPerSecond;
use splatseg_files::AtomicFile;
use splatseg_metrics::{InstanceScores, Protocol, Scores};
use splatseg_output::{OutputError, write_atomically};
use splatseg_report::{Benchmark, Measurement, MissingResult, PageSelection, Variant};
use splatseg_report::{csv_table, html_page, markdown_tables};
use splatseg_tracking::TrackErrorCounts;
use std::collections::BTreeMap;
use std::path::Path;

/// A plan and the outcomes of its jobs.
pub struct Results<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// The result or error of each of the plan's jobs.
    pub outcomes: &'a [Result<Outcome, String>],
}

/// A row of `results.json`. Its keys are part of the interface.
#[derive(Clone, Debug, Serialize)]
struct Row<'a> {
    /// Name of the scene.
    scene: &'a str,
    /// The scene as given on the command line.
    scene_path: &'a str,
    /// Name of the method.
    method: &'static str,
    /// The ablated settings, e.g. `memory.feature_dim=14`.
    variant: Option<String>,
    /// The seed.
    seed: u64,
    /// Name of the segmenter; `none` if ground truth prompts a tracker.
    segmenter: &'static str,
    /// The protocol of the scores that follow.
    protocol: &'static str,
    /// The scores under that protocol, percent.
    #[serde(flatten)]
    scores: Scores,
    /// The scores under the other protocol, under its name.
    #[serde(flatten)]
    other_protocol: BTreeMap<&'static str, Scores>,
    /// The scores after the final pass, in which the map of the end decides the ids of all frames again; null without
    /// it. All other scores are those of the time.
    final_pass: Option<FinalRow>,
    /// The scores of the frames as they are decided `late_frames` later; null with 0.
    late: Option<FinalRow>,
    /// 3D instances on the vertices of the scene's mesh; null without a mesh or a memory.
    mesh: Option<InstanceScores>,
    /// The processor, and the GPU if used.
    machine: &'a str,
    /// Speed, without the time for scoring.
    fps: FramesPerSecond,
    /// Frames with a result.
    frames: usize,
    /// Frames that could not be read; they are not scored.
    skipped_frames: usize,
    /// Frames on which the segmenter failed; they are scored as empty.
    failed_frames: usize,
    /// Number of distinct ids in the results.
    segments: usize,
    /// Gaussians in the memory at the end.
    gaussians: usize,
    /// Number of parameters of the memory at the end.
    parameters: usize,
    /// Mean time of each stage per frame, milliseconds.
    stage_ms: &'a BTreeMap<String, f64>,
    /// Tracker errors that the method found and corrected.
    track_errors: TrackErrorCounts,
    /// The file with the full result.
    file: String,
    /// All settings; `threads` is 0.
    settings: &'a Settings,
    /// Version of splatseg.
    version: &'a str,
}

/// Scores after the final pass.
#[derive(Clone, Debug, Serialize)]
struct FinalRow {
    /// The scores under the row's protocol, percent.
    #[serde(flatten)]
    scores: Scores,
    /// The scores under the other protocol, under its name.
    #[serde(flatten)]
    other_protocol: BTreeMap<&'static str, Scores>,
    /// Time of the pass without scoring, seconds.
    seconds: f64,
}

impl<'a> Results<'a> {
    /// Returns the data of the report.
    pub fn benchmark(&self) -> Result<Benchmark<'a>, Failure> {
        let plan = self.plan;
        let variants: Vec<Variant> = plan
            .variants
            .iter()
            .map(|variant| Variant { method: variant.method.name().to_owned(), changes: variant.changes.clone() })
            .collect();
        let (mut measurements, mut missing) = (Vec::new(), Vec::new());
        for entry in &plan.entries {
            match &self.outcomes[entry.job] {
                Ok(outcome) => measurements.push(measurement(entry, &outcome.result)),
                Err(error) => missing.push(MissingResult {
                    scene: &plan.scenes[entry.scene].name,
                    scene_path: &plan.scenes[entry.scene].path_text,
                    method: plan.variants[entry.variant].method.name(),
                    variant: variants[entry.variant].change(),
                    seed: entry.seed,
                    error,
                }),
            }
        }
        Ok(Benchmark {
            scenes: plan.scenes.iter().map(|scene| scene.name.clone()).collect(),
            variants,
            seeds: plan.seeds.clone(),
            protocol: plan.protocol,
            setup: plan.parts(),
            settings: toml::to_string_pretty(&plan.settings).map_err(Failure::runtime)?,
            version: env!("CARGO_PKG_VERSION"),
            reference: plan.reference,
            stages: self.stages(),
            measurements,
            missing,
        })
    }

    /// Writes the rows, the tables and the report to a folder.
    pub fn write(&self, benchmark: &Benchmark, out: &Path) -> Result<(), Failure> {
        let write =
            |name: &str, text: &str| write_atomically(&out.join(name), text.as_bytes()).map_err(Failure::runtime);
        self.write_rows(benchmark, &out.join("results.json")).map_err(Failure::runtime)?;
        write("failures.json", &serde_json::to_string_pretty(&benchmark.missing).map_err(Failure::runtime)?)?;
        write("results.csv", &csv_table(benchmark))?;
        write("tables.md", &markdown_tables(benchmark))?;
        let selection = PageSelection::new(benchmark);
        let drawings = drawings(self, &selection, out);
        write("report.html", &html_page(benchmark, &selection, &drawings).map_err(Failure::runtime)?)
    }

    /// Names of all stages: this program's stages in their order, then others.
    fn stages(&self) -> Vec<&'a str> {
        let mut stages: Vec<&str> = StageTimes::default().stages().iter().map(|(name, _)| *name).collect();
        for outcome in self.outcomes.iter().flatten() {
            for name in outcome.result.stage_ms.keys() {
                if !stages.contains(&name.as_str()) {
                    stages.push(name);
                }
            }
        }
        stages
    }

    /// Writes `results.json` row by row. With all settings in each row, it can be larger than the memory.
    fn write_rows(&self, benchmark: &Benchmark, path: &Path) -> Result<(), OutputError> {
        let failed = |source| OutputError::Io { path: path.to_owned(), source };
        let mut file = AtomicFile::create(path).map_err(failed)?;
        let mut serializer = serde_json::Serializer::pretty(&mut file);
        serializer.collect_seq(self.rows(benchmark)).map_err(|error| failed(error.into()))?;
        file.commit().map_err(failed)
    }

    fn rows<'b>(&'b self, benchmark: &'b Benchmark) -> impl Iterator<Item = Row<'a>> + 'b {
        let measured =
            self.plan.entries.iter().filter_map(|entry| Some((entry, self.outcomes[entry.job].as_ref().ok()?)));
        measured.map(|(entry, outcome)| self.row(entry, outcome, &benchmark.variants[entry.variant]))
    }

    fn row(&self, entry: &ResultEntry, outcome: &'a Outcome, variant: &Variant) -> Row<'a> {
        let (plan, result) = (self.plan, &outcome.result);
        let other = match plan.protocol {
            Protocol::Paper => Protocol::Strict,
            Protocol::Strict => Protocol::Paper,
        };
        let again = |found: &FinalScores| FinalRow {
            scores: found.score(plan.protocol).scores(),
            other_protocol: BTreeMap::from([(other.name(), found.score(other).scores())]),
            seconds: found.seconds,
        };
        Row {
            scene: &plan.scenes[entry.scene].name,
            scene_path: &plan.scenes[entry.scene].path_text,
            method: plan.variants[entry.variant].method.name(),
            variant: variant.change(),
            seed: entry.seed,
            segmenter: segmenter(result),
            protocol: plan.protocol.name(),
            scores: result.score(plan.protocol).scores(),
            other_protocol: BTreeMap::from([(other.name(), result.score(other).scores())]),
            final_pass: result.final_pass.as_ref().map(again),
            late: result.late.as_ref().map(again),
            mesh: result.mesh.as_ref().map(|scorer| scorer.scores()),
            machine: &result.machine,
            fps: result.fps,
            frames: result.frames,
            skipped_frames: result.skipped_frames,
            failed_frames: result.failed_frames,
            segments: result.segments,
            gaussians: result.gaussians,
            parameters: result.parameters,
            stage_ms: &result.stage_ms,
            track_errors: result.track_errors,
            file: format!("results/{}.json", outcome.key),
            settings: &result.inputs.settings,
            version: &result.inputs.version,
        }
    }
}

fn segmenter(result: &JobResult) -> &'static str {
    let settings = &result.inputs.settings;
    if settings.method.uses_segmenter() { settings.segmenter.name() } else { "none" }
}

fn measurement<'a>(entry: &ResultEntry, result: &'a JobResult) -> Measurement<'a> {
    Measurement {
        scene: entry.scene,
        variant: entry.variant,
        seed: entry.seed,
        segmenter: segmenter(result),
        frames: result.frames,
        skipped_frames: result.skipped_frames,
        failed_frames: result.failed_frames,
        segments: result.segments,
        gaussians: result.gaussians,
        parameters: result.parameters,
        frames_per_second: result.fps.total,
        frames_per_second_without_segmenter: result.fps.without_segmenter,
        stage_ms: &result.stage_ms,
        machine: &result.machine,
        paper: &result.paper,
        strict: &result.strict,
        final_pass: result.final_pass.as_ref().map(|found| [&found.paper, &found.strict]),
        mesh: result.mesh.as_ref(),
    }
}

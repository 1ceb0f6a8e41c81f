//! `--preset paper`: measures the rows of the paper's tables for which all inputs are available.
//!
//! `rows.rs` defines every row, `inputs.rs` finds data sets and checkpoints, `dry_run.rs` lists the work of a run. The rows
//! on ScanNet-MV and on MVPd are two benchmarks in separate folders, as their scenes and scores differ.

mod dry_run;
mod inputs;
mod other_trackers;
mod rows;

use super::arguments::BenchArguments;
use super::plan::{Plan, SceneEntry, Subject, Variant, scenes};
use crate::Failure;
use crate::options::{DatasetOptions, PresetName, SettingsOptions};
use inputs::{Input, Inputs, MissingInput};
use other_trackers::OtherTracker;
use rows::PlannedRow;
use splatseg::settings::SettingsLayers;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_report::Benchmark;
use splatseg_report::paper::{EFFICIENCY, EfficiencyRow, PaperResults, PaperRow, PaperTable, Reference};
use std::path::Path;

/// Minimum area of true segments in MVPd's benchmark, fraction of the image. Smaller ones are left out of a frame.
const MVPD_MIN_TRUTH_AREA: f64 = 0.001;

/// A data set of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataSet {
    /// ScanNet's validation videos, every 20th frame.
    ScannetMv,
    /// MVPd.
    Mvpd,
}

impl DataSet {
    /// Both data sets, in the order of the tables.
    pub const ALL: [Self; 2] = [Self::ScannetMv, Self::Mvpd];

    /// Name of the folder of the data set's benchmark.
    pub fn folder(self) -> &'static str {
        match self {
            Self::ScannetMv => "scannet-mv",
            Self::Mvpd => "mvpd",
        }
    }

    fn of(table: PaperTable) -> Self {
        if table.is_of_mvpd() { Self::Mvpd } else { Self::ScannetMv }
    }
}

/// The rows of the paper's tables, and the inputs found for them.
#[derive(Debug)]
pub struct PaperBenchmark {
    /// The inputs found in the folders.
    inputs: Inputs,
    /// Every row, with its missing inputs.
    rows: Vec<(PlannedRow, Vec<Input>)>,
    scannet: Part,
    mvpd: Part,
}

/// The benchmark on one data set.
#[derive(Debug)]
struct Part {
    layers: SettingsLayers,
    scenes: Vec<SceneEntry>,
}

impl PaperBenchmark {
    /// Finds the inputs, and the missing inputs of each row.
    ///
    /// # Errors
    /// If a folder cannot be read or a setting is wrong.
    pub fn prepare(arguments: &BenchArguments) -> Result<Self, Failure> {
        let mut inputs =
            Inputs::find(arguments.scannet.as_deref(), arguments.mvpd.as_deref(), arguments.weights_dir.as_deref())?;
        inputs.scenes.extend(arguments.scenes.iter().cloned());
        let has_fastsam = inputs.fastsam.is_some() || arguments.options.weights.is_some();
        let base = base(&inputs, has_fastsam)?;
        let layers = |preset| options_with(arguments, preset).layers_over(base.clone(), []);
        let scannet = layers(PresetName::ScannetMv)?;
        inputs.missing.retain(|missing| !is_replaced(missing, &scannet, !inputs.scenes.is_empty()));
        let settings = scannet.resolve_shared().map_err(Failure::input)?;
        settings.run.memory_limit.enforce();
        let scenes = scenes(&inputs.scenes, &settings.dataset, &arguments.mesh)?;
        let scannet = Part { layers: scannet, scenes };
        let video = |video: &splatseg_dataset::MvpdVideo| SceneEntry {
            path: video.path.clone(),
            path_text: video.path.display().to_string(),
            name: video.name.clone(),
            error: None,
            mesh: None,
        };
        let videos = inputs.mvpd.videos.iter().map(video).collect();
        let mvpd = Part { layers: layers(PresetName::Mvpd)?, scenes: videos };
        let lacks = |row: &PlannedRow| {
            let is_missing = |input: &Input| inputs.missing.iter().any(|missing| missing.input == *input);
            row.needs().into_iter().filter(is_missing).collect::<Vec<_>>()
        };
        // A command line's own tracker takes the place of all networks.
        if !uses(&scannet.layers, "tracker", "sam2") {
            inputs.other_trackers.clear();
        }
        inputs.notes.extend(inputs.other_trackers.iter().map(OtherTracker::note));
        let rows = rows::all(&inputs.other_trackers).into_iter().map(|row| {
            let lacks = lacks(&row);
            (row, lacks)
        });
        Ok(Self { rows: rows.collect(), inputs, scannet, mvpd })
    }

    /// Plans the benchmark on a data set. Returns `None` if nothing can be measured.
    ///
    /// # Errors
    /// If a setting is wrong.
    pub fn plan(&self, data: DataSet, arguments: &BenchArguments) -> Result<Option<Plan>, Failure> {
        let part = self.part(data);
        let mut variants: Vec<Variant> = Vec::new();
        for (row, lacks) in self.rows.iter().filter(|(row, _)| DataSet::of(row.table) == data) {
            variants.extend(row.variant.clone().filter(|variant| lacks.is_empty() && !variants.contains(variant)));
        }
        if part.scenes.is_empty() || variants.is_empty() {
            return Ok(None);
        }
        let (score, reference) = match data {
            DataSet::ScannetMv => (arguments.score.settings()?, Reference::ScannetMv),
            DataSet::Mvpd => (arguments.score.settings_of_benchmark(MVPD_MIN_TRUTH_AREA)?, Reference::Mvpd),
        };
        Plan::of(arguments, &part.layers, Subject { scenes: part.scenes.clone(), variants, score, reference }).map(Some)
    }

    fn part(&self, data: DataSet) -> &Part {
        match data {
            DataSet::ScannetMv => &self.scannet,
            DataSet::Mvpd => &self.mvpd,
        }
    }

    /// Formats the list of missing inputs with their sources.
    pub fn missing_list(&self) -> String {
        let lines: String = self.missing_inputs().iter().map(|missing| format!("- {missing}\n")).collect();
        if lines.is_empty() { "Nothing is missing.\n".to_owned() } else { format!("Missing:\n\n{lines}") }
    }

    /// Calls `write` with the paper's tables and the measured results. `measured` has the plan and the benchmark of each
    /// measured data set.
    pub fn with_results<T>(
        &self,
        measured: &[(DataSet, &Plan, &Benchmark<'_>)],
        write: impl FnOnce(&PaperResults<'_>) -> T,
    ) -> T {
        let of = |data| measured.iter().find(|(measured, _, _)| *measured == data);
        let variant_of = |row: &PlannedRow| {
            let (_, plan, _) = of(DataSet::of(row.table))?;
            plan.variants.iter().position(|variant| Some(variant) == row.variant.as_ref())
        };
        let rows: Vec<PaperRow> = self
            .rows
            .iter()
            .map(|(row, lacks)| PaperRow {
                table: row.table,
                name: row.name.clone(),
                published: row.published,
                point: row.point,
                variant: variant_of(row),
                obstacle: obstacle(lacks),
            })
            .collect();
        write(&PaperResults {
            scannet: of(DataSet::ScannetMv).map(|(_, _, benchmark)| *benchmark),
            mvpd: of(DataSet::Mvpd).map(|(_, _, benchmark)| *benchmark),
            rows: &rows,
            efficiency: &self.efficiency(&rows),
            notes: &self.inputs.notes,
            missing: &self.missing_inputs(),
        })
    }

    /// Returns our rows of the efficiency table: those of the paper, and the optional ones.
    fn efficiency(&self, rows: &[PaperRow]) -> Vec<EfficiencyRow> {
        let methods = || rows.iter().zip(&self.rows).filter(|(row, _)| row.table == PaperTable::Methods);
        let published = EFFICIENCY.iter().filter_map(|published| methods().find(|(row, _)| row.name == published.name));
        let optional = methods().filter(|(_, (planned, _))| planned.tracker.is_some() && !planned.is_prompted());
        let row = |(row, (planned, _)): (&PaperRow, &(PlannedRow, Vec<Input>))| EfficiencyRow {
            name: row.name.clone(),
            variant: row.variant,
            backbone_parameters: self.backbone_parameters(planned),
            obstacle: row.obstacle.clone(),
        };
        published.chain(optional).map(row).collect()
    }

    /// Returns the number of parameters of a method's network: that of the tracker, or FastSAM.
    fn backbone_parameters(&self, row: &PlannedRow) -> Option<usize> {
        let (part, network, key) = match row.name.as_str() {
            name if name.starts_with("SAM2") => ("tracker", "sam2", "tracker_weights"),
            _ => ("segmenter", "fastsam", "weights"),
        };
        let layers = &self.scannet.layers;
        let of_all = layers.get(key).and_then(toml::Value::as_str).filter(|_| uses(layers, part, network));
        let weights = row.tracker.as_ref().map(|tracker| tracker.weights.as_path()).or(of_all.map(Path::new))?;
        Checkpoint::open(weights).ok().map(|checkpoint| checkpoint.parameters())
    }

    fn missing_inputs(&self) -> Vec<String> {
        self.inputs.missing.iter().map(|missing| format!("{}: {}", missing.what, missing.published)).collect()
    }
}

/// Returns the command line's options with a data set's preset for reading scenes.
fn options_with(arguments: &BenchArguments, preset: PresetName) -> SettingsOptions {
    let dataset = DatasetOptions { preset: Some(preset), ..arguments.options.dataset.clone() };
    SettingsOptions { dataset, ..arguments.options.clone() }
}

/// Returns the settings for the paper's networks, as the layer below the command line. Without FastSAM's weights, only rows
/// without a segmenter can run.
fn base(inputs: &Inputs, has_fastsam: bool) -> Result<SettingsLayers, Failure> {
    let mut layers = SettingsLayers::default();
    let mut add = |key: &str, value: toml::Value| {
        layers.add(key, value).ok_or_else(|| Failure::runtime(format!("there is no setting {key}")))
    };
    if has_fastsam {
        add("segmenter", toml::Value::String("fastsam".to_owned()))?;
    }
    for (key, path) in [("weights", &inputs.fastsam), ("tracker_weights", &inputs.sam2)] {
        if let Some(path) = path {
            add(key, toml::Value::String(path.to_string_lossy().into_owned()))?;
        }
    }
    Ok(layers)
}

/// Returns the reason if a row cannot run.
fn obstacle(lacks: &[Input]) -> Option<String> {
    let names: Vec<&str> = lacks.iter().map(|input| input.name()).collect();
    (!names.is_empty()).then(|| format!("needs {}", names.join(" and ")))
}

/// Returns true if the setting `part` is `name` or not set. `name` is used by default.
fn uses(layers: &SettingsLayers, part: &str, name: &str) -> bool {
    layers.get(part).and_then(toml::Value::as_str).is_none_or(|chosen| chosen == name)
}

/// Returns true if the command line replaces a missing input.
fn is_replaced(missing: &MissingInput, layers: &SettingsLayers, has_scenes: bool) -> bool {
    let has_file = |key| layers.get(key).and_then(toml::Value::as_str).is_some_and(|path| Path::new(path).exists());
    match missing.input {
        Input::Scenes => has_scenes,
        Input::FastSam => !uses(layers, "segmenter", "fastsam") || has_file("weights"),
        Input::Sam2 => !uses(layers, "tracker", "sam2") || has_file("tracker_weights"),
        Input::RestOfTheSplit | Input::Mvpd => false,
    }
}

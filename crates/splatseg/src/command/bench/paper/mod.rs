//! `--preset paper`: the rows of the paper's tables that can be measured with the inputs that are at hand.

mod inputs;
mod rows;

use super::arguments::BenchArguments;
use super::plan::{Plan, Variant};
use crate::command::Failure;
use crate::settings::SettingsLayers;
use inputs::{Input, Inputs, MissingInput};
use rows::PlannedRow;
use splatseg_report::Benchmark;
use splatseg_report::paper::{PaperRow, document};
use std::path::Path;

/// The paper's tables, as far as the inputs allow.
#[derive(Debug)]
pub struct PaperBenchmark {
    /// What was found in the folders.
    inputs: Inputs,
    /// Every row, and why it cannot be run, if it cannot.
    rows: Vec<(PlannedRow, Option<&'static str>)>,
    layers: SettingsLayers,
}

impl PaperBenchmark {
    /// Looks for the inputs and decides which rows can be run.
    ///
    /// # Errors
    /// If a folder cannot be read or a setting is wrong.
    pub fn prepare(arguments: &BenchArguments) -> Result<Self, Failure> {
        let mut inputs = Inputs::find(arguments.scannet.as_deref(), arguments.weights_dir.as_deref())?;
        inputs.scenes.extend(arguments.scenes.iter().cloned());
        let has_fastsam = inputs.fastsam.is_some() || arguments.options.weights.is_some();
        let layers = arguments.options.layers_over(base(&inputs, has_fastsam)?, [])?;
        inputs.missing.retain(|missing| !is_replaced(missing, &layers, !inputs.scenes.is_empty()));
        let rows = rows::all().into_iter().map(|row| {
            let obstacle = obstacle(&row, &layers);
            (row, obstacle)
        });
        Ok(Self { rows: rows.collect(), inputs, layers })
    }

    /// What to measure.
    ///
    /// # Errors
    /// If there is no scene, or no row has what it needs.
    pub fn plan(&self, arguments: &BenchArguments) -> Result<Plan, Failure> {
        let mut variants: Vec<Variant> = Vec::new();
        for (row, obstacle) in &self.rows {
            if obstacle.is_none() && !variants.contains(&row.variant) {
                variants.push(row.variant.clone());
            }
        }
        if self.inputs.scenes.is_empty() || variants.is_empty() {
            say!("{}", self.missing_list());
            return Err(Failure::input("nothing of the paper can be run: give --scannet and --weights-dir"));
        }
        Plan::of(arguments, &self.layers, &self.inputs.scenes, variants)
    }

    /// What is missing, and where its owner publishes it.
    pub fn missing_list(&self) -> String {
        let lines = self.missing_inputs().map(|missing| format!("- {missing}\n"));
        format!("Missing:\n\n{}", lines.collect::<String>())
    }

    /// The paper's tables with what was measured, as Markdown.
    pub fn document(&self, plan: &Plan, benchmark: &Benchmark) -> String {
        let rows = self.rows.iter().map(|(row, obstacle)| PaperRow {
            table: row.table,
            name: row.name.clone(),
            published: row.published,
            variant: plan.variants.iter().position(|variant| *variant == row.variant),
            obstacle: obstacle.map(str::to_owned),
        });
        let missing: Vec<String> = self.missing_inputs().collect();
        document(benchmark, &rows.collect::<Vec<_>>(), &self.inputs.notes, &missing)
    }

    fn missing_inputs(&self) -> impl Iterator<Item = String> {
        self.inputs.missing.iter().map(|missing| format!("{}: {}", missing.what, missing.published))
    }
}

/// The paper's parts; the command line, whose preset has how scenes are read, is laid over them. Without FastSAM's weights, only rows without a
/// segmenter can be run.
fn base(inputs: &Inputs, has_fastsam: bool) -> Result<SettingsLayers, Failure> {
    let mut layers = SettingsLayers::default();
    let mut add = |key: &str, value: toml::Value| {
        layers.add(key, value).ok_or_else(|| Failure::work(format!("there is no setting {key}")))
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

/// Why a row cannot be run, if it cannot.
fn obstacle(row: &PlannedRow, layers: &SettingsLayers) -> Option<&'static str> {
    if row.needs_tracker() && uses(layers, "tracker", "sam2") && layers.get("tracker_weights").is_none() {
        return Some("needs weights of SAM 2.1");
    }
    let needs_weights = row.needs_segmenter() && uses(layers, "segmenter", "fastsam");
    (needs_weights && layers.get("weights").is_none()).then_some("needs weights of FastSAM")
}

/// Whether a part is the one named, which is also the one that is used where none is given.
fn uses(layers: &SettingsLayers, part: &str, name: &str) -> bool {
    layers.get(part).and_then(toml::Value::as_str).is_none_or(|chosen| chosen == name)
}

/// Whether the command line replaces a missing input with something else.
fn is_replaced(missing: &MissingInput, layers: &SettingsLayers, has_scenes: bool) -> bool {
    let has_file = |key| layers.get(key).and_then(toml::Value::as_str).is_some_and(|path| Path::new(path).exists());
    match missing.input {
        Input::Scenes => has_scenes,
        Input::FastSam => !uses(layers, "segmenter", "fastsam") || has_file("weights"),
        Input::Sam2 => !uses(layers, "tracker", "sam2") || has_file("tracker_weights"),
        Input::RestOfTheSplit | Input::Mvpd => false,
    }
}

//! The whole paper in one command: what its rows need, what of that is there, and its numbers beside ours.

mod document;
mod inputs;
mod numbers;
mod rows;

pub use document::document;
pub use numbers::{MARK, SCANNET_MV};

use super::arguments::BenchArguments;
use super::plan::{Plan, Variant};
use crate::command::Failure;
use inputs::{Inputs, MissingInput};
use rows::PaperRow;
use splatseg::Settings;
use splatseg::settings::{SegmenterName, SettingsLayers, TrackerName};
use splatseg_dataset::Preset;
use std::path::Path;

/// The paper's tables, as far as the inputs allow.
#[derive(Debug)]
pub struct PaperBenchmark {
    /// Folders' contents.
    inputs: Inputs,
    /// Every row, and what keeps it from being run.
    rows: Vec<(PaperRow, Option<&'static str>)>,
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
        let layers = arguments.options.layers_over(base(&inputs)?, [])?;
        let settings = layers.clone().resolve().map_err(Failure::input)?;
        inputs.missing.retain(|missing| !is_replaced(missing, &settings, !inputs.scenes.is_empty()));
        let rows = rows::all().into_iter().map(|row| {
            let obstacle = obstacle(&row, &settings);
            (row, obstacle)
        });
        Ok(Self { rows: rows.collect(), inputs, layers })
    }

    /// What is to be measured.
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
        let lines = self.inputs.missing.iter().map(|missing| format!("- {}: {}\n", missing.what, missing.published));
        format!("Missing:\n\n{}", lines.collect::<String>())
    }
}

/// The paper's settings, below those of the command line.
fn base(inputs: &Inputs) -> Result<SettingsLayers, Failure> {
    let mut layers = SettingsLayers::default();
    let mut add = |key: &str, value: toml::Value| {
        layers.add(key, value).ok_or_else(|| Failure::work(format!("{key} is no setting")))
    };
    let preset = toml::Value::try_from(Preset::ScannetMv.settings()).map_err(Failure::work)?;
    add("dataset", preset)?;
    add("segmenter", toml::Value::String("fastsam".to_owned()))?;
    for (key, path) in [("weights", &inputs.fastsam), ("tracker_weights", &inputs.sam2)] {
        if let Some(path) = path {
            add(key, toml::Value::String(path.to_string_lossy().into_owned()))?;
        }
    }
    Ok(layers)
}

/// What keeps a row from being run.
fn obstacle(row: &PaperRow, settings: &Settings) -> Option<&'static str> {
    if row.needs_tracker() && settings.tracker == TrackerName::Sam2 && settings.tracker_weights.is_none() {
        return Some("needs weights of SAM 2.1");
    }
    let needs_weights = row.needs_segmenter() && settings.segmenter == SegmenterName::Fastsam;
    (needs_weights && settings.weights.is_none()).then_some("needs weights of FastSAM")
}

/// Whether the command line put something in the place of a missing input.
fn is_replaced(missing: &MissingInput, settings: &Settings, has_scenes: bool) -> bool {
    let has_file = |path: &Option<std::path::PathBuf>| path.as_deref().is_some_and(Path::exists);
    match missing.what.split(|letter: char| !letter.is_alphanumeric()).next() {
        Some("ScanNet") => has_scenes,
        Some("FastSAM") => settings.segmenter != SegmenterName::Fastsam || has_file(&settings.weights),
        Some("sam2") => settings.tracker != TrackerName::Sam2 || has_file(&settings.tracker_weights),
        _ => false,
    }
}

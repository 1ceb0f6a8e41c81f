//! Options that several commands share, and the settings they make.

use super::Failure;
use clap::Args;
use splatseg::settings::{SegmenterName, SettingsLayers, TrackerName};
use splatseg_dataset::{DatasetSettings, Format, Preset};
use splatseg_metrics::{Protocol, ScoreSettings, Void};
use splatseg_models::device::DeviceName;
use std::path::PathBuf;

/// How a scene is read.
#[derive(Clone, Debug, Default, Args)]
pub struct DatasetOptions {
    /// Format of the scene: auto, 7scenes, scannet, sens, tum, replica, mvpd or synthetic [default: auto]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<Format>,
    /// Read scenes as a published benchmark does; other options win over it
    #[arg(long, value_enum, value_name = "PRESET")]
    pub preset: Option<PresetName>,
    /// Use every N-th frame
    #[arg(long, value_name = "N")]
    pub stride: Option<usize>,
    /// Resize frames first, e.g. 320x240
    #[arg(long, value_name = "WxH")]
    pub resize: Option<String>,
    /// Then cut this many pixels off on each side
    #[arg(long, value_name = "PX")]
    pub crop_border: Option<usize>,
    /// Position of the first frame, counted from 0
    #[arg(long, value_name = "N")]
    pub start: Option<usize>,
    /// Use at most this many frames
    #[arg(long, value_name = "N")]
    pub max_frames: Option<usize>,
    /// 7-Scenes as published: warp depth into the colour camera
    #[arg(long)]
    pub register_depth: bool,
}

/// The presets on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PresetName {
    /// The paper's ScanNet-MV: --stride 20 --resize 320x240 --crop-border 5
    ScannetMv,
    /// The same; `bench` then measures every row of the paper's tables
    Paper,
}

impl DatasetOptions {
    /// Lays the options that were given over the layers.
    pub fn add_to(&self, layers: &mut SettingsLayers) -> Result<(), Failure> {
        if self.preset.is_some() {
            // Both read scenes in the same way.
            let preset = Preset::ScannetMv.settings();
            let settings = [
                ("dataset.stride", whole(preset.stride)),
                ("dataset.resize", preset.resize.and_then(|size| text(size.to_string()))),
                ("dataset.crop_border", whole(preset.crop_border)),
            ];
            add_given(layers, settings)?;
        }
        let options = [
            ("dataset.format", self.format.and_then(|format| text(format.to_string()))),
            ("dataset.stride", self.stride.and_then(whole)),
            ("dataset.resize", self.resize.clone().and_then(text)),
            ("dataset.crop_border", self.crop_border.and_then(whole)),
            ("dataset.start", self.start.and_then(whole)),
            ("dataset.max_frames", self.max_frames.and_then(whole)),
            ("dataset.register_depth", self.register_depth.then_some(toml::Value::Boolean(true))),
        ];
        add_given(layers, options)
    }

    /// The dataset settings that `base` and the options make together.
    pub fn over(&self, base: &DatasetSettings) -> Result<DatasetSettings, Failure> {
        let mut layers = SettingsLayers::default();
        let base = toml::Value::try_from(base).map_err(Failure::work)?;
        add_given(&mut layers, [("dataset", Some(base))])?;
        self.add_to(&mut layers)?;
        Ok(layers.resolve().map_err(Failure::input)?.dataset)
    }
}

/// The settings of whatever runs methods.
#[derive(Clone, Debug, Default, Args)]
pub struct SettingsOptions {
    #[command(flatten)]
    pub dataset: DatasetOptions,
    /// Segmenter that the method builds on [default: graph]
    #[arg(long, value_enum, value_name = "SEGMENTER")]
    pub segmenter: Option<SegmenterName>,
    /// Precomputed masks for --segmenter masks: <frame>.png with an id per pixel, or <frame>.json with COCO masks
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Checkpoint for --segmenter fastsam: FastSAM's .pt as it is published, or a .safetensors
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// Tracker of the methods sam2 and sam2-splat [default: sam2]
    #[arg(long, value_enum, value_name = "TRACKER")]
    pub tracker: Option<TrackerName>,
    /// Checkpoint for --tracker sam2: Meta's sam2.1_hiera_*.pt as it is published, or a .safetensors
    #[arg(long, value_name = "FILE")]
    pub tracker_weights: Option<PathBuf>,
    /// Where the tracker's mask prompts come from [default: detections]
    #[arg(long, value_enum, value_name = "SOURCE")]
    pub prompts: Option<PromptsName>,
    /// What networks run on; others than the CPU must be built in [default: cpu]
    #[arg(long, value_name = "DEVICE", value_parser = DeviceName::ALL.map(DeviceName::name))]
    pub device: Option<String>,
    /// Settings from a TOML file
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Any setting, e.g. memory.max_votes=8; `summary.json` lists them all
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of everything random [default: 0]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Threads to compute with; results do not depend on it [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
}

impl SettingsOptions {
    /// The layers that file, options and assignments make together; `more` options lie under the assignments.
    pub fn layers<const N: usize>(&self, more: [(&str, Option<toml::Value>); N]) -> Result<SettingsLayers, Failure> {
        self.layers_over(SettingsLayers::default(), more)
    }

    /// [`Self::layers`] over other settings.
    pub fn layers_over<const N: usize>(
        &self,
        mut layers: SettingsLayers,
        more: [(&str, Option<toml::Value>); N],
    ) -> Result<SettingsLayers, Failure> {
        if let Some(path) = &self.config {
            layers.add_file(path).map_err(Failure::input)?;
        }
        self.dataset.add_to(&mut layers)?;
        let options = [
            ("segmenter", self.segmenter.as_ref().and_then(choice_name)),
            ("masks", self.masks.as_ref().and_then(|path| text(path.to_string_lossy().into_owned()))),
            ("weights", self.weights.as_ref().and_then(|path| text(path.to_string_lossy().into_owned()))),
            ("tracker", self.tracker.as_ref().and_then(choice_name)),
            (
                "tracker_weights",
                self.tracker_weights.as_ref().and_then(|path| text(path.to_string_lossy().into_owned())),
            ),
            ("prompts", self.prompts.as_ref().and_then(choice_name)),
            ("device", self.device.clone().and_then(text)),
            ("seed", self.seed.and_then(|seed| i64::try_from(seed).ok().map(toml::Value::Integer))),
            ("threads", self.threads.and_then(whole)),
        ];
        add_given(&mut layers, options)?;
        add_given(&mut layers, more)?;
        for assignment in &self.set {
            layers.add_assignment(assignment).map_err(Failure::input)?;
        }
        Ok(layers)
    }
}

/// Where a tracker's mask prompts come from, on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PromptsName {
    /// The segmenter's detections that lie on no track
    Detections,
    /// The scene's ground truth: every object on the frame where it becomes visible
    GroundTruth,
}

/// How results are scored.
#[derive(Clone, Debug, Args)]
pub struct ScoreOptions {
    /// Definition of the metrics: `paper` as in the paper's evaluation code, `strict` as in print
    #[arg(long, value_enum, value_name = "PROTOCOL", default_value = "paper")]
    pub protocol: ProtocolName,
    /// Leave predictions on unlabelled ground out of the score; they count against the prediction otherwise
    #[arg(long)]
    pub exclude_void: bool,
    /// True segments below this fraction of the image are unlabelled in that frame (MVPd: 0.001)
    #[arg(long, value_name = "FRACTION", default_value_t = 0.0)]
    pub min_truth_area: f64,
}

/// The protocols on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProtocolName {
    /// What the paper's evaluation code computes
    Paper,
    /// The formulas as printed
    Strict,
}

impl ScoreOptions {
    /// The settings of scores.
    pub fn settings(&self) -> Result<ScoreSettings, Failure> {
        if !(0.0..1.0).contains(&self.min_truth_area) {
            return Err(Failure::input(format!(
                "--min-truth-area: found {}, expected a fraction from 0 to 1",
                self.min_truth_area
            )));
        }
        let protocol = match self.protocol {
            ProtocolName::Paper => Protocol::Paper,
            ProtocolName::Strict => Protocol::Strict,
        };
        let void = if self.exclude_void { Void::Excluded } else { Void::Counted };
        Ok(ScoreSettings { protocol, void, min_ground_truth_area: self.min_truth_area })
    }
}

/// Lays the values that are there over the layers.
fn add_given<const N: usize>(
    layers: &mut SettingsLayers,
    options: [(&str, Option<toml::Value>); N],
) -> Result<(), Failure> {
    for (key, value) in options {
        if let Some(value) = value {
            layers.add(key, value).ok_or_else(|| Failure::input(format!("{key} is no table in the settings")))?;
        }
    }
    Ok(())
}

/// The name of a choice on the command line, which is also its name in settings.
pub fn choice_name(choice: &impl clap::ValueEnum) -> Option<toml::Value> {
    choice.to_possible_value().map(|value| toml::Value::String(value.get_name().to_owned()))
}

fn whole(number: usize) -> Option<toml::Value> {
    i64::try_from(number).ok().map(toml::Value::Integer)
}

fn text(text: String) -> Option<toml::Value> {
    Some(toml::Value::String(text))
}

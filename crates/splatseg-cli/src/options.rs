//! Options shared by several commands, and the settings they stand for.

use super::Failure;
use clap::Args;
use splatseg::settings::SettingsLayers;
use splatseg_dataset::{DatasetSettings, Preset};
use splatseg_files::MemoryLimit;
use splatseg_metrics::{Protocol, ScoreSettings, Void};
use std::path::PathBuf;

/// Options for reading a scene. Options without help stand for settings and use the settings' help.
#[derive(Clone, Debug, Default, Args)]
pub struct DatasetOptions {
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<String>,
    /// Read scenes as a published benchmark does; other options override it
    #[arg(long, value_enum, value_name = "PRESET")]
    pub preset: Option<PresetName>,
    #[arg(long, value_name = "N")]
    pub stride: Option<String>,
    #[arg(long, value_name = "WxH")]
    pub resize: Option<String>,
    #[arg(long, value_name = "PX")]
    pub crop_border: Option<String>,
    #[arg(long, value_name = "N")]
    pub start: Option<String>,
    #[arg(long, value_name = "N")]
    pub max_frames: Option<String>,
    #[command(flatten)]
    pub camera: CameraOptions,
    #[command(flatten)]
    pub poses: RecordedPoseOptions,
    #[command(flatten)]
    pub topics: TopicOptions,
}

/// Options that say what recorded poses are.
#[derive(Clone, Debug, Default, Args)]
pub struct RecordedPoseOptions {
    #[arg(long, value_name = "CONVENTION")]
    pub pose_convention: Option<String>,
    #[arg(long, value_name = "ORDER")]
    pub quaternion_order: Option<String>,
    #[arg(long, value_name = "METRES")]
    pub pose_scale: Option<String>,
}

/// Options that describe the camera of a recording.
#[derive(Clone, Debug, Default, Args)]
pub struct CameraOptions {
    #[arg(long, value_name = "PX")]
    pub fx: Option<String>,
    #[arg(long, value_name = "PX")]
    pub fy: Option<String>,
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub cx: Option<String>,
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub cy: Option<String>,
    #[arg(long, value_name = "UNITS")]
    pub depth_scale: Option<String>,
    #[arg(long, value_name = "METRES")]
    pub max_depth_m: Option<String>,
}

impl CameraOptions {
    /// Adds the options that were given to the layers.
    fn add_to(&self, layers: &mut SettingsLayers) -> Result<(), Failure> {
        let options = [
            ("dataset.fx", self.fx.as_ref()),
            ("dataset.fy", self.fy.as_ref()),
            ("dataset.cx", self.cx.as_ref()),
            ("dataset.cy", self.cy.as_ref()),
            ("dataset.depth_scale", self.depth_scale.as_ref()),
            ("dataset.max_depth_m", self.max_depth_m.as_ref()),
        ];
        add_given(layers, options)
    }
}

/// Options that select the topics of a recording, and say how they fit together.
#[derive(Clone, Debug, Default, Args)]
pub struct TopicOptions {
    #[arg(long, value_name = "TOPIC")]
    pub color: Option<String>,
    #[arg(long, value_name = "TOPIC")]
    pub depth: Option<String>,
    #[arg(long, value_name = "TOPIC")]
    pub camera_info: Option<String>,
    #[arg(long, value_name = "TOPIC")]
    pub pose: Option<String>,
    #[arg(long, value_name = "FRAME")]
    pub world_frame: Option<String>,
    #[arg(long, value_name = "FRAME")]
    pub pose_frame: Option<String>,
    // The value may also follow as a word of its own: see `with_joined_values`.
    #[arg(long, value_name = "WHETHER", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub register_depth: Option<String>,
    #[arg(long, value_name = "MS")]
    pub max_time_difference_ms: Option<String>,
}

impl TopicOptions {
    /// Returns the dataset settings with these options.
    pub fn settings(&self, camera: &CameraOptions) -> Result<DatasetSettings, Failure> {
        let mut layers = SettingsLayers::default();
        camera.add_to(&mut layers)?;
        self.add_to(&mut layers)?;
        Ok(layers.resolve_shared().map_err(Failure::input)?.dataset)
    }

    /// Adds the options that were given to the layers.
    fn add_to(&self, layers: &mut SettingsLayers) -> Result<(), Failure> {
        let options = [
            ("dataset.color", self.color.as_ref()),
            ("dataset.depth", self.depth.as_ref()),
            ("dataset.camera_info", self.camera_info.as_ref()),
            ("dataset.pose", self.pose.as_ref()),
            ("dataset.world_frame", self.world_frame.as_ref()),
            ("dataset.pose_frame", self.pose_frame.as_ref()),
            ("dataset.register_depth", self.register_depth.as_ref()),
            ("dataset.max_time_difference_ms", self.max_time_difference_ms.as_ref()),
        ];
        add_given(layers, options)
    }
}

/// Presets for reading scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PresetName {
    /// The paper's ScanNet-MV: --stride 20 --resize 320x240 --crop-border 5
    ScannetMv,
    /// MVPd as the paper reads it: --resize 320x240. Its scores also need --min-truth-area 0.001
    Mvpd,
    /// Like scannet-mv; in addition, `bench` measures every row of the paper's tables
    Paper,
}

impl PresetName {
    /// Returns the preset's dataset settings.
    fn settings(self) -> DatasetSettings {
        match self {
            Self::ScannetMv | Self::Paper => Preset::ScannetMv.settings(),
            Self::Mvpd => Preset::Mvpd.settings(),
        }
    }
}

impl DatasetOptions {
    /// Adds the options that were given to the layers.
    pub fn add_to(&self, layers: &mut SettingsLayers) -> Result<(), Failure> {
        if let Some(preset) = self.preset.map(PresetName::settings) {
            let (stride, crop_border) = (preset.stride.to_string(), preset.crop_border.to_string());
            let resize = preset.resize.map(|size| size.to_string());
            let settings = [
                ("dataset.stride", Some(&stride)),
                ("dataset.resize", resize.as_ref()),
                ("dataset.crop_border", Some(&crop_border)),
            ];
            add_given(layers, settings)?;
        }
        let options = [
            ("dataset.format", self.format.as_ref()),
            ("dataset.stride", self.stride.as_ref()),
            ("dataset.resize", self.resize.as_ref()),
            ("dataset.crop_border", self.crop_border.as_ref()),
            ("dataset.start", self.start.as_ref()),
            ("dataset.max_frames", self.max_frames.as_ref()),
            ("dataset.pose_convention", self.poses.pose_convention.as_ref()),
            ("dataset.quaternion_order", self.poses.quaternion_order.as_ref()),
            ("dataset.pose_scale", self.poses.pose_scale.as_ref()),
        ];
        add_given(layers, options)?;
        self.camera.add_to(layers)?;
        self.topics.add_to(layers)
    }

    /// Returns the dataset settings `base`, overridden by these options.
    pub fn over(&self, base: &DatasetSettings) -> Result<DatasetSettings, Failure> {
        let mut layers = SettingsLayers::default();
        self.add_to(&mut layers)?;
        layers.over_dataset(base).map_err(Failure::input)
    }
}

/// Options of commands that run methods. Options without help stand for settings and use the settings' help.
#[derive(Clone, Debug, Default, Args)]
pub struct SettingsOptions {
    #[command(flatten)]
    pub dataset: DatasetOptions,
    #[arg(long, value_name = "PRESET")]
    pub method_preset: Option<String>,
    #[arg(long, value_name = "SEGMENTER")]
    pub segmenter: Option<String>,
    #[arg(long, value_name = "DIR")]
    pub masks: Option<String>,
    #[arg(long, value_name = "FILE")]
    pub weights: Option<String>,
    #[arg(long, value_name = "TRACKER")]
    pub tracker: Option<String>,
    #[arg(long, value_name = "FILE")]
    pub tracker_weights: Option<String>,
    #[arg(long, value_name = "FILE")]
    pub names: Option<String>,
    #[arg(long, value_name = "FILE")]
    pub vocabulary: Option<String>,
    #[arg(long, value_name = "FILE")]
    pub depth_weights: Option<String>,
    #[arg(long, value_name = "USE")]
    pub predicted_depth: Option<String>,
    #[arg(long, value_name = "SOURCE")]
    pub prompts: Option<String>,
    #[arg(long, value_name = "SOURCE", value_delimiter = ',')]
    pub poses: Vec<String>,
    #[arg(long, value_name = "HOW")]
    pub detail: Option<String>,
    #[arg(long, value_name = "DEGREES")]
    pub rotate: Option<String>,
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// Settings from a TOML file, or from the summary.json of an earlier run
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Any setting, e.g. memory.max_votes=8; `splatseg settings` lists them all
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    #[arg(long, value_name = "N")]
    pub seed: Option<String>,
    #[arg(long, value_name = "N")]
    pub threads: Option<String>,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

impl SettingsOptions {
    /// Returns the layers from file, options and assignments, in this order. `more` contains further options.
    pub fn layers<const N: usize>(&self, more: [(&str, Option<&String>); N]) -> Result<SettingsLayers, Failure> {
        self.layers_over(SettingsLayers::default(), more)
    }

    /// Like [`Self::layers`], on top of other layers.
    pub fn layers_over<const N: usize>(
        &self,
        mut layers: SettingsLayers,
        more: [(&str, Option<&String>); N],
    ) -> Result<SettingsLayers, Failure> {
        if let Some(path) = &self.config {
            layers.add_file(path).map_err(Failure::input)?;
        }
        self.dataset.add_to(&mut layers)?;
        if self.poses.len() > 1 {
            let found = self.poses.join(",");
            return Err(Failure::input(format!(
                "--poses: found {found}, expected one source; only bench compares several"
            )));
        }
        let namer = self.names.as_ref().map(|_| "clip".to_owned());
        let depth_predictor = self.depth_weights.as_ref().map(|_| "depth-anything".to_owned());
        let options = [
            ("method_preset", self.method_preset.as_ref()),
            ("segmenter", self.segmenter.as_ref()),
            ("masks", self.masks.as_ref()),
            ("weights", self.weights.as_ref()),
            ("tracker", self.tracker.as_ref()),
            ("tracker_weights", self.tracker_weights.as_ref()),
            ("namer", namer.as_ref()),
            ("names", self.names.as_ref()),
            ("vocabulary", self.vocabulary.as_ref()),
            ("depth_predictor", depth_predictor.as_ref()),
            ("depth_weights", self.depth_weights.as_ref()),
            ("predicted_depth", self.predicted_depth.as_ref()),
            ("prompts", self.prompts.as_ref()),
            ("poses", self.poses.first()),
            ("detail", self.detail.as_ref()),
            ("rotate", self.rotate.as_ref()),
            ("device", self.device.as_ref()),
            ("seed", self.seed.as_ref()),
            ("threads", self.threads.as_ref()),
            ("memory_limit", self.memory_limit.as_ref()),
        ];
        add_given(&mut layers, options)?;
        add_given(&mut layers, more)?;
        for assignment in &self.set {
            layers.add_assignment(assignment).map_err(Failure::input)?;
        }
        Ok(layers)
    }
}

/// The setting `memory_limit` of a command that has no other settings.
///
/// # Errors
/// If the text is not a size.
pub fn memory_limit(text: Option<&String>) -> Result<MemoryLimit, Failure> {
    let mut layers = SettingsLayers::default();
    if let Some(text) = text {
        layers.add_text("memory_limit", text);
    }
    Ok(layers.resolve_shared().map_err(Failure::input)?.run.memory_limit)
}

/// Options for scoring.
#[derive(Clone, Debug, Args)]
pub struct ScoreOptions {
    /// Definition of the metrics: `paper` as in the authors' evaluation code, `strict` as in VPQ and STEP
    #[arg(long, value_enum, value_name = "PROTOCOL", default_value = "paper")]
    pub protocol: ProtocolName,
    /// Ignore predictions on unlabelled pixels, which otherwise count as wrong
    #[arg(long)]
    pub exclude_void: bool,
    /// Treat true segments below this fraction of the image as unlabelled in that frame (MVPd: 0.001) [default: 0]
    #[arg(long, value_name = "FRACTION")]
    pub min_truth_area: Option<f64>,
}

/// Definitions of the metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ProtocolName {
    /// As the authors' evaluation code computes them
    Paper,
    /// VPQ (IoU above 0.5) on the paper's windows, and STEP's STQ
    Strict,
}

impl ScoreOptions {
    /// Returns the score settings.
    pub fn settings(&self) -> Result<ScoreSettings, Failure> {
        self.settings_of_benchmark(0.0)
    }

    /// Returns the score settings for a benchmark that by default leaves out true segments below `min_truth_area`, a
    /// fraction of the image.
    pub fn settings_of_benchmark(&self, min_truth_area: f64) -> Result<ScoreSettings, Failure> {
        let min_ground_truth_area = self.min_truth_area.unwrap_or(min_truth_area);
        if !(0.0..1.0).contains(&min_ground_truth_area) {
            return Err(Failure::input(format!(
                "--min-truth-area: found {min_ground_truth_area}, expected a fraction from 0 to 1"
            )));
        }
        let protocol = match self.protocol {
            ProtocolName::Paper => Protocol::Paper,
            ProtocolName::Strict => Protocol::Strict,
        };
        let void = if self.exclude_void { Void::Excluded } else { Void::Counted };
        Ok(ScoreSettings { protocol, void, min_ground_truth_area })
    }
}

/// Adds the options that were given to the layers.
fn add_given<const N: usize>(
    layers: &mut SettingsLayers,
    options: [(&str, Option<&String>); N],
) -> Result<(), Failure> {
    for (key, text) in options {
        if let Some(text) = text {
            layers
                .add_text(key, text)
                .ok_or_else(|| Failure::input(format!("{key} is not a section in the settings")))?;
        }
    }
    Ok(())
}

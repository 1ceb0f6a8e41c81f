//! All settings of a run in one place: what the command line, a TOML file and `summary.json` share.

use serde::{Deserialize, Serialize};
use splatseg_dataset::DatasetSettings;
use splatseg_memory::MemorySettings;
use splatseg_models::device::DeviceName;
use splatseg_models::fastsam::FastSamPredictorSettings;
use splatseg_segmenter::{GraphSettings, OracleSettings};
use splatseg_tracking::{
    ExplanationSettings, FastSamSettings, FastSamSplatSettings, FastSpamSettings, NewObjectSettings, PromptSource,
    RepromptSettings, Sam2SplatSettings, Sam2TrackerSettings, SimTrackerSettings,
};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Settings of a run. Every key has the same name as a field here, a key in a TOML file, in `--set` and in
/// `summary.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The method.
    pub method: MethodName,
    /// The segmenter that the method builds on.
    pub segmenter: SegmenterName,
    /// Folder of precomputed masks, one file per frame, for the segmenter `masks`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masks: Option<PathBuf>,
    /// Checkpoint of the segmenter `fastsam`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weights: Option<PathBuf>,
    /// The tracker of the methods `sam2` and `sam2-splat`.
    pub tracker: TrackerName,
    /// Checkpoint of the tracker `sam2`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracker_weights: Option<PathBuf>,
    /// Where the tracker's mask prompts come from: the segmenter's detections, or the ground truth.
    pub prompts: PromptSource,
    /// Detections with a larger IoU with any track's mask are no new objects.
    pub max_detection_iou: f64,
    /// What networks run on.
    pub device: DeviceName,
    /// Whether the next frame is segmented while the memory learns this one. Results do not depend on it; the times of
    /// stages then include what the other side takes from them.
    pub segment_ahead: bool,
    /// Seed of everything random.
    pub seed: u64,
    /// Threads to compute with; 0: one per core. Results do not depend on it.
    pub threads: usize,
    /// Predicted segments of fewer pixels are ignored, and so are remembered ones in the output.
    pub min_segment_area: usize,
    /// Expected and predicted segments with a smaller F-score are no match. The paper names no minimum.
    pub min_match_f_score: f64,
    /// Whether the method `fastsam-splat` shows a segment before its thing was seen in a second frame.
    pub show_tentative: bool,
    /// What the method `fastsam-splat` lets its memory know better than a frame.
    pub explanation: ExplanationSettings,
    /// How the scene is read.
    pub dataset: DatasetSettings,
    /// The splat memory.
    pub memory: MemorySettings,
    /// The segmenter `fastsam`.
    pub fastsam: FastSamPredictorSettings,
    /// The tracker `sam2`.
    pub sam2: Sam2TrackerSettings,
    /// The tracker `sim`.
    pub sim_tracker: SimTrackerSettings,
    /// How the method `sam2-splat` puts its tracker right.
    pub reprompt: RepromptSettings,
    /// The segmenter `graph`.
    pub graph: GraphSettings,
    /// The segmenter `oracle`.
    pub oracle: OracleSettings,
}

/// The methods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum MethodName {
    /// A segmenter for single frames, and a splat that remembers
    #[default]
    FastsamSplat,
    /// A segmenter for single frames; ids are carried by overlap with the frame before
    Fastsam,
    /// A segmenter for single frames, and one remembered point per segment that prompts it
    Fastspam,
    /// A tracker that detections of a segmenter prompt
    Sam2,
    /// The same, and a splat that remembers and puts the tracker right
    Sam2Splat,
}

/// The segmenters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum SegmenterName {
    /// Built in, no weights: cuts where depth, normals and colour say that one object ends
    #[default]
    Graph,
    /// The network of the paper, on the weights of --weights
    Fastsam,
    /// Precomputed masks of any other model, one file per frame
    Masks,
    /// The scene's ground truth with errors of known kinds and rates, for comparing methods
    Oracle,
}

/// The trackers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum TrackerName {
    /// SAM 2.1, on the weights of --tracker-weights
    #[default]
    Sam2,
    /// The scene's ground truth with errors of known kinds and rates, for comparing methods
    Sim,
}

impl MethodName {
    /// The name on the command line, in settings and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::FastsamSplat => "fastsam-splat",
            Self::Fastsam => "fastsam",
            Self::Fastspam => "fastspam",
            Self::Sam2 => "sam2",
            Self::Sam2Splat => "sam2-splat",
        }
    }

    /// Whether the method builds on a tracker.
    pub fn has_tracker(self) -> bool {
        matches!(self, Self::Sam2 | Self::Sam2Splat)
    }
}

impl TrackerName {
    /// The name on the command line, in settings and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sam2 => "sam2",
            Self::Sim => "sim",
        }
    }
}

impl SegmenterName {
    /// The name on the command line, in settings and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Graph => "graph",
            Self::Fastsam => "fastsam",
            Self::Masks => "masks",
            Self::Oracle => "oracle",
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        let method = FastSamSplatSettings::default();
        Self {
            method: MethodName::default(),
            segmenter: SegmenterName::default(),
            masks: None,
            weights: None,
            tracker: TrackerName::default(),
            tracker_weights: None,
            prompts: PromptSource::default(),
            max_detection_iou: NewObjectSettings::default().max_detection_iou,
            device: DeviceName::default(),
            segment_ahead: false,
            seed: method.seed,
            threads: 0,
            min_segment_area: method.min_segment_area,
            min_match_f_score: method.min_match_f_score,
            show_tentative: method.show_tentative,
            explanation: method.explanation,
            dataset: DatasetSettings::default(),
            memory: method.memory,
            fastsam: FastSamPredictorSettings::default(),
            sam2: Sam2TrackerSettings::default(),
            sim_tracker: SimTrackerSettings::default(),
            reprompt: RepromptSettings::default(),
            graph: GraphSettings::default(),
            oracle: OracleSettings::default(),
        }
    }
}

/// Settings that cannot be read.
#[derive(Debug, Error)]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The TOML file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file is no TOML.
    #[error("{}: {message}", path.display())]
    Syntax {
        /// The TOML file.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
    },
    /// `--set` without `=`, or with a key that goes through a plain value.
    #[error("--set {0}: expected KEY=VALUE, e.g. memory.feature_dim=14")]
    Assignment(String),
    /// A key that does not exist, or a value of another type.
    #[error("settings: {0}")]
    Invalid(String),
}

impl Settings {
    /// The settings for [`splatseg_tracking::FastSamSplat`].
    pub fn fastsam_splat(&self) -> FastSamSplatSettings {
        FastSamSplatSettings {
            memory: self.memory.clone(),
            min_segment_area: self.min_segment_area,
            min_match_f_score: self.min_match_f_score,
            show_tentative: self.show_tentative,
            explanation: self.explanation,
            seed: self.seed,
        }
    }

    /// The settings for [`splatseg_tracking::FastSam`].
    pub fn fastsam(&self) -> FastSamSettings {
        FastSamSettings { min_segment_area: self.min_segment_area, ..FastSamSettings::default() }
    }

    /// The settings for [`splatseg_tracking::FastSpam`].
    pub fn fastspam(&self) -> FastSpamSettings {
        FastSpamSettings { min_segment_area: self.min_segment_area, seed: self.seed, ..FastSpamSettings::default() }
    }

    /// The settings for [`splatseg_tracking::Sam2Baseline`].
    pub fn new_objects(&self) -> NewObjectSettings {
        NewObjectSettings {
            prompts: self.prompts,
            max_detection_iou: self.max_detection_iou,
            min_segment_area: self.min_segment_area,
        }
    }

    /// The settings for [`splatseg_tracking::Sam2Splat`].
    pub fn sam2_splat(&self) -> Sam2SplatSettings {
        Sam2SplatSettings {
            memory: self.memory.clone(),
            new_objects: self.new_objects(),
            reprompt: self.reprompt,
            seed: self.seed,
        }
    }
}

/// Settings being put together, later layers over earlier ones.
#[derive(Clone, Debug, Default)]
pub struct SettingsLayers {
    table: toml::Table,
}

impl SettingsLayers {
    /// Lays a TOML file over what is there.
    ///
    /// # Errors
    /// If the file cannot be read or is no TOML.
    pub fn add_file(&mut self, path: &Path) -> Result<(), SettingsError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| SettingsError::Read { path: path.to_owned(), source })?;
        let table = text.parse::<toml::Table>().map_err(|error| SettingsError::Syntax {
            path: path.to_owned(),
            message: error.to_string().trim().replace('\n', " "),
        })?;
        lay_over(&mut self.table, table);
        Ok(())
    }

    /// Lays `KEY=VALUE` over what is there. A key's parts are joined by dots; a value that is no TOML is a string.
    ///
    /// # Errors
    /// If `assignment` has not that form.
    pub fn add_assignment(&mut self, assignment: &str) -> Result<(), SettingsError> {
        let malformed = || SettingsError::Assignment(assignment.to_owned());
        let (key, value) = assignment.split_once('=').ok_or_else(malformed)?;
        let value = format!("value = {}", value.trim())
            .parse::<toml::Table>()
            .ok()
            .and_then(|mut table| table.remove("value"))
            .unwrap_or_else(|| toml::Value::String(value.trim().to_owned()));
        self.add(key.trim(), value).ok_or_else(malformed)
    }

    /// Lays one value over what is there; `None` if a part of the key is empty or leads through a plain value.
    pub fn add(&mut self, key: &str, value: toml::Value) -> Option<()> {
        let mut parts: Vec<&str> = key.split('.').collect();
        let last = parts.pop()?;
        if last.is_empty() || parts.iter().any(|part| part.is_empty()) {
            return None;
        }
        let mut table = &mut self.table;
        for part in parts {
            table = table.entry(part).or_insert_with(|| toml::Value::Table(toml::Table::new())).as_table_mut()?;
        }
        table.insert(last.to_owned(), value);
        Some(())
    }

    /// The settings: defaults where no layer says otherwise.
    ///
    /// # Errors
    /// If a key does not exist or a value has the wrong type.
    pub fn resolve(self) -> Result<Settings, SettingsError> {
        toml::Value::Table(self.table)
            .try_into()
            .map_err(|error: toml::de::Error| SettingsError::Invalid(error.to_string().trim().replace('\n', " ")))
    }
}

fn lay_over(below: &mut toml::Table, above: toml::Table) {
    for (key, value) in above {
        match (below.get_mut(&key), value) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_layers_win_and_the_rest_is_default() {
        let mut layers = SettingsLayers::default();
        layers.add_assignment("memory.feature_dim=14").unwrap();
        layers.add_assignment("memory.num_steps = 5").unwrap();
        layers.add_assignment("memory.feature_dim=7").unwrap();
        layers.add_assignment("segmenter=masks").unwrap();
        layers.add_assignment("dataset.resize=320x240").unwrap();
        let settings = layers.resolve().unwrap();
        assert_eq!((settings.memory.feature_dim, settings.memory.num_steps), (7, 5));
        assert_eq!(settings.segmenter, SegmenterName::Masks);
        assert_eq!(settings.memory.num_codes, MemorySettings::default().num_codes);
    }

    #[test]
    fn unknown_keys_and_wrong_types_are_named() {
        let resolve = |assignment: &str| {
            let mut layers = SettingsLayers::default();
            layers.add_assignment(assignment).and_then(|()| layers.resolve().map(|_| ()))
        };
        assert!(resolve("memory.feature_dimm=14").unwrap_err().to_string().contains("feature_dimm"));
        assert!(resolve("memory.feature_dim=many").unwrap_err().to_string().contains("many"));
        for malformed in ["memory", "=3", "memory..x=1"] {
            assert!(matches!(resolve(malformed), Err(SettingsError::Assignment(_))), "{malformed}");
        }
    }

    #[test]
    fn settings_survive_toml_and_json() {
        let settings = Settings::default();
        let text = toml::to_string(&settings).unwrap();
        assert_eq!(toml::from_str::<Settings>(&text).unwrap(), settings);
        let json = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings);
    }
}

//! All settings of a run, the same in a TOML file, in `--set`, in `summary.json` and in programs.

mod document;
mod error;
mod file;
mod input_files;
mod layers;
mod names;
mod preset;
mod registry;
mod table;
mod usage;

pub use document::{describe_settings, markdown};
pub use error::{MissingFile, SettingsError};
pub use input_files::SettingsInput;
pub use layers::SettingsLayers;
pub use names::{MemoryDevice, MethodName, SegmenterName, TrackerName};
pub use preset::MethodPreset;
pub use registry::{ChosenValues, Entry, Need, describe, entries};

use serde::Serialize;
use splatseg_dataset::DatasetSettings;
use splatseg_input::MemoryLimit;
use splatseg_memory::MemorySettings;
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_models::fastsam::FastSamPredictorSettings;
use splatseg_segmenter::{AffinitySettings, GraphSettings};
use splatseg_settings::{Allowed, Choice, settings};
use splatseg_simulators::{OracleSettings, SimTrackerSettings};
use splatseg_tracking::{
    FastSamBaselineSettings, FastSamSplatSettings, FastSpamBaselineSettings, PromptSource, Sam2BaselineSettings,
    Sam2SplatSettings, Sam2TrackerSettings,
};
use std::path::PathBuf;

/// Settings of a run: a method, a segmenter, and how frames are read.
///
/// In TOML and JSON the parts are at one level: `method = "fastsam-splat"`, `memory.max_votes = 8`. They have the
/// settings of the chosen method, segmenter, tracker and memory only.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// The method, with its settings.
    pub method: MethodSettings,
    /// The segmenter whose masks the method uses, with its settings.
    pub segmenter: SegmenterSettings,
    /// How the scene is read.
    pub dataset: DatasetSettings,
    /// Settings of every run.
    pub run: RunSettings,
}

settings! {
    /// Settings of every run, whatever its method.
    pub struct RunSettings in "" {
        /// Whose defaults other settings have. Values that are given win over them. `splatseg settings` lists both.
        method_preset: MethodPreset = MethodPreset::Splatseg, Allowed::Names(MethodPreset::NAMES);
        /// The device that runs the networks. Support for devices other than the CPU must be built in.
        device: DeviceName = DeviceName::Cpu, Allowed::Names(DeviceName::NAMES);
        /// The device that keeps and renders the memory. `gpu` must be built in. On some GPUs a few pixels differ.
        memory_device: MemoryDevice = MemoryDevice::Cpu, Allowed::Names(MemoryDevice::NAMES);
        /// Whether the next frame is segmented while the method works on this one. Results do not depend on it. Stages
        /// take longer, as they share the processor.
        segment_ahead: bool = true, Allowed::Switch;
        /// Whether `run` writes `index.html`, a page to look at the result: map, video and list of objects.
        page: bool = true, Allowed::Switch;
        /// Seed of all random numbers.
        seed: u64 = 0, Allowed::between(0.0, Allowed::MAX_WHOLE as f64);
        /// Whether the first frame that cannot be used ends the run, instead of being skipped.
        strict_input: bool = false, Allowed::Switch;
        /// Every how many frames the state of the run is saved, so that `--resume` can go on with it; 0: never. Only
        /// `fastsam-splat` can go on. Results do not depend on it.
        save_every: usize = 0, Allowed::between(0.0, 1e9);
        /// Number of threads; 0: one per core. Results do not depend on it.
        threads: usize = 0, Allowed::between(0.0, 512.0);
        /// The memory that the program may take, e.g. `4GB`; `auto`: what the machine has available. Input that would
        /// take more is refused. Results do not depend on it.
        memory_limit: MemoryLimit = MemoryLimit::Auto, Allowed::Text(MemoryLimit::EXPECTED);
    }
}

/// A method with its settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "method", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum MethodSettings {
    /// [`splatseg_tracking::FastSamSplat`].
    FastsamSplat(FastSamSplatSettings),
    /// [`splatseg_tracking::FastSamBaseline`].
    Fastsam(FastSamBaselineSettings),
    /// [`splatseg_tracking::FastSpamBaseline`].
    Fastspam(FastSpamBaselineSettings),
    /// [`splatseg_tracking::Sam2Baseline`].
    Sam2 {
        /// Its settings.
        #[serde(flatten)]
        settings: Sam2BaselineSettings,
        /// The tracker.
        #[serde(flatten)]
        tracker: TrackerSettings,
    },
    /// [`splatseg_tracking::Sam2Splat`].
    Sam2Splat {
        /// Its settings.
        #[serde(flatten)]
        settings: Box<Sam2SplatSettings>,
        /// The tracker.
        #[serde(flatten)]
        tracker: TrackerSettings,
    },
}

/// A segmenter with its settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "segmenter", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SegmenterSettings {
    /// [`splatseg_segmenter::AffinitySegmenter`].
    Affinity {
        /// Weights other than those built in.
        #[serde(skip_serializing_if = "Option::is_none")]
        weights: Option<PathBuf>,
        /// Its settings.
        affinity: AffinitySettings,
    },
    /// [`splatseg_segmenter::GraphSegmenter`].
    Graph {
        /// Its settings.
        graph: GraphSettings,
    },
    /// [`splatseg_segmenter::FastSamSegmenter`].
    Fastsam {
        /// Its checkpoint; needed to build a pipeline.
        #[serde(skip_serializing_if = "Option::is_none")]
        weights: Option<PathBuf>,
        /// Its settings.
        fastsam: FastSamPredictorSettings,
    },
    /// [`splatseg_segmenter::MaskFolder`].
    Masks {
        /// A folder with one file per frame; needed to build a pipeline.
        #[serde(skip_serializing_if = "Option::is_none")]
        masks: Option<PathBuf>,
    },
    /// [`splatseg_simulators::OracleSegmenter`].
    Oracle {
        /// Its settings.
        oracle: OracleSettings,
    },
}

/// A tracker with its settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "tracker", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TrackerSettings {
    /// [`splatseg_tracking::Sam2Tracker`].
    Sam2 {
        /// Its checkpoint; needed to build a pipeline.
        #[serde(skip_serializing_if = "Option::is_none")]
        tracker_weights: Option<PathBuf>,
        /// Its settings.
        sam2: Sam2TrackerSettings,
    },
    /// [`splatseg_simulators::SimTracker`].
    Sim {
        /// Its settings.
        sim_tracker: SimTrackerSettings,
    },
}

impl Default for MethodSettings {
    fn default() -> Self {
        Self::FastsamSplat(FastSamSplatSettings::default())
    }
}

impl Default for SegmenterSettings {
    fn default() -> Self {
        Self::Affinity { weights: None, affinity: AffinitySettings::default() }
    }
}

impl MethodSettings {
    /// Its name.
    pub fn name(&self) -> MethodName {
        match self {
            Self::FastsamSplat(_) => MethodName::FastsamSplat,
            Self::Fastsam(_) => MethodName::Fastsam,
            Self::Fastspam(_) => MethodName::Fastspam,
            Self::Sam2 { .. } => MethodName::Sam2,
            Self::Sam2Splat { .. } => MethodName::Sam2Splat,
        }
    }

    /// The settings of its memory, if it has one.
    pub fn memory(&self) -> Option<&MemorySettings> {
        match self {
            Self::FastsamSplat(settings) => Some(&settings.memory),
            Self::Sam2Splat { settings, .. } => Some(&settings.memory),
            Self::Fastsam(_) | Self::Fastspam(_) | Self::Sam2 { .. } => None,
        }
    }

    /// Its tracker, if it has one.
    pub fn tracker(&self) -> Option<&TrackerSettings> {
        match self {
            Self::Sam2 { tracker, .. } | Self::Sam2Splat { tracker, .. } => Some(tracker),
            Self::FastsamSplat(_) | Self::Fastsam(_) | Self::Fastspam(_) => None,
        }
    }

    /// The source of its tracker's prompts, and the area of the smallest object that is prompted, pixels; `None`
    /// without a tracker.
    pub fn prompts(&self) -> Option<(PromptSource, usize)> {
        match self {
            Self::Sam2 { settings, .. } => Some((settings.prompts, settings.min_prediction_area)),
            Self::Sam2Splat { settings, .. } => Some((settings.prompts, settings.min_prediction_area)),
            Self::FastsamSplat(_) | Self::Fastsam(_) | Self::Fastspam(_) => None,
        }
    }

    /// Whether it prompts the objects that its tracker has lost.
    pub(crate) fn prompts_lost_objects(&self) -> bool {
        matches!(self, Self::Sam2Splat { settings, .. } if settings.reprompt.not_tracked)
    }

    /// Whether it takes masks from the segmenter; otherwise ground truth prompts its tracker.
    pub fn uses_segmenter(&self) -> bool {
        self.prompts().is_none_or(|(source, _)| source == PromptSource::Detections)
    }

    /// Checks every setting.
    fn validate(&self) -> Result<(), splatseg_settings::SettingError> {
        match self {
            Self::FastsamSplat(settings) => settings.validate(),
            Self::Fastsam(settings) => settings.validate(),
            Self::Fastspam(settings) => settings.validate(),
            Self::Sam2 { settings, tracker } => settings.validate().and_then(|()| tracker.validate()),
            Self::Sam2Splat { settings, tracker } => settings.validate().and_then(|()| tracker.validate()),
        }
    }
}

impl SegmenterSettings {
    /// Its name.
    pub fn name(&self) -> SegmenterName {
        match self {
            Self::Graph { .. } => SegmenterName::Graph,
            Self::Affinity { .. } => SegmenterName::Affinity,
            Self::Fastsam { .. } => SegmenterName::Fastsam,
            Self::Masks { .. } => SegmenterName::Masks,
            Self::Oracle { .. } => SegmenterName::Oracle,
        }
    }

    fn validate(&self) -> Result<(), splatseg_settings::SettingError> {
        match self {
            Self::Graph { graph } => graph.validate(),
            Self::Affinity { affinity, .. } => affinity.validate(),
            Self::Fastsam { fastsam, .. } => fastsam.validate(),
            Self::Masks { .. } => Ok(()),
            Self::Oracle { oracle } => oracle.validate(),
        }
    }
}

impl TrackerSettings {
    /// Its name.
    pub fn name(&self) -> TrackerName {
        match self {
            Self::Sam2 { .. } => TrackerName::Sam2,
            Self::Sim { .. } => TrackerName::Sim,
        }
    }

    fn validate(&self) -> Result<(), splatseg_settings::SettingError> {
        match self {
            Self::Sam2 { sam2, .. } => sam2.validate(),
            Self::Sim { sim_tracker } => sim_tracker.validate(),
        }
    }
}

impl Settings {
    /// Checks every setting, that every file that is needed is given, and that the program has the device that its
    /// networks are to run on.
    ///
    /// # Errors
    /// Names the first setting that is out of range or missing.
    pub fn validate(&self) -> Result<(), SettingsError> {
        self.method.validate()?;
        self.segmenter.validate()?;
        self.dataset.validate()?;
        self.run.validate()?;
        let segmenter = self.method.uses_segmenter().then_some(&self.segmenter);
        let tracker = self.method.tracker();
        match segmenter {
            Some(SegmenterSettings::Fastsam { weights: None, .. }) => {
                return Err(SettingsError::Missing(MissingFile::FASTSAM));
            }
            Some(SegmenterSettings::Masks { masks: None }) => return Err(SettingsError::Missing(MissingFile::MASKS)),
            _ => {}
        }
        if let Some(TrackerSettings::Sam2 { tracker_weights: None, .. }) = tracker {
            return Err(SettingsError::Missing(MissingFile::SAM2));
        }
        match self.devices().find(|device| !device.is_built()) {
            Some(device) => Err(DeviceError::NotBuilt(device.name()).into()),
            None => Ok(()),
        }
    }

    /// The devices that networks and the memory need, if there are any.
    pub fn devices(&self) -> impl Iterator<Item = DeviceName> {
        let has_network =
            matches!(self.segmenter, SegmenterSettings::Affinity { .. } | SegmenterSettings::Fastsam { .. });
        let segments = self.method.uses_segmenter() && has_network;
        let tracks = matches!(self.method.tracker(), Some(TrackerSettings::Sam2 { .. }));
        let remembers = self.method.memory().is_some() && self.run.memory_device == MemoryDevice::Gpu;
        let networks = (segments || tracks).then_some(self.run.device);
        networks.into_iter().chain(remembers.then_some(DeviceName::Gpu))
    }
}

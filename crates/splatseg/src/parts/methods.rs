//! The methods: names, settings and construction. A new method is added here.

use super::TrackerSettings;
use super::requirements::{Registry, choice};
use super::values::{chosen, section};
use serde::Serialize;
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_settings::{Choice, Section, SettingError, choices};
use splatseg_tracking::{
    FastSamBaseline, FastSamBaselineSettings, FastSamSplat, FastSamSplatSettings, FastSpamBaseline,
    FastSpamBaselineSettings, Method, PromptSource, Sam2Baseline, Sam2BaselineSettings, Sam2Splat, Sam2SplatSettings,
    Tracker, TrackingError,
};
use toml::Table;

choices! {
    /// The methods.
    pub enum MethodName, default FastsamSplat {
        /// A splat memory keeps the ids of any segmenter's masks, not only FastSAM's
        FastsamSplat = "fastsam-splat",
        /// Baseline without a memory: the masks of any segmenter get ids by overlap with the previous frame
        Fastsam = "fastsam",
        /// Baseline without a memory: a segmenter, prompted with one remembered point per object
        Fastspam = "fastspam",
        /// Baseline without a memory: a tracker, prompted with the detections of a segmenter
        Sam2 = "sam2",
        /// A tracker with a splat memory that corrects it
        Sam2Splat = "sam2-splat",
    }
}

impl MethodName {
    /// Returns true if the method has a splat memory.
    pub fn has_memory(self) -> bool {
        matches!(self, Self::FastsamSplat | Self::Sam2Splat)
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

impl Default for MethodSettings {
    fn default() -> Self {
        Self::FastsamSplat(FastSamSplatSettings::default())
    }
}

impl MethodSettings {
    /// Returns the name of the method.
    pub fn name(&self) -> MethodName {
        match self {
            Self::FastsamSplat(_) => MethodName::FastsamSplat,
            Self::Fastsam(_) => MethodName::Fastsam,
            Self::Fastspam(_) => MethodName::Fastspam,
            Self::Sam2 { .. } => MethodName::Sam2,
            Self::Sam2Splat { .. } => MethodName::Sam2Splat,
        }
    }

    /// Returns the settings of the memory, if the method has one.
    pub fn memory(&self) -> Option<&MemorySettings> {
        match self {
            Self::FastsamSplat(settings) => Some(&settings.memory),
            Self::Sam2Splat { settings, .. } => Some(&settings.memory),
            Self::Fastsam(_) | Self::Fastspam(_) | Self::Sam2 { .. } => None,
        }
    }

    /// Returns the tracker, if the method has one.
    pub fn tracker(&self) -> Option<&TrackerSettings> {
        match self {
            Self::Sam2 { tracker, .. } | Self::Sam2Splat { tracker, .. } => Some(tracker),
            Self::FastsamSplat(_) | Self::Fastsam(_) | Self::Fastspam(_) => None,
        }
    }

    /// As [`Self::tracker`], to be changed.
    pub(crate) fn tracker_mut(&mut self) -> Option<&mut TrackerSettings> {
        match self {
            Self::Sam2 { tracker, .. } | Self::Sam2Splat { tracker, .. } => Some(tracker),
            Self::FastsamSplat(_) | Self::Fastsam(_) | Self::Fastspam(_) => None,
        }
    }

    /// Returns the source of the tracker's prompts and the minimum area of a prompted object, pixels; `None` without a
    /// tracker.
    pub fn prompts(&self) -> Option<(PromptSource, usize)> {
        match self {
            Self::Sam2 { settings, .. } => Some((settings.prompts, settings.min_area)),
            Self::Sam2Splat { settings, .. } => Some((settings.prompts, settings.min_area)),
            Self::FastsamSplat(_) | Self::Fastsam(_) | Self::Fastspam(_) => None,
        }
    }

    /// Returns true if the method re-prompts objects that its tracker has lost.
    pub(crate) fn prompts_lost_objects(&self) -> bool {
        matches!(self, Self::Sam2Splat { settings, .. } if settings.reprompt.not_tracked)
    }

    /// Returns true if the method uses the segmenter's masks; otherwise ground truth prompts its tracker.
    pub fn uses_segmenter(&self) -> bool {
        self.prompts().is_none_or(|(source, _)| source == PromptSource::Detections)
    }

    /// Checks every setting.
    pub(crate) fn validate(&self) -> Result<(), SettingError> {
        match self {
            Self::FastsamSplat(settings) => settings.validate(),
            Self::Fastsam(settings) => settings.validate(),
            Self::Fastspam(settings) => settings.validate(),
            Self::Sam2 { settings, tracker } => settings.validate().and_then(|()| tracker.validate()),
            Self::Sam2Splat { settings, tracker } => settings.validate().and_then(|()| tracker.validate()),
        }
    }

    /// Reads the method and its settings from a table of checked values.
    pub(crate) fn from_table(table: &Table) -> Result<Self, SettingError> {
        Ok(match chosen(table, "method") {
            MethodName::FastsamSplat => Self::FastsamSplat(section(table)?),
            MethodName::Fastsam => Self::Fastsam(section(table)?),
            MethodName::Fastspam => Self::Fastspam(section(table)?),
            MethodName::Sam2 => Self::Sam2 { settings: section(table)?, tracker: TrackerSettings::from_table(table)? },
            MethodName::Sam2Splat => {
                Self::Sam2Splat { settings: Box::new(section(table)?), tracker: TrackerSettings::from_table(table)? }
            }
        })
    }

    /// Builds the method with the parts that `parts` makes.
    pub(crate) fn build<P: MethodParts>(&self, seed: u64, parts: &mut P) -> Result<Box<dyn Method>, P::Error> {
        Ok(match self {
            Self::FastsamSplat(settings) => {
                let memory = parts.make_memory(&settings.memory)?;
                Box::new(FastSamSplat::with_memory(settings.clone(), memory)?)
            }
            Self::Fastsam(settings) => Box::new(FastSamBaseline::new(settings.clone())?),
            Self::Fastspam(settings) => Box::new(FastSpamBaseline::new(settings.clone(), seed)?),
            Self::Sam2 { settings, tracker } => {
                Box::new(Sam2Baseline::new(parts.make_tracker(tracker)?, settings.clone())?)
            }
            Self::Sam2Splat { settings, tracker } => {
                let tracker = parts.make_tracker(tracker)?;
                let memory = parts.make_memory(&settings.memory)?;
                Box::new(Sam2Splat::with_memory(tracker, (**settings).clone(), memory)?)
            }
        })
    }
}

/// Makes the parts of a method: those that settings describe, or a caller's own.
pub(crate) trait MethodParts {
    /// The error of a part that cannot be made, or of the method.
    type Error: From<TrackingError>;

    /// The memory that the method continues, or an empty one.
    fn make_memory(&mut self, settings: &MemorySettings) -> Result<SplatMemory, Self::Error>;

    /// The tracker of the method.
    fn make_tracker(&mut self, settings: &TrackerSettings) -> Result<Box<dyn Tracker>, Self::Error>;
}

/// The methods that use a tracker.
pub(crate) const WITH_TRACKER: [&str; 2] = ["sam2", "sam2-splat"];

/// Help of the choice of a method.
const METHOD_HELP: &str = "How masks get lasting ids. The names are the paper's: `fastsam` in them stands for any segmenter, which \
     `segmenter` chooses.";

/// Adds the choice of a method.
pub(crate) fn add_choice(registry: &mut Registry) {
    registry.add(vec![choice("method", Some(MethodName::default().name()), MethodName::NAMES, METHOD_HELP)], &[]);
}

/// Adds the settings of each method.
pub(crate) fn add_settings(registry: &mut Registry) {
    for (method, fields) in [
        ("fastsam-splat", FastSamSplatSettings::fields()),
        ("fastsam", FastSamBaselineSettings::fields()),
        ("fastspam", FastSpamBaselineSettings::fields()),
        ("sam2", Sam2BaselineSettings::fields()),
        ("sam2-splat", Sam2SplatSettings::fields()),
    ] {
        registry.add(fields, &[("method", &[method])]);
    }
}

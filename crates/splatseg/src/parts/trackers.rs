//! The trackers: names, settings and construction. A new tracker is added here.

use super::methods;
use crate::pipeline::{PipelineBuilder, PipelineError};
use crate::settings::registry::{Registry, choice, file};
use crate::settings::table::{chosen, path, section};
use crate::settings::{MissingFile, SettingsError, SettingsInput};
use serde::Serialize;
use splatseg_settings::{Section, SettingError, choices};
use splatseg_simulators::{SimTracker, SimTrackerSettings};
use splatseg_tracking::{Sam2Tracker, Sam2TrackerSettings, Tracker};
use std::path::{Path, PathBuf};
use toml::Table;

choices! {
    /// The trackers.
    pub enum TrackerName, default Sam2 {
        /// SAM 2.1, EdgeTAM or EfficientTAM; needs tracker_weights
        Sam2 = "sam2",
        /// The scene's ground truth with errors at set rates, for comparing methods
        Sim = "sim",
    }
}

/// A tracker with its settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "tracker", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TrackerSettings {
    /// [`splatseg_tracking::Sam2Tracker`].
    Sam2 {
        /// Its checkpoint; required to build a pipeline.
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

impl TrackerSettings {
    /// Returns the name of the tracker.
    pub fn name(&self) -> TrackerName {
        match self {
            Self::Sam2 { .. } => TrackerName::Sam2,
            Self::Sim { .. } => TrackerName::Sim,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), SettingError> {
        match self {
            Self::Sam2 { sam2, .. } => sam2.validate(),
            Self::Sim { sim_tracker } => sim_tracker.validate(),
        }
    }

    /// Returns true if the tracker is a network, which runs on the device of the settings.
    pub(crate) fn is_network(&self) -> bool {
        matches!(self, Self::Sam2 { .. })
    }

    /// Returns the file that the tracker needs and the settings do not name.
    pub(crate) fn missing_input(&self) -> Option<MissingFile> {
        matches!(self, Self::Sam2 { tracker_weights: None, .. }).then_some(NO_CHECKPOINT)
    }

    /// Returns the file that the tracker reads.
    pub(crate) fn input(&self) -> Option<SettingsInput<'_>> {
        let Self::Sam2 { tracker_weights, .. } = self else { return None };
        let path = tracker_weights.as_deref()?;
        Some(SettingsInput { what: "the file of --tracker-weights", path, is_checkpoint: true, is_of_segmenter: false })
    }

    /// Reads the tracker and its settings from a table of checked values.
    pub(crate) fn from_table(table: &Table) -> Result<Self, SettingsError> {
        Ok(match chosen(table, "tracker") {
            TrackerName::Sam2 => Self::Sam2 { tracker_weights: path(table, "tracker_weights"), sam2: section(table)? },
            TrackerName::Sim => Self::Sim { sim_tracker: section(table)? },
        })
    }

    /// Builds the tracker with the parts of a pipeline.
    pub(crate) fn build(&self, parts: &PipelineBuilder<'_>) -> Result<Box<dyn Tracker>, PipelineError> {
        match self {
            Self::Sam2 { tracker_weights, sam2 } => {
                let path = tracker_weights.as_deref().unwrap_or(Path::new(""));
                let network =
                    parts.networks.sam2(path, sam2.image_size, sam2.memory_pooling, parts.settings.run.device)?;
                let sam2 = sam2.resolved(parts.settings.method.prompts_lost_objects());
                Ok(Box::new(Sam2Tracker::new(network, sam2)?))
            }
            Self::Sim { sim_tracker } => {
                let truth = parts.ground_truth("tracker = sim")?;
                Ok(Box::new(SimTracker::new(truth, *sim_tracker, parts.settings.run.seed)?))
            }
        }
    }
}

/// The error of `sam2` without a checkpoint.
const NO_CHECKPOINT: MissingFile = MissingFile {
    chosen: "tracker = sam2",
    key: "tracker_weights",
    what: "a checkpoint of SAM 2.1, EdgeTAM or EfficientTAM, e.g. --tracker-weights edgetam.pt",
};

/// Registers the choice of a tracker, and the settings of each.
pub(crate) fn register(registry: &mut Registry) {
    let tracked = ("method", &methods::WITH_TRACKER[..]);
    registry
        .add(vec![choice::<TrackerName>("tracker", "The tracker of the methods `sam2` and `sam2-splat`.")], &[tracked]);
    let with_sam2 = [tracked, ("tracker", &["sam2"][..])];
    let weights = "Checkpoint of SAM 2.1, EdgeTAM or EfficientTAM: `sam2.1_hiera_*.pt`, `edgetam.pt` or \
                   `efficienttam_*.pt` as published, or a `.safetensors`. The network is recognised.";
    registry.add(vec![file("tracker_weights", weights)], &with_sam2);
    registry.add(Sam2TrackerSettings::fields(), &with_sam2);
    registry.add(SimTrackerSettings::fields(), &[tracked, ("tracker", &["sim"])]);
}

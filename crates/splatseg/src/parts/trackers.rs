//! The built-in trackers: names, files and construction. A new tracker is added here.

use super::requirements::{Registry, choice};
use super::{Part, PartContext, PartError, PartFile, PartFiles, PartKind, PartSection, PartSettings, PartTable};
use splatseg_settings::SettingError;
use splatseg_simulators::{SimTracker, SimTrackerSettings};
use splatseg_tracking::{Sam2Tracker, Sam2TrackerSettings, Tracker};
use toml::Table;

/// A tracker with its settings.
pub type TrackerSettings = PartSettings<dyn Tracker>;

static TRACKERS: PartTable<dyn Tracker> =
    PartTable::new(&[Part::of::<Sam2TrackerSettings>(), Part::of::<SimTrackerSettings>()]);

impl PartKind for dyn Tracker {
    const KEY: &'static str = "tracker";
    const DEFAULT: Option<Part<Self>> = Some(Part::of::<Sam2TrackerSettings>());

    fn table() -> &'static PartTable<Self> {
        &TRACKERS
    }
}

impl Default for TrackerSettings {
    fn default() -> Self {
        Self::of(Sam2TrackerSettings::default())
    }
}

impl TrackerSettings {
    /// Reads the tracker and its settings from a table of checked values.
    pub(crate) fn from_table(table: &Table) -> Result<Self, SettingError> {
        Ok(Self::chosen_in(table)?.unwrap_or_default())
    }
}

const WEIGHTS: PartFile = PartFile {
    key: "tracker_weights",
    help: "Checkpoint of SAM 2.1, EdgeTAM or EfficientTAM: `sam2.1_hiera_*.pt`, `edgetam.pt` or \
           `efficienttam_*.pt` as published, or a `.safetensors`. The network is recognised.",
    what: "a checkpoint of SAM 2.1, EdgeTAM or EfficientTAM, e.g. --tracker-weights edgetam.pt",
    called: "the file of --tracker-weights",
    is_required: true,
    is_checkpoint: true,
};

impl PartSection<dyn Tracker> for Sam2TrackerSettings {
    const NAME: &'static str = "sam2";
    const HELP: &'static str = "SAM 2.1, EdgeTAM or EfficientTAM; needs tracker_weights";
    const FILES: &'static [PartFile] = &[WEIGHTS];
    const IS_NETWORK: bool = true;
    const NEEDS_NETWORKS: bool = true;

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn Tracker>, PartError> {
        let weights = files.required(&WEIGHTS)?;
        let network = context.networks.sam2(weights, self.image_size, self.memory_pooling, context.device)?;
        Ok(Box::new(Sam2Tracker::new(network, self.resolved(context.prompts_lost_objects))?))
    }
}

impl PartSection<dyn Tracker> for SimTrackerSettings {
    const NAME: &'static str = "sim";
    const HELP: &'static str = "The scene's ground truth with errors at set rates, for comparing methods";

    fn build(&self, _: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn Tracker>, PartError> {
        let truth = context.ground_truth("tracker = sim")?;
        Ok(Box::new(SimTracker::new(truth, *self, context.seed)?))
    }
}

/// Adds the choice of a tracker, and the settings of each. `methods` are those that have a tracker.
pub(crate) fn add_settings(registry: &mut Registry, methods: &[&'static str]) {
    let tracked = ("method", methods);
    let help = "The tracker of the methods `sam2` and `sam2-splat`.";
    registry.add(vec![choice("tracker", Some(Sam2TrackerSettings::NAME), TRACKERS.names(), help)], &[tracked]);
    TRACKERS.add_settings(registry, &[tracked]);
}

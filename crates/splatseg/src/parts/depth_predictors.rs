//! Depth predictors: they return the depth of an image. Without one, depth is what the sensor has measured.

use super::DepthAnythingSettings;
use super::requirements::{Registry, choice};
use super::{Part, PartContext, PartError, PartFiles, PartKind, PartSection, PartSettings, PartTable};
use splatseg_depth::DepthPredictor;
use splatseg_settings::SettingError;
use splatseg_simulators::{SimDepthPredictor, SimDepthSettings};
use toml::Table;

/// A depth predictor with its settings.
pub type DepthPredictorSettings = PartSettings<dyn DepthPredictor>;

static DEPTH_PREDICTORS: PartTable<dyn DepthPredictor> =
    PartTable::new(&[Part::of::<DepthAnythingSettings>(), Part::of::<SimDepthSettings>()]);

impl PartKind for dyn DepthPredictor {
    const KEY: &'static str = "depth_predictor";
    const DEFAULT: Option<Part<Self>> = None;

    fn table() -> &'static PartTable<Self> {
        &DEPTH_PREDICTORS
    }
}

impl DepthPredictorSettings {
    /// Reads the depth predictor and its settings from a table of checked values; `None` without one.
    pub(crate) fn from_table(table: &Table) -> Result<Option<Self>, SettingError> {
        Self::chosen_in(table)
    }
}

impl PartSection<dyn DepthPredictor> for SimDepthSettings {
    const NAME: &'static str = "sim";
    const HELP: &'static str = "The frame's own depth with the errors of a network, for comparing methods";

    fn build(&self, _: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn DepthPredictor>, PartError> {
        Ok(Box::new(SimDepthPredictor::new(*self, context.seed)))
    }
}

/// Adds the choice of a depth predictor, and the settings of each.
pub(crate) fn add_settings(registry: &mut Registry) {
    let help = "Predicts depth from colour. `predicted_depth` says where it is used. Without it, depth is what the sensor has \
                measured. `--depth-weights FILE` chooses `depth-anything`.";
    registry.add(vec![choice("depth_predictor", None, DEPTH_PREDICTORS.names(), help)], &[]);
    DEPTH_PREDICTORS.add_settings(registry, &[]);
}

//! Depth predictors: they return the depth of an image. Without one, depth is what the sensor has measured.

use super::DepthAnythingSettings;
use super::requirements::{Registry, choice};
use super::{Part, PartContext, PartError, PartFile, PartFiles, PartKind, PartSection, PartSettings, PartTable};
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_depth::DepthPredictor;
use splatseg_settings::SettingError;
use splatseg_simulators::{SimDepthPredictor, SimDepthSettings};
use toml::Table;

/// A depth predictor with its settings.
pub type DepthPredictorSettings = PartSettings<dyn DepthPredictor>;

static DEPTH_PREDICTORS: PartTable<dyn DepthPredictor> =
    PartTable::new(&[Part::of::<DepthAnythingSettings>(), Part::of::<SimDepthSettings>()]);

const TRUE_DEPTH: PartFile = PartFile {
    key: "true_depth",
    help: "For `sim`: a scene with the same frames, whose depth it distorts instead of the frames' own. So the filling of \
           holes can be measured.",
    what: "a scene, e.g. --set true_depth=SCENE",
    called: "the scene of true_depth",
    is_required: false,
    is_checkpoint: false,
};

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
    const FILES: &'static [PartFile] = &[TRUE_DEPTH];

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn DepthPredictor>, PartError> {
        let mut predictor = SimDepthPredictor::new(*self, context.seed);
        if let Some(path) = files.get(&TRUE_DEPTH) {
            let failed = |source| PartError::Other { name: "true_depth".to_owned(), source: Box::new(source) };
            let truth = open_scene(path, &DatasetSettings::default()).map_err(failed)?;
            predictor = predictor.with_truth(truth, context.framing);
        }
        if let Some(scene) = context.scene {
            let frames = context.dataset.selected_frames(scene.frame_count())?;
            predictor.check_truth(scene.as_ref(), &frames)?;
        }
        Ok(Box::new(predictor))
    }
}

/// Adds the choice of a depth predictor, and the settings of each.
pub(crate) fn add_settings(registry: &mut Registry) {
    let help = "Predicts depth from colour. `predicted_depth` says where it is used. Without it, depth is what the sensor has \
                measured. `--depth-weights FILE` chooses `depth-anything`.";
    registry.add(vec![choice("depth_predictor", None, DEPTH_PREDICTORS.names(), help)], &[]);
    DEPTH_PREDICTORS.add_settings(registry, &[]);
}

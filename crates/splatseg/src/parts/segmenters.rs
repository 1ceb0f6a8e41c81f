//! The built-in segmenters: names, files and construction. A new segmenter is added here.

use super::requirements::{ChosenValues, Registry, Requirement, choice};
use super::{Part, PartContext, PartError, PartFile, PartFiles, PartKind, PartSection, PartSettings, PartTable};
use splatseg_models::fastsam::FastSamPredictorSettings;
use splatseg_segmenter::{
    AffinitySegmenter, AffinitySettings, FastSamSegmenter, GraphSegmenter, GraphSettings, MaskFolder, Segmenter,
};
use splatseg_settings::{SettingError, settings};
use splatseg_simulators::{OracleSegmenter, OracleSettings};
use toml::Table;

/// A segmenter with its settings.
pub type SegmenterSettings = PartSettings<dyn Segmenter>;

static SEGMENTERS: PartTable<dyn Segmenter> = PartTable::new(&[
    Part::of::<GraphSettings>(),
    Part::of::<AffinitySettings>(),
    Part::of::<FastSamPredictorSettings>(),
    Part::of::<MaskFolderSettings>(),
    Part::of::<OracleSettings>(),
]);

impl PartKind for dyn Segmenter {
    const KEY: &'static str = "segmenter";
    const DEFAULT: Option<Part<Self>> = Some(Part::of::<AffinitySettings>());

    fn table() -> &'static PartTable<Self> {
        &SEGMENTERS
    }
}

impl Default for SegmenterSettings {
    fn default() -> Self {
        Self::of(AffinitySettings::default())
    }
}

impl SegmenterSettings {
    /// Reads the segmenter and its settings from a table of checked values.
    pub(crate) fn from_table(table: &Table) -> Result<Self, SettingError> {
        Ok(Self::chosen_in(table)?.unwrap_or_default())
    }
}

impl PartSection<dyn Segmenter> for GraphSettings {
    const NAME: &'static str = "graph";
    const HELP: &'static str = "Built in, no weights: cuts along edges in depth, normals and colour";

    fn build(&self, _: &PartFiles, _: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
        Ok(Box::new(GraphSegmenter::new(self.clone())?))
    }
}

const WEIGHTS_OF_AFFINITY: PartFile = PartFile { is_required: false, ..WEIGHTS };

impl PartSection<dyn Segmenter> for AffinitySettings {
    const NAME: &'static str = "affinity";
    const HELP: &'static str = "A small network that predicts which pixels belong to one object; weights built in";
    const FILES: &'static [PartFile] = &[WEIGHTS_OF_AFFINITY];
    const IS_NETWORK: bool = true;

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
        let (network, noisy_depth) = context.networks.affinity(files.get(&WEIGHTS_OF_AFFINITY), context.device)?;
        let mut segmenter = AffinitySegmenter::new(network, self.clone())?;
        if let Some(network) = noisy_depth {
            segmenter = segmenter.with_noisy_depth(network);
        }
        Ok(Box::new(segmenter))
    }
}

const WEIGHTS: PartFile = PartFile {
    key: "weights",
    help: "Checkpoint of FastSAM: the published `.pt`, or a `.safetensors`. For `affinity`: a `.safetensors` \
           to use instead of the built-in weights.",
    what: "a checkpoint of FastSAM, e.g. --weights FastSAM-x.pt",
    called: "the file of --weights",
    is_required: true,
    is_checkpoint: true,
};

impl PartSection<dyn Segmenter> for FastSamPredictorSettings {
    const NAME: &'static str = "fastsam";
    const HELP: &'static str = "The paper's network; needs weights";
    const FILES: &'static [PartFile] = &[WEIGHTS];
    const IS_NETWORK: bool = true;
    const NEEDS_NETWORKS: bool = true;

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
        let predictor = context.networks.fastsam(files.required(&WEIGHTS)?, self, context.device)?;
        Ok(Box::new(FastSamSegmenter::new(predictor)))
    }
}

settings! {
    /// Settings of [`splatseg_segmenter::MaskFolder`]: none besides its folder, `masks`.
    pub struct MaskFolderSettings in "" {}
}

const MASKS: PartFile = PartFile {
    key: "masks",
    help: "Folder of precomputed masks: `<frame>.png` with an id per pixel, or `<frame>.json` with COCO masks.",
    what: "a folder with one .png or .json file per frame, e.g. --masks DIR",
    called: "the folder of --masks",
    is_required: true,
    is_checkpoint: false,
};

impl PartSection<dyn Segmenter> for MaskFolderSettings {
    const NAME: &'static str = "masks";
    const HELP: &'static str = "Precomputed masks of another model, one file per frame";
    const FILES: &'static [PartFile] = &[MASKS];

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
        Ok(Box::new(MaskFolder::open(files.required(&MASKS)?, context.framing)?))
    }
}

impl PartSection<dyn Segmenter> for OracleSettings {
    const NAME: &'static str = "oracle";
    const HELP: &'static str = "The scene's ground truth with errors at set rates, for comparing methods";

    fn build(&self, _: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn Segmenter>, PartError> {
        let truth = context.ground_truth("segmenter = oracle")?;
        Ok(Box::new(OracleSegmenter::new(truth, self, context.seed)?))
    }
}

/// Adds the choice of a segmenter.
pub(crate) fn add_choice(registry: &mut Registry) {
    let help = "The segmenter whose masks the method uses.";
    registry.add(vec![choice("segmenter", Some(AffinitySettings::NAME), SEGMENTERS.names(), help)], &[]);
    registry.require("segmenter", Requirement::Not(ChosenValues { key: "prompts", values: vec!["ground-truth"] }));
}

/// The segmenters that have a degree of detail.
pub(crate) const WITH_DETAIL: [&str; 2] = [AffinitySettings::NAME, GraphSettings::NAME];

/// Adds the settings of each segmenter.
pub(crate) fn add_settings(registry: &mut Registry) {
    SEGMENTERS.add_settings(registry, &[]);
}

//! The segmenters: names, settings and construction. A new segmenter is added here.

use crate::pipeline::{PipelineBuilder, PipelineError};
use crate::settings::registry::{ChosenValues, Registry, Requirement, choice, file};
use crate::settings::table::{chosen, path, section};
use crate::settings::{MissingFile, SettingsError, SettingsInput};
use serde::Serialize;
use splatseg_models::fastsam::FastSamPredictorSettings;
use splatseg_segmenter::{
    AffinitySegmenter, AffinitySettings, FastSamSegmenter, GraphSegmenter, GraphSettings, MaskFolder, Segmenter,
};
use splatseg_settings::{Section, SettingError, choices};
use splatseg_simulators::{OracleSegmenter, OracleSettings};
use std::path::{Path, PathBuf};
use toml::Table;

choices! {
    /// The segmenters.
    pub enum SegmenterName, default Affinity {
        /// A small network that predicts which pixels belong to one object; weights built in
        Affinity = "affinity",
        /// Built in, no weights: cuts along edges in depth, normals and colour
        Graph = "graph",
        /// The paper's network; needs weights
        Fastsam = "fastsam",
        /// Precomputed masks of another model, one file per frame
        Masks = "masks",
        /// The scene's ground truth with errors at set rates, for comparing methods
        Oracle = "oracle",
    }
}

/// A segmenter with its settings.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "segmenter", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SegmenterSettings {
    /// [`splatseg_segmenter::AffinitySegmenter`].
    Affinity {
        /// Weights to use instead of the built-in ones.
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
        /// Its checkpoint; required to build a pipeline.
        #[serde(skip_serializing_if = "Option::is_none")]
        weights: Option<PathBuf>,
        /// Its settings.
        fastsam: FastSamPredictorSettings,
    },
    /// [`splatseg_segmenter::MaskFolder`].
    Masks {
        /// Folder with one file per frame; required to build a pipeline.
        #[serde(skip_serializing_if = "Option::is_none")]
        masks: Option<PathBuf>,
    },
    /// [`splatseg_simulators::OracleSegmenter`].
    Oracle {
        /// Its settings.
        oracle: OracleSettings,
    },
}

impl Default for SegmenterSettings {
    fn default() -> Self {
        Self::Affinity { weights: None, affinity: AffinitySettings::default() }
    }
}

impl SegmenterSettings {
    /// Returns the name of the segmenter.
    pub fn name(&self) -> SegmenterName {
        match self {
            Self::Graph { .. } => SegmenterName::Graph,
            Self::Affinity { .. } => SegmenterName::Affinity,
            Self::Fastsam { .. } => SegmenterName::Fastsam,
            Self::Masks { .. } => SegmenterName::Masks,
            Self::Oracle { .. } => SegmenterName::Oracle,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), SettingError> {
        match self {
            Self::Graph { graph } => graph.validate(),
            Self::Affinity { affinity, .. } => affinity.validate(),
            Self::Fastsam { fastsam, .. } => fastsam.validate(),
            Self::Masks { .. } => Ok(()),
            Self::Oracle { oracle } => oracle.validate(),
        }
    }

    /// Returns true if the segmenter is a network, which runs on the device of the settings.
    pub(crate) fn is_network(&self) -> bool {
        matches!(self, Self::Affinity { .. } | Self::Fastsam { .. })
    }

    /// Returns true if the segmenter is missing in a program without the feature `networks`.
    pub(crate) fn needs_networks(&self) -> bool {
        matches!(self, Self::Fastsam { .. })
    }

    /// Returns the file or folder that the segmenter needs and the settings do not name.
    pub(crate) fn missing_input(&self) -> Option<MissingFile> {
        match self {
            Self::Fastsam { weights: None, .. } => Some(NO_CHECKPOINT),
            Self::Masks { masks: None } => Some(NO_MASKS),
            _ => None,
        }
    }

    /// Returns the file or folder that the segmenter reads.
    pub(crate) fn input(&self) -> Option<SettingsInput<'_>> {
        let (what, path, is_checkpoint) = match self {
            Self::Affinity { weights, .. } | Self::Fastsam { weights, .. } => {
                ("the file of --weights", weights.as_deref()?, true)
            }
            Self::Masks { masks } => ("the folder of --masks", masks.as_deref()?, false),
            Self::Graph { .. } | Self::Oracle { .. } => return None,
        };
        Some(SettingsInput { what, path, is_checkpoint, is_of_segmenter: true })
    }

    /// Reads the segmenter and its settings from a table of checked values.
    pub(crate) fn from_table(table: &Table) -> Result<Self, SettingsError> {
        Ok(match chosen(table, "segmenter") {
            SegmenterName::Graph => Self::Graph { graph: section(table)? },
            SegmenterName::Affinity => Self::Affinity { weights: path(table, "weights"), affinity: section(table)? },
            SegmenterName::Fastsam => Self::Fastsam { weights: path(table, "weights"), fastsam: section(table)? },
            SegmenterName::Masks => Self::Masks { masks: path(table, "masks") },
            SegmenterName::Oracle => Self::Oracle { oracle: section(table)? },
        })
    }

    /// Builds the segmenter with the parts of a pipeline.
    pub(crate) fn build(&self, parts: &PipelineBuilder<'_>) -> Result<Box<dyn Segmenter>, PipelineError> {
        Ok(match self {
            Self::Graph { graph } => Box::new(GraphSegmenter::new(graph.clone())?),
            Self::Affinity { weights, affinity } => {
                let network = parts.networks.affinity(weights.as_deref(), parts.settings.run.device)?;
                Box::new(AffinitySegmenter::new(network, affinity.clone())?)
            }
            Self::Fastsam { weights, fastsam } => {
                let weights = weights.as_deref().unwrap_or(Path::new(""));
                let predictor = parts.networks.fastsam(weights, fastsam, parts.settings.run.device)?;
                Box::new(FastSamSegmenter::new(predictor))
            }
            Self::Masks { masks } => {
                let masks = masks.as_deref().unwrap_or(Path::new(""));
                Box::new(MaskFolder::open(masks, parts.settings.dataset.framing())?)
            }
            Self::Oracle { oracle } => {
                let truth = parts.ground_truth("segmenter = oracle")?;
                Box::new(OracleSegmenter::new(truth, oracle, parts.settings.run.seed)?)
            }
        })
    }
}

/// The error of `fastsam` without a checkpoint.
const NO_CHECKPOINT: MissingFile = MissingFile {
    chosen: "segmenter = fastsam",
    key: "weights",
    what: "a checkpoint of FastSAM, e.g. --weights FastSAM-x.pt",
};

/// The error of `masks` without a folder.
const NO_MASKS: MissingFile = MissingFile {
    chosen: "segmenter = masks",
    key: "masks",
    what: "a folder with one .png or .json file per frame, e.g. --masks DIR",
};

/// Registers the choice of a segmenter.
pub(crate) fn register_choice(registry: &mut Registry) {
    registry.add(vec![choice::<SegmenterName>("segmenter", "The segmenter whose masks the method uses.")], &[]);
    registry.require("segmenter", Requirement::Not(ChosenValues { key: "prompts", values: vec!["ground-truth"] }));
}

/// The segmenters that are networks.
pub(crate) const NETWORKS: [&str; 2] = ["affinity", "fastsam"];

/// Registers the settings of each segmenter.
pub(crate) fn register(registry: &mut Registry) {
    let with = |segmenter: &'static [&'static str]| [("segmenter", segmenter)];
    registry.add(GraphSettings::fields(), &with(&["graph"]));
    registry.add(AffinitySettings::fields(), &with(&["affinity"]));
    let weights = "Checkpoint of FastSAM: the published `.pt`, or a `.safetensors`. For `affinity`: a `.safetensors` \
                   to use instead of the built-in weights.";
    registry.add(vec![file("weights", weights)], &with(&NETWORKS));
    registry.add(FastSamPredictorSettings::fields(), &with(&["fastsam"]));
    let masks = "Folder of precomputed masks: `<frame>.png` with an id per pixel, or `<frame>.json` with COCO masks.";
    registry.add(vec![file("masks", masks)], &with(&["masks"]));
    registry.add(OracleSettings::fields(), &with(&["oracle"]));
}

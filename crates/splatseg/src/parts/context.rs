//! The data of a run that its parts may use.

use super::{LoadedNetworks, PartError};
use splatseg_dataset::{DatasetSettings, Framing, Scene};
use splatseg_models::device::DeviceName;
use splatseg_simulators::SceneGroundTruth;
use std::sync::Arc;

/// The data of a run that its parts may use, besides their own settings.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct PartContext<'a> {
    /// The device that runs the networks.
    pub device: DeviceName,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How every frame is resized and cropped.
    pub framing: Framing,
    /// True if the method prompts objects again that its tracker has lost.
    pub prompts_lost_objects: bool,
    /// Which frames of the scene are used.
    pub(crate) dataset: &'a DatasetSettings,
    pub(crate) networks: &'a LoadedNetworks,
    pub(crate) scene: Option<&'a Arc<dyn Scene>>,
}

impl PartContext<'_> {
    /// The ground truth of the scene, for simulators. `needed_by` is the choice that needs it, e.g.
    /// `segmenter = oracle`.
    ///
    /// # Errors
    /// [`PartError::NoScene`] without a scene; [`PartError::Simulator`] if the scene is not labelled.
    pub fn ground_truth(&self, needed_by: &'static str) -> Result<SceneGroundTruth, PartError> {
        let scene = self.scene.ok_or(PartError::NoScene(needed_by))?;
        Ok(SceneGroundTruth::new(Arc::clone(scene), self.framing)?)
    }
}

//! Checks of a benchmark's depth predictors, before anything is measured.

use super::plan::Plan;
use crate::Failure;
use splatseg::pipeline::LoadedNetworks;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::open_scene;
use std::sync::Arc;

impl Plan {
    /// Checks that the depth predictor of every variant can be built. A scene that `true_depth` does not fit gets an error,
    /// like one that cannot be opened.
    ///
    /// # Errors
    /// If a depth predictor cannot be built.
    pub fn check_depth_predictors(&mut self) -> Result<(), Failure> {
        let all = (0..self.variants.len()).map(|variant| self.variant_settings(variant));
        let predicting: Vec<Settings> = all.filter(|settings| settings.depth_predictor.is_some()).cloned().collect();
        let networks = Arc::<LoadedNetworks>::default();
        for settings in &predicting {
            Pipeline::builder(settings).networks(&networks).check_depth_predictor().map_err(Failure::input)?;
        }
        for scene in self.scenes.iter_mut().filter(|scene| scene.error.is_none() && !predicting.is_empty()) {
            let Ok(opened) = open_scene(&scene.path, &self.settings.dataset) else { continue };
            let check =
                |settings| Pipeline::builder(settings).networks(&networks).scene(&opened).check_depth_predictor().err();
            scene.error = predicting.iter().find_map(check).map(|error| error.to_string());
        }
        Ok(())
    }
}

//! The depth predictor `depth-anything`: a network that predicts depth from a single image.

use super::{PartContext, PartError, PartFile, PartFiles, PartSection};
use splatseg_depth::{DepthPredictor, DepthPredictorError, PredictedDepth};
use splatseg_geometry::{CameraFrame, Image};
use splatseg_models::depth_anything::{DepthAnythingNetwork, DepthOutput};
use splatseg_settings::{Allowed, Choice, choices, settings};
use std::sync::Arc;

choices! {
    /// Kind of depth that a network returns, which its tensors do not show.
    pub enum DepthAnythingOutput, default Auto {
        /// As a `config.json` beside the file or the file's name says.
        Auto = "auto",
        /// Inverse depth up to scale and shift.
        Relative = "relative",
        /// Metres up to 20, of a network that was trained on rooms.
        Indoor = "indoor",
        /// Metres up to 80, of a network that was trained on streets.
        Outdoor = "outdoor",
    }
}

settings! {
    /// Settings of the depth predictor `depth-anything`.
    #[derive(Copy)]
    pub struct DepthAnythingSettings in "depth_anything" {
        /// The image's short side as the network sees it, pixels, rounded down to whole patches of 14. The networks were trained
        /// at 518, which takes five times as long.
        short_side: usize = 252, Allowed::between(56.0, 1036.0);
        /// Kind of depth that the network returns: `relative`, inverse depth without a scale, or metres as `indoor` or `outdoor` networks do.
        /// `auto`: as a `config.json` beside the file says, else the file's name: `metric` for metres, with `vkitti` outdoors.
        output: DepthAnythingOutput = DepthAnythingOutput::Auto, Allowed::Names(DepthAnythingOutput::NAMES);
    }
}

const DEPTH_WEIGHTS: PartFile = PartFile {
    key: "depth_weights",
    help: "Checkpoint of a network that predicts depth: Depth Anything V2, as its authors' `.pth` or as `.safetensors` of \
           Hugging Face. See docs/PREDICTED_DEPTH.md.",
    what: "a checkpoint of Depth Anything V2, e.g. --depth-weights depth_anything_v2_vits.pth",
    called: "the file of --depth-weights",
    is_required: true,
    is_checkpoint: true,
};

/// Depth that a relative network's median and its farthest possible point are assumed to have in the first frame, metres:
/// those of a room.
const MEDIAN_DEPTH: f32 = 2.5;
const FARTHEST_DEPTH: f32 = 10.0;

impl PartSection<dyn DepthPredictor> for DepthAnythingSettings {
    const NAME: &'static str = "depth-anything";
    const HELP: &'static str = "Depth Anything V2; needs --depth-weights";
    const FILES: &'static [PartFile] = &[DEPTH_WEIGHTS];

    fn build(&self, files: &PartFiles, context: &PartContext<'_>) -> Result<Box<dyn DepthPredictor>, PartError> {
        let output = match self.output {
            DepthAnythingOutput::Auto => None,
            DepthAnythingOutput::Relative => Some(DepthOutput::Relative),
            DepthAnythingOutput::Indoor => Some(DepthOutput::INDOOR),
            DepthAnythingOutput::Outdoor => Some(DepthOutput::OUTDOOR),
        };
        let network = context.networks.depth_anything(files.required(&DEPTH_WEIGHTS)?, output)?;
        network.config().assumed.iter().for_each(|assumed| tracing::info!("{}: {assumed}", network.path().display()));
        Ok(Box::new(DepthAnything { network, short_side: self.short_side, assumed: None }))
    }
}

/// A network, with what its relative depth is assumed to mean.
struct DepthAnything {
    network: Arc<DepthAnythingNetwork>,
    short_side: usize,
    /// Factor of a relative network's output, which makes it inverse metres before a shift. It stays that of the first frame,
    /// as the output of one network means about the same in all frames of a room.
    assumed: Option<f32>,
}

/// Assumed shift of a relative network's inverse depth, 1/m: where the network gives 0, depth is `FARTHEST_DEPTH`.
const ASSUMED_SHIFT: f32 = 1.0 / FARTHEST_DEPTH;

impl DepthAnything {
    /// Metres of a relative network's output, up to the scale and the shift that are fitted to what is known better.
    fn metres(&mut self, inverse: &Image<f32>) -> Image<f32> {
        let factor = *self.assumed.get_or_insert_with(|| {
            let mut values = inverse.pixels().to_vec();
            let middle = values.len() / 2;
            let (_, median, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
            (1.0 / MEDIAN_DEPTH - ASSUMED_SHIFT) / median.max(1e-6)
        });
        inverse.map(|inverse| 1.0 / (factor * inverse + ASSUMED_SHIFT))
    }
}

impl DepthPredictor for DepthAnything {
    fn name(&self) -> &str {
        DepthAnythingSettings::NAME
    }

    fn predict(&mut self, frame: &CameraFrame<'_>) -> Result<PredictedDepth, DepthPredictorError> {
        let predicted = self.network.predict(frame.color(), self.short_side);
        let predicted = predicted
            .map_err(|error| DepthPredictorError::Other { name: self.name().to_owned(), source: Box::new(error) })?;
        let depth = match self.network.config().output {
            DepthOutput::Relative => self.metres(&predicted),
            DepthOutput::Metric { .. } => predicted,
        };
        Ok(PredictedDepth { depth, confidence: None })
    }

    fn knows_scale(&self) -> bool {
        self.network.config().output != DepthOutput::Relative
    }
}

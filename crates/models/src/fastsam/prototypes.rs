//! The branch that computes mask prototypes.

use super::conv::{ConvShape, FusedConv};
use super::{FastSamConfig, FastSamError, Weights};
use burn::tensor::{Device, Tensor};

/// Ultralytics' `Proto`: computes prototypes at a quarter of the input's size from features at an eighth.
#[derive(Clone, Debug)]
pub(super) struct PrototypeBranch {
    entry: FusedConv,
    upsample: FusedConv,
    middle: FusedConv,
    exit: FusedConv,
}

impl PrototypeBranch {
    pub fn load(
        weights: &dyn Weights,
        name: &str,
        config: &FastSamConfig,
        device: &Device,
    ) -> Result<Self, FastSamError> {
        let hidden = config.prototype_channels;
        let conv = |part: &str, shape: ConvShape| {
            FusedConv::batch_normalised(weights, &format!("{name}.{part}"), shape, device)
        };
        Ok(Self {
            entry: conv("cv1", ConvShape::new(config.stage_channels[2], hidden, 3))?,
            upsample: FusedConv::doubling(weights, &format!("{name}.upsample"), hidden, device)?,
            middle: conv("cv2", ConvShape::new(hidden, hidden, 3))?,
            exit: conv("cv3", ConvShape::new(hidden, config.mask_coefficients, 1))?,
        })
    }

    /// `[batch, channels, height, width]` → `[batch, prototypes, 2 height, 2 width]`.
    pub fn forward(&self, features: Tensor<4>) -> Tensor<4> {
        let upsampled = self.upsample.forward(self.entry.forward(features));
        self.exit.forward(self.middle.forward(upsampled))
    }
}

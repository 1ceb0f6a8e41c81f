//! The branch that makes mask prototypes.

use super::conv::{Activation, ConvShape, FusedConv};
use super::{Architecture, FastSamError, Weights};
use burn::tensor::{Device, Tensor};

/// Ultralytics' `Proto`: prototypes at a quarter of the input's size from features at an eighth.
#[derive(Clone, Debug)]
pub(super) struct PrototypeBranch {
    entry: FusedConv,
    /// The transposed convolution, 2×2 with stride 2: its windows do not overlap, so it is a 1×1 convolution to four
    /// times the channels (channel, row, column), which are then laid out as pixels.
    upsample: FusedConv,
    middle: FusedConv,
    exit: FusedConv,
}

impl PrototypeBranch {
    pub fn load(
        weights: &dyn Weights,
        name: &str,
        architecture: &Architecture,
        device: &Device,
    ) -> Result<Self, FastSamError> {
        let hidden = architecture.prototype_channels;
        let conv =
            |part: &str, shape: ConvShape| FusedConv::normalised(weights, &format!("{name}.{part}"), shape, device);
        Ok(Self {
            entry: conv("cv1", ConvShape::new(architecture.stage_channels[2], hidden, 3))?,
            upsample: upsampling(weights, &format!("{name}.upsample"), hidden, device)?,
            middle: conv("cv2", ConvShape::new(hidden, hidden, 3))?,
            exit: conv("cv3", ConvShape::new(hidden, architecture.mask_coefficients, 1))?,
        })
    }

    /// `[batch, channels, height, width]` → `[batch, prototypes, 2 height, 2 width]`.
    pub fn forward(&self, features: Tensor<4>) -> Tensor<4> {
        let upsampled = depth_to_space(self.upsample.forward(self.entry.forward(features)));
        self.exit.forward(self.middle.forward(upsampled))
    }
}

/// Reads a transposed convolution's weight `[inputs, outputs, 2, 2]` as that of a 1×1 convolution.
fn upsampling(weights: &dyn Weights, name: &str, channels: usize, device: &Device) -> Result<FusedConv, FastSamError> {
    let transposed = weights.read_f32(&format!("{name}.weight"), &[channels, channels, 2, 2])?;
    let bias = weights.read_f32(&format!("{name}.bias"), &[channels])?;
    let mut weight = vec![0.0; transposed.len()];
    for (input, kernel) in transposed.chunks_exact(4 * channels).enumerate() {
        for (output, value) in kernel.iter().enumerate() {
            weight[output * channels + input] = *value;
        }
    }
    let bias = bias.iter().flat_map(|value| [*value; 4]).collect();
    Ok(FusedConv::new(weight, bias, ConvShape::new(channels, 4 * channels, 1), Activation::None, device))
}

/// `[batch, 4 channels, height, width]` → `[batch, channels, 2 height, 2 width]`.
fn depth_to_space(input: Tensor<4>) -> Tensor<4> {
    let [batch, channels, height, width] = input.dims();
    input.reshape([batch, channels / 4, 2, 2, height, width]).permute([0, 1, 4, 2, 5, 3]).reshape([
        batch,
        channels / 4,
        2 * height,
        2 * width,
    ])
}

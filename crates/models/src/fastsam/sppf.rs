//! SPPF: spatial pyramid pooling at the end of the backbone.

use super::conv::{ConvShape, FusedConv};
use super::{FastSamError, Weights};
use burn::tensor::module::max_pool2d;
use burn::tensor::ops::MaxPoolOptions;
use burn::tensor::{Device, Tensor};

/// Ultralytics' `SPPF`: three chained 5×5 max-poolings, concatenated with their input, between two 1×1 convolutions.
#[derive(Clone, Debug)]
pub(super) struct Sppf {
    entry: FusedConv,
    exit: FusedConv,
}

impl Sppf {
    pub fn load(weights: &dyn Weights, name: &str, channels: usize, device: &Device) -> Result<Self, FastSamError> {
        let hidden = channels / 2;
        let conv = |part: &str, shape: ConvShape| {
            FusedConv::batch_normalised(weights, &format!("{name}.{part}"), shape, device)
        };
        Ok(Self {
            entry: conv("cv1", ConvShape::new(channels, hidden, 1))?,
            exit: conv("cv2", ConvShape::new(4 * hidden, channels, 1))?,
        })
    }

    pub fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let mut parts = vec![self.entry.forward(input)];
        for pooled in 0..3 {
            let options = MaxPoolOptions::new([5, 5]).with_stride([1, 1]).with_padding([2, 2]);
            parts.push(max_pool2d(parts[pooled].clone(), options));
        }
        self.exit.forward_joined(parts)
    }
}

//! The head: boxes, scores and mask coefficients of every anchor.

use super::conv::{ConvShape, FusedConv};
use super::prototypes::PrototypeBranch;
use super::{FastSamConfig, FastSamError, Weights};
use burn::tensor::{Device, Tensor};

/// Number of bins of the distribution of distances from an anchor to a side of its box.
pub(super) const DISTANCE_BINS: usize = 16;

/// Distance between anchors in image pixels, for each level of the head.
pub(super) const STRIDES: [usize; 3] = [8, 16, 32];

/// The last layer: Ultralytics' `Segment` with one class.
#[derive(Clone, Debug)]
pub(super) struct Head {
    levels: Vec<HeadLevel>,
    prototypes: PrototypeBranch,
}

/// The three branches of a level, each two 3×3 convolutions and a 1×1 without activation.
#[derive(Clone, Debug)]
struct HeadLevel {
    distances: Branch,
    score: Branch,
    coefficients: Branch,
}

/// The head's output for the anchors of one level, before decoding.
#[derive(Clone, Debug)]
pub(super) struct LevelOutput {
    /// `[batch, 4 · bins, height, width]`: logits of the distances to the left, top, right and bottom side.
    pub distances: Tensor<4>,
    /// `[batch, 1, height, width]`: logit of the score.
    pub score: Tensor<4>,
    /// `[batch, coefficients, height, width]`.
    pub coefficients: Tensor<4>,
}

impl Head {
    pub fn load(
        weights: &dyn Weights,
        name: &str,
        config: &FastSamConfig,
        device: &Device,
    ) -> Result<Self, FastSamError> {
        let features = [2, 3, 4].map(|stage| config.stage_channels[stage]);
        let coefficients = config.mask_coefficients;
        let load_level = |(level, inputs): (usize, usize)| {
            let branch = |part: &str, hidden: usize, outputs: usize| {
                Branch::load(weights, &format!("{name}.{part}.{level}"), [inputs, hidden, outputs], device)
            };
            Ok(HeadLevel {
                distances: branch("cv2", (features[0] / 4).max(4 * DISTANCE_BINS), 4 * DISTANCE_BINS)?,
                score: branch("cv3", features[0], 1)?,
                coefficients: branch("cv4", (features[0] / 4).max(coefficients), coefficients)?,
            })
        };
        Ok(Self {
            levels: features.into_iter().enumerate().map(load_level).collect::<Result<_, FastSamError>>()?,
            prototypes: PrototypeBranch::load(weights, &format!("{name}.proto"), config, device)?,
        })
    }

    /// Computes the levels' outputs and the prototypes `[batch, coefficients, height / 4, width / 4]` from features of
    /// strides 8, 16 and 32.
    pub fn forward(&self, features: [Tensor<4>; 3]) -> (Vec<LevelOutput>, Tensor<4>) {
        let prototypes = self.prototypes.forward(features[0].clone());
        let levels = self.levels.iter().zip(features).map(|(level, input)| level.forward(input)).collect();
        (levels, prototypes)
    }
}

impl HeadLevel {
    fn forward(&self, input: Tensor<4>) -> LevelOutput {
        LevelOutput {
            distances: self.distances.forward(input.clone()),
            score: self.score.forward(input.clone()),
            coefficients: self.coefficients.forward(input),
        }
    }
}

#[derive(Clone, Debug)]
struct Branch([FusedConv; 3]);

impl Branch {
    fn load(
        weights: &dyn Weights,
        name: &str,
        [inputs, hidden, outputs]: [usize; 3],
        device: &Device,
    ) -> Result<Self, FastSamError> {
        Ok(Self([
            FusedConv::batch_normalised(weights, &format!("{name}.0"), ConvShape::new(inputs, hidden, 3), device)?,
            FusedConv::batch_normalised(weights, &format!("{name}.1"), ConvShape::new(hidden, hidden, 3), device)?,
            FusedConv::plain(weights, &format!("{name}.2"), ConvShape::new(hidden, outputs, 1), device)?,
        ]))
    }

    fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        self.0.iter().fold(input, |features, conv| conv.forward(features))
    }
}

//! The feature pyramid between trunk and decoder (official `FpnNeck`).

use super::Sam2Error;
use super::layers::Linear;
use super::weights::WeightReader;
use burn::tensor::Tensor;

/// The pyramid's lateral projections. The two coarsest levels are fused top-down; the coarsest is then dropped.
#[derive(Clone, Debug)]
pub(super) struct FpnNeck {
    /// Finest level first.
    lateral: [Linear; 4],
}

impl FpnNeck {
    /// Reads the neck over a trunk whose stages have `channels`, finest first.
    pub fn load(reader: &WeightReader, channels: [usize; 4], hidden_dim: usize) -> Result<Self, Sam2Error> {
        // The checkpoint counts from the coarsest level.
        let level = |level: usize| {
            Linear::load_pointwise(&reader.child(format!("convs.{}.conv", 3 - level)), channels[level], hidden_dim)
        };
        Ok(Self { lateral: [level(0)?, level(1)?, level(2)?, level(3)?] })
    }

    /// The projection of a level that nothing is added to: level 0 or 1.
    pub fn lateral(&self, level: usize) -> &Linear {
        &self.lateral[level]
    }

    /// Level 2 from the trunk's last two stages, `[side, side, channels]` and `[side / 2, side / 2, channels]`, to
    /// `[side, side, hidden]`.
    pub fn fuse(&self, stage2: Tensor<3>, stage3: Tensor<3>) -> Tensor<3> {
        let coarse = self.lateral[3].forward(stage3);
        let [height, width, channels] = coarse.dims();
        let enlarged = coarse
            .reshape([height, 1, width, 1, channels])
            .expand([height, 2, width, 2, channels])
            .reshape([2 * height, 2 * width, channels]);
        self.lateral[2].forward(stage2) + enlarged
    }
}

//! The feature pyramid between trunk and decoder (official `FpnNeck`).

use crate::sam2::Sam2Error;
use crate::sam2::layers::{Linear, LinearWeights};
use crate::sam2::weights::WeightReader;
use burn::tensor::Tensor;

/// Lateral projections of the pyramid. The two coarsest levels are fused top-down; the coarsest is then dropped.
#[derive(Clone, Debug)]
pub(crate) struct FpnNeck {
    /// Projections of levels 2 and 3.
    lateral: [Linear; 2],
}

impl FpnNeck {
    /// Loads the neck over a trunk whose stages have `channels`, finest first. Also returns the projections of the two
    /// finest levels, which are not fused.
    pub fn load(
        reader: &WeightReader,
        channels: [usize; 4],
        hidden_dim: usize,
    ) -> Result<(Self, [LinearWeights; 2]), Sam2Error> {
        // The checkpoint numbers levels from the coarsest.
        let level = |level: usize| {
            let reader = reader.child(format!("convs.{}.conv", 3 - level));
            LinearWeights::load_pointwise(&reader, channels[level], hidden_dim)
        };
        let lateral = [level(2)?.on(reader.device()), level(3)?.on(reader.device())];
        Ok((Self { lateral }, [level(0)?, level(1)?]))
    }

    /// Computes level 2, `[side, side, hidden]`, from the trunk's last two stages, `[side, side, channels]` and
    /// `[side / 2, side / 2, channels]`.
    pub fn fuse(&self, stage2: Tensor<3>, stage3: Tensor<3>) -> Tensor<3> {
        let coarse = self.lateral[1].forward(stage3);
        let [height, width, channels] = coarse.dims();
        let enlarged = coarse
            .reshape([height, 1, width, 1, channels])
            .expand([height, 2, width, 2, channels])
            .reshape([2 * height, 2 * width, channels]);
        self.lateral[0].forward_added(stage2, enlarged)
    }
}

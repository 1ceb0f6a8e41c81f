//! Fusion of a stage of the decoder with what comes from the coarser ones.

use super::DepthAnythingError;
use super::decoder::convolution;
use super::layout::FusionNames;
use super::planes::Planes;
use crate::transformer::LayerReader;
use splatseg_kernels::Activation;
use splatseg_kernels::convolution::{ConvolutionShape, PackedConvolution};

/// Two convolutions, each after a rectifier, whose result is added to their input.
#[derive(Clone, Debug)]
struct ResidualUnit([PackedConvolution; 2]);

#[derive(Clone, Debug)]
pub(super) struct Fusion {
    /// For the stage's own features. The coarsest stage has none: nothing is added to it.
    own: Option<ResidualUnit>,
    sum: ResidualUnit,
    projection: PackedConvolution,
    features: usize,
}

impl ResidualUnit {
    fn load(reader: LayerReader<'_>, names: &[String; 2], features: usize) -> Result<Self, DepthAnythingError> {
        let shape = ConvolutionShape::new(features, features, 3, 1, 1);
        Ok(Self([
            convolution(reader, &names[0], shape, Activation::Relu, true)?,
            convolution(reader, &names[1], shape, Activation::None, true)?,
        ]))
    }

    fn forward(&self, input: &Planes, features: usize) -> Planes {
        let [first, second] = &self.0;
        let hidden = input.rectified().convolved(first, features, input.size);
        let mut output = hidden.convolved(second, features, input.size);
        output.add(input);
        output
    }
}

impl Fusion {
    pub fn load(
        reader: LayerReader<'_>,
        names: &FusionNames,
        features: usize,
        is_coarsest: bool,
    ) -> Result<Self, DepthAnythingError> {
        let [own, sum] = &names.residuals;
        let own = (!is_coarsest).then(|| ResidualUnit::load(reader, own, features)).transpose()?;
        let shape = ConvolutionShape::new(features, features, 1, 1, 0);
        let projection = convolution(reader, &names.projection, shape, Activation::None, true)?;
        Ok(Self { own, sum: ResidualUnit::load(reader, sum, features)?, projection, features })
    }

    /// Fuses the features of the stage with those of the coarser ones, which have the same size, and enlarges the result
    /// to `size`.
    pub fn forward(&self, coarser: Option<Planes>, stage: Planes, size: [usize; 2]) -> Planes {
        let mut input = match &self.own {
            Some(own) => own.forward(&stage, self.features),
            None => stage,
        };
        if let Some(coarser) = coarser {
            input.add(&coarser);
        }
        let fused = self.sum.forward(&input, self.features);
        // The official code projects after enlarging: the same, as both are linear and interpolation's weights sum to 1,
        // at a quarter of the cost.
        fused.convolved(&self.projection, self.features, fused.size).resized(size)
    }
}

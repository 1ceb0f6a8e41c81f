//! The decoder: tokens after four blocks become feature images of four sizes, which are fused from the coarsest to the
//! finest (DPT).

use super::fusion::Fusion;
use super::planes::Planes;
use super::{DepthAnythingConfig, DepthAnythingError, DepthOutput};
use crate::transformer::LayerReader;
use splatseg_kernels::convolution::{ConvolutionShape, PackedConvolution};
use splatseg_kernels::exp::exp;
use splatseg_kernels::gemm::{LinearChain, PackedLinear};
use splatseg_kernels::{Activation, Instructions};

/// How many times larger than the grid of patches the images of the first stages are.
const SCALES: [usize; 4] = [4, 2, 1, 1];

#[derive(Clone, Debug)]
pub(super) struct Decoder {
    stages: [Stage; 4],
    /// The finest first.
    fusions: [Fusion; 4],
    head: [PackedConvolution; 3],
}

/// From tokens to a feature image.
#[derive(Clone, Debug)]
struct Stage {
    projection: PackedLinear,
    /// A transposed convolution whose kernel is its stride: each pixel becomes a square.
    enlarging: Option<PackedLinear>,
    /// Halves the last stage.
    reducing: Option<PackedConvolution>,
    features: PackedConvolution,
}

/// Reads a convolution.
pub(super) fn convolution(
    reader: LayerReader<'_>,
    name: &str,
    shape: ConvolutionShape,
    activation: Activation,
    has_bias: bool,
) -> Result<PackedConvolution, DepthAnythingError> {
    let weight = reader.tensor(&format!("{name}.weight"), &shape.weight_shape())?;
    let bias =
        if has_bias { reader.tensor(&format!("{name}.bias"), &[shape.outputs])? } else { vec![0.0; shape.outputs] };
    Ok(PackedConvolution::new(&weight, &bias, shape, activation, Instructions::best()))
}

impl Stage {
    fn load(reader: LayerReader<'_>, config: &DepthAnythingConfig, stage: usize) -> Result<Self, DepthAnythingError> {
        let (width, channels) = (config.encoder.width, config.stages[stage]);
        let name = config.layout.projection(stage);
        // A convolution with a kernel of one pixel.
        let weight = reader.tensor(&format!("{name}.weight"), &[channels, width, 1, 1])?;
        let bias = reader.tensor(&format!("{name}.bias"), &[channels])?;
        let projection = crate::transformer::packed(&weight, &bias, [width, channels]);
        let name = config.layout.resize(stage);
        let scale = SCALES[stage];
        let enlarging = (scale > 1)
            .then(|| -> Result<PackedLinear, DepthAnythingError> {
                let weight = reader.tensor(&format!("{name}.weight"), &[channels, channels, scale, scale])?;
                let bias = reader.tensor(&format!("{name}.bias"), &[channels])?;
                let bias: Vec<f32> = bias.iter().flat_map(|bias| std::iter::repeat_n(*bias, scale * scale)).collect();
                Ok(PackedLinear::new(&weight, &bias, Instructions::best()))
            })
            .transpose()?;
        let halving = ConvolutionShape::new(channels, channels, 3, 2, 1);
        let reducing = (stage == 3).then(|| convolution(reader, &name, halving, Activation::None, true)).transpose()?;
        let shape = ConvolutionShape::new(channels, config.features, 3, 1, 1);
        let features = convolution(reader, &config.layout.features(stage), shape, Activation::None, false)?;
        Ok(Self { projection, enlarging, reducing, features })
    }

    /// Tokens `[rows, columns, width]` to features.
    fn forward(&self, tokens: &[f32], grid: [usize; 2], config: &DepthAnythingConfig) -> Planes {
        let projection = (&self.projection, Activation::None);
        let (pixels, scale) = match &self.enlarging {
            Some(enlarging) => {
                let layers = [projection, (enlarging, Activation::None)];
                let pixels = LinearChain { norm: None, layers: &layers }.forward(tokens, None);
                (pixels, (enlarging.dims()[1] / self.projection.dims()[1]).isqrt())
            }
            None => (self.projection.forward(tokens), 1),
        };
        let mut image = Planes::from_pixels(&pixels, grid, scale);
        if let Some(reducing) = &self.reducing {
            image = image.convolved(reducing, self.projection.dims()[1], grid.map(|side| side.div_ceil(2)));
        }
        image.convolved(&self.features, config.features, image.size)
    }
}

impl Decoder {
    pub fn load(reader: LayerReader<'_>, config: &DepthAnythingConfig) -> Result<Self, DepthAnythingError> {
        let stage = |stage| Stage::load(reader, config, stage);
        let fusion = |stage| Fusion::load(reader, &config.layout.fusion(stage), config.features, stage == 3);
        let [first, second, last] = config.layout.head();
        let half = config.features / 2;
        let shapes = [
            ConvolutionShape::new(config.features, half, 3, 1, 1),
            ConvolutionShape::new(half, config.head, 3, 1, 1),
            ConvolutionShape::new(config.head, 1, 1, 1, 0),
        ];
        Ok(Self {
            stages: [stage(0)?, stage(1)?, stage(2)?, stage(3)?],
            fusions: [fusion(0)?, fusion(1)?, fusion(2)?, fusion(3)?],
            head: [
                convolution(reader, first, shapes[0], Activation::None, true)?,
                convolution(reader, second, shapes[1], Activation::Relu, true)?,
                convolution(reader, last, shapes[2], Activation::None, true)?,
            ],
        })
    }

    /// Tokens after four blocks, `[rows, columns, width]` each, to what the network returns, `[rows · patch,
    /// columns · patch]`.
    pub fn forward(&self, tokens: &[Vec<f32>; 4], grid: [usize; 2], config: &DepthAnythingConfig) -> Planes {
        let mut fused: Option<Planes> = None;
        let mut stages: Vec<Planes> =
            self.stages.iter().zip(tokens).map(|(stage, tokens)| stage.forward(tokens, grid, config)).collect();
        for fusion in self.fusions.iter().rev() {
            let Some(stage) = stages.pop() else { break };
            let size = stages.last().map_or_else(|| stage.size.map(|side| 2 * side), |finer| finer.size);
            fused = Some(fusion.forward(fused, stage, size));
        }
        let [first, second, last] = &self.head;
        let finest = fused.unwrap_or_else(|| Planes { values: Vec::new(), size: [0; 2] });
        let size = grid.map(|side| side * config.patch);
        let narrow = finest.convolved(first, config.features / 2, finest.size).resized(size);
        let mut depth = narrow.convolved(second, config.head, size).convolved(last, 1, size);
        match config.output {
            DepthOutput::Relative => Activation::Relu.apply_parallel(&mut depth.values),
            DepthOutput::Metric { max_depth } => {
                depth
                    .values
                    .iter_mut()
                    .for_each(|value| *value = max_depth / (1.0 + exp((-*value).clamp(-87.0, 87.0))));
            }
        }
        depth
    }
}

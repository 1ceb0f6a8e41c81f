//! The network on a device other than the CPU, with Burn.

use super::grid::Grid;
use super::network::{Layers, PathStep, Stage};
use super::weights::{AffinityWeightsError, Layer, Weights};
use crate::SegmenterError;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions, PadMode};
use burn::tensor::{Device, Tensor};
use splatseg_kernels::Activation;
use splatseg_kernels::feature_map::FeatureMap;
use splatseg_models::convolution::{Convolution, ConvolutionShape};
use splatseg_models::transfer::{download, upload};

/// The layers on a device.
#[derive(Debug)]
pub(super) struct DeviceNetwork {
    layers: Layers<DeviceLayer>,
    device: Device,
}

/// A convolution on a device.
#[derive(Debug)]
struct DeviceLayer {
    convolution: Convolution,
    outputs: usize,
}

impl Layer for DeviceLayer {
    type Place = Device;

    fn new(
        weight: &[f32],
        bias: &[f32],
        kernel: usize,
        stride: usize,
        activation: Activation,
        device: &Device,
    ) -> Self {
        let (outputs, inputs) = (bias.len(), weight.len() / (bias.len() * kernel * kernel));
        let shape = ConvolutionShape::new(inputs, outputs, kernel, stride, kernel / 2);
        Self { convolution: Convolution::new(weight.to_vec(), bias.to_vec(), shape, activation, device), outputs }
    }

    fn outputs(&self) -> usize {
        self.outputs
    }
}

impl DeviceNetwork {
    pub fn load(weights: &Weights<'_>, device: &Device) -> Result<Self, AffinityWeightsError> {
        Ok(Self { layers: Layers::load(weights, device)?, device: device.clone() })
    }

    /// Number of output channels.
    pub fn outputs(&self) -> usize {
        self.layers.head.outputs()
    }

    /// Computes the log-odds of an input of 8 channels.
    pub fn forward(&self, input: &FeatureMap, grid: Grid, log_odds: &mut FeatureMap) -> Result<(), SegmenterError> {
        let shape = [1, input.channels(), input.height(), input.width()];
        let rows = (0..shape[1]).flat_map(|channel| (0..shape[2]).map(move |row| (channel, row)));
        let values = rows.flat_map(|(channel, row)| input.row(channel, row)).copied().collect();
        let output = self.layers.forward(upload(values, shape, &self.device), grid);
        let [_, channels, height, width] = output.dims();
        let values = download(vec![output.reshape([channels * height * width])]);
        let values = values.map_err(|message| SegmenterError::Device { message })?.pop().unwrap_or_default();
        *log_odds = FeatureMap::zeros(channels, height, width);
        for (row, values) in log_odds.rows_mut().flatten().zip(values.chunks_exact(width)) {
            row.copy_from_slice(values);
        }
        Ok(())
    }
}

impl Layers<DeviceLayer> {
    fn forward(&self, input: Tensor<4>, grid: Grid) -> Tensor<4> {
        let start = |level: usize, map: &Tensor<4>| grid.start(level, (map.dims()[2], map.dims()[3]));
        let first = start(0, &input);
        let mut maps = vec![self.stem.forward_from(input, first)];
        for (index, stage) in self.stages.iter().enumerate() {
            let map = maps[index].clone();
            let start = start(index + 1, &map);
            maps.push(stage.forward(map, start));
        }
        let coarsest = maps.pop().expect("a map of the stem");
        let mean = coarsest.clone().mean_dim(3).mean_dim(2);
        let mut map = coarsest + self.pool.convolution.forward(mean);
        for (index, (step, fine)) in self.path.iter().zip(maps).enumerate().rev() {
            let start = start(index + 1, &fine);
            map = step.forward(map, fine, start);
        }
        self.head.convolution.forward(map)
    }
}

impl DeviceLayer {
    /// A layer of stride 2 whose first output is centred at row and column `start` of the input, 0 or 1.
    fn forward_from(&self, input: Tensor<4>, start: [usize; 2]) -> Tensor<4> {
        // With zeros before the first row or column, the first output is centred there: it is cut off.
        let padded = input.pad([(0, 0), (0, 0), (start[0], 0), (start[1], 0)], PadMode::Constant(0.0));
        let output = self.convolution.forward(padded);
        let [_, channels, height, width] = output.dims();
        output.slice([0..1, 0..channels, start[0]..height, start[1]..width])
    }
}

impl Stage<DeviceLayer> {
    fn forward(&self, input: Tensor<4>, start: [usize; 2]) -> Tensor<4> {
        let map = self.down.forward_from(input, start);
        self.blocks.iter().fold(map, |map, [a, b]| {
            let change = b.convolution.forward(a.convolution.forward(map.clone()));
            map + change
        })
    }
}

impl PathStep<DeviceLayer> {
    fn forward(&self, coarse: Tensor<4>, fine: Tensor<4>, start: [usize; 2]) -> Tensor<4> {
        let [_, channels, height, width] = fine.dims();
        let lateral = self.lateral.convolution.forward(coarse);
        let [_, _, coarse_height, coarse_width] = lateral.dims();
        let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false);
        // Exactly twice the size, then cut: an odd size must not be stretched, as in `add_doubled`.
        let doubled = interpolate(lateral, options.with_output_size([2 * coarse_height, 2 * coarse_width]));
        let shifted = doubled.pad([(0, 0), (0, 0), (start[0], 0), (start[1], 0)], PadMode::Edge);
        let enlarged = shifted.slice([0..1, 0..channels, 0..height, 0..width]);
        self.layers.iter().fold(fine + enlarged, |map, layer| layer.convolution.forward(map))
    }
}

//! The network on a device other than the CPU, with Burn.

use super::network::{Layers, PathStep, Stage};
use super::weights::{AffinityWeightsError, Layer, Weights};
use crate::SegmenterError;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
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
    pub fn forward(&self, input: &FeatureMap, log_odds: &mut FeatureMap) -> Result<(), SegmenterError> {
        let shape = [1, input.channels(), input.height(), input.width()];
        let rows = (0..shape[1]).flat_map(|channel| (0..shape[2]).map(move |row| (channel, row)));
        let values = rows.flat_map(|(channel, row)| input.row(channel, row)).copied().collect();
        let output = self.layers.forward(upload(values, shape, &self.device));
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
    fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let mut maps = vec![self.stem.convolution.forward(input)];
        for stage in &self.stages {
            maps.push(stage.forward(maps[maps.len() - 1].clone()));
        }
        let coarsest = maps.pop().expect("a map of the stem");
        let mean = coarsest.clone().mean_dim(3).mean_dim(2);
        let mut map = coarsest + self.pool.convolution.forward(mean);
        for (step, fine) in self.path.iter().zip(maps).rev() {
            map = step.forward(map, fine);
        }
        self.head.convolution.forward(map)
    }
}

impl Stage<DeviceLayer> {
    fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let map = self.down.convolution.forward(input);
        self.blocks.iter().fold(map, |map, [a, b]| {
            let change = b.convolution.forward(a.convolution.forward(map.clone()));
            map + change
        })
    }
}

impl PathStep<DeviceLayer> {
    fn forward(&self, coarse: Tensor<4>, fine: Tensor<4>) -> Tensor<4> {
        let [_, channels, height, width] = fine.dims();
        let lateral = self.lateral.convolution.forward(coarse);
        let [_, _, coarse_height, coarse_width] = lateral.dims();
        let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false);
        // Exactly twice the size, cropped: an odd size must not be stretched, as in `add_upsampled`.
        let doubled = interpolate(lateral, options.with_output_size([2 * coarse_height, 2 * coarse_width]));
        let enlarged = doubled.slice([0..1, 0..channels, 0..height, 0..width]);
        self.layers.iter().fold(fine + enlarged, |map, layer| layer.convolution.forward(map))
    }
}

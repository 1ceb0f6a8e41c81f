//! YOLOv8-seg: backbone, neck and head.

use super::c2f::{C2f, C2fShape};
use super::config::C2F_LAYERS;
use super::conv::{ConvShape, FusedConv};
use super::head::{DISTANCE_BINS, Head};
use super::raw_output::{RawLevel, RawOutput};
use super::sppf::Sppf;
use super::{FastSamConfig, FastSamError, Prototypes, Weights};
use crate::transfer::{download, upload};
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};
use burn::tensor::{Device, Tensor};

/// The network of FastSAM: YOLOv8-seg with one class, on one device. Layers are numbered as in `yolov8-seg.yaml`.
#[derive(Clone, Debug)]
pub struct FastSamNetwork {
    config: FastSamConfig,
    device: Device,
    /// Layers 0, 1, 3, 5, 7: each halves the image size.
    stages: [FusedConv; 5],
    /// Layers 2, 4, 6, 8.
    backbone: [C2f; 4],
    /// Layer 9.
    sppf: Sppf,
    /// Layers 12, 15, 18, 21.
    neck: [C2f; 4],
    /// Layers 16 and 19.
    downsampling: [FusedConv; 2],
    /// Layer 22.
    head: Head,
}

impl FastSamNetwork {
    /// Loads the network from `weights`; batch normalisation is folded into the convolutions.
    ///
    /// # Errors
    /// [`FastSamError`], with the name of the tensor, if a tensor is missing or its shape does not match the config.
    pub fn load(weights: &dyn Weights, config: FastSamConfig, device: &Device) -> Result<Self, FastSamError> {
        let channels = config.stage_channels;
        let halving = |layer: usize, inputs: usize, outputs: usize| {
            FusedConv::batch_normalised(weights, &format!("model.{layer}"), ConvShape::halving(inputs, outputs), device)
        };
        let c2f = |index: usize, inputs: usize, outputs: usize| {
            let shape = C2fShape { inputs, outputs, bottlenecks: config.bottlenecks[index], shortcut: index < 4 };
            C2f::load(weights, &format!("model.{}", C2F_LAYERS[index]), shape, device)
        };
        let [p1, p2, p3, p4, p5] = channels;
        Ok(Self {
            config,
            device: device.clone(),
            stages: [
                halving(0, 3, p1)?,
                halving(1, p1, p2)?,
                halving(3, p2, p3)?,
                halving(5, p3, p4)?,
                halving(7, p4, p5)?,
            ],
            backbone: [c2f(0, p2, p2)?, c2f(1, p3, p3)?, c2f(2, p4, p4)?, c2f(3, p5, p5)?],
            sppf: Sppf::load(weights, "model.9", p5, device)?,
            neck: [c2f(4, p5 + p4, p4)?, c2f(5, p4 + p3, p3)?, c2f(6, p3 + p4, p4)?, c2f(7, p4 + p5, p5)?],
            downsampling: [halving(16, p3, p3)?, halving(19, p4, p4)?],
            head: Head::load(weights, "model.22", &config, device)?,
        })
    }

    /// Sizes of the network.
    pub fn config(&self) -> &FastSamConfig {
        &self.config
    }

    /// Runs the network on `input`, one RGB image `[3, height, width]` in [0, 1], row-major.
    ///
    /// # Errors
    /// [`FastSamError::Device`] if the device fails.
    ///
    /// # Panics
    /// If height or width is not a multiple of 32, or `input` has another length.
    pub fn forward(&self, input: Vec<f32>, height: usize, width: usize) -> Result<RawOutput, FastSamError> {
        assert!(height.is_multiple_of(32) && width.is_multiple_of(32), "the input's size must be a multiple of 32");
        let image = upload(input, [1, 3, height, width], &self.device);
        let features = self.features(image);
        let (levels, prototypes) = self.head.forward(features);
        let [_, count, proto_height, proto_width] = prototypes.dims();
        let sizes: Vec<[usize; 4]> = levels.iter().map(|level| level.score.dims()).collect();
        let maps = levels.into_iter().flat_map(|level| [level.distances, level.score, level.coefficients]);
        let outputs = maps.chain([prototypes]).map(|map| map.flatten(0, 3)).collect();
        let mut values = download(outputs).map_err(|message| FastSamError::Device { message })?.into_iter();
        let mut next = || values.next().unwrap_or_default();
        let level = |[_, _, height, width]: [usize; 4]| RawLevel {
            height,
            width,
            distances: next(),
            scores: next(),
            coefficients: next(),
        };
        let levels = sizes.into_iter().map(level).collect();
        let prototypes = Prototypes { count, height: proto_height, width: proto_width, values: next() };
        Ok(RawOutput { levels, prototypes, distance_bins: DISTANCE_BINS })
    }

    /// Returns features of strides 8, 16 and 32: the backbone, then the neck's upsampling and downsampling paths.
    fn features(&self, image: Tensor<4>) -> [Tensor<4>; 3] {
        let [layer0, layer1, layer3, layer5, layer7] = &self.stages;
        let [layer2, layer4, layer6, layer8] = &self.backbone;
        let [layer12, layer15, layer18, layer21] = &self.neck;
        let [layer16, layer19] = &self.downsampling;
        let stride4 = layer2.forward(layer1.forward(layer0.forward(image)));
        let stride8 = layer4.forward(layer3.forward(stride4));
        let stride16 = layer6.forward(layer5.forward(stride8.clone()));
        let stride32 = self.sppf.forward(layer8.forward(layer7.forward(stride16.clone())));

        let middle = layer12.forward_joined(vec![doubled(stride32.clone()), stride16]);
        let fine = layer15.forward_joined(vec![doubled(middle.clone()), stride8]);
        let middle = layer18.forward_joined(vec![layer16.forward(fine.clone()), middle]);
        let coarse = layer21.forward_joined(vec![layer19.forward(middle.clone()), stride32]);
        [fine, middle, coarse]
    }
}

/// Doubles the image's size by nearest-neighbour interpolation.
fn doubled(input: Tensor<4>) -> Tensor<4> {
    interpolate(input, InterpolateOptions::new(InterpolateMode::Nearest).with_scale_factor([2.0, 2.0]))
}

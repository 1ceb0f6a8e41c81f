//! Sizes of a YOLOv8-seg, and how to find them in a checkpoint.

use super::{FastSamError, Weights};
use crate::checkpoint::Checkpoint;
use serde_json::Value;

/// Layers that are C2f blocks, in graph order: four in the backbone, four in the neck.
pub(super) const C2F_LAYERS: [usize; 8] = [2, 4, 6, 8, 12, 15, 18, 21];

/// Layers whose outputs are the five stages of the backbone, strides 2, 4, 8, 16, 32.
const STAGE_LAYERS: [usize; 5] = [0, 1, 3, 5, 7];

/// Maximum number of bottlenecks per block; the largest model, x, has 6.
const MAX_BOTTLENECKS: usize = 64;

/// Sizes of a YOLOv8-seg (`yolov8-seg.yaml` of Ultralytics); they determine the whole architecture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FastSamConfig {
    /// Channels of the backbone's five stages, strides 2, 4, 8, 16, 32.
    pub stage_channels: [usize; 5],
    /// Number of bottlenecks of each C2f block: layers 2, 4, 6, 8 of the backbone, 12, 15, 18, 21 of the neck.
    pub bottlenecks: [usize; 8],
    /// Hidden channels of the prototype branch.
    pub prototype_channels: usize,
    /// Number of prototypes, and thus of coefficients of each mask: 32 in all published models.
    pub mask_coefficients: usize,
}

/// The modules of `yolov8-seg.yaml`, layer by layer.
const MODULES: [&str; 23] = [
    "Conv",
    "Conv",
    "C2f",
    "Conv",
    "C2f",
    "Conv",
    "C2f",
    "Conv",
    "C2f",
    "SPPF",
    "nn.Upsample",
    "Concat",
    "C2f",
    "nn.Upsample",
    "Concat",
    "C2f",
    "Conv",
    "Concat",
    "C2f",
    "Conv",
    "Concat",
    "C2f",
    "Segment",
];

/// Depth, width and maximum channels before widening of the published sizes (`scales` in `yolov8-seg.yaml`).
const SCALES: [(char, f64, f64, usize); 5] = [
    ('n', 0.33, 0.25, 1024),
    ('s', 0.33, 0.50, 1024),
    ('m', 0.67, 0.75, 768),
    ('l', 1.00, 1.00, 512),
    ('x', 1.00, 1.25, 512),
];

impl FastSamConfig {
    /// Returns the architecture with a `depth` and `width` multiple and at most `max_channels` channels before
    /// widening.
    ///
    /// As in Ultralytics' `parse_model`, channels are rounded up to multiples of 8 and numbers of bottlenecks to the
    /// nearest integer, at least 1.
    pub fn scaled(depth: f64, width: f64, max_channels: usize) -> Self {
        let channels = |base: usize| (base.min(max_channels) as f64 * width / 8.0).ceil() as usize * 8;
        let repeats = |base: usize| ((base as f64 * depth).round_ties_even() as usize).max(1);
        Self {
            stage_channels: [64, 128, 256, 512, 1024].map(channels),
            bottlenecks: [3, 6, 6, 3, 3, 3, 3, 3].map(repeats),
            prototype_channels: channels(256),
            mask_coefficients: 32,
        }
    }

    /// Returns a published size: `n`, `s`, `m`, `l` or `x`; `None` for any other letter.
    pub fn published(size: char) -> Option<Self> {
        let (_, depth, width, max_channels) = *SCALES.iter().find(|scale| scale.0 == size)?;
        Some(Self::scaled(depth, width, max_channels))
    }

    /// Name of the architecture, e.g. `yolov8x-seg`, or `yolov8-seg` if the size is not a published one.
    pub fn name(&self) -> String {
        let size = SCALES.iter().find(|scale| Self::published(scale.0) == Some(*self));
        format!("yolov8{}-seg", size.map(|scale| scale.0.to_string()).unwrap_or_default())
    }

    /// Reads the architecture from a checkpoint's configuration, which must be YOLOv8-seg's. Without a configuration,
    /// reads it from the shapes of the tensors.
    ///
    /// # Errors
    /// [`FastSamError::NotFastSam`] if the checkpoint belongs to another model.
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, FastSamError> {
        let from_tensors = Self::from_tensors(checkpoint)?;
        let Some(configuration) = checkpoint.configuration() else { return Ok(from_tensors) };
        let other = |found: String| FastSamError::NotFastSam { path: checkpoint.path().to_owned(), found };
        match Self::from_configuration(configuration) {
            Ok(architecture) => Ok(architecture.unwrap_or(from_tensors)),
            Err(found) => Err(other(found)),
        }
    }

    /// Reads Ultralytics' `yaml` dict; `None` if it has no scale. `Err` describes how it differs from YOLOv8-seg.
    fn from_configuration(configuration: &Value) -> Result<Option<Self>, String> {
        let layers = ["backbone", "head"].into_iter().filter_map(|part| configuration[part].as_array()).flatten();
        let modules: Vec<&str> = layers.filter_map(|layer| layer[2].as_str()).collect();
        if modules != MODULES {
            let different = modules.iter().zip(MODULES).position(|(found, expected)| *found != expected);
            let layer = different.unwrap_or(modules.len().min(MODULES.len()));
            let found = modules.get(layer).map_or("missing".to_owned(), |module| (*module).chars().take(40).collect());
            let expected = MODULES.get(layer).copied().unwrap_or("nothing");
            return Err(format!("a network whose layer {layer} is {found} (expected {expected})"));
        }
        let scale = configuration["scale"].as_str().map(|scale| &configuration["scales"][scale]);
        let [depth, width, max_channels] = match scale {
            Some(Value::Array(scale)) => [0, 1, 2].map(|place| scale.get(place).and_then(Value::as_f64)),
            _ => ["depth_multiple", "width_multiple", "max_channels"].map(|key| configuration[key].as_f64()),
        };
        let (Some(depth), Some(width)) = (depth, width) else { return Ok(None) };
        let max_channels = max_channels.unwrap_or(f64::MAX);
        if !(0.0..=16.0).contains(&depth) || !(0.0..=16.0).contains(&width) || max_channels < 1.0 {
            return Err(format!("a network of depth {depth}, width {width} and at most {max_channels} channels"));
        }
        Ok(Some(Self::scaled(depth, width, max_channels as usize)))
    }

    /// Infers the architecture from the shapes of the tensors.
    ///
    /// # Errors
    /// [`FastSamError::NotFastSam`] if a tensor that every YOLOv8-seg has is missing, or the number of classes is not
    /// 1.
    pub fn from_tensors(weights: &dyn Weights) -> Result<Self, FastSamError> {
        let other = |found: String| FastSamError::NotFastSam { path: weights.path().to_owned(), found };
        let outputs = |name: String| match weights.shape(&name).as_deref() {
            Some([outputs, ..]) if *outputs > 0 => Ok(*outputs),
            Some(_) => Err(other(format!("tensor {name} without channels"))),
            None => Err(other(format!("no tensor {name}"))),
        };
        let mut stage_channels = [0; 5];
        for (channels, layer) in stage_channels.iter_mut().zip(STAGE_LAYERS) {
            *channels = outputs(format!("model.{layer}.conv.weight"))?;
        }
        let mut bottlenecks = [0; 8];
        for (count, layer) in bottlenecks.iter_mut().zip(C2F_LAYERS) {
            let is_there = |index: &usize| weights.shape(&format!("model.{layer}.m.{index}.cv1.conv.weight")).is_some();
            *count = (0..MAX_BOTTLENECKS).take_while(is_there).count();
        }
        let classes = outputs("model.22.cv3.0.2.weight".to_owned())?;
        if classes != 1 {
            return Err(other(format!("a model with {classes} classes")));
        }
        Ok(Self {
            stage_channels,
            bottlenecks,
            prototype_channels: outputs("model.22.proto.cv1.conv.weight".to_owned())?,
            mask_coefficients: outputs("model.22.proto.cv3.conv.weight".to_owned())?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_match_the_published_models() {
        let x = FastSamConfig::published('x').unwrap();
        assert_eq!(x.stage_channels, [80, 160, 320, 640, 640]);
        assert_eq!(x.bottlenecks, [3, 6, 6, 3, 3, 3, 3, 3]);
        assert_eq!((x.prototype_channels, x.name().as_str()), (320, "yolov8x-seg"));
        let medium = FastSamConfig::published('m').unwrap();
        assert_eq!(medium.stage_channels, [48, 96, 192, 384, 576]);
        assert_eq!(medium.bottlenecks, [2, 4, 4, 2, 2, 2, 2, 2]);
        assert_eq!(FastSamConfig::scaled(0.33, 0.125, 1024).name(), "yolov8-seg");
        assert_eq!(FastSamConfig::published('z'), None);
    }
}

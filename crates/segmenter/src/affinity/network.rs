//! The network: a small U-Net that predicts, for each pixel of the half-size image, the log-odds that it belongs to the
//! same object as the pixels at some offsets.
//!
//! Each stage halves the image with a 3×3 convolution of stride 2, at the places of a [`Grid`], followed by residual
//! blocks. The last stage's mean, after a 1×1 convolution, is added to its output. The path up doubles each level by
//! exactly 2 and cuts the surplus of odd sizes, as resizing to an odd size would stretch the map. It adds the level to
//! the next finer one, and ends with a 1×1 convolution. The weights determine the widths and the numbers of stages and
//! blocks. Batch norms are folded into the convolutions.

use super::device_network::DeviceNetwork;
use super::grid::Grid;
use super::weights::{AffinityWeights, AffinityWeightsError, Layer, Offset, Weights};
use crate::SegmenterError;
use splatseg_kernels::feature_map::{FeatureMap, MapConvolution, add_doubled, mean_per_channel};
use splatseg_kernels::{Activation, Instructions};
use splatseg_models::device::Device;
use std::sync::Arc;

/// A network that predicts which pixels belong to the same object. Clones share its weights.
#[derive(Clone, Debug)]
pub struct AffinityNetwork {
    layers: PlacedLayers,
    pub(super) offsets: Arc<[Offset]>,
    pub(super) threshold: f32,
}

/// The layers on the CPU or on another device.
#[derive(Clone, Debug)]
enum PlacedLayers {
    Cpu(Arc<Layers<MapConvolution>>),
    Device(Arc<DeviceNetwork>),
}

#[derive(Debug)]
pub(super) struct Layers<L> {
    pub stem: L,
    /// From fine to coarse.
    pub stages: Vec<Stage<L>>,
    pub pool: L,
    /// For each level, from fine to coarse, the step that adds the next coarser level.
    pub path: Vec<PathStep<L>>,
    pub head: L,
}

#[derive(Debug)]
pub(super) struct Stage<L> {
    pub down: L,
    pub blocks: Vec<[L; 2]>,
}

#[derive(Debug)]
pub(super) struct PathStep<L> {
    pub lateral: L,
    pub layers: Vec<L>,
}

/// Feature maps of a network, reused from frame to frame.
#[derive(Clone, Debug, Default)]
pub(super) struct NetworkMemory {
    levels: Vec<LevelMemory>,
    /// The log-odds, `[offsets, height, width]`.
    pub log_odds: FeatureMap,
}

/// Feature maps of one resolution.
#[derive(Clone, Debug, Default)]
struct LevelMemory {
    map: FeatureMap,
    first: FeatureMap,
    second: FeatureMap,
    lateral: FeatureMap,
    phases: FeatureMap,
}

impl AffinityNetwork {
    /// Loads weights on the CPU.
    ///
    /// # Errors
    /// If the file cannot be read, or a tensor is missing or its shape does not match the others; never for built-in
    /// weights (checked by a test).
    pub fn load(weights: &AffinityWeights) -> Result<Self, AffinityWeightsError> {
        Self::placed(weights, None)
    }

    /// Loads weights on a device. The log-odds differ from those on the CPU by rounding.
    ///
    /// # Errors
    /// As [`load`](Self::load); [`AffinityWeightsError::Device`] without the feature `networks`.
    pub fn load_on_device(weights: &AffinityWeights, device: &Device) -> Result<Self, AffinityWeightsError> {
        Self::placed(weights, Some(device))
    }

    fn placed(weights: &AffinityWeights, device: Option<&Device>) -> Result<Self, AffinityWeightsError> {
        let (bytes, file) = weights.read()?;
        let weights = Weights::parse(&bytes, &file)?;
        let (layers, outputs) = match device {
            None => {
                let layers = Layers::<MapConvolution>::load(&weights, &())?;
                let outputs = layers.head.outputs();
                (PlacedLayers::Cpu(Arc::new(layers)), outputs)
            }
            Some(device) => {
                let network = DeviceNetwork::load(&weights, device)?;
                let outputs = network.outputs();
                (PlacedLayers::Device(Arc::new(network)), outputs)
            }
        };
        let offsets = weights.offsets()?;
        if offsets.len() != outputs {
            let expected = format!("{outputs}, the outputs of the head");
            return Err(weights.fault("offsets in the metadata", offsets.len().to_string(), expected));
        }
        Ok(Self { layers, offsets: offsets.into(), threshold: weights.threshold()? })
    }

    /// Computes the log-odds of an input of 8 channels.
    ///
    /// # Errors
    /// [`SegmenterError::Device`] if the device fails.
    pub(super) fn forward(
        &self,
        input: &FeatureMap,
        grid: Grid,
        memory: &mut NetworkMemory,
    ) -> Result<(), SegmenterError> {
        match &self.layers {
            PlacedLayers::Cpu(layers) => layers.forward(input, grid, memory),
            PlacedLayers::Device(network) => network.forward(input, grid, &mut memory.log_odds)?,
        }
        Ok(())
    }
}

impl Layers<MapConvolution> {
    fn forward(&self, input: &FeatureMap, grid: Grid, memory: &mut NetworkMemory) {
        let Self { stem, stages, pool, path, head } = self;
        memory.levels.resize_with(stages.len() + 1, LevelMemory::default);
        let start = |level: usize, map: &FeatureMap| grid.start(level, (map.height(), map.width()));
        let LevelMemory { map, phases, .. } = &mut memory.levels[0];
        stem.forward_from(input, start(0, input), None, phases, map);
        for (index, stage) in stages.iter().enumerate() {
            let (above, below) = memory.levels.split_at_mut(index + 1);
            let map = &above[index].map;
            stage.forward(map, start(index + 1, map), &mut below[0]);
        }
        let LevelMemory { map, phases, first, .. } = &mut memory.levels[stages.len()];
        pool.forward(&mean_per_channel(map), None, phases, first);
        for (channel, rows) in map.rows_mut().enumerate() {
            let mean = first.row(channel, 0)[0];
            rows.flatten().for_each(|value| *value += mean);
        }
        for (index, step) in path.iter().enumerate().rev() {
            let (fine, coarse) = memory.levels.split_at_mut(index + 1);
            let start = start(index + 1, &fine[index].map);
            step.forward(&mut coarse[0], &mut fine[index], start);
        }
        let LevelMemory { map, phases, .. } = &mut memory.levels[0];
        head.forward(map, None, phases, &mut memory.log_odds);
    }
}

impl<L: Layer> Layers<L> {
    pub fn load(weights: &Weights<'_>, place: &L::Place) -> Result<Self, AffinityWeightsError> {
        let stem: L = weights.stem(place)?;
        let mut widths = vec![stem.outputs()];
        let mut stages: Vec<Stage<L>> = Vec::new();
        while weights.contains(&format!("e{}.0", stages.len() + 1)) {
            let stage = Stage::<L>::load(weights, stages.len() + 1, widths[stages.len()], place)?;
            widths.push(stage.down.outputs());
            stages.push(stage);
        }
        let coarsest = widths[stages.len()];
        let pool = same_width(weights, "pool", coarsest, 1, place)?;
        let path = (0..stages.len()).map(|level| PathStep::load(weights, level, &widths, place));
        let path = path.collect::<Result<_, _>>()?;
        let head = weights.convolution("head", widths[0], (1, 1), Activation::None, place)?;
        Ok(Self { stem, stages, pool, path, head })
    }
}

impl<L: Layer> Stage<L> {
    fn load(
        weights: &Weights<'_>,
        number: usize,
        inputs: usize,
        place: &L::Place,
    ) -> Result<Self, AffinityWeightsError> {
        let down: L = weights.convolution(&format!("e{number}.0"), inputs, (3, 2), Activation::Silu, place)?;
        let mut blocks = Vec::new();
        while weights.contains(&format!("e{number}.{}.a", blocks.len() + 1)) {
            let name = |part: &str| format!("e{number}.{}.{part}", blocks.len() + 1);
            let load = |part: &str| same_width(weights, &name(part), down.outputs(), 3, place);
            blocks.push([load("a")?, load("b")?]);
        }
        Ok(Self { down, blocks })
    }
}

impl<L: Layer> PathStep<L> {
    fn load(
        weights: &Weights<'_>,
        level: usize,
        widths: &[usize],
        place: &L::Place,
    ) -> Result<Self, AffinityWeightsError> {
        let lateral_name = format!("l{}", level + 1);
        let lateral: L = weights.convolution(&lateral_name, widths[level + 1], (1, 1), Activation::None, place)?;
        if lateral.outputs() != widths[level] {
            let found = format!("{} outputs", lateral.outputs());
            return Err(weights.fault(&format!("tensor {lateral_name}.weight"), found, widths[level].to_string()));
        }
        let mut layers = Vec::new();
        while weights.contains(&format!("d{level}.{}", layers.len())) {
            layers.push(same_width(weights, &format!("d{level}.{}", layers.len()), widths[level], 3, place)?);
        }
        Ok(Self { lateral, layers })
    }
}

impl Stage<MapConvolution> {
    fn forward(&self, input: &FeatureMap, start: [usize; 2], level: &mut LevelMemory) {
        let LevelMemory { map, first, second, phases, .. } = level;
        self.down.forward_from(input, start, None, phases, map);
        for [a, b] in &self.blocks {
            a.forward(map, None, phases, first);
            b.forward(first, Some(map), phases, second);
            std::mem::swap(map, second);
        }
    }
}

impl PathStep<MapConvolution> {
    fn forward(&self, coarse: &mut LevelMemory, fine: &mut LevelMemory, start: [usize; 2]) {
        self.lateral.forward(&coarse.map, None, &mut coarse.phases, &mut coarse.lateral);
        let LevelMemory { map, first, phases, .. } = fine;
        add_doubled(&coarse.lateral, map, start, Instructions::best());
        for layer in &self.layers {
            layer.forward(map, None, phases, first);
            std::mem::swap(map, first);
        }
    }
}

/// A convolution with equal numbers of inputs and outputs, followed by SiLU.
fn same_width<L: Layer>(
    weights: &Weights<'_>,
    name: &str,
    width: usize,
    kernel: usize,
    place: &L::Place,
) -> Result<L, AffinityWeightsError> {
    let layer: L = weights.convolution(name, width, (kernel, 1), Activation::Silu, place)?;
    if layer.outputs() != width {
        let found = format!("{} outputs", layer.outputs());
        return Err(weights.fault(&format!("tensor {name}.weight"), found, width.to_string()));
    }
    Ok(layer)
}

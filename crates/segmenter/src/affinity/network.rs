//! The network: a small U-Net that predicts, for each pixel of the half-size image, the log-odds that it belongs to the
//! same object as the pixels at some offsets.
//!
//! Stages of 3×3 convolutions halve the image; each begins with a stride of 2 and goes on with residual blocks. The mean of
//! the last stage is added to it. The path up adds each stage to the one above, enlarged, and ends in a 1×1 convolution.
//! Widths, stages and blocks are those of the weights. Batch norms are folded into the convolutions.

use super::weights::{AffinityWeightsError, BUILT_IN, MAX_BYTES, Offset, Weights};
use splatseg_kernels::feature_map::{FeatureMap, MapConvolution, add_upsampled, mean_per_channel};
use splatseg_kernels::{Activation, Instructions};
use std::path::Path;
use std::sync::Arc;

/// A network that predicts which pixels belong to the same object. Copies share its weights.
#[derive(Clone, Debug)]
pub struct AffinityNetwork {
    layers: Arc<Layers>,
    pub(super) offsets: Arc<[Offset]>,
    pub(super) threshold: f32,
}

#[derive(Debug)]
struct Layers {
    stem: MapConvolution,
    /// From fine to coarse.
    stages: Vec<Stage>,
    pool: MapConvolution,
    /// From fine to coarse: what each level receives from the next coarser one.
    path: Vec<PathStep>,
    head: MapConvolution,
}

#[derive(Debug)]
struct Stage {
    down: MapConvolution,
    blocks: Vec<[MapConvolution; 2]>,
}

#[derive(Debug)]
struct PathStep {
    lateral: MapConvolution,
    layers: Vec<MapConvolution>,
}

/// The maps of a network, kept from one frame to the next.
#[derive(Clone, Debug, Default)]
pub(super) struct NetworkMemory {
    levels: Vec<LevelMemory>,
    /// The log-odds, `[offsets, height, width]`.
    pub log_odds: FeatureMap,
}

/// The maps of one resolution.
#[derive(Clone, Debug, Default)]
struct LevelMemory {
    map: FeatureMap,
    first: FeatureMap,
    second: FeatureMap,
    lateral: FeatureMap,
    phases: FeatureMap,
}

impl AffinityNetwork {
    /// The network whose weights are part of the program.
    ///
    /// # Errors
    /// Never, as a test checks.
    pub fn built_in() -> Result<Self, AffinityWeightsError> {
        Self::parse(BUILT_IN, "built-in weights")
    }

    /// The network of a `.safetensors` file that `training/splatseg_training/export.py` wrote.
    ///
    /// # Errors
    /// If the file cannot be read, or a tensor is missing or of a shape that does not fit the others.
    pub fn open(path: &Path) -> Result<Self, AffinityWeightsError> {
        let read = splatseg_input::read_file(path, MAX_BYTES);
        let bytes = read.map_err(|source| AffinityWeightsError::Read { path: path.to_owned(), source })?;
        Self::parse(&bytes, &path.display().to_string())
    }

    fn parse(bytes: &[u8], file: &str) -> Result<Self, AffinityWeightsError> {
        let weights = Weights::parse(bytes, file)?;
        let layers = Layers::load(&weights)?;
        let offsets = weights.offsets()?;
        if offsets.len() != layers.head.outputs() {
            let expected = format!("{}, the outputs of the head", layers.head.outputs());
            return Err(weights.fault("offsets in the metadata", offsets.len().to_string(), expected));
        }
        Ok(Self { layers: Arc::new(layers), offsets: offsets.into(), threshold: weights.threshold()? })
    }

    /// Computes the log-odds of an input of 8 channels.
    pub(super) fn forward(&self, input: &FeatureMap, memory: &mut NetworkMemory) {
        let Layers { stem, stages, pool, path, head } = &*self.layers;
        memory.levels.resize_with(stages.len() + 1, LevelMemory::default);
        let LevelMemory { map, phases, .. } = &mut memory.levels[0];
        stem.forward(input, None, phases, map);
        for (index, stage) in stages.iter().enumerate() {
            let (above, below) = memory.levels.split_at_mut(index + 1);
            stage.forward(&above[index].map, &mut below[0]);
        }
        let LevelMemory { map, phases, first, .. } = &mut memory.levels[stages.len()];
        pool.forward(&mean_per_channel(map), None, phases, first);
        for (channel, rows) in map.rows_mut().enumerate() {
            let mean = first.row(channel, 0)[0];
            rows.flatten().for_each(|value| *value += mean);
        }
        for (index, step) in path.iter().enumerate().rev() {
            let (fine, coarse) = memory.levels.split_at_mut(index + 1);
            step.forward(&mut coarse[0], &mut fine[index]);
        }
        let LevelMemory { map, phases, .. } = &mut memory.levels[0];
        head.forward(map, None, phases, &mut memory.log_odds);
    }
}

impl Layers {
    fn load(weights: &Weights<'_>) -> Result<Self, AffinityWeightsError> {
        let stem = weights.stem()?;
        let mut widths = vec![stem.outputs()];
        let mut stages = Vec::new();
        while weights.contains(&format!("e{}.0", stages.len() + 1)) {
            let stage = Stage::load(weights, stages.len() + 1, widths[stages.len()])?;
            widths.push(stage.down.outputs());
            stages.push(stage);
        }
        let coarsest = widths[stages.len()];
        let pool = same_width(weights, "pool", coarsest, 1)?;
        let path = (0..stages.len()).map(|level| PathStep::load(weights, level, &widths)).collect::<Result<_, _>>()?;
        let head = weights.convolution("head", widths[0], (1, 1), Activation::None)?;
        Ok(Self { stem, stages, pool, path, head })
    }
}

impl Stage {
    fn load(weights: &Weights<'_>, number: usize, inputs: usize) -> Result<Self, AffinityWeightsError> {
        let down = weights.convolution(&format!("e{number}.0"), inputs, (3, 2), Activation::Silu)?;
        let mut blocks = Vec::new();
        while weights.contains(&format!("e{number}.{}.a", blocks.len() + 1)) {
            let name = |part: &str| format!("e{number}.{}.{part}", blocks.len() + 1);
            let load = |part: &str| same_width(weights, &name(part), down.outputs(), 3);
            blocks.push([load("a")?, load("b")?]);
        }
        Ok(Self { down, blocks })
    }

    fn forward(&self, input: &FeatureMap, level: &mut LevelMemory) {
        let LevelMemory { map, first, second, phases, .. } = level;
        self.down.forward(input, None, phases, map);
        for [a, b] in &self.blocks {
            a.forward(map, None, phases, first);
            b.forward(first, Some(map), phases, second);
            std::mem::swap(map, second);
        }
    }
}

impl PathStep {
    fn load(weights: &Weights<'_>, level: usize, widths: &[usize]) -> Result<Self, AffinityWeightsError> {
        let lateral_name = format!("l{}", level + 1);
        let lateral = weights.convolution(&lateral_name, widths[level + 1], (1, 1), Activation::None)?;
        if lateral.outputs() != widths[level] {
            let found = format!("{} outputs", lateral.outputs());
            return Err(weights.fault(&format!("tensor {lateral_name}.weight"), found, widths[level].to_string()));
        }
        let mut layers = Vec::new();
        while weights.contains(&format!("d{level}.{}", layers.len())) {
            layers.push(same_width(weights, &format!("d{level}.{}", layers.len()), widths[level], 3)?);
        }
        Ok(Self { lateral, layers })
    }

    fn forward(&self, coarse: &mut LevelMemory, fine: &mut LevelMemory) {
        self.lateral.forward(&coarse.map, None, &mut coarse.phases, &mut coarse.lateral);
        let LevelMemory { map, first, phases, .. } = fine;
        add_upsampled(&coarse.lateral, map, Instructions::best());
        for layer in &self.layers {
            layer.forward(map, None, phases, first);
            std::mem::swap(map, first);
        }
    }
}

/// A convolution with as many outputs as inputs, followed by SiLU.
fn same_width(
    weights: &Weights<'_>,
    name: &str,
    width: usize,
    kernel: usize,
) -> Result<MapConvolution, AffinityWeightsError> {
    let layer = weights.convolution(name, width, (kernel, 1), Activation::Silu)?;
    if layer.outputs() != width {
        let found = format!("{} outputs", layer.outputs());
        return Err(weights.fault(&format!("tensor {name}.weight"), found, width.to_string()));
    }
    Ok(layer)
}

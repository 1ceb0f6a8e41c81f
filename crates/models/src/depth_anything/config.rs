//! The sizes of a Depth Anything network: from the shapes of its tensors, and what those do not tell from a `config.json`
//! or from the file's name.

use super::{DepthAnythingError, DepthAnythingLayout};
use crate::checkpoint::{Checkpoint, printable};
use crate::transformer::TowerConfig;
use serde_json::Value;
use splatseg_kernels::Activation;
use std::path::PathBuf;

/// Channels per attention head of every published network.
const HEAD_WIDTH: usize = 64;
/// Limits far above every published network, so that no file makes the program take all memory.
const MAX_WIDTH: usize = 4096;
const MAX_BLOCKS: usize = 96;
const MAX_POSITIONS: usize = 4097;
/// Configurations beside a checkpoint.
const CONFIG_FILES: [&str; 1] = ["config.json"];
/// Largest depth of the published metric networks, metres: of Hypersim's rooms and of Virtual KITTI's streets.
const INDOOR_DEPTH: f32 = 20.0;
const OUTDOOR_DEPTH: f32 = 80.0;

/// Kind of depth that a network returns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthOutput {
    /// Inverse depth up to scale and shift, 0 or more.
    Relative,
    /// z-depth in metres.
    Metric {
        /// The largest possible depth, metres.
        max_depth: f32,
    },
}

impl DepthOutput {
    /// Metres, as networks that were trained on rooms return.
    pub const INDOOR: Self = Self::Metric { max_depth: INDOOR_DEPTH };
    /// Metres, as networks that were trained on streets return.
    pub const OUTDOOR: Self = Self::Metric { max_depth: OUTDOOR_DEPTH };
}

/// Sizes of a Depth Anything network, and what it returns.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthAnythingConfig {
    /// Names of the tensors.
    pub layout: DepthAnythingLayout,
    /// Side of a patch, pixels.
    pub patch: usize,
    /// Positions that have an embedding, along a side: 37 in the published networks, 518 pixels.
    pub grid: usize,
    /// The encoder.
    pub encoder: TowerConfig,
    /// The decoder gets the tokens after these blocks, counted from 1.
    pub taps: [usize; 4],
    /// Channels of the decoder's stages, the finest first.
    pub stages: [usize; 4],
    /// Channels after the stages.
    pub features: usize,
    /// Channels before the last layer.
    pub head: usize,
    /// Kind of depth that the network returns.
    pub output: DepthOutput,
    /// Assumptions where neither shapes nor a configuration decide, in words; empty if there are none.
    pub assumed: Vec<String>,
}

impl DepthAnythingConfig {
    /// Reads the sizes of a checkpoint, and the configuration beside it, if there is one. `output` is what the network
    /// returns, if it is known.
    ///
    /// # Errors
    /// If the checkpoint is not of a Depth Anything network, or a size is impossible or not supported.
    pub fn of(checkpoint: &Checkpoint, output: Option<DepthOutput>) -> Result<Self, DepthAnythingError> {
        let path = checkpoint.path();
        let Some(layout) = DepthAnythingLayout::of(checkpoint) else {
            let found = format!("{} ({})", checkpoint.architecture(), checkpoint.first_names());
            return Err(DepthAnythingError::OtherNetwork { path: path.to_owned(), found });
        };
        let given = checkpoint.configuration_beside(&CONFIG_FILES)?;
        let given = given.filter(|(_, json)| json.get("model_type").and_then(Value::as_str) == Some("depth_anything"));
        Reader { checkpoint, layout, given, assumed: Vec::new() }.config(output)
    }
}

struct Reader<'a> {
    checkpoint: &'a Checkpoint,
    layout: DepthAnythingLayout,
    given: Option<(PathBuf, Value)>,
    assumed: Vec<String>,
}

impl Reader<'_> {
    fn config(mut self, output: Option<DepthOutput>) -> Result<DepthAnythingConfig, DepthAnythingError> {
        // Tensors of PyTorch's files may share data, so that a small one could take all memory.
        let (stated, stored) = self.checkpoint.stated_and_stored_bytes();
        let expected = format!("at most {stored}, the size of the file");
        self.check("tensors", format!("{stated} bytes"), &expected, stated <= u128::from(stored))?;
        let names = self.layout.encoder();
        let [width, channels, patch, patch_width] = self.shape(&format!("{}.weight", names.patches))?;
        let found = format!("{channels} channels, {patch_width} x {patch}");
        let is_right = channels == 3 && patch == patch_width && (1..=64).contains(&patch);
        self.check("patches", found, "square patches of 3 channels", is_right)?;
        let [_, positions, _] = self.shape(names.positions)?;
        let grid = positions.saturating_sub(1).isqrt();
        let is_right = positions <= MAX_POSITIONS && grid > 0 && grid * grid + 1 == positions;
        self.check(
            "positions",
            positions.to_string(),
            "one for the class, and those of a square of patches",
            is_right,
        )?;
        let encoder = self.encoder(width)?;
        let stages = self.stages()?;
        let [features, ..] = self.shape::<4>(&format!("{}.weight", self.layout.features(0)))?;
        let is_right = (2..=MAX_WIDTH).contains(&features) && features.is_multiple_of(2);
        self.check("channels after the stages", features.to_string(), "an even number up to 4096", is_right)?;
        let [head, ..] = self.shape::<4>(&format!("{}.weight", self.layout.head()[1]))?;
        self.check("channels of the head", head.to_string(), "1 to 4096", (1..=MAX_WIDTH).contains(&head))?;
        let taps = self.taps(encoder.blocks)?;
        let output = match output {
            Some(output) => output,
            None => self.output()?,
        };
        let Self { layout, assumed, .. } = self;
        Ok(DepthAnythingConfig { layout, patch, grid, encoder, taps, stages, features, head, output, assumed })
    }

    fn encoder(&self, width: usize) -> Result<TowerConfig, DepthAnythingError> {
        self.check("width", width.to_string(), "8 to 4096", (8..=MAX_WIDTH).contains(&width))?;
        let blocks = self.layout.blocks(self.checkpoint).count(self.checkpoint);
        self.check("blocks", blocks.to_string(), "4 to 96", (4..=MAX_BLOCKS).contains(&blocks))?;
        let given = self.value(&["backbone_config", "num_attention_heads"]).and_then(Value::as_u64);
        let heads = given.unwrap_or((width / HEAD_WIDTH) as u64);
        let is_possible = heads > 0 && (width as u64).is_multiple_of(heads);
        self.check("attention heads", heads.to_string(), &format!("a divisor of {width}"), is_possible)?;
        Ok(TowerConfig { width, heads: heads as usize, blocks, activation: Activation::Gelu })
    }

    fn stages(&self) -> Result<[usize; 4], DepthAnythingError> {
        let mut stages = [0; 4];
        for (stage, channels) in stages.iter_mut().enumerate() {
            [*channels, ..] = self.shape::<4>(&format!("{}.weight", self.layout.projection(stage)))?;
            let what = format!("channels of stage {stage}");
            self.check(&what, channels.to_string(), "1 to 4096", (1..=MAX_WIDTH).contains(channels))?;
        }
        Ok(stages)
    }

    /// The blocks whose tokens the decoder gets: those of V2, unless the configuration says otherwise.
    fn taps(&self, blocks: usize) -> Result<[usize; 4], DepthAnythingError> {
        let usual = match blocks {
            24 => [5, 12, 18, 24],
            _ => [1, 2, 3, 4].map(|quarter| quarter * blocks / 4),
        };
        let Some(given) = self.value(&["backbone_config", "out_indices"]).and_then(Value::as_array) else {
            return Ok(usual);
        };
        let numbers: Option<Vec<usize>> =
            given.iter().map(|number| number.as_u64().and_then(|number| usize::try_from(number).ok())).collect();
        let found = numbers.and_then(|numbers| <[usize; 4]>::try_from(numbers).ok());
        let found = found.filter(|taps| taps[0] > 0 && taps[3] <= blocks && taps.is_sorted_by(|a, b| a < b));
        found.ok_or_else(|| DepthAnythingError::Size {
            path: self.given_path(),
            what: "out_indices".to_owned(),
            found: printable(&Value::from(given.clone()).to_string()),
            expected: format!("four rising numbers from 1 to {blocks}"),
        })
    }

    /// Kind of depth that the network returns: as the configuration says, else as the file's name does. The tensors are the same.
    fn output(&mut self) -> Result<DepthOutput, DepthAnythingError> {
        if let Some(kind) = self.value(&["depth_estimation_type"]).and_then(Value::as_str) {
            let depth = self.value(&["max_depth"]).and_then(Value::as_f64).unwrap_or(1.0) as f32;
            let wrong = |what: &str, found: String, expected: &str| DepthAnythingError::Size {
                path: self.given_path(),
                what: what.to_owned(),
                found,
                expected: expected.to_owned(),
            };
            return match kind {
                "relative" => Ok(DepthOutput::Relative),
                "metric" if (0.1..=10_000.0).contains(&depth) => Ok(DepthOutput::Metric { max_depth: depth }),
                "metric" => Err(wrong("max_depth", depth.to_string(), "0.1 to 10000 metres")),
                other => Err(wrong("depth_estimation_type", printable(other), "relative or metric")),
            };
        }
        let name = self.checkpoint.path().file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        let (output, words) = match () {
            () if name.contains("vkitti") || name.contains("outdoor") => (DepthOutput::OUTDOOR, "metres up to 80"),
            () if name.contains("metric") || name.contains("hypersim") || name.contains("indoor") => {
                (DepthOutput::INDOOR, "metres up to 20")
            }
            () => (DepthOutput::Relative, "inverse depth without a scale"),
        };
        self.assumed.push(format!("it returns {words}, as its name says (or set depth_anything.output)"));
        Ok(output)
    }

    /// A value of the configuration.
    fn value(&self, keys: &[&str]) -> Option<&Value> {
        let (_, json) = self.given.as_ref()?;
        keys.iter().try_fold(json, |value, key| value.get(key))
    }

    fn given_path(&self) -> PathBuf {
        self.given.as_ref().map_or_else(|| self.checkpoint.path().to_owned(), |(path, _)| path.clone())
    }

    /// The shape of a tensor with `N` axes.
    fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N], DepthAnythingError> {
        let size = |found: String| DepthAnythingError::Size {
            path: self.checkpoint.path().to_owned(),
            what: name.to_owned(),
            found,
            expected: format!("{N} axes"),
        };
        let info = self.checkpoint.info(name).ok_or_else(|| size("no such tensor".to_owned()))?;
        info.shape().try_into().map_err(|_| size(format!("shape {:?}", info.shape())))
    }

    fn check(&self, what: &str, found: String, expected: &str, is_right: bool) -> Result<(), DepthAnythingError> {
        if is_right {
            return Ok(());
        }
        let path = self.checkpoint.path().to_owned();
        Err(DepthAnythingError::Size { path, what: what.to_owned(), found, expected: expected.to_owned() })
    }
}

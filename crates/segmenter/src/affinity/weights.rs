//! Weights of the network: a `.safetensors` file in half or single precision, either built in or supplied by the user.

use super::inputs::{CHANNELS, COLOR_CHANNELS, DEPTH_CHANNELS};
use safetensors::{Dtype, SafeTensors};
use splatseg_kernels::feature_map::MapConvolution;
use splatseg_kernels::{Activation, Instructions};
use splatseg_models::device::DeviceError;
use std::borrow::Cow;
use std::path::PathBuf;
use thiserror::Error;

/// The weights built into the program, made by `training/splatseg_training/export.py`.
static BUILT_IN: &[u8] = include_bytes!("weights.safetensors");
/// The built-in weights for noisy depth, made by `training/splatseg_training/average.py`.
static NOISY_DEPTH: &[u8] = include_bytes!("weights_noisy_depth.safetensors");
/// Maximum size of a weights file, bytes.
const MAX_BYTES: u64 = 256 << 20;

/// Where the weights of an affinity network come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AffinityWeights {
    /// Built into the program.
    #[default]
    BuiltIn,
    /// Built into the program, for frames with noisy depth.
    NoisyDepth,
    /// A `.safetensors` file written by `training/splatseg_training/export.py`.
    File(PathBuf),
}

impl AffinityWeights {
    /// Reads the file if it is one. Also returns its name for messages.
    pub(super) fn read(&self) -> Result<(Cow<'static, [u8]>, String), AffinityWeightsError> {
        match self {
            Self::BuiltIn => Ok((BUILT_IN.into(), "built-in weights".to_owned())),
            Self::NoisyDepth => Ok((NOISY_DEPTH.into(), "built-in weights for noisy depth".to_owned())),
            Self::File(path) => match splatseg_files::read_file(path, MAX_BYTES) {
                Ok(bytes) => Ok((bytes.into(), path.display().to_string())),
                Err(source) => Err(AffinityWeightsError::Read { path: path.clone(), source }),
            },
        }
    }
}

/// Errors loading weights of the affinity network.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AffinityWeightsError {
    /// The file could not be read.
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The I/O error.
        source: std::io::Error,
    },
    /// The file does not contain an affinity network.
    #[error("{file}: {part}: found {found}, expected {expected}")]
    Content {
        /// The file, or `built-in weights`.
        file: String,
        /// The part of the file, e.g. `tensor e1.0.weight`.
        part: String,
        /// The content found.
        found: String,
        /// The expected content.
        expected: String,
    },
    /// The program was built without networks on devices.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// Offset from a pixel to its partner: rows down and columns to the right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Offset {
    pub down: i32,
    pub right: i32,
}

/// A convolution with bias and activation, on the CPU or on another device.
pub(super) trait Layer: Sized {
    /// Location of the parameters.
    type Place;

    /// Creates a layer. `weight` is `[outputs, inputs, kernel, kernel]`, row-major. The input is zero-padded by
    /// `kernel / 2` on each side.
    fn new(
        weight: &[f32],
        bias: &[f32],
        kernel: usize,
        stride: usize,
        activation: Activation,
        place: &Self::Place,
    ) -> Self;

    /// Number of output channels.
    fn outputs(&self) -> usize;
}

impl Layer for MapConvolution {
    type Place = ();

    fn new(weight: &[f32], bias: &[f32], kernel: usize, stride: usize, activation: Activation, (): &()) -> Self {
        Self::new(weight, bias, kernel, stride, activation, Instructions::best())
    }

    fn outputs(&self) -> usize {
        self.outputs()
    }
}

/// The tensors and the metadata of a file.
pub(super) struct Weights<'a> {
    tensors: SafeTensors<'a>,
    metadata: std::collections::HashMap<String, String>,
    /// The file's name for messages.
    file: &'a str,
}

impl<'a> Weights<'a> {
    pub fn parse(bytes: &'a [u8], file: &'a str) -> Result<Self, AffinityWeightsError> {
        let fault = |error: safetensors::SafeTensorError| AffinityWeightsError::Content {
            file: file.to_owned(),
            part: "the file".to_owned(),
            found: error.to_string(),
            expected: "a safetensors file with an affinity network (FastSAM's files need segmenter = fastsam)"
                .to_owned(),
        };
        let tensors = SafeTensors::deserialize(bytes).map_err(fault)?;
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(fault)?;
        Ok(Self { tensors, metadata: metadata.metadata().clone().unwrap_or_default(), file })
    }

    /// Returns an error for a part of the file.
    pub fn fault(&self, part: &str, found: impl Into<String>, expected: impl Into<String>) -> AffinityWeightsError {
        let (part, found, expected) = (part.to_owned(), found.into(), expected.into());
        AffinityWeightsError::Content { file: self.file.to_owned(), part, found, expected }
    }

    /// True if there is a convolution of this name.
    pub fn contains(&self, name: &str) -> bool {
        self.tensors.tensor(&format!("{name}.weight")).is_ok()
    }

    /// Reads `offsets` from the metadata, a JSON list of (row, column): the pixel pairs of the head's channels. None points
    /// upwards: each pair is stored at its upper pixel, see [`splatseg_geometry::Affinities`].
    pub fn offsets(&self) -> Result<Vec<Offset>, AffinityWeightsError> {
        let text = self.metadata.get("offsets").map_or("nothing", String::as_str);
        let expected = "a list of pairs (row, column): rows down from 0 to 9999, columns to the right from -9999 to 9999, not both 0";
        let pairs: Vec<(i32, i32)> =
            serde_json::from_str(text).map_err(|_| self.fault("offsets in the metadata", text, expected))?;
        let is_possible = |(down, right): &(i32, i32)| {
            (*down, *right) != (0, 0) && (0..10_000).contains(down) && (-9_999..10_000).contains(right)
        };
        if !pairs.iter().all(is_possible) {
            return Err(self.fault("offsets in the metadata", text, expected));
        }
        Ok(pairs.into_iter().map(|(down, right)| Offset { down, right }).collect())
    }

    /// Reads `threshold` from the metadata: the mean log-odds above which regions are merged.
    pub fn threshold(&self) -> Result<f32, AffinityWeightsError> {
        let text = self.metadata.get("threshold").map_or("nothing", String::as_str);
        let threshold = text.parse().ok().filter(|threshold: &f32| threshold.is_finite());
        threshold.ok_or_else(|| self.fault("threshold in the metadata", text, "a number"))
    }

    /// Loads the first convolution, with all [`CHANNELS`]. A colour-only network has 3 input channels and a depth-only
    /// one 5. The weights of missing channels are set to 0.
    pub fn stem<L: Layer>(&self, place: &L::Place) -> Result<L, AffinityWeightsError> {
        let (shape, weight) = self.numbers("stem.weight")?;
        let first = match shape[..] {
            [(1..), CHANNELS | COLOR_CHANNELS, 3, 3] => 0,
            [(1..), DEPTH_CHANNELS, 3, 3] => COLOR_CHANNELS,
            _ => {
                let expected = "[outputs, 3, 5 or 8, 3, 3]";
                return Err(self.fault("tensor stem.weight", format!("shape {shape:?}"), expected));
            }
        };
        let mut padded = vec![0.0; shape[0] * CHANNELS * 9];
        for (out, weight) in padded.chunks_exact_mut(CHANNELS * 9).zip(weight.chunks_exact(shape[1] * 9)) {
            out[first * 9..][..weight.len()].copy_from_slice(weight);
        }
        let bias = self.bias("stem", shape[0])?;
        Ok(L::new(&padded, &bias, 3, 2, Activation::Silu, place))
    }

    /// Loads the convolution `name` of `inputs` channels, with a kernel of `kernel` × `kernel`.
    pub fn convolution<L: Layer>(
        &self,
        name: &str,
        inputs: usize,
        (kernel, stride): (usize, usize),
        activation: Activation,
        place: &L::Place,
    ) -> Result<L, AffinityWeightsError> {
        let (shape, weight) = self.numbers(&format!("{name}.weight"))?;
        let outputs = shape.first().copied().unwrap_or(0);
        if outputs == 0 || shape != [outputs, inputs, kernel, kernel] {
            let expected = format!("[outputs, {inputs}, {kernel}, {kernel}]");
            return Err(self.fault(&format!("tensor {name}.weight"), format!("shape {shape:?}"), expected));
        }
        let bias = self.bias(name, outputs)?;
        Ok(L::new(&weight, &bias, kernel, stride, activation, place))
    }

    /// Reads the biases of the convolution `name`.
    fn bias(&self, name: &str, outputs: usize) -> Result<Vec<f32>, AffinityWeightsError> {
        let (shape, bias) = self.numbers(&format!("{name}.bias"))?;
        if shape != [outputs] {
            return Err(self.fault(&format!("tensor {name}.bias"), format!("shape {shape:?}"), format!("[{outputs}]")));
        }
        Ok(bias)
    }

    /// Reads the shape and values of a tensor.
    fn numbers(&self, name: &str) -> Result<(Vec<usize>, Vec<f32>), AffinityWeightsError> {
        let part = format!("tensor {name}");
        let tensor = self.tensors.tensor(name).map_err(|_| self.fault(&part, "nothing", "a tensor"))?;
        let bytes = tensor.data();
        let numbers: Vec<f32> = match tensor.dtype() {
            Dtype::F16 => bytes.as_chunks().0.iter().map(|bytes| half::f16::from_le_bytes(*bytes).to_f32()).collect(),
            Dtype::F32 => bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
            other => return Err(self.fault(&part, format!("{other:?}"), "F16 or F32")),
        };
        // One such weight would make every log-odds useless, and no object would be found.
        if let Some(number) = numbers.iter().find(|number| !number.is_finite()) {
            return Err(self.fault(&part, number.to_string(), "finite numbers"));
        }
        Ok((tensor.shape().to_vec(), numbers))
    }
}

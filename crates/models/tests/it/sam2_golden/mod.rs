//! Reads and compares reference data in `../shared/golden/sam2`.
#![allow(dead_code)] // The unit tests of the blocks use a part.

#[path = "../test_device/mod.rs"]
pub mod test_device;

use safetensors::{Dtype, SafeTensors};
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::sam2::{Sam2Error, Weights};
use splatseg_test_scenes::{shared, shared_folder, skipped};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folder of the reference data. `None`, reported on a line of its own, if the folder or the device is missing.
pub fn folder(test: &str) -> Option<PathBuf> {
    if let Some(reason) = test_device::missing() {
        skipped(test, &reason);
        return None;
    }
    shared("golden/sam2", test)
}

/// A file of `../shared`, which may also be in `tests/data`, there without `golden/`. `None`, reported on a line of its own,
/// if it is in neither because `../shared` is missing.
pub fn own_or_shared(path: &str, test: &str) -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(path.trim_start_matches("golden/"));
    if own.is_file() { Some(own) } else { Some(shared_folder(test)?.join(path)) }
}

/// One reference file.
pub struct Golden(Vec<u8>);

impl Golden {
    pub fn open(folder: &Path, name: &str) -> Self {
        let path = folder.join(format!("{name}.safetensors"));
        Self(std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
    }

    fn tensors(&self) -> SafeTensors<'_> {
        SafeTensors::deserialize(&self.0).unwrap()
    }

    pub fn shape(&self, name: &str) -> Vec<usize> {
        self.tensors().tensor(name).unwrap_or_else(|error| panic!("{name}: {error}")).shape().to_vec()
    }

    pub fn has(&self, name: &str) -> bool {
        self.tensors().tensor(name).is_ok()
    }

    /// Returns the elements as `f32`, row-major.
    pub fn floats(&self, name: &str) -> Vec<f32> {
        let tensors = self.tensors();
        let tensor = tensors.tensor(name).unwrap_or_else(|error| panic!("{name}: {error}"));
        let data = tensor.data();
        match tensor.dtype() {
            Dtype::F32 => data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
            Dtype::F64 => data.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes) as f32).collect(),
            Dtype::I32 => data.as_chunks::<4>().0.iter().map(|bytes| i32::from_le_bytes(*bytes) as f32).collect(),
            Dtype::F16 => {
                data.as_chunks::<2>().0.iter().map(|bytes| burn::tensor::f16::from_le_bytes(*bytes).to_f32()).collect()
            }
            Dtype::U8 => data.iter().map(|byte| f32::from(*byte)).collect(),
            other => panic!("{name} is {other:?}"),
        }
    }

    pub fn doubles(&self, name: &str) -> Vec<f64> {
        let tensors = self.tensors();
        let data = tensors.tensor(name).unwrap().data();
        data.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()
    }

    pub fn ints(&self, name: &str) -> Vec<usize> {
        self.floats(name).iter().map(|value| *value as usize).collect()
    }

    pub fn bytes(&self, name: &str) -> Vec<u8> {
        self.tensors().tensor(name).unwrap_or_else(|error| panic!("{name}: {error}")).data().to_vec()
    }
}

/// Maximum difference from the reference.
#[derive(Clone, Copy, Debug)]
pub enum Within {
    /// A fraction of the largest reference magnitude.
    OfMax(f32),
    /// An absolute difference.
    Absolute(f32),
    /// An absolute difference plus a fraction of the reference value.
    Mixed(f32, f32),
}

/// Panics unless `found` is close to `expected`; returns the largest difference. With `SAM2_REPORT` set, prints the
/// differences.
#[track_caller]
pub fn assert_close(what: &str, found: &[f32], expected: &[f32], within: Within) -> f32 {
    assert_eq!(found.len(), expected.len(), "{what}: number of elements");
    let largest = expected.iter().fold(0f32, |largest, value| largest.max(value.abs()));
    let mut worst = 0f32;
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let difference = (found - expected).abs();
        let allowed = match within {
            Within::OfMax(share) => share * largest,
            Within::Absolute(allowed) => allowed,
            Within::Mixed(allowed, share) => allowed + share * expected.abs(),
        };
        assert!(
            difference <= allowed,
            "{what}[{index}]: {found} instead of {expected}, off by {difference}, allowed {allowed} (max {largest})"
        );
        worst = worst.max(difference);
    }
    if std::env::var_os("SAM2_REPORT").is_some() {
        eprintln!("{what}: off by {worst:.2e} at most, {:.1e} of the largest", worst / largest.max(1e-30));
    }
    worst
}

/// Weights given by a formula of name and index (the reference data's README).
pub struct FormulaWeights {
    shapes: BTreeMap<String, Vec<usize>>,
    /// Factors of the tensors whose names have a part.
    factors: Vec<(String, f32)>,
}

impl FormulaWeights {
    /// Weights of the names and shapes in `manifest_<size>.json`.
    pub fn from_manifest(folder: &Path, size: &str) -> Self {
        let text = std::fs::read_to_string(folder.join(format!("manifest_{size}.json"))).unwrap();
        let manifest: serde_json::Value = serde_json::from_str(&text).unwrap();
        let entry = |entry: &serde_json::Value| {
            let shape = entry[1].as_array().unwrap().iter().map(|size| size.as_u64().unwrap() as usize).collect();
            (entry[0].as_str().unwrap().to_owned(), shape)
        };
        let factor =
            |entry: &serde_json::Value| (entry[0].as_str().unwrap().to_owned(), entry[1].as_f64().unwrap() as f32);
        let factors = manifest["factors"].as_array().into_iter().flatten().map(factor).collect();
        Self { shapes: manifest["tensors"].as_array().unwrap().iter().map(entry).collect(), factors }
    }

    pub fn shapes_mut(&mut self) -> &mut BTreeMap<String, Vec<usize>> {
        &mut self.shapes
    }
}

/// Number `index` of the sequence with this name hash, in [-1, 1).
pub fn uniform(name_hash: u64, index: usize) -> f64 {
    let mut z = name_hash.wrapping_add(index as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    let hash = z ^ (z >> 31);
    (hash >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
}

pub fn fnv1a64(name: &str) -> u64 {
    name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Element `index` of the tensor called `name`.
pub fn formula_element(name: &str, shape: &[usize], index: usize) -> f32 {
    let leaf = name.rsplit('.').next().unwrap();
    let fan_in: usize = shape.iter().skip(1).product();
    let (offset, scale) = match leaf {
        "positional_encoding_gaussian_matrix" => (0.0, 3f64.sqrt()),
        "gamma" => (1.0, 0.1),
        _ if name == "sam_mask_decoder.pred_obj_score_head.layers.2.bias" => (3.0, 0.05),
        "weight" if shape.len() >= 2 => (0.0, (3.0 / fan_in as f64).sqrt()),
        "weight" | "running_var" => (1.0, 0.1),
        "bias" | "running_mean" => (0.0, 0.05),
        "latents" | "latents_2d" => (0.0, 1.0),
        _ => (0.0, 0.02),
    };
    (offset + scale * uniform(fnv1a64(name), index)) as f32
}

impl Weights for FormulaWeights {
    fn names(&self) -> Vec<String> {
        self.shapes.keys().cloned().collect()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.shapes.get(name).cloned()
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        if self.shape(name).as_deref() != Some(shape) {
            return Err(refusal(name));
        }
        let count: usize = shape.iter().product();
        let factor: f32 =
            self.factors.iter().filter(|(part, _)| name.contains(part)).map(|(_, factor)| factor).product();
        Ok((0..count).map(|index| formula_element(name, shape, index) * factor).collect())
    }
}

fn refusal(name: &str) -> Sam2Error {
    Sam2Error::UnreadableTensor { name: name.to_owned(), reason: "not there, or of another shape".to_owned() }
}

/// Side of the formula's video.
pub const VIDEO_SIDE: usize = 128;

/// Frame t of the formula's video, normalised, `[3, VIDEO_SIDE, VIDEO_SIDE]`.
pub fn formula_video_frame(t: usize) -> Vec<f32> {
    let (coarse, fine) = (fnv1a64("input.coarse"), fnv1a64(&format!("input.fine.{t}")));
    let cells = VIDEO_SIDE / 16;
    let mut values = Vec::with_capacity(3 * VIDEO_SIDE * VIDEO_SIDE);
    for channel in 0..3 {
        for y in 0..VIDEO_SIDE {
            for x in 0..VIDEO_SIDE {
                let (row, column) = ((y + 2 * t) / 16 % cells, (x + 4 * t) / 16 % cells);
                let cell = uniform(coarse, (channel * cells + row) * cells + column);
                let noise = uniform(fine, (channel * VIDEO_SIDE + y) * VIDEO_SIDE + x);
                values.push((1.5 * cell + 0.5 * noise) as f32);
            }
        }
    }
    values
}

/// The formula's input frame t, `[3, 1024, 1024]`.
pub fn formula_frame(t: usize) -> Vec<f32> {
    let (coarse, fine) = (fnv1a64("input.coarse"), fnv1a64(&format!("input.fine.{t}")));
    let mut values = Vec::with_capacity(3 << 20);
    for channel in 0..3 {
        for y in 0..1024 {
            for x in 0..1024 {
                let (yc, xc) = ((y + 8 * t) / 32 % 32, (x + 16 * t) / 32 % 32);
                let coarse = uniform(coarse, channel * 1024 + yc * 32 + xc);
                let fine = uniform(fine, channel * 1_048_576 + y * 1024 + x);
                values.push((1.5 * coarse + 0.5 * fine) as f32);
            }
        }
    }
    values
}

/// Tensors in memory: a map from names to shapes and elements.
#[derive(Clone)]
pub struct MemoryWeights(pub BTreeMap<String, (Vec<usize>, Vec<f32>)>);

impl Weights for MemoryWeights {
    fn names(&self) -> Vec<String> {
        self.0.keys().cloned().collect()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.0.get(name).map(|(shape, _)| shape.clone())
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        let (_, values) = self.0.get(name).filter(|(found, _)| found == shape).ok_or_else(|| refusal(name))?;
        Ok(values.clone())
    }
}

/// The miniature network's weights.
pub fn mini_weights(folder: &Path) -> MemoryWeights {
    let checkpoint = Checkpoint::open(&folder.join("sam2_mini.pt")).unwrap();
    let entry = |name: String| {
        let shape = checkpoint.shape(&name).unwrap();
        let values = checkpoint.read(&name, &shape).unwrap();
        (name, (shape, values))
    };
    MemoryWeights(checkpoint.names().into_iter().map(entry).collect())
}

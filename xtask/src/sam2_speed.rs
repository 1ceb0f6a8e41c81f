//! Times of SAM 2.1, EdgeTAM and EfficientTAM with random weights, whose values do not affect the speed. `tools/compare_sam2.py` compares them
//! with the official code.

use crate::device::{moved, parse_device};
use crate::peak_memory::peak_memory_mib;
use anyhow::{Context, ensure};
use burn::tensor::{Device, Tensor, TensorData};
use splatseg_geometry::{Mask, Prompt};
use splatseg_models::device::DeviceName;
use splatseg_models::sam2::{FeatureMaps, Sam2Error, Sam2Network, Sam2Predictor, Sam2PredictorSettings, Weights};
use splatseg_models::transfer::Transfers;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Time SAM 2.1, EdgeTAM or EfficientTAM with random weights; prints one line of JSON
///
/// Times the image encoder and every frame tracked after the first, in seconds. RAYON_NUM_THREADS sets the number of
/// threads.
#[derive(clap::Args)]
pub struct Arguments {
    /// Names and shapes of the weights: crates/models/tests/data/{sam2,edgetam,efficienttam}/manifest_SIZE.json
    manifest: PathBuf,
    /// Width and height of the network's input
    #[arg(long, default_value_t = 1024)]
    image_size: usize,
    /// Objects to track
    #[arg(long, default_value_t = 1)]
    objects: usize,
    /// Frames, the first with prompts; the memory is full after 7
    #[arg(long, default_value_t = 9)]
    frames: usize,
    /// The device: cpu, gpu, cuda, vulkan or metal
    #[arg(long, default_value = "cpu", value_parser = parse_device)]
    device: DeviceName,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let side = arguments.image_size;
    ensure!(arguments.frames > 0, "--frames is 0, expected 1 or more");
    let weights = RandomWeights::from_manifest(&arguments.manifest)?;
    let device = arguments.device.open()?;
    let network = Sam2Network::load(&weights, Some(side), &device)?;
    let mut encoder = Vec::new();
    for frame in 0..3 {
        let input = noise(frame, side, &device);
        let started = Instant::now();
        wait_for(network.encode(input))?;
        encoder.push(started.elapsed().as_secs_f64());
    }
    let mut tracked = Vec::new();
    let (mut bank_mib, mut moved_per_frame) = (0.0, serde_json::Value::Null);
    if arguments.objects > 0 {
        let mut predictor = Sam2Predictor::new(network, Sam2PredictorSettings::default())?;
        predictor.track_input(noise(0, side, &device), (side, side))?;
        predictor.prompt_all(&prompts(arguments.objects, side))?;
        let before = Transfers::so_far();
        for frame in 1..arguments.frames {
            let input = noise(frame, side, &device);
            let started = Instant::now();
            predictor.track_input(input, (side, side))?;
            tracked.push(started.elapsed().as_secs_f64());
        }
        moved_per_frame = moved(before, arguments.frames - 1);
        bank_mib = predictor.state().memory_bytes() as f64 / f64::from(1 << 20);
    }
    println!(
        "{}",
        serde_json::json!({ "image_size": side, "objects": arguments.objects, "encoder_s": encoder,
            "tracked_frame_s": tracked, "peak_memory_mib": peak_memory_mib(), "memory_bank_mib": bank_mib,
            "device": arguments.device.name(), "moved_per_frame": moved_per_frame })
    );
    Ok(())
}

/// Waits for a computation, which may be lazy, by reading its result.
fn wait_for(maps: FeatureMaps) -> anyhow::Result<()> {
    maps.embedding.into_data().try_into_vec::<f32>().map(drop).context("the image encoder's result")
}

/// A mask for each object, side by side in the upper half.
fn prompts(objects: usize, side: usize) -> Vec<(u64, Prompt)> {
    let prompt = |object: usize| {
        let left = object * side / (2 * objects);
        let mask = Mask::from_fn(side, side, |x, y| (left..left + side / 4).contains(&x) && y < side / 2);
        (object as u64, Prompt::Mask(mask))
    };
    (0..objects).map(prompt).collect()
}

/// A normalised frame of noise, `[1, 3, side, side]`. Its upload is not counted in `moved_per_frame`.
fn noise(frame: usize, side: usize, device: &Device) -> Tensor<4> {
    let values = (0..3 * side * side).map(|index| ((index * 7919 + frame * 104_729) % 1000) as f32 / 250.0 - 2.0);
    Tensor::from_data(TensorData::new(values.collect::<Vec<f32>>(), [1, 3, side, side]), device)
}

/// Random weights with the names and shapes of a manifest, scaled to keep activations near 1.
struct RandomWeights(BTreeMap<String, Vec<usize>>);

impl RandomWeights {
    fn from_manifest(path: &Path) -> anyhow::Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        let manifest: serde_json::Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        let tensors: Vec<(String, Vec<usize>)> =
            serde_json::from_value(manifest["tensors"].clone()).with_context(|| path.display().to_string())?;
        Ok(Self(tensors.into_iter().collect()))
    }
}

impl Weights for RandomWeights {
    fn names(&self) -> Vec<String> {
        self.0.keys().cloned().collect()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.0.get(name).cloned()
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        if self.0.get(name).map(Vec::as_slice) != Some(shape) {
            let reason = format!("expected shape {shape:?}, found {:?}", self.0.get(name));
            return Err(Sam2Error::UnreadableTensor { name: name.to_owned(), reason });
        }
        let fan_in: usize = shape.iter().skip(1).product();
        let (mean, spread) = match (name.rsplit('.').next(), shape.len()) {
            (Some("weight" | "gamma" | "running_var"), 1) => (1.0, 0.1),
            (Some("weight"), _) => (0.0, (3.0 / fan_in as f32).sqrt()),
            _ => (0.0, 0.02),
        };
        // A linear congruential generator is cheap, and good enough because the values do not matter.
        let mut state = name.len() as u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        Ok((0..shape.iter().product::<usize>()).map(|_| mean + spread * uniform()).collect())
    }
}

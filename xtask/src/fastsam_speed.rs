//! Times of FastSAM's network. `tools/compare_onnxruntime.py` compares them with ONNX Runtime, `tools/measure_gpu.sh`
//! with PyTorch.

use crate::device::{moved, parse_device};
use crate::peak_memory::peak_memory_mib;
use anyhow::ensure;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::device::DeviceName;
use splatseg_models::fastsam::{FastSamConfig, FastSamNetwork};
use splatseg_models::transfer::Transfers;
use std::path::PathBuf;
use std::time::Instant;

/// Time FastSAM's network on an image of noise; prints one line of JSON
///
/// RAYON_NUM_THREADS sets the number of threads.
#[derive(clap::Args)]
pub struct Arguments {
    /// A FastSAM checkpoint
    checkpoint: PathBuf,
    /// Width and height of the image, a multiple of 32
    size: usize,
    /// Timed passes, after one to warm up
    passes: usize,
    /// The device: cpu, gpu, cuda, vulkan or metal
    #[arg(long, default_value = "cpu", value_parser = parse_device)]
    device: DeviceName,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (size, passes) = (arguments.size, arguments.passes);
    ensure!(size > 0 && size.is_multiple_of(32), "SIZE is {size}, expected a multiple of 32");
    let start = Instant::now();
    let network = {
        let checkpoint = Checkpoint::open(&arguments.checkpoint)?;
        let architecture = FastSamConfig::from_checkpoint(&checkpoint)?;
        FastSamNetwork::load(&checkpoint, architecture, &arguments.device.open()?)?
    };
    let load = milliseconds(start);
    let image: Vec<f32> = (0..3 * size * size).map(|index| (index * 7919 % 256) as f32 / 255.0).collect();
    let mut times = Vec::with_capacity(passes);
    let before = Transfers::so_far();
    for pass in 0..=passes {
        let start = Instant::now();
        network.forward(image.clone(), size, size)?;
        if pass > 0 {
            times.push(milliseconds(start));
        }
    }
    let moved = moved(before, passes + 1);
    let line = serde_json::json!({ "device": arguments.device.name(), "milliseconds": times,
        "peak_mib": peak_memory_mib(), "load_milliseconds": load, "moved_per_pass": moved });
    println!("{line}");
    Ok(())
}

fn milliseconds(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

//! Times of FastSAM's network on the CPU and the process's peak memory, as one line of JSON; `tools/compare_onnxruntime.py`
//! sets it beside ONNX Runtime.
//!
//! `fastsam_speed CHECKPOINT SIZE PASSES`: loads the checkpoint, runs the network on a `SIZE`×`SIZE` image of noise once
//! to warm up and then `PASSES` times. `RAYON_NUM_THREADS` sets the number of threads.

use burn::tensor::Device;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::fastsam::{FastSamConfig, FastSamNetwork};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, size, passes] = arguments.as_slice() else {
        return Err("usage: fastsam_speed CHECKPOINT SIZE PASSES".into());
    };
    let (size, passes): (usize, usize) = (size.parse()?, passes.parse()?);
    if size == 0 || !size.is_multiple_of(32) {
        return Err("SIZE must be a multiple of 32".into());
    }
    let start = Instant::now();
    let network = {
        let checkpoint = Checkpoint::open(Path::new(path))?;
        let architecture = FastSamConfig::from_checkpoint(&checkpoint)?;
        FastSamNetwork::load(&checkpoint, architecture, &Device::default())?
    };
    let load = milliseconds(start);
    let image: Vec<f32> = (0..3 * size * size).map(|index| (index * 7919 % 256) as f32 / 255.0).collect();
    let mut times = Vec::with_capacity(passes);
    for pass in 0..=passes {
        let start = Instant::now();
        network.forward(image.clone(), size, size)?;
        if pass > 0 {
            times.push(milliseconds(start));
        }
    }
    let line = serde_json::json!({ "milliseconds": times, "peak_mib": peak_memory(), "load_milliseconds": load });
    println!("{line}");
    Ok(())
}

fn milliseconds(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

/// Most memory that the process has used, in MiB; `None` where the system does not tell (only Linux does).
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim_end_matches("kB").trim().parse::<f64>().ok()? / 1024.0)
}

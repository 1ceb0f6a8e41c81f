//! Times SAM 2.1 with weights given by a formula (speed does not depend on their values).
//!
//! `sam2_speed MANIFEST_FOLDER SIZE IMAGE_SIZE OBJECTS [FRAMES]` prints one line of JSON: seconds of the image encoder,
//! and of tracked frames with that many objects once all six recent memories are there.

#[path = "../tests/sam2_golden/mod.rs"]
mod sam2_golden;

use burn::tensor::{Device, Tensor, TensorData};
use sam2_golden::FormulaWeights;
use splatseg_geometry::Mask;
use splatseg_models::sam2::{Prompt, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use std::time::Instant;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, otherwise: usize| {
        arguments.get(index).map_or(otherwise, |text| text.parse().expect("a whole number"))
    };
    let (folder, size) = (&arguments[0], &arguments[1]);
    let (side, objects, frames) = (number(2, 1024), number(3, 1), number(4, 9));
    let weights = FormulaWeights::of_manifest(std::path::Path::new(folder), size);
    let network = Sam2Network::load(&weights, Some(side), &Device::flex()).expect("the manifest's tensors");
    let input = |frame: usize| {
        let values = (0..3 * side * side).map(|index| ((index * 7919 + frame * 104_729) % 1000) as f32 / 250.0 - 2.0);
        Tensor::<4>::from_data(TensorData::new(values.collect::<Vec<f32>>(), [1, 3, side, side]), &Device::flex())
    };
    let mut encoder = Vec::new();
    for frame in 0..3 {
        let input = input(frame);
        let started = Instant::now();
        let maps = network.encode(input);
        assert!(maps.embedding.into_data().try_into_vec::<f32>().is_ok());
        encoder.push(started.elapsed().as_secs_f64());
    }
    let mut tracked = Vec::new();
    let mut state_mb = 0.0;
    if objects > 0 {
        let mut predictor = Sam2Predictor::new(network, Sam2PredictorSettings::default()).expect("default settings");
        predictor.track_input(input(0), (side, side)).expect("the first frame");
        let prompts: Vec<(u64, Prompt)> = (0..objects)
            .map(|object| {
                let left = object * side / (2 * objects);
                let mask = Mask::from_fn(side, side, |x, y| (left..left + side / 4).contains(&x) && y < side / 2);
                (object as u64, Prompt::Mask(mask))
            })
            .collect();
        predictor.prompt_all(&prompts).expect("masks");
        for frame in 1..frames {
            let input = input(frame);
            let started = Instant::now();
            predictor.track_input(input, (side, side)).expect("frames of one size");
            tracked.push(started.elapsed().as_secs_f64());
        }
        state_mb = predictor.state().memory_bytes() as f64 / (1 << 20) as f64;
    }
    println!(
        "{}",
        serde_json::json!({ "size": size, "image_size": side, "objects": objects, "encoder_s": encoder,
            "tracked_frame_s": tracked, "peak_memory_mb": peak_memory_mb(), "memory_bank_mb": state_mb })
    );
}

/// Peak resident memory of this process; 0 where the system does not tell.
fn peak_memory_mb() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<usize>().ok()).unwrap_or(0) / 1024
}

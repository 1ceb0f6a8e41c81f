//! Clicks an object and follows it through a stream with SAM 2.1 alone:
//!
//!     cargo run --release --example follow_click -- sam2.1_hiera_tiny.pt SCENE X Y OUT
//!
//! X and Y are a pixel in the scene's first frame. OUT is a new folder for one overlay per frame.

use splatseg::dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg::geometry::{Prompt, SegmentMap};
use splatseg::models::checkpoint::Checkpoint;
use splatseg::models::device::DeviceName;
use splatseg::models::sam2::{Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use splatseg::output::write_overlay_jpeg;
use std::path::Path;

fn main() {
    if let Err(error) = follow() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn follow() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [weights, scene, x, y, out] = arguments.as_slice() else {
        return Err("usage: follow_click SAM2_CHECKPOINT SCENE X Y OUT".into());
    };
    let out = Path::new(out);
    std::fs::create_dir(out)?;
    // 512 x 512 is a quarter of the published number of pixels, and fast enough to watch on a CPU.
    let network = Sam2Network::load(&Checkpoint::open(Path::new(weights))?, Some(512), &DeviceName::Cpu.open()?)?;
    let mut predictor = Sam2Predictor::new(network, Sam2PredictorSettings::default())?;

    let settings = DatasetSettings::default();
    let frames = FrameStream::open(open_scene(scene, &settings)?, &settings, GroundTruth::Skip)?;
    for (index, frame) in frames.enumerate() {
        let frame = frame?.frame;
        let mut masks = predictor.track(frame.color())?;
        if index == 0 {
            masks = vec![predictor.prompt(1, &Prompt::click(x.parse()?, y.parse()?))?];
        }
        // A second click, on any later frame, would correct the object: `predictor.prompt(1, …)` again.
        let mut segments = SegmentMap::filled(frame.width(), frame.height(), 0);
        for pixel in masks[0].mask().pixel_indices() {
            segments.pixels_mut()[pixel] = 1;
        }
        println!("{}: {} pixels, score {:.1}", frame.name(), masks[0].mask().area(), masks[0].object_score);
        write_overlay_jpeg(&out.join(format!("{}.jpg", frame.name())), frame.color(), &segments)?;
    }
    Ok(())
}

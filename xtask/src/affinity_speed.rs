//! Times of the affinity segmenter and of its network alone. `tools/compare_onnxruntime.py` compares the network with
//! ONNX Runtime.

use crate::peak_memory::peak_memory_mib;
use anyhow::Context;
use splatseg_dataset::{FrameStream, GroundTruth, open_scene};
use splatseg_segmenter::{AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeights, Segmenter};
use std::path::PathBuf;
use std::time::Instant;

/// Time the affinity segmenter's network on the frames of a scene; prints one line of JSON
///
/// RAYON_NUM_THREADS sets the number of threads.
#[derive(clap::Args)]
pub struct Arguments {
    /// Timed passes over the scene's frames, after one to warm up
    passes: usize,
    /// A scene
    #[arg(long, default_value = "synthetic:frames=1,width=320,height=240,noise=kinect")]
    scene: PathBuf,
}

pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let dataset = Default::default();
    let scene = open_scene(&arguments.scene, &dataset)?;
    let frames = FrameStream::open(scene, &dataset, GroundTruth::Skip)?.collect::<Result<Vec<_>, _>>()?;
    let start = Instant::now();
    let mut segmenter =
        AffinitySegmenter::new(AffinityNetwork::load(&AffinityWeights::BuiltIn)?, AffinitySettings::default())?;
    let load = milliseconds(start);
    let first = &frames.first().context("the scene has no frame")?.frame;
    let size = (first.width(), first.height());
    let (mut network, mut all) = (Vec::new(), Vec::new());
    for pass in 0..=arguments.passes {
        for frame in &frames {
            // On a pool thread, as in the pipeline.
            let times = rayon::scope(|_| -> anyhow::Result<[f64; 3]> {
                let frame = &frame.frame;
                let mut times = [0.0; 3];
                let start = Instant::now();
                segmenter.inputs(frame);
                times[0] = milliseconds(start);
                let start = Instant::now();
                segmenter.log_odds(frame)?;
                times[1] = milliseconds(start);
                let start = Instant::now();
                segmenter.segment(frame)?;
                times[2] = milliseconds(start);
                Ok(times)
            })?;
            if pass > 0 {
                network.push((times[1] - times[0]).max(0.0));
                all.push(times[2]);
            }
        }
    }
    let line = serde_json::json!({ "size": [size.0, size.1], "milliseconds": network, "segmenter_milliseconds": all,
        "peak_mib": peak_memory_mib(), "load_milliseconds": load });
    println!("{line}");
    Ok(())
}

fn milliseconds(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

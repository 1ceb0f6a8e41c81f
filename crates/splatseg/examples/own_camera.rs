//! Lasting ids for frames from your own camera: `cargo run --release --example own_camera`.
//!
//! The synthetic room stands in for the camera; a robot makes each `RgbdFrame` from its driver's images and its pose.

use splatseg::dataset::{Scene, SyntheticScene, SyntheticSettings};
use splatseg::{FastSamSplat, FastSamSplatSettings, GraphSegmenter, GraphSettings, Method, RgbdFrame};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let segmenter = GraphSegmenter::new(GraphSettings::default())?;
    let mut method = FastSamSplat::new(Box::new(segmenter), FastSamSplatSettings::default(), &mut |_| {})?;
    let camera = SyntheticScene::new(SyntheticSettings { frames: 12, ..SyntheticSettings::default() })?;
    for index in 0..camera.frame_count() {
        let output = method.process(&next_frame(&camera, index)?)?;
        let largest = output.segments.areas().into_iter().max_by_key(|(_, pixels)| *pixels);
        println!("frame {index}: {} segments, largest {largest:?}", output.segments.areas().len());
    }
    Ok(())
}

/// One frame, put together as a driver would: registered colour and depth in metres, intrinsics, camera-to-world pose.
fn next_frame(camera: &SyntheticScene, index: usize) -> Result<RgbdFrame<'static>, Box<dyn std::error::Error>> {
    let frame = camera.read_frame(index)?;
    let (color, depth) = (frame.color().clone(), frame.depth().clone());
    Ok(RgbdFrame::new(format!("{index}"), color, depth, *frame.intrinsics(), *frame.world_from_camera())?)
}

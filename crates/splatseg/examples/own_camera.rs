//! Lasting ids for frames from your own camera: `cargo run --release --example own_camera`.
//!
//! The synthetic room stands in for the camera. A robot creates each `RgbdFrame` from its driver's images and its pose.

use splatseg::dataset::{Scene, SyntheticScene, SyntheticSettings};
use splatseg::{Pipeline, RgbdFrame, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut pipeline = Pipeline::builder(&Settings::default()).build()?;
    let camera = SyntheticScene::new(SyntheticSettings { frames: 12, ..SyntheticSettings::default() })?;
    for index in 0..camera.frame_count() {
        let result = pipeline.step(&next_frame(&camera, index)?)?;
        let largest = result.objects.iter().max_by_key(|object| object.area);
        println!("frame {index}: {} objects, the largest: {largest:?}", result.objects.len());
    }
    Ok(())
}

/// Creates a frame as a driver would: registered colour and depth in metres, intrinsics, camera-to-world pose.
fn next_frame(camera: &SyntheticScene, index: usize) -> Result<RgbdFrame<'static>, Box<dyn std::error::Error>> {
    let frame = camera.read_frame(index)?;
    let (color, depth) = (frame.color().clone(), frame.depth().clone());
    Ok(RgbdFrame::new(format!("{index}"), color, depth, *frame.intrinsics(), *frame.world_from_camera())?)
}

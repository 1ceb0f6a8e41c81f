//! Measures the time to open longer and longer recordings, with `/tf` at ten times the rate of images.
//!
//! ```sh
//! cargo run --release -p splatseg-dataset --example long_recording -- 2000 20000 100000
//! ```
//!
//! The arguments are numbers of frames, or recordings. The time per frame must not grow.

#[path = "../tests/it/support/mod.rs"]
mod support;

use glam::{DQuat, DVec3};
use splatseg_dataset::{DatasetSettings, RecordingScene, Scene};
use splatseg_geometry::Intrinsics;
use std::error::Error;
use std::time::Instant;
use support::mcap::{FRAME_NS, McapWriter, OPTICAL, START, info, raw, transform};

const SIZE: (usize, usize) = (4, 3);
const TRANSFORMS_PER_FRAME: i64 = 10;

fn recording(frames: i64) -> Vec<u8> {
    let camera = Intrinsics { fx: 4.0, fy: 4.0, cx: 1.5, cy: 1.0, width: SIZE.0, height: SIZE.1 };
    let mut writer = McapWriter::new();
    for index in 0..frames {
        let stamp = START + index * FRAME_NS;
        for step in 0..TRANSFORMS_PER_FRAME {
            let at = stamp + step * FRAME_NS / TRANSFORMS_PER_FRAME;
            let shift = DVec3::X * ((at - START) as f64 * 1e-9).sin();
            writer.write("/tf", &transform(at, "world", "base", shift, DQuat::IDENTITY), at);
            // Some drivers broadcast static transforms in /tf.
            writer.write("/tf", &transform(at, "base", OPTICAL, DVec3::Z, DQuat::IDENTITY), at);
        }
        writer.write("/camera/camera_info", &info(stamp, OPTICAL, &camera), stamp);
        writer.write("/camera/image_raw", &raw(stamp, OPTICAL, "rgb8", SIZE, &[9; 36]), stamp);
        writer.write("/camera/depth", &raw(stamp, OPTICAL, "16UC1", SIZE, &[1; 24]), stamp);
    }
    writer.finish()
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    println!("frames  seconds to open  microseconds per frame");
    for argument in std::env::args().skip(1) {
        let path = if let Ok(count) = argument.parse() {
            let path = folder.path().join("long.mcap");
            std::fs::write(&path, recording(count))?;
            path
        } else {
            argument.into()
        };
        let started = Instant::now();
        let scene = RecordingScene::open(&path, &DatasetSettings::default())?;
        let (frames, seconds) = (scene.frame_count(), started.elapsed().as_secs_f64());
        println!("{frames:6}  {seconds:15.2}  {:22.1}", 1e6 * seconds / frames.max(1) as f64);
    }
    Ok(())
}

//! A stream with 12 new objects in each frame. Prints time per frame, memory and largest id.
//!
//! ```sh
//! cargo run --release -p splatseg-memory --example endless_stream -- 36000
//! ```
//!
//! The argument is the number of frames. The camera looks at a wall; each frame predicts 12 new masks there, like a
//! segmenter that never finds the same object twice. No printed number may grow once all ids that fit a 16-bit image
//! have been given out (5,462 frames).

use splatseg_geometry::{Pose, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_test_scenes::{camera, wall};
use std::collections::BTreeSet;
use std::error::Error;
use std::time::Instant;

const SIZE: (usize, usize) = (80, 60);
const MASKS: usize = 12;
const LINES: usize = 12;

fn main() -> Result<(), Box<dyn Error>> {
    let frames: usize = std::env::args().nth(1).map_or(Ok(36_000), |text| text.parse())?;
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {})?;
    let (width, height) = SIZE;
    let frame = wall("wall", camera(width, height, 70.0), 2.0, Pose::IDENTITY);
    println!("frames  ms per frame  resident MB  Gaussians  largest id  saved bytes");
    let folder = std::env::temp_dir().join(format!("endless-stream-{}.ply", std::process::id()));
    let (mut started, mut largest) = (Instant::now(), 0);
    let step = frames.div_ceil(LINES).max(1);
    for number in 1..=frames {
        let ids: Vec<u32> = (0..MASKS).map(|_| memory.new_segment()).collect::<Result<_, _>>()?;
        largest = largest.max(ids.iter().copied().max().unwrap_or(0));
        let place = |column: usize, row: usize| ids[(column + number) / 20 % 4 + 4 * (row / 20)];
        let predicted = SegmentMap::from_fn(width, height, place);
        let recall = memory.recall(&frame);
        memory.fuse(&recall, &predicted)?;
        memory.update(recall, &predicted, &BTreeSet::new())?;
        if number.is_multiple_of(step) {
            let ms = started.elapsed().as_secs_f64() * 1e3 / step as f64;
            memory.save(&folder)?;
            let (resident, saved) = (resident_mb().unwrap_or(f64::NAN), std::fs::metadata(&folder)?.len());
            println!("{number:6}  {ms:12.3}  {resident:11.1}  {:9}  {largest:10}  {saved}", memory.gaussian_count());
            started = Instant::now();
        }
    }
    Ok(std::fs::remove_file(&folder)?)
}

/// Resident memory of this process, megabytes; Linux only.
fn resident_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

//! Measures how long a video waits for the codebook of a memory of features: at the start, and when codes run out.
//!
//! `SPLATSEG_CACHE= cargo run --release --example codebook_stalls` measures without the cache on disk.

use splatseg_memory::{Codebook, CodebookSettings, MemoryKind, MemorySettings, SplatMemory};
use std::time::{Duration, Instant};

/// Number of ids that the video needs.
const IDS: usize = 1_100;
/// Time between two new ids.
const FRAME: Duration = Duration::from_millis(10);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let start = Instant::now();
    let mut codebook = Codebook::generate(&CodebookSettings::default(), &mut |_| {})?;
    println!("512 codes made now     {:.3} s", start.elapsed().as_secs_f64());
    let start = Instant::now();
    codebook.extend(512, &mut |_| {})?;
    println!("512 more made now      {:.3} s", start.elapsed().as_secs_f64());

    let settings = MemorySettings::default().with(|settings| settings.kind = MemoryKind::Features);
    for run in ["first", "second"] {
        let start = Instant::now();
        let mut memory = SplatMemory::new(settings.clone(), 0, &mut |_| {})?;
        println!("{run} start            {:.3} s", start.elapsed().as_secs_f64());
        let mut longest = Duration::ZERO;
        for _ in 0..IDS {
            let start = Instant::now();
            memory.new_segment()?;
            longest = longest.max(start.elapsed());
            std::thread::sleep(FRAME);
        }
        println!("{run} longest new id   {:.3} s", longest.as_secs_f64());
    }
    Ok(())
}

//! Runs SAM2-Splat on ten thousand objects, two per frame, and prints time per frame and number of tracks, which must
//! not grow.
//!
//! ```sh
//! cargo run --release -p splatseg-tracking --example ten_thousand_things
//! ```

#[path = "../tests/it/endless_wall/mod.rs"]
mod endless_wall;

use endless_wall::{THINGS_PER_FRAME, show};
use std::time::Instant;

const FRAMES: usize = 5000;
const LINES: usize = 10;

fn main() {
    let (mut started, step) = (Instant::now(), FRAMES / LINES);
    println!("things  ms per frame  tracks");
    show(FRAMES, |number, followed| {
        let frames = number + 1;
        if frames.is_multiple_of(step) {
            let milliseconds = started.elapsed().as_secs_f64() * 1000.0 / step as f64;
            println!("{:6}  {milliseconds:12.2}  {:6}", THINGS_PER_FRAME * frames, followed.things.len());
            started = Instant::now();
        }
    });
}

//! Time of Depth Anything per image: `cargo run --release -p splatseg-models --no-default-features --example
//! depth_anything_time -- FILE [SHORT_SIDE] [N]`. The weights do not matter for it, so a file of random ones will do
//! (`tools/time_depth_pytorch.py` writes one).

use splatseg_geometry::Image;
use splatseg_models::depth_anything::DepthAnythingNetwork;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: depth_anything_time FILE [SHORT_SIDE] [REPETITIONS]")?;
    let short_side: usize = arguments.next().map_or(Ok(252), |side| side.parse())?;
    let repetitions: usize = arguments.next().map_or(Ok(7), |count| count.parse())?;
    let started = Instant::now();
    let network = DepthAnythingNetwork::open(Path::new(&path), None)?;
    println!("loaded in {:.2} s", started.elapsed().as_secs_f64());
    let (width, height) = network.input_size((640, 480), short_side);
    let image = Image::from_fn(width, height, |column, row| [column as u8, row as u8, (column * row) as u8]);
    let mut times = Vec::new();
    for _ in 0..=repetitions {
        let started = Instant::now();
        network.predict(&image, short_side)?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
    }
    times.remove(0);
    times.sort_by(f64::total_cmp);
    println!("{width} x {height}: {:.1} ms", times[times.len() / 2]);
    Ok(())
}

//! Time of a CLIP network per image and per text: `cargo run --release -p splatseg-models --example clip_time -- FILE [N]`.
//! The weights do not matter for it, so a file of random ones will do (`tools/time_clip_pytorch.py` writes some).

use splatseg_geometry::Image;
use splatseg_models::clip::ClipNetwork;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: clip_time FILE.safetensors [REPETITIONS]")?;
    let repetitions: usize = arguments.next().map_or(Ok(5), |count| count.parse())?;
    let started = Instant::now();
    let network = ClipNetwork::open(Path::new(&path))?;
    println!("loaded in {:.2} s", started.elapsed().as_secs_f64());
    let side = network.config().image_size;
    let image = Image::from_fn(side, side, |column, row| [column as u8, row as u8, (column * row) as u8]);
    let median = |mut run: Box<dyn FnMut() -> Result<(), Box<dyn Error>> + '_>| -> Result<f64, Box<dyn Error>> {
        run()?;
        let mut times = Vec::new();
        for _ in 0..repetitions {
            let started = Instant::now();
            run()?;
            times.push(started.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        Ok(times[times.len() / 2])
    };
    let image_ms = median(Box::new(|| Ok(network.embed_images(&[image.as_borrowed()]).map(|_| ())?)))?;
    println!("image: {image_ms:.1} ms");
    let texts: Vec<String> = (0..32).map(|index| format!("a photo of a thing number {index}")).collect();
    let text_ms = median(Box::new(|| Ok(network.embed_texts(&texts).map(|_| ())?)))?;
    println!("text: {:.2} ms each, of {}", text_ms / texts.len() as f64, texts.len());
    Ok(())
}

//! Cost of naming objects beside the frames of a stream: a scene is played at a steady rate, forwards and backwards, with a
//! network that names objects and without one, in turn. Frames that are due while one is processed are left out, as with a
//! camera. The weights do not matter for the time, so a file of random ones will do (`tools/time_clip_pytorch.py`).
//!
//! `cargo run --release -p splatseg --no-default-features --example names_beside -- SCENE NAMES.safetensors [RUNS [SECONDS [RATE]]]`

use splatseg::dataset::open_scene;
use splatseg::settings::SettingsLayers;
use splatseg::{Pipeline, RgbdFrame};
use std::error::Error;
use std::time::{Duration, Instant};

/// Measurements of a run.
struct Played {
    /// Time of each frame, milliseconds, in ascending order.
    times: Vec<f64>,
    /// Frames left out.
    missed: usize,
    /// Objects that had been looked at when the stream ended, and objects of the map.
    named: usize,
    objects: usize,
}

impl Played {
    fn quantile(&self, share: f64) -> f64 {
        let last = self.times.len().saturating_sub(1);
        self.times.get((share * last as f64).round() as usize).copied().unwrap_or_default()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let usage = "usage: names_beside SCENE NAMES.safetensors [RUNS [SECONDS [RATE]]]";
    let (scene, names) = (arguments.next().ok_or(usage)?, arguments.next().ok_or(usage)?);
    let runs: usize = arguments.next().map_or(Ok(3), |count| count.parse())?;
    let seconds: f64 = arguments.next().map_or(Ok(30.0), |count| count.parse())?;
    let rate: f64 = arguments.next().map_or(Ok(30.0), |count| count.parse())?;
    let without = SettingsLayers::default();
    let mut with = SettingsLayers::default();
    with.add_assignment("namer=clip")?;
    with.add_assignment(&format!("names={names}"))?;
    let scene = open_scene(&scene, &without.resolve()?.dataset)?;
    let frames = (0..scene.frame_count()).map(|index| scene.read_frame(index)).collect::<Result<Vec<_>, _>>()?;
    let mut medians = [Vec::new(), Vec::new()];
    for run in 0..2 * runs {
        let layers = [&without, &with][run % 2];
        let played = play(Pipeline::builder(&layers.resolve()?).build()?, &frames, seconds, rate)?;
        println!(
            "{}: {} frames, {} left out; ms per frame: median {:.2}, mean {:.2}, 95 % {:.2}; {} of {} objects named, {:.2} a second",
            ["without names", "with names"][run % 2],
            played.times.len(),
            played.missed,
            played.quantile(0.5),
            played.times.iter().sum::<f64>() / played.times.len().max(1) as f64,
            played.quantile(0.95),
            played.named,
            played.objects,
            played.named as f64 / seconds,
        );
        medians[run % 2].push(played.quantile(0.5));
    }
    let [without, with] = medians.map(|mut medians| {
        medians.sort_by(f64::total_cmp);
        medians[medians.len() / 2]
    });
    println!(
        "median of the medians: {without:.2} ms without, {with:.2} ms with names: {:+.1} %",
        100.0 * (with / without - 1.0)
    );
    Ok(())
}

/// Plays frames for some seconds.
fn play(
    mut pipeline: Pipeline,
    frames: &[RgbdFrame<'static>],
    seconds: f64,
    rate: f64,
) -> Result<Played, Box<dyn Error>> {
    pipeline.name_beside_frames()?;
    let (started, mut times, mut number, mut due) = (Instant::now(), Vec::new(), 0usize, 0usize);
    while due as f64 / rate < seconds {
        let wait = Duration::from_secs_f64(due as f64 / rate).saturating_sub(started.elapsed());
        std::thread::sleep(wait);
        // There and back again.
        let period = (2 * frames.len()).saturating_sub(2).max(1);
        let place = due % period;
        let frame = &frames[if place < frames.len() { place } else { period - place }];
        let began = Instant::now();
        pipeline.step(frame)?;
        times.push(began.elapsed().as_secs_f64() * 1e3);
        number += 1;
        due = (due + 1).max((started.elapsed().as_secs_f64() * rate).floor() as usize);
    }
    let named = pipeline.names().embeddings().count();
    let objects = pipeline.object_list().objects.len();
    times.sort_by(f64::total_cmp);
    Ok(Played { times, missed: due - number, named, objects })
}

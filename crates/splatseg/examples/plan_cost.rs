//! The cost of the plan of a map in a live session: the time that frames wait for the copy of the map, and that of its thread.
//!
//! `cargo run --release -p splatseg --no-default-features --example plan_cost -- MAP`

use splatseg::Pipeline;
use splatseg::places::PlanSettings;
use splatseg::settings::SettingsLayers;
use std::error::Error;
use std::time::Instant;

const ROUNDS: u32 = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let map = std::env::args().nth(1).ok_or("usage: plan_cost MAP")?;
    let mut layers = SettingsLayers::default();
    layers.add_saved_memory(map.as_ref())?;
    let pipeline = Pipeline::builder(&layers.resolve()?).saved_memory(&map).build()?;
    let gaussians = pipeline.map().map_or(0, |map| map.gaussian_count());
    println!("{} keyframes, {gaussians} Gaussians", pipeline.keyframes().len());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    for _ in 0..ROUNDS {
        let started = Instant::now();
        let input = pipeline.plan_input().ok_or("the map has no keyframes")?;
        let copied = started.elapsed();
        let places = pool.install(|| input.places(PlanSettings::default()))?;
        let made = started.elapsed() - copied;
        let rooms = places.plan.map(|plan| plan.rooms().len());
        println!(
            "copy {:.1} ms, plan {:.0} ms, rooms: {rooms:?}",
            copied.as_secs_f64() * 1e3,
            made.as_secs_f64() * 1e3
        );
    }
    Ok(())
}

//! Measures the errors of objects' boxes in synthetic rooms, for the numbers in docs/OBJECTS.md.
//!
//! `cargo run --release -p splatseg-objects --example box_errors -- 200 229` (the first and the last seed)

#[path = "../tests/it/seen_room/mod.rs"]
mod seen_room;

use seen_room::{BoxErrors, room, seen_room};
use splatseg_geometry::Pose;
use splatseg_objects::object_shapes;

fn main() -> Result<(), String> {
    let seeds: Vec<u64> = std::env::args().skip(1).map_while(|seed| seed.parse().ok()).collect();
    let [first, last] = seeds[..] else { return Err("expected two seeds: box_errors FIRST LAST".to_owned()) };
    let mut errors = Vec::new();
    for seed in first..=last {
        let seen = seen_room(room(seed), Pose::IDENTITY);
        let shapes = object_shapes(&seen.memory.map());
        for thing in seen.boxes() {
            let found = seen.box_errors(thing, &shapes[&thing.id]);
            let BoxErrors { off, iou, aligned_iou } = found;
            let covered = shapes[&thing.id].area_m2 / seen.faces[&thing.id].area(thing.size);
            println!(
                "seed {seed} object {}: off {:.1} mm, IoU {iou:.3}, axis-aligned {aligned_iou:.3}, area {covered:.2}",
                thing.id,
                1e3 * off
            );
            errors.push(found);
        }
    }
    if errors.is_empty() {
        return Err("no box of these rooms was seen from two sides".to_owned());
    }
    let count = errors.len();
    let mut off: Vec<f32> = errors.iter().map(|errors| 1e3 * errors.off).collect();
    off.sort_by(f32::total_cmp);
    let within = off.iter().filter(|off| **off <= 30.0).count();
    let mean = |value: fn(&BoxErrors) -> f32| errors.iter().map(value).sum::<f32>() / count as f32;
    let least = |value: fn(&BoxErrors) -> f32| errors.iter().map(value).fold(1.0, f32::min);
    println!(
        "{within} of {count} middles within 3 cm: median {:.1} mm, largest {:.1} mm",
        off[count / 2],
        off[count - 1]
    );
    println!("IoU: mean {:.3}, least {:.3}", mean(|errors| errors.iou), least(|errors| errors.iou));
    println!(
        "axis-aligned: mean {:.3}, least {:.3}",
        mean(|errors| errors.aligned_iou),
        least(|errors| errors.aligned_iou)
    );
    Ok(())
}

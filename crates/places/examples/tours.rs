//! Plans of tours of four rooms, compared with the exact ones: `cargo run --release -p splatseg-places --example tours -- 20`
//! prints a line for each of 20 seeds, `-- 20 kinect` with the noise of a Kinect,
//! `-- 4 none 16` the seeds from 16.

#[path = "../tests/it/seen_tour/mod.rs"]
mod seen_tour;

use seen_tour::SeenTour;

/// Every such frame of the recording is used.
const STRIDE: usize = 15;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds = arguments.first().and_then(|count| count.parse().ok()).unwrap_or(20_u64);
    let noise = arguments.get(1).map_or("none", String::as_str);
    let first = arguments.get(2).and_then(|first| first.parse().ok()).unwrap_or(0_u64);
    let (mut worst, mut four) = (1.0_f64, 0);
    println!(
        "seed   IoU  free cells: right, missed, wrong; centre inside, wholly inside; unseen | rooms | objects | routes: found, none, touching"
    );
    for seed in first..first + seeds {
        let tour = SeenTour::new(seed, STRIDE, noise);
        let (errors, rooms) = (tour.errors(), tour.rooms_found());
        let (right, all) = tour.objects_in_rooms();
        let (found, none, touching) = tour.routes(0.2);
        println!(
            "{seed:4} {:.3}  {}, {}, {}; {}, {}; {} | {rooms} of 4, {} found | {right} of {all} | {found}, {none}, {touching}",
            errors.iou(),
            errors.both,
            errors.missed,
            errors.wrong,
            errors.inside,
            tour.wholly_inside(),
            errors.unseen,
            tour.plan.rooms().len(),
        );
        worst = worst.min(errors.iou());
        four += usize::from(rooms == 4 && tour.plan.rooms().len() == 4);
    }
    println!("lowest IoU {worst:.3}; four rooms found in {four} of {seeds}");
}

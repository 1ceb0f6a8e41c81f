//! The plan of a saved map of a synthetic scene, compared with the exact one:
//! `cargo run --release -p splatseg --no-default-features --example plan_truth -- 'synthetic:frames=320,tour=4' map.ply`.

use splatseg::dataset::SyntheticScene;
use splatseg::pipeline::NamedMap;
use splatseg::places::{Cell, PlanSettings, map_server};
use splatseg_test_scenes::{PlanErrors, true_cells};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, map] = arguments.as_slice() else { return Err("expected a scene and a map".into()) };
    let scene = SyntheticScene::new(scene.parse()?)?;
    let map = NamedMap::load(map)?;
    let start = std::time::Instant::now();
    let plan = map.floor_plan(PlanSettings::default())?;
    println!(
        "plan in {:.2} s, floor {:?}, world {}",
        start.elapsed().as_secs_f64(),
        plan.floor_heights(),
        plan.frame().is_world()
    );
    let grid = plan.grid();
    let shape = &grid.shape;
    let truth = true_cells(&scene, shape.origin, (shape.width, shape.height), shape.resolution);
    let errors = PlanErrors::new(grid.cells.iter().map(|cell| *cell == Cell::Free), &truth);
    let all = truth.iter().filter(|cell| cell.is_free).count();
    println!("IoU {:.3}; {errors:?}; of all free cells {:.3}", errors.iou(), errors.both as f64 / all as f64);
    for (index, cell) in truth.iter().enumerate().filter(|(index, cell)| grid.cells[*index] == Cell::Free && !cell.is_free) {
        let place = shape.center(index);
        let near = scene.things().into_iter().min_by(|one, other| {
            let apart = |thing: &splatseg::dataset::Thing| thing.center.truncate().as_dvec2().distance(place);
            apart(one).total_cmp(&apart(other))
        });
        let near = near.unwrap();
        println!("{} {place:.3} {:?} {} at {:.3} size {:.3} apart {:.3}", cell.is_inside, near.kind, near.id, near.center, near.size, near.center.truncate().as_dvec2().distance(place));
    }
    std::fs::write("/tmp/plan.pgm", map_server::pgm(grid))?;
    Ok(())
}

//! The plan of a saved map of a synthetic scene, compared with the exact one: `cargo run --release -p splatseg
//! --no-default-features --example plan_truth -- 'synthetic:frames=1800,tour=4' map.ply`. The scene is the one without noise.

use splatseg::dataset::SyntheticScene;
use splatseg::pipeline::NamedMap;
use splatseg::places::{Cell, PlanSettings};
use splatseg_test_scenes::{PlanErrors, true_cells};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, map] = arguments.as_slice() else { return Err("expected a scene and a map".into()) };
    let scene = SyntheticScene::new(scene.parse()?)?;
    let map = NamedMap::load(map)?;
    let start = std::time::Instant::now();
    let plan = map.floor_plan(PlanSettings::default())?;
    println!("plan in {:.2} s, floor at {:?} m", start.elapsed().as_secs_f64(), plan.floor_heights());
    let shape = &plan.grid().shape;
    let truth = true_cells(&scene, 1, shape.origin, (shape.width, shape.height), shape.resolution);
    let errors = PlanErrors::new(plan.grid().cells.iter().map(|cell| *cell == Cell::Free), &truth);
    println!("IoU of free cells {:.3}; {errors:?}; {} rooms", errors.iou(), plan.rooms().len());
    Ok(())
}

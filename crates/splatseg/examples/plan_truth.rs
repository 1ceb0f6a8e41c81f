//! The plan of a saved map of a synthetic scene, compared with the exact one: `cargo run --release -p splatseg
//! --no-default-features --example plan_truth -- 'synthetic:frames=1800,tour=4' map.ply`. The scene is the one without noise.
//! It may also be the folder of a room rendered with its exact surfaces: `python -m splatseg_training.rooms --mesh`.

use splatseg::dataset::{DatasetSettings, Scene, SyntheticScene, open_scene};
use splatseg::pipeline::NamedMap;
use splatseg::places::{Cell, PlanSettings};
use splatseg_test_scenes::{ExactPlan, PlanErrors, TrueSurfaces, true_cells};
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, map] = arguments.as_slice() else { return Err("expected a scene and a map".into()) };
    let (exact, frames) = exact(scene)?;
    let map = NamedMap::load(map)?;
    let start = std::time::Instant::now();
    let plan = map.floor_plan(PlanSettings::default())?;
    println!("plan in {:.2} s, floor at {:?} m", start.elapsed().as_secs_f64(), plan.floor_heights());
    let shape = &plan.grid().shape;
    let truth = true_cells(&*exact, (&*frames, 1), shape.origin, (shape.width, shape.height), shape.resolution);
    let errors = PlanErrors::new(plan.grid().cells.iter().map(|cell| *cell == Cell::Free), &truth);
    println!("IoU of free cells {:.3}; {errors:?}; {} rooms", errors.iou(), plan.rooms().len());
    Ok(())
}

/// Where things stand, and frames with exact depth.
type Truth = (Box<dyn ExactPlan>, Arc<dyn Scene>);

fn exact(scene: &str) -> Result<Truth, Box<dyn std::error::Error>> {
    if let Some(surfaces) = TrueSurfaces::read(Path::new(scene)) {
        return Ok((Box::new(surfaces), open_scene(scene, &DatasetSettings::default())?));
    }
    let scene = || SyntheticScene::new(scene.parse()?).map_err(Box::<dyn std::error::Error>::from);
    Ok((Box::new(scene()?), Arc::new(scene()?)))
}

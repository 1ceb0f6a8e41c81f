//! Plans and boxes of rendered rooms, compared with their exact surfaces: rooms of `python -m splatseg_training.rooms --mesh`
//! (docs/PLACES.md). `cargo run --release -p splatseg-places --example rendered_rooms -- FOLDER …` prints a line for each; the
//! map learns the true ids.

#[path = "../tests/it/seen_tour/mod.rs"]
#[allow(dead_code)] // The tests and the other example use more of it.
mod seen_tour;

use glam::{Mat3, Vec3};
use seen_tour::{routes, seen, wholly_inside};
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_geometry::Pose;
use splatseg_objects::object_shapes;
use splatseg_places::{Cell, FloorPlan, PlanSettings};
use splatseg_test_scenes::{PlanErrors, TrueSurfaces, true_cells};
use std::path::Path;

/// A side of a box is met if it differs by less than this, metres, or by less than this share of its length.
const WITHIN: (f32, f32) = (0.05, 0.1);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "IoU  free cells: right, missed, wrong; centre inside, wholly inside; unseen | routes: found, none, touching | boxes \
         with all sides met, sides met"
    );
    for folder in std::env::args().skip(1) {
        let scene = open_scene(&folder, &DatasetSettings::default())?;
        let surfaces = TrueSurfaces::read(Path::new(&folder)).ok_or("no surfaces.ply")?;
        let (memory, views) = seen(&*scene, 1, Pose::IDENTITY);
        let plan = FloorPlan::new(&memory.map(), &views, PlanSettings::default())?;
        let shape = &plan.grid().shape;
        let size = (shape.width, shape.height);
        let truth = true_cells(&surfaces, (&*scene, 1), shape.origin, size, shape.resolution);
        let errors = PlanErrors::new(plan.grid().cells.iter().map(|cell| *cell == Cell::Free), &truth);
        let (found, none, touching) = routes(&plan, &surfaces, 0.2);
        let (mut all_met, mut boxes, mut sides_met) = (0, 0, 0);
        for (id, object) in object_shapes(&memory.map()).iter().filter(|(id, _)| surfaces.extents().contains_key(id)) {
            let axes = Mat3::from_quat(object.oriented_box.rotation);
            let exact = Vec3::from_array(surfaces.sides(*id, [axes.x_axis, axes.y_axis, axes.z_axis]));
            let is_met = (object.oriented_box.size - exact).abs().cmple((exact * WITHIN.1).max(Vec3::splat(WITHIN.0)));
            boxes += 1;
            all_met += usize::from(is_met.all());
            sides_met += is_met.bitmask().count_ones();
        }
        println!(
            "{folder}: {:.3}  {}, {}, {}; {}, {}; {} | {found}, {none}, {touching} | {all_met} of {boxes}, {sides_met} of {}",
            errors.iou(),
            errors.both,
            errors.missed,
            errors.wrong,
            errors.inside,
            wholly_inside(plan.grid(), &surfaces),
            errors.unseen,
            3 * boxes,
        );
    }
    Ok(())
}

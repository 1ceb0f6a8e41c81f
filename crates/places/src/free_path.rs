//! The floor that the camera was carried over: it hardly sees the floor below itself.

use crate::PlanFrame;
use crate::columns::ColumnContent;
use crate::grid::{Cell, GridShape};
use glam::DVec2;
use splatseg_objects::DepthView;

/// Keyframes that are farther apart than this, metres, are not taken to be joined by a straight way.
const APART: f64 = 1.0;

/// The straight pieces of the camera's path on the plan, from keyframe to keyframe. A keyframe that is far from the one
/// before is a piece of no length.
pub(crate) fn camera_path(views: &[DepthView], frame: &PlanFrame) -> Vec<[DVec2; 2]> {
    let places: Vec<DVec2> = views.iter().map(|view| frame.to_plan(view.world_from_camera.translation())).collect();
    let first = places.first().map(|place| [*place, *place]);
    let steps = places.windows(2).map(|pair| match pair[0].distance(pair[1]) <= APART {
        true => [pair[0], pair[1]],
        false => [pair[1], pair[1]],
    });
    first.into_iter().chain(steps).collect()
}

/// Frees unknown cells within `radius` metres of the path in which nothing was seen at all.
pub(crate) fn free_path(
    cells: &mut [Cell],
    shape: &GridShape,
    columns: &[ColumnContent],
    path: &[[DVec2; 2]],
    radius: f64,
) {
    for [from, to] in path {
        let steps = (from.distance(*to) / (0.5 * shape.resolution)).ceil().max(1.0) as usize;
        for step in 0..=steps {
            for cell in shape.within(from.lerp(*to, step as f64 / steps as f64), radius) {
                let content = &columns[cell];
                if cells[cell] == Cell::Unknown && !content.is_obstacle && !content.is_doubtful && !content.is_tall {
                    cells[cell] = Cell::Free;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_cells_without_anything_are_freed() {
        let shape = GridShape { resolution: 0.1, origin: DVec2::ZERO, width: 20, height: 9 };
        let mut columns = vec![ColumnContent::default(); shape.len()];
        let mut cells = vec![Cell::Unknown; shape.len()];
        let at = |x: f64, y: f64| shape.cell_at(DVec2::new(x, y)).unwrap();
        let (wall, doubt, occupied) = (at(0.75, 0.45), at(0.95, 0.45), at(1.15, 0.45));
        columns[wall].is_tall = true;
        columns[doubt].is_doubtful = true;
        cells[occupied] = Cell::Occupied;
        free_path(&mut cells, &shape, &columns, &[[DVec2::new(0.5, 0.45), DVec2::new(1.5, 0.45)]], 0.2);
        assert_eq!([wall, doubt, occupied].map(|cell| cells[cell]), [Cell::Unknown, Cell::Unknown, Cell::Occupied]);
        let free = |x: f64, y: f64| cells[at(x, y)] == Cell::Free;
        assert!(free(0.55, 0.45) && free(1.45, 0.55) && free(0.35, 0.45) && free(1.05, 0.3));
        assert!(!free(0.15, 0.45) && !free(1.05, 0.75) && !free(1.85, 0.45));
    }
}

//! Where objects stand: the cells of the plan that they cover.

use crate::PlanFrame;
use crate::floor_heights::FloorHeights;
use crate::grid::GridShape;
use crate::outline::outlines;
use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{MapView, SegmentId};
use splatseg_objects::{ObjectShape, ObjectSurfaces};
use std::collections::{BTreeMap, BTreeSet};

/// Gaussians at most this far outside an object's box belong to its footprint, metres.
const OUTSIDE: f32 = 0.03;
/// The share of an object's Gaussians that may be lower, and higher, than its footprint tells.
const TAIL: f64 = 0.03;
/// A Gaussian covers at most this much to each side of its centre, metres: it may be far away and large.
const REACH: f64 = 0.1;

/// The part of the floor that an object covers, seen from above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Footprint {
    /// Its id.
    pub id: SegmentId,
    /// Cells of the grid, ascending.
    pub cells: Vec<usize>,
    /// Its outlines in the plan's coordinates, metres: counter-clockwise around each part, clockwise around holes.
    pub outlines: Vec<Vec<DVec2>>,
    /// Mean of its cells, in the plan's coordinates.
    pub center: DVec2,
    /// Height of its lowest and its highest part above the floor below it, metres, without the lowest and highest 3 % of its
    /// points.
    pub heights: (f64, f64),
    /// Area of its cells, square metres.
    pub area_m2: f64,
}

impl Footprint {
    /// True of floors and rugs: nothing of it is as high as an obstacle.
    pub fn is_flat(&self, min_height: f64) -> bool {
        self.heights.1 < min_height
    }
}

/// The footprints of all objects that have a place in the grid. The rules for Gaussians that do not belong to their object
/// are those of `surfaces`. `floor` has the heights of the floor relative to the grid's corner, at that of `frame`.
pub(crate) fn footprints(
    map: &MapView<'_>,
    surfaces: &ObjectSurfaces,
    frame: &PlanFrame,
    shape: &GridShape,
    floor: &FloorHeights,
) -> BTreeMap<SegmentId, Footprint> {
    let shapes = surfaces.shapes();
    let corner = shape.origin.extend(frame.floor_height());
    let mut cells: BTreeMap<SegmentId, (BTreeSet<usize>, Vec<f64>)> = BTreeMap::new();
    let ids = map.segment_ids();
    for (index, id) in ids.iter().enumerate() {
        let Some(object) = shapes.get(id).filter(|_| map.surfaces[index].has_place()) else { continue };
        let world = map.origin + map.means[index].as_dvec3();
        if !is_in_box(object, world) {
            continue;
        }
        let point = frame.point_to_plan(world);
        let reach = (0.5 * f64::from(map.patch.side * map.radii[index])).min(REACH);
        let entry = cells.entry(*id).or_default();
        // Beside the grid, where no floor was looked for, the height is that above the floor in general.
        let above_general = point - corner;
        entry.1.push(above_general.z - floor.at(above_general.as_vec3()).map_or(0.0, f64::from));
        entry.0.extend(covered(shape, point, reach));
    }
    let footprint = |(id, (cells, mut heights)): (SegmentId, (BTreeSet<usize>, Vec<f64>))| {
        heights.sort_by(f64::total_cmp);
        let tail = (TAIL * heights.len() as f64) as usize;
        let (low, high) = (heights[tail], heights[heights.len() - 1 - tail]);
        let count = cells.len();
        let center = cells.iter().map(|cell| shape.center(*cell)).sum::<DVec2>() / count as f64;
        let area_m2 = count as f64 * shape.resolution * shape.resolution;
        let outlines = outlines(shape, &cells);
        let cells = cells.into_iter().collect();
        (id, Footprint { id, cells, outlines, center, heights: (low, high), area_m2 })
    };
    cells.into_iter().filter(|(_, (cells, _))| !cells.is_empty()).map(footprint).collect()
}

fn is_in_box(object: &ObjectShape, world: DVec3) -> bool {
    let oriented = &object.oriented_box;
    let local = oriented.rotation.inverse() * (world - oriented.center).as_vec3();
    local.abs().cmple(0.5 * oriented.size + Vec3::splat(OUTSIDE)).all()
}

/// The cells of a patch of surface.
fn covered(shape: &GridShape, point: DVec3, reach: f64) -> Vec<usize> {
    let place = DVec2::new(point.x, point.y);
    let steps = (2.0 * reach / shape.resolution).ceil() as usize + 1;
    let at = |step: usize| reach * (2.0 * step as f64 / (steps - 1).max(1) as f64 - 1.0);
    let offsets = (0..steps * steps).map(|index| DVec2::new(at(index % steps), at(index / steps)));
    offsets.filter_map(|offset| shape.cell_at(place + offset)).collect()
}

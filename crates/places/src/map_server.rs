//! A grid as an image and a YAML file, as ROS's `map_server` and Nav2 read them.
//!
//! The rules are those of <https://wiki.ros.org/map_server> and Nav2's `map_io.cpp`: the first row of the image is at the
//! highest y, and `origin` is the lower-left corner of the lower-left pixel. A pixel `p` is occupied if
//! `(255 - p) / 255 > occupied_thresh`, free if it is below `free_thresh`, and else unknown.

use crate::PlanFrame;
use crate::grid::{Cell, OccupancyGrid};
use glam::DQuat;

/// Values of pixels.
const FREE: u8 = 254;
const OCCUPIED: u8 = 0;
const UNKNOWN: u8 = 205;

/// The bytes of the grid as a binary PGM image.
pub fn pgm(grid: &OccupancyGrid) -> Vec<u8> {
    let mut bytes = format!("P5\n{} {}\n255\n", grid.shape.width, grid.shape.height).into_bytes();
    let value = |cell: &Cell| match cell {
        Cell::Free => FREE,
        Cell::Occupied => OCCUPIED,
        Cell::Unknown => UNKNOWN,
    };
    for row in grid.cells.chunks(grid.shape.width.max(1)).rev() {
        bytes.extend(row.iter().map(value));
    }
    bytes
}

/// The text of the YAML file beside an image of that name, which the file names relative to itself. Comments tell the
/// transform from the map's world to the grid's frame if they are not the same.
pub fn yaml(grid: &OccupancyGrid, frame: &PlanFrame, image: &str) -> String {
    let shape = &grid.shape;
    let quoted = serde_json::Value::from(image);
    let mut text = String::new();
    if frame.is_world() {
        text += "# Frame: the map's world, z up.\n";
    } else {
        let transform = frame.plan_from_world();
        let [x, y, z] = transform.translation().to_array();
        let rotation = DQuat::from_mat3(&transform.rotation()).normalize();
        text += "# Frame: the map's world turned so that z is up, with the floor at z = 0. From world to this frame:\n";
        text += &format!("# translation: [{x:.6}, {y:.6}, {z:.6}]\n");
        text += &format!(
            "# rotation: [{:.9}, {:.9}, {:.9}, {:.9}]  # x, y, z, w\n",
            rotation.x, rotation.y, rotation.z, rotation.w
        );
    }
    text += &format!("# z of the floor: {:.3} m\n", frame.floor_height());
    text += &format!("image: {quoted}\nmode: trinary\nresolution: {}\n", shape.resolution);
    text += &format!("origin: [{:.6}, {:.6}, 0.0]\n", shape.origin.x, shape.origin.y);
    // The values of nav2_map_server for these pixels: with a larger free_thresh, 205 would be free.
    text += "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n";
    text
}

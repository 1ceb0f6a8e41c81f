//! The surface where the field is zero: one vertex in each cell that it passes through, four cells joined by each edge that
//! it crosses.
//!
//! A cell is the cube between eight voxels. If two sheets pass through one cell, they share its vertex, so the mesh is not
//! a manifold there. That happens where things are thinner than two voxels; viewers and measurements do not mind.

use crate::block_grid::{BlockGrid, NO_BLOCK, SIDE, VOXELS, Voxel, neighbour};
use glam::{IVec3, Vec3};
use rayon::prelude::*;

/// Voxels with a smaller weight are unknown.
const MIN_WEIGHT: f32 = 0.04;
/// A cell without a vertex.
const NONE: u16 = u16::MAX;
/// Offset of a cell's corners from its voxel.
const CORNERS: [IVec3; 8] = [
    IVec3::new(0, 0, 0),
    IVec3::new(1, 0, 0),
    IVec3::new(0, 1, 0),
    IVec3::new(1, 1, 0),
    IVec3::new(0, 0, 1),
    IVec3::new(1, 0, 1),
    IVec3::new(0, 1, 1),
    IVec3::new(1, 1, 1),
];
/// Corners that each edge of a cell joins.
const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];
/// Rows of a block with one voxel more on each side.
const WIDE: usize = SIDE + 1;

/// A surface without colours.
pub(crate) struct Surface {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// The vertices of one block.
struct BlockVertices {
    positions: Vec<Vec3>,
    /// Number of each cell's vertex in `positions`, [`NONE`] without.
    cells: Option<Box<[u16; VOXELS]>>,
}

/// Finds the surface. Vertices and triangles are ordered by block.
pub(crate) fn surface(grid: &BlockGrid) -> Surface {
    let found: Vec<BlockVertices> =
        (0..grid.places.len()).into_par_iter().map(|block| vertices_of(grid, block)).collect();
    let mut firsts = Vec::with_capacity(found.len());
    let mut count = 0u32;
    for block in &found {
        firsts.push(count);
        count = count.saturating_add(block.positions.len() as u32);
    }
    let triangles: Vec<Vec<[u32; 3]>> =
        (0..found.len()).into_par_iter().map(|block| triangles_of(grid, &found, &firsts, block)).collect();
    Surface {
        positions: found.into_iter().flat_map(|block| block.positions).collect(),
        triangles: triangles.into_iter().flatten().collect(),
    }
}

/// The voxels of a block and those beyond its upper sides; distances, not a number where unknown.
fn distances(grid: &BlockGrid, neighbours: &[u32; 27]) -> [f32; WIDE * WIDE * WIDE] {
    let known = |voxel: Voxel| if voxel.weight >= MIN_WEIGHT { voxel.distance } else { f32::NAN };
    std::array::from_fn(|index| {
        let (x, y, z) = (index % WIDE, index / WIDE % WIDE, index / (WIDE * WIDE));
        let (block, voxel) = neighbour(IVec3::new(x as i32, y as i32, z as i32));
        match neighbours[block] {
            NO_BLOCK => f32::NAN,
            block => known(grid.blocks[block as usize][voxel]),
        }
    })
}

fn wide_index(voxel: IVec3) -> usize {
    voxel.x as usize + WIDE * (voxel.y as usize + WIDE * voxel.z as usize)
}

fn voxel_at(index: usize) -> IVec3 {
    IVec3::new((index % SIDE) as i32, (index / SIDE % SIDE) as i32, (index / (SIDE * SIDE)) as i32)
}

fn vertices_of(grid: &BlockGrid, block: usize) -> BlockVertices {
    let mut found = BlockVertices { positions: Vec::new(), cells: None };
    if !has_both_signs(grid, block) {
        return found;
    }
    let distances = distances(grid, &grid.neighbours(block));
    let corner = grid.corner(block);
    let mut cells = Box::new([NONE; VOXELS]);
    for (index, cell) in cells.iter_mut().enumerate() {
        let voxel = voxel_at(index);
        let corners = CORNERS.map(|offset| distances[wide_index(voxel + offset)]);
        if let Some(place) = crossing(&corners) {
            *cell = found.positions.len() as u16;
            found.positions.push(corner + (voxel.as_vec3() + place) * grid.voxel);
        }
    }
    found.cells = (!found.positions.is_empty()).then_some(cells);
    found
}

/// False if no surface can pass through a block: it and its neighbours have distances of one sign.
fn has_both_signs(grid: &BlockGrid, block: usize) -> bool {
    let neighbours = grid.neighbours(block);
    let (mut inside, mut outside) = (false, false);
    // Neighbours towards higher coordinates, and the block itself.
    for index in [13, 14, 16, 17, 22, 23, 25, 26] {
        if neighbours[index] == NO_BLOCK {
            continue;
        }
        for voxel in grid.blocks[neighbours[index] as usize].iter().filter(|voxel| voxel.weight >= MIN_WEIGHT) {
            inside |= voxel.distance < 0.0;
            outside |= voxel.distance >= 0.0;
        }
        if inside && outside {
            return true;
        }
    }
    false
}

/// Mean of the places where the surface crosses a cell's edges, in cells. `None` if it does not, or a corner is unknown.
fn crossing(corners: &[f32; 8]) -> Option<Vec3> {
    let inside = corners.iter().filter(|distance| **distance < 0.0).count();
    if inside == 0 || inside == 8 || corners.iter().any(|distance| distance.is_nan()) {
        return None;
    }
    let (mut sum, mut count) = (Vec3::ZERO, 0.0);
    for (from, to) in EDGES {
        let (a, b) = (corners[from], corners[to]);
        if (a < 0.0) != (b < 0.0) {
            sum += CORNERS[from].as_vec3().lerp(CORNERS[to].as_vec3(), a / (a - b));
            count += 1.0;
        }
    }
    Some(sum / count)
}

fn triangles_of(grid: &BlockGrid, found: &[BlockVertices], firsts: &[u32], block: usize) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    if !has_both_signs(grid, block) {
        return triangles;
    }
    let neighbours = grid.neighbours(block);
    let distances = distances(grid, &neighbours);
    let vertex = |cell: IVec3| {
        let (block, cell) = neighbour(cell);
        let block = neighbours[block];
        let local = *found.get(block as usize)?.cells.as_ref()?.get(cell)?;
        (local != NONE).then(|| (firsts[block as usize] + u32::from(local), block as usize, usize::from(local)))
    };
    let axes = [IVec3::X, IVec3::Y, IVec3::Z];
    for voxel in (0..VOXELS).map(voxel_at) {
        let here = distances[wide_index(voxel)];
        for axis in 0..3 {
            let there = distances[wide_index(voxel + axes[axis])];
            if here.is_nan() || there.is_nan() || (here < 0.0) == (there < 0.0) {
                continue;
            }
            let (b, c) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
            // Counter-clockwise as seen from the end of the axis.
            let cells = [voxel - b - c, voxel - c, voxel, voxel - b].map(vertex);
            let [Some(first), Some(second), Some(third), Some(fourth)] = cells else { continue };
            let mut quad = [first, second, third, fourth];
            if here >= 0.0 {
                quad.reverse();
            }
            let place = |corner: usize| found[quad[corner].1].positions[quad[corner].2];
            let numbers = quad.map(|(number, ..)| number);
            // Along the shorter diagonal.
            if place(0).distance_squared(place(2)) <= place(1).distance_squared(place(3)) {
                triangles.extend([[numbers[0], numbers[1], numbers[2]], [numbers[0], numbers[2], numbers[3]]]);
            } else {
                triangles.extend([[numbers[0], numbers[1], numbers[3]], [numbers[1], numbers[2], numbers[3]]]);
            }
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TriangleMesh;
    use std::collections::BTreeMap;

    /// A field that contains a ball.
    fn ball(radius: f32, voxel: f32) -> BlockGrid {
        let reach = (radius / (voxel * SIDE as f32)).ceil() as i32 + 1;
        let range = || -reach..reach;
        let places = range().flat_map(|z| range().flat_map(move |y| range().map(move |x| IVec3::new(x, y, z))));
        let mut grid = BlockGrid::new(voxel, places.collect());
        for block in 0..grid.places.len() {
            let corner = grid.corner(block);
            for index in 0..VOXELS {
                let distance = (corner + voxel_at(index).as_vec3() * voxel).length() - radius;
                grid.blocks[block][index] = Voxel { distance, weight: 1.0 };
            }
        }
        grid
    }

    #[test]
    fn a_ball_is_closed_and_round_and_faces_outwards() {
        let found = surface(&ball(0.5, 0.04));
        let mesh = TriangleMesh { positions: found.positions, triangles: found.triangles, ..TriangleMesh::default() };
        assert!(mesh.positions.iter().all(|place| (place.length() - 0.5).abs() < 0.004));
        let area = 4.0 * std::f64::consts::PI * 0.25;
        assert!((mesh.area() / area - 1.0).abs() < 0.02, "{} {area}", mesh.area());
        let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((*from.min(to), *from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
            let [a, b, c] = [a, b, c].map(|vertex| mesh.positions[*vertex as usize]);
            assert!((b - a).cross(c - a).dot(a) > 0.0);
        }
        // Each edge is passed once in each direction.
        assert!(edges.values().all(|passes| *passes == 0));
        assert_eq!(mesh.positions.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64, 2);
    }

    #[test]
    fn unknown_voxels_have_no_surface() {
        let mut grid = ball(0.3, 0.05);
        let whole = surface(&grid).triangles.len();
        for block in 0..grid.places.len() {
            if grid.places[block].x >= 0 {
                grid.blocks[block].iter_mut().for_each(|voxel| voxel.weight = 0.0);
            }
        }
        let half = surface(&grid);
        assert!(half.triangles.len() < 6 * whole / 10 && half.triangles.len() > whole / 3);
        assert!(half.positions.iter().all(|place| place.x <= 0.0));
    }
}

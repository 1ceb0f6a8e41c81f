//! The exact surfaces of a rendered room, which `splatseg_training.rooms --mesh` writes beside its frames.

use crate::true_plan::{ExactPlan, HEIGHTS};
use glam::{Vec2, Vec3, Vec3Swizzles};
use std::collections::BTreeMap;
use std::path::Path;

/// Side of a square of the raster, metres.
const SQUARE: f32 = 0.01;
/// A surface that only touches a square does not stand in it, metres.
const TOUCHING: f32 = 1e-4;
/// The id of the floor in rendered rooms; walls, floor and ceiling have those up to [`LAST_OF_SHELL`].
const FLOOR: i32 = 5;
const LAST_OF_SHELL: i32 = 6;
/// The floor reaches below the walls by this, metres.
const BELOW_WALLS: f32 = 0.15;
/// Bytes of a vertex: x, y, z and the id.
const VERTEX: usize = 16;

/// Triangles of a room with the id of their instance, and where they stand at the heights of a robot.
pub struct TrueSurfaces {
    triangles: Vec<([Vec3; 3], i32)>,
    lowest: Vec2,
    width: usize,
    is_occupied: Vec<bool>,
    /// Lowest and highest corner of the floor between the walls.
    floor: (Vec2, Vec2),
}

impl TrueSurfaces {
    /// Reads `surfaces.ply` of a room's folder; `None` if it has none.
    pub fn read(folder: &Path) -> Option<Self> {
        let bytes = std::fs::read(folder.join("surfaces.ply")).ok()?;
        let end = b"end_header\n";
        let start = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
        let header = std::str::from_utf8(&bytes[..start]).unwrap();
        let count: usize =
            header.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap().parse().unwrap();
        let vertices: Vec<(Vec3, i32)> = bytes[start..][..count * VERTEX].chunks_exact(VERTEX).map(vertex).collect();
        // Triangles share no vertices.
        let triangles = vertices.chunks_exact(3).map(|three| ([three[0].0, three[1].0, three[2].0], three[0].1));
        Some(Self::new(triangles.collect()))
    }

    fn new(triangles: Vec<([Vec3; 3], i32)>) -> Self {
        let bounds = |is_counted: &dyn Fn(i32) -> bool| {
            let points = triangles.iter().filter(|(_, id)| is_counted(*id)).flat_map(|(corners, _)| corners);
            points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)))
        };
        let ((low, high), floor) = (bounds(&|_| true), bounds(&|id| id == FLOOR));
        let lowest = (low.xy() / SQUARE).floor() * SQUARE - SQUARE;
        let [width, height] = ((high.xy() - lowest) / SQUARE).to_array().map(|squares| squares.ceil() as usize + 1);
        let floor = (floor.0.xy() + BELOW_WALLS, floor.1.xy() - BELOW_WALLS);
        let mut surfaces = Self { triangles, lowest, width, is_occupied: vec![false; width * height], floor };
        surfaces.mark_crossed();
        surfaces.mark_inside();
        surfaces
    }

    /// Lowest and highest corner of each thing, by id, metres.
    pub fn extents(&self) -> BTreeMap<u32, (Vec3, Vec3)> {
        let mut extents = BTreeMap::new();
        for (corners, id) in self.triangles.iter().filter(|(_, id)| *id > LAST_OF_SHELL) {
            let (low, high) = extents.entry(*id as u32).or_insert((Vec3::INFINITY, Vec3::NEG_INFINITY));
            for corner in corners {
                (*low, *high) = (low.min(*corner), high.max(*corner));
            }
        }
        extents
    }

    /// The extent of a thing along each of these axes, metres.
    pub fn sides(&self, id: u32, axes: [Vec3; 3]) -> [f32; 3] {
        axes.map(|axis| {
            let of_thing = self.triangles.iter().filter(|(_, other)| *other == id as i32);
            let along = of_thing.flat_map(|(corners, _)| corners).map(|corner| corner.dot(axis));
            let (low, high) =
                along.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
            high - low
        })
    }

    /// Marks the squares above which a surface stands.
    fn mark_crossed(&mut self) {
        for index in 0..self.triangles.len() {
            let corners = self.triangles[index].0;
            let part: Vec<Vec2> = between_heights(&corners).into_iter().map(Vec3::xy).collect();
            for square in self.squares_around(&part) {
                self.is_occupied[square] |= overlaps(&part, self.center(square));
            }
        }
    }

    /// Marks the squares inside a closed thing that is higher and lower than the robot: a line upwards leaves it an odd
    /// number of times above, and enters it below.
    fn mark_inside(&mut self) {
        let mut things: BTreeMap<i32, Vec<usize>> = BTreeMap::new();
        for (index, (_, id)) in self.triangles.iter().enumerate().filter(|(_, (_, id))| *id > LAST_OF_SHELL) {
            things.entry(*id).or_default().push(index);
        }
        for triangles in things.into_values() {
            let mut crossed: BTreeMap<usize, (bool, bool)> = BTreeMap::new();
            for index in triangles {
                let corners = self.triangles[index].0;
                for square in self.squares_around(&corners.map(Vec3::xy)) {
                    let Some(z) = height_at(&corners, self.center(square)) else { continue };
                    let (below, above) = crossed.entry(square).or_default();
                    *below ^= z <= HEIGHTS.0;
                    *above ^= z >= HEIGHTS.1;
                }
            }
            let inside = crossed.into_iter().filter(|(_, (below, above))| *below && *above);
            inside.for_each(|(square, _)| self.is_occupied[square] = true);
        }
    }

    fn center(&self, square: usize) -> Vec2 {
        self.lowest + (Vec2::new((square % self.width) as f32, (square / self.width) as f32) + 0.5) * SQUARE
    }

    /// The squares of the box around these points; none if there are no points.
    fn squares_around(&self, points: &[Vec2]) -> Vec<usize> {
        let (low, high) = points
            .iter()
            .fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)));
        if points.is_empty() {
            return Vec::new();
        }
        let [first, last] = [low, high].map(|point| ((point - self.lowest) / SQUARE).floor().as_uvec2());
        let rows = first.y as usize..=last.y as usize;
        rows.flat_map(|row| (first.x as usize..=last.x as usize).map(move |column| row * self.width + column)).collect()
    }
}

impl ExactPlan for TrueSurfaces {
    fn is_occupied(&self, place: Vec2) -> bool {
        let [column, row] = ((place - self.lowest) / SQUARE).floor().to_array();
        if column < 0.0 || row < 0.0 || column >= self.width as f32 {
            return false;
        }
        self.is_occupied.get(row as usize * self.width + column as usize).copied().unwrap_or_default()
    }

    fn is_in_house(&self, place: Vec2) -> bool {
        self.room_at(place).is_some()
    }

    fn room_at(&self, place: Vec2) -> Option<usize> {
        (place.cmpgt(self.floor.0).all() && place.cmplt(self.floor.1).all()).then_some(0)
    }
}

fn vertex(bytes: &[u8]) -> (Vec3, i32) {
    let number = |at: usize| bytes[4 * at..].first_chunk().copied().unwrap();
    (Vec3::from_array([0, 1, 2].map(|axis| f32::from_le_bytes(number(axis)))), i32::from_le_bytes(number(3)))
}

/// The part of a triangle at the heights of a robot.
fn between_heights(corners: &[Vec3; 3]) -> Vec<Vec3> {
    let above = clipped(corners, |point| point.z - HEIGHTS.0);
    clipped(&above, |point| HEIGHTS.1 - point.z)
}

/// The part of a convex polygon on which `distance` is positive.
fn clipped(corners: &[Vec3], distance: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let mut part = Vec::new();
    for (index, corner) in corners.iter().enumerate() {
        let next = corners[(index + 1) % corners.len()];
        let (here, there) = (distance(*corner), distance(next));
        if here > 0.0 {
            part.push(*corner);
        }
        if (here > 0.0) != (there > 0.0) {
            part.push(corner.lerp(next, here / (here - there)));
        }
    }
    part
}

/// True if a convex polygon, a line or a point reaches into the square around a centre: no side of either parts them.
fn overlaps(polygon: &[Vec2], center: Vec2) -> bool {
    let half = 0.5 * SQUARE - TOUCHING;
    let sides = (0..polygon.len()).map(|index| (polygon[(index + 1) % polygon.len()] - polygon[index]).perp());
    sides.chain([Vec2::X, Vec2::Y]).all(|axis| {
        let along = polygon.iter().map(|point| (*point - center).dot(axis));
        let (low, high) = along.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
        let reach = half * (axis.x.abs() + axis.y.abs());
        low <= reach && high >= -reach
    })
}

/// The height at which a vertical line passes a triangle.
fn height_at(corners: &[Vec3; 3], place: Vec2) -> Option<f32> {
    let [a, b, c] = corners.map(Vec3::xy);
    let area = (b - a).perp_dot(c - a);
    let weights = [(c - b).perp_dot(place - b), (a - c).perp_dot(place - c), (b - a).perp_dot(place - a)];
    let is_inside = area != 0.0 && weights.iter().all(|weight| weight / area >= 0.0);
    is_inside.then(|| weights.iter().zip(corners).map(|(weight, corner)| weight / area * corner.z).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The triangles of a box.
    fn cuboid(low: Vec3, high: Vec3, id: i32) -> Vec<([Vec3; 3], i32)> {
        let corner =
            |index: usize| Vec3::select(glam::BVec3::new(index & 1 != 0, index & 2 != 0, index & 4 != 0), high, low);
        let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let halves = faces.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        halves.map(|corners| (corners.map(corner), id)).collect()
    }

    #[test]
    fn things_stand_where_their_surfaces_are_at_the_heights_of_a_robot() {
        let mut triangles = cuboid(Vec3::new(-0.15, -0.15, -0.1), Vec3::new(4.15, 3.15, 0.0), FLOOR);
        triangles.extend(cuboid(Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.5, 1.5, 0.4), 7));
        triangles.extend(cuboid(Vec3::new(2.0, 1.0, 0.0), Vec3::new(2.5, 1.5, 2.2), 8));
        triangles.extend(cuboid(Vec3::new(3.0, 1.0, 0.0), Vec3::new(3.5, 1.5, 0.05), 9));
        triangles.extend(cuboid(Vec3::new(3.0, 2.0, 1.9), Vec3::new(3.5, 2.5, 2.2), 10));
        let surfaces = TrueSurfaces::new(triangles);
        for (place, is_occupied) in [
            ((1.25, 1.25), true),
            ((1.005, 1.25), true),
            ((0.995, 1.25), false),
            // In a cupboard, which is higher than the robot.
            ((2.25, 1.25), true),
            // On a rug, and below a lamp.
            ((3.25, 1.25), false),
            ((3.25, 2.25), false),
        ] {
            assert_eq!(surfaces.is_occupied(place.into()), is_occupied, "{place:?}");
        }
        assert_eq!(
            [(0.01, 0.01), (3.99, 2.99), (-0.01, 1.0), (4.01, 1.0)].map(|place| surfaces.is_in_house(place.into())),
            [true, true, false, false]
        );
        assert_eq!(surfaces.extents()[&8], (Vec3::new(2.0, 1.0, 0.0), Vec3::new(2.5, 1.5, 2.2)));
    }
}

//! A triangle mesh with a colour and an object at each vertex.

use glam::{DVec3, Vec3};
use splatseg_geometry::SegmentId;
use std::collections::{BTreeMap, BTreeSet};

/// A triangle mesh. The vectors of vertices have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Origin of the positions: world coordinates, metres.
    pub origin: DVec3,
    /// Position of each vertex, metres, relative to the origin.
    pub positions: Vec<Vec3>,
    /// Colour of each vertex, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Object of each vertex, 0 for none.
    pub ids: Vec<SegmentId>,
    /// Vertices of each triangle, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The object that a triangle shows: that of at least two of its vertices, or of the first one.
    pub fn triangle_id(&self, triangle: [u32; 3]) -> SegmentId {
        let [first, second, third] = triangle.map(|vertex| self.ids[vertex as usize]);
        if second == third { second } else { first }
    }

    /// The objects that triangles show.
    pub fn object_ids(&self) -> BTreeSet<SegmentId> {
        self.triangles.iter().map(|triangle| self.triangle_id(*triangle)).filter(|id| *id != 0).collect()
    }

    /// The triangles that show each object, in the mesh's order; those without an object under 0.
    pub fn triangles_by_object(&self) -> BTreeMap<SegmentId, Vec<[u32; 3]>> {
        let mut parts: BTreeMap<SegmentId, Vec<[u32; 3]>> = BTreeMap::new();
        for triangle in &self.triangles {
            parts.entry(self.triangle_id(*triangle)).or_default().push(*triangle);
        }
        parts
    }

    /// A mesh of some of the triangles, with only the vertices that they use.
    #[must_use]
    pub fn part(&self, triangles: &[[u32; 3]]) -> Self {
        let mut used = vec![false; self.positions.len()];
        triangles.iter().flatten().for_each(|vertex| used[*vertex as usize] = true);
        let mut part = Self { origin: self.origin, ..Self::default() };
        let mut places = vec![0; used.len()];
        for vertex in (0..used.len()).filter(|vertex| used[*vertex]) {
            places[vertex] = part.positions.len() as u32;
            part.positions.push(self.positions[vertex]);
            part.colors.push(self.colors[vertex]);
            part.ids.push(self.ids[vertex]);
        }
        part.triangles = triangles.iter().map(|triangle| triangle.map(|vertex| places[vertex as usize])).collect();
        part
    }

    /// Unit normal of each vertex: the mean of its triangles' normals, weighted by their areas.
    pub fn normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
            let normal = (b - a).cross(c - a);
            triangle.iter().for_each(|vertex| normals[*vertex as usize] += normal);
        }
        normals.into_iter().map(|normal| normal.normalize_or(Vec3::Z)).collect()
    }

    /// Area of all triangles, square metres.
    pub fn area(&self) -> f64 {
        let area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| self.positions[vertex as usize]);
            f64::from(0.5 * (b - a).cross(c - a).length())
        };
        self.triangles.iter().map(area).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriangleMesh {
        TriangleMesh {
            origin: DVec3::new(1e6, 0.0, 0.0),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::ONE - Vec3::Z, Vec3::Y],
            colors: vec![[1; 3], [2; 3], [3; 3], [4; 3]],
            ids: vec![7, 7, 7, 9],
            triangles: vec![[0, 1, 2], [3, 0, 2]],
        }
    }

    #[test]
    fn a_triangle_shows_what_most_of_its_vertices_show() {
        let mesh = square();
        assert_eq!(mesh.triangles.iter().map(|one| mesh.triangle_id(*one)).collect::<Vec<_>>(), [7, 7]);
        let mesh = TriangleMesh { ids: vec![5, 7, 9, 9], ..mesh };
        assert_eq!(mesh.triangles_by_object(), BTreeMap::from([(5, vec![[0, 1, 2]]), (9, vec![[3, 0, 2]])]));
    }

    #[test]
    fn a_part_has_only_its_own_vertices() {
        let part = square().part(&[[3, 0, 2]]);
        assert_eq!(part.positions, [Vec3::ZERO, Vec3::ONE - Vec3::Z, Vec3::Y]);
        assert_eq!((part.triangles, part.ids, part.origin), (vec![[2, 0, 1]], vec![7, 7, 9], square().origin));
        assert_eq!(part.colors, [[1; 3], [3; 3], [4; 3]]);
    }

    #[test]
    fn normals_point_to_where_triangles_are_counter_clockwise_from() {
        assert_eq!(square().normals(), vec![Vec3::Z; 4]);
        assert!((square().area() - 1.0).abs() < 1e-6);
    }
}

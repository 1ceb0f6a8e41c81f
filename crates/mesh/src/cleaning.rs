//! Takes away what does not belong to a mesh: triangles without a Gaussian near them, and specks.

use splatseg_geometry::SegmentId;
use splatseg_objects::VertexId;
use std::collections::BTreeMap;

/// Fewer connected triangles than this are a speck.
const SPECK_TRIANGLES: usize = 60;

/// Keeps the triangles whose vertices all have a Gaussian near them, without specks.
pub(crate) fn cleaned(triangles: Vec<[u32; 3]>, found: &[VertexId]) -> Vec<[u32; 3]> {
    let is_held = |triangle: &[u32; 3]| triangle.iter().all(|vertex| found[*vertex as usize].color.is_some());
    let mut triangles = triangles;
    triangles.retain(is_held);
    let parts = connected(&triangles, found.len());
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for triangle in &triangles {
        *counts.entry(parts[triangle[0] as usize]).or_default() += 1;
    }
    triangles.retain(|triangle| counts[&parts[triangle[0] as usize]] >= SPECK_TRIANGLES);
    triangles
}

/// For each vertex, the lowest vertex that it is connected with.
fn connected(triangles: &[[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut parents: Vec<u32> = (0..vertices as u32).collect();
    for [a, b, c] in triangles {
        for (one, other) in [(*a, *b), (*a, *c)] {
            let (one, other) = (root(&mut parents, one), root(&mut parents, other));
            parents[one.max(other) as usize] = one.min(other);
        }
    }
    (0..vertices as u32).map(|vertex| root(&mut parents, vertex)).collect()
}

fn root(parents: &mut [u32], vertex: u32) -> u32 {
    let mut vertex = vertex;
    while parents[vertex as usize] != vertex {
        let next = parents[parents[vertex as usize] as usize];
        parents[vertex as usize] = next;
        vertex = next;
    }
    vertex
}

/// Gives each vertex the id of more than half of its neighbours, if they have one, a few times over: so single vertices
/// have the id of their surroundings.
pub(crate) fn smoothed_ids(triangles: &[[u32; 3]], ids: Vec<SegmentId>, rounds: usize) -> Vec<SegmentId> {
    let mut ids = ids;
    for _ in 0..rounds {
        let mut around: Vec<Vec<SegmentId>> = vec![Vec::new(); ids.len()];
        for triangle in triangles {
            for corner in 0..3 {
                let [vertex, next] = [triangle[corner], triangle[(corner + 1) % 3]];
                around[vertex as usize].push(ids[next as usize]);
            }
        }
        ids = ids.iter().zip(around).map(|(id, around)| majority(*id, around)).collect();
    }
    ids
}

/// The id of more than half of the neighbours, or its own.
fn majority(own: SegmentId, mut around: Vec<SegmentId>) -> SegmentId {
    around.sort_unstable();
    let most = around.chunk_by(|a, b| a == b).max_by_key(|run| run.len());
    most.filter(|run| 2 * run.len() > around.len()).map_or(own, |run| run[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of triangles over vertices `first..first + count + 2`.
    fn strip(first: u32, count: u32) -> Vec<[u32; 3]> {
        (first..first + count).map(|vertex| [vertex, vertex + 1, vertex + 2]).collect()
    }

    #[test]
    fn specks_and_triangles_without_gaussians_go() {
        let held = VertexId { id: 7, confidence: 1.0, color: Some([9; 3]) };
        let mut found = vec![held; 300];
        let triangles = [strip(0, 100), strip(150, 20), strip(200, 80)].concat();
        assert_eq!(cleaned(triangles.clone(), &found).len(), 180);
        // The last strip falls into two specks.
        found[240].color = None;
        assert_eq!(cleaned(triangles, &found), strip(0, 100));
    }

    #[test]
    fn single_vertices_take_the_id_around_them() {
        // A fan around vertex 0.
        let fan: Vec<[u32; 3]> = (1..7).map(|vertex| [0, vertex, vertex % 6 + 1]).collect();
        assert_eq!(smoothed_ids(&fan, vec![0, 7, 7, 7, 7, 7, 7], 1), [7; 7]);
        assert_eq!(smoothed_ids(&fan, vec![5, 7, 7, 7, 9, 9, 9], 0), [5, 7, 7, 7, 9, 9, 9]);
        assert_eq!(smoothed_ids(&fan, vec![5, 7, 7, 7, 9, 9, 9], 1)[0], 5);
    }
}

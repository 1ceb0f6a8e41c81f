//! Transfer of ids from the map to the vertices of a mesh.

use glam::{IVec3, Vec3};
use rayon::prelude::*;
use splatseg_geometry::{MapGaussian, SegmentId};
use std::collections::HashMap;

/// Reach of a Gaussian, standard deviations.
const REACH_IN_RADII: f32 = 3.0;
/// Minimum and maximum reach, metres: a map is not accurate to the millimetre, and a large Gaussian is coarse.
const REACH_M: (f32, f32) = (0.05, 0.3);
/// Side of the grid cells for looking up Gaussians, metres.
const CELL_M: f32 = 0.1;

/// Votes of the Gaussians around a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VertexId {
    /// The id of the Gaussians around it; 0 if there are none or they have no id.
    pub id: SegmentId,
    /// The id's share of their weight, from 0 to 1.
    pub confidence: f32,
    /// Their mean colour, sRGB; `None` if no Gaussian reaches the vertex.
    pub color: Option<[u8; 3]>,
}

/// Returns the id of each vertex: the one with the most weight among the Gaussians that reach it. A Gaussian reaches
/// three standard deviations, but at least 5 and at most 30 cm. Its weight falls linearly with the distance and is
/// proportional to the confidence of its id. Vertices and Gaussians are in the same world coordinates, metres.
pub fn vertex_ids(gaussians: &[MapGaussian], vertices: &[Vec3]) -> Vec<VertexId> {
    let mut cells: HashMap<IVec3, Vec<usize>> = HashMap::new();
    for (index, gaussian) in gaussians.iter().enumerate().filter(|(_, gaussian)| gaussian.mean.is_finite()) {
        let (least, most) = (cell(gaussian.mean - reach(gaussian)), cell(gaussian.mean + reach(gaussian)));
        for x in least.x..=most.x {
            for y in least.y..=most.y {
                (least.z..=most.z).for_each(|z| cells.entry(IVec3::new(x, y, z)).or_default().push(index));
            }
        }
    }
    let around = |vertex: &Vec3| {
        let near = cells.get(&cell(*vertex)).into_iter().flatten();
        vertex_id(*vertex, near.filter_map(|index| gaussians.get(*index)))
    };
    vertices.par_iter().map(around).collect()
}

fn reach(gaussian: &MapGaussian) -> f32 {
    (REACH_IN_RADII * gaussian.radius).max(REACH_M.0).min(REACH_M.1)
}

fn cell(point: Vec3) -> IVec3 {
    (point / CELL_M).floor().as_ivec3()
}

fn vertex_id<'g>(vertex: Vec3, near: impl Iterator<Item = &'g MapGaussian>) -> VertexId {
    let (mut weights, mut sum): (Vec<(SegmentId, f32)>, f32) = (Vec::new(), 0.0);
    let (mut color, mut all) = (Vec3::ZERO, 0.0);
    for gaussian in near {
        let nearness = 1.0 - gaussian.mean.distance(vertex) / reach(gaussian);
        if nearness.is_nan() || nearness <= 0.0 {
            continue;
        }
        color += nearness * Vec3::from_array(gaussian.color.map(f32::from));
        all += nearness;
        let weight = gaussian.confidence * nearness;
        if weight.is_nan() || weight <= 0.0 {
            continue;
        }
        sum += weight;
        match weights.iter_mut().find(|(id, _)| *id == gaussian.segment_id) {
            Some((_, total)) => *total += weight,
            None => weights.push((gaussian.segment_id, weight)),
        }
    }
    // Ties go to the lowest id.
    let best = weights.into_iter().max_by(|left, right| left.1.total_cmp(&right.1).then(right.0.cmp(&left.0)));
    let (id, confidence) = best.map_or((0, 0.0), |(id, weight)| (id, weight / sum));
    let color = (all > 0.0).then(|| (color / all).to_array().map(|channel| channel.round() as u8));
    VertexId { id, confidence, color }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaussian(x: f32, segment_id: SegmentId, confidence: f32) -> MapGaussian {
        MapGaussian { mean: Vec3::new(x, 0.0, 0.0), radius: 0.01, color: [segment_id as u8; 3], segment_id, confidence }
    }

    #[test]
    fn near_and_sure_gaussians_count_most() {
        let gaussians = [gaussian(0.0, 7, 1.0), gaussian(0.04, 9, 1.0), gaussian(0.1, 9, 0.5), gaussian(0.1, 7, 0.6)];
        let at = |x: f32| vertex_ids(&gaussians, &[Vec3::new(x, 0.0, 0.0)])[0];
        assert_eq!([0.01, 0.03, 0.1, -0.049].map(|x| at(x).id), [7, 9, 7, 7]);
        assert_eq!(at(-0.051), VertexId::default());
        assert!((at(0.1).confidence - 0.6 / 1.1).abs() < 1e-6);
        assert_eq!(at(0.0).confidence, 1.0 / 1.2);
        // Nine colours of 7 and 9, weighted by distance; one without an id has a colour, too.
        assert_eq!((at(0.0).color, at(0.02).color), (Some([7; 3]), Some([8; 3])));
        let without = [gaussian(0.0, 0, 0.0)];
        assert_eq!(vertex_ids(&without, &[Vec3::ZERO])[0], VertexId { color: Some([0; 3]), ..VertexId::default() });
        assert_eq!(vertex_ids(&[], &[Vec3::ZERO, Vec3::MAX]).len(), 2);
    }
}

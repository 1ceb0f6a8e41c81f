//! Scores the 3D instances of a memory against the true instances of a mesh's vertices.

use glam::{DVec3, Vec3};
use splatseg_annotations::{read_mesh_vertices, read_vertex_instances};
use splatseg_dataset::DatasetError;
use splatseg_geometry::{MapGaussian, SegmentId};
use splatseg_metrics::{InstanceScorer, MetricsError, PredictedInstance};
use splatseg_objects::{VertexId, vertex_ids};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The vertices of a mesh and their true instances.
#[derive(Clone, Debug)]
pub struct MeshTruth {
    /// World coordinates, metres.
    vertices: Vec<DVec3>,
    /// Instance of each vertex, 0 if unlabelled.
    instances: Vec<SegmentId>,
}

/// The result of scoring a memory on a mesh.
#[derive(Clone, Debug)]
pub struct MeshScore {
    /// The matches, which can be merged with other scenes' matches.
    pub scorer: InstanceScorer,
    /// Number of vertices that no Gaussian reaches.
    pub unseen_vertices: usize,
    /// Number of predicted instances.
    pub predicted_instances: usize,
}

impl MeshTruth {
    /// Reads a mesh (binary PLY) and the text file with the instance of each vertex, see
    /// [`splatseg_annotations::read_vertex_instances`].
    ///
    /// # Errors
    /// If a file cannot be read, or the two files do not match.
    pub fn read(mesh: &Path, instances: &Path, void_labels: &[u64]) -> Result<Self, DatasetError> {
        let vertices = read_mesh_vertices(mesh)?;
        let instances = read_vertex_instances(instances, vertices.len(), void_labels)?;
        Ok(Self { vertices, instances })
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// Number of true instances.
    pub fn instance_count(&self) -> usize {
        self.instances.iter().filter(|id| **id != 0).collect::<BTreeSet<_>>().len()
    }

    /// Transfers the ids of a memory's Gaussians to the vertices, and scores them as instances. The Gaussians' positions
    /// are relative to `origin`.
    ///
    /// # Errors
    /// If an instance has a vertex index out of range (unreachable).
    pub fn score(&self, gaussians: &[MapGaussian], origin: DVec3) -> Result<MeshScore, MetricsError> {
        let vertices: Vec<Vec3> = self.vertices.iter().map(|vertex| (*vertex - origin).as_vec3()).collect();
        let ids = vertex_ids(gaussians, &vertices);
        let predictions = group_instances(&ids);
        let mut scorer = InstanceScorer::default();
        scorer.add_scene(&self.instances, &predictions)?;
        let unseen_vertices = ids.iter().filter(|found| found.color.is_none()).count();
        Ok(MeshScore { scorer, unseen_vertices, predicted_instances: predictions.len() })
    }
}

/// Groups vertices by id into instances. An instance's confidence is the mean of its vertices' confidences.
fn group_instances(ids: &[VertexId]) -> Vec<PredictedInstance> {
    let mut instances: BTreeMap<SegmentId, (Vec<usize>, f64)> = BTreeMap::new();
    for (vertex, found) in ids.iter().enumerate().filter(|(_, found)| found.id != 0) {
        let (vertices, sum) = instances.entry(found.id).or_default();
        vertices.push(vertex);
        *sum += f64::from(found.confidence);
    }
    let instance = |(vertices, sum): (Vec<usize>, f64)| {
        let confidence = (sum / vertices.len() as f64) as f32;
        PredictedInstance { confidence, vertices }
    };
    instances.into_values().map(instance).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_whose_gaussians_have_no_id_are_seen() {
        let vertices = [0.0, 1.0, 2.0].map(|x| DVec3::new(x, 0.0, 0.0)).to_vec();
        let truth = MeshTruth { vertices, instances: vec![1, 1, 1] };
        let gaussian = |x: f32, segment_id: SegmentId, confidence: f32| MapGaussian {
            mean: Vec3::new(x, 0.0, 0.0),
            radius: 0.01,
            color: [90; 3],
            segment_id,
            confidence,
        };
        // Nothing is known of the second one yet, and none is at the last vertex.
        let found = truth.score(&[gaussian(0.0, 4, 1.0), gaussian(1.0, 0, 0.0)], DVec3::ZERO).unwrap();
        assert_eq!((found.unseen_vertices, found.predicted_instances), (1, 1));
    }
}

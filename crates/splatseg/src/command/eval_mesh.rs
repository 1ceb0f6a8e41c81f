//! `splatseg eval --mesh`: 3D instances of a saved memory against those of a mesh's vertices.

use super::Failure;
use super::eval::EvalArguments;
use super::terminal::counted;
use serde::Serialize;
use splatseg_dataset::{read_mesh_vertices, read_vertex_instances};
use splatseg_geometry::SegmentId;
use splatseg_memory::{ExportedGaussian, SplatFile};
use splatseg_metrics::{InstanceScorer, PredictedInstance};
use splatseg_objects::{VertexId, vertex_ids};
use splatseg_output::write_atomically;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// What `--json` writes. Its keys are part of the interface.
#[derive(Debug, Serialize)]
struct MeshEvaluation {
    ap: Option<f64>,
    ap50: Option<f64>,
    ap25: Option<f64>,
    mesh: String,
    predictions: String,
    vertices: usize,
    /// Vertices that no Gaussian reaches.
    unseen_vertices: usize,
    true_instances: usize,
    predicted_instances: usize,
    version: &'static str,
}

/// Does what `splatseg eval --mesh` asks for.
pub fn eval_mesh(arguments: &EvalArguments, mesh: &Path, instances: &Path) -> Result<(), Failure> {
    arguments.memory_limit()?.enforce();
    let vertices = read_mesh_vertices(mesh).map_err(Failure::input)?;
    let truth = read_vertex_instances(instances, vertices.len(), &arguments.void_labels).map_err(Failure::input)?;
    let gaussians: Vec<ExportedGaussian> =
        SplatFile::load(&arguments.pred).map_err(Failure::input)?.gaussians().collect();
    let ids = vertex_ids(&gaussians, &vertices);
    let predictions = instances_of(&ids);
    let mut scorer = InstanceScorer::default();
    scorer.add_scene(&truth, &predictions).map_err(Failure::input)?;
    let scores = scorer.scores();
    let true_ids: BTreeSet<SegmentId> = truth.into_iter().filter(|id| *id != 0).collect();
    let evaluation = MeshEvaluation {
        ap: scores.ap,
        ap50: scores.ap50,
        ap25: scores.ap25,
        mesh: mesh.display().to_string(),
        predictions: arguments.pred.display().to_string(),
        vertices: vertices.len(),
        unseen_vertices: ids.iter().filter(|found| found.confidence == 0.0).count(),
        true_instances: true_ids.len(),
        predicted_instances: predictions.len(),
        version: env!("CARGO_PKG_VERSION"),
    };
    print(&evaluation);
    let Some(path) = &arguments.json else { return Ok(()) };
    let text = serde_json::to_vec_pretty(&evaluation).map_err(Failure::work)?;
    write_atomically(path, &text).map_err(Failure::work)
}

/// The instances of vertices with ids; each is as sure as its vertices are in the mean.
fn instances_of(ids: &[VertexId]) -> Vec<PredictedInstance> {
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

fn print(found: &MeshEvaluation) {
    let percent = |score: Option<f64>| score.map_or("-".to_owned(), |score| format!("{score:.2}"));
    say!(
        "{}: {} vertices, {} of them reached by no Gaussian; {}, {} predicted",
        found.mesh,
        found.vertices,
        found.unseen_vertices,
        counted(found.true_instances, "true instance"),
        found.predicted_instances
    );
    say!(
        "class-agnostic, percent: AP {}, AP50 {}, AP25 {}",
        percent(found.ap),
        percent(found.ap50),
        percent(found.ap25)
    );
}

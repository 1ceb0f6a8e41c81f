//! `splatseg eval --mesh`: scores the 3D instances of a saved memory against the true instances of a mesh's vertices.

use super::Failure;
use super::eval::EvalArguments;
use super::terminal::counted;
use serde::Serialize;
use splatseg::evaluation::MeshTruth;
use splatseg_geometry::MapGaussian;
use splatseg_memory::SplatFile;
use std::path::Path;

/// Content of the `--json` file. Its keys are part of the interface.
#[derive(Debug, Serialize)]
struct MeshEvaluation {
    ap: Option<f64>,
    ap50: Option<f64>,
    ap25: Option<f64>,
    mesh: String,
    predictions: String,
    vertices: usize,
    /// Number of vertices that no Gaussian reaches.
    unseen_vertices: usize,
    true_instances: usize,
    predicted_instances: usize,
    version: &'static str,
}

/// Executes `splatseg eval --mesh`.
pub fn eval_mesh(arguments: &EvalArguments, mesh: &Path, instances: &Path) -> Result<(), Failure> {
    arguments.memory_limit()?.enforce();
    let truth = MeshTruth::read(mesh, instances, &arguments.void_labels).map_err(Failure::input)?;
    let file = SplatFile::load(&arguments.pred).map_err(Failure::input)?;
    let gaussians: Vec<MapGaussian> = file.gaussians().collect();
    let found = truth.score(&gaussians, file.origin).map_err(Failure::input)?;
    let scores = found.scorer.scores();
    let evaluation = MeshEvaluation {
        ap: scores.ap,
        ap50: scores.ap50,
        ap25: scores.ap25,
        mesh: mesh.display().to_string(),
        predictions: arguments.pred.display().to_string(),
        vertices: truth.vertex_count(),
        unseen_vertices: found.unseen_vertices,
        true_instances: truth.instance_count(),
        predicted_instances: found.predicted_instances,
        version: env!("CARGO_PKG_VERSION"),
    };
    if arguments.prints_tables() {
        print(&evaluation);
    }
    arguments.write_json(&evaluation)
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

//! Meshes with true instances, for scoring a memory's ids in 3D.

use crate::Failure;
use clap::Args;
use serde::{Deserialize, Serialize};
use splatseg::evaluation::MeshTruth;
use splatseg_geometry::MapView;
use splatseg_metrics::InstanceScorer;
use std::path::{Path, PathBuf};

/// Suffixes of a mesh's file name after the scene's name.
const MESH_ENDINGS: [&str; 2] = ["_vh_clean_2.ply", ".ply"];

/// Options for meshes, like those of `eval --mesh` but for many scenes.
#[derive(Clone, Debug, Default, Args)]
pub struct MeshOptions {
    /// Also score 3D instances on the vertices of the scenes' meshes: AP, AP50 and AP25 of methods with a memory. DIR contains
    /// <scene>.txt, the true instance of each vertex as in `eval --instances`; the mesh is <scene>_vh_clean_2.ply (or
    /// <scene>.ply) beside it or in the scene's folder
    #[arg(long, value_name = "DIR")]
    pub instances: Option<PathBuf>,
    /// With --instances: labels without instances, e.g. wall and floor: 1,2 with ScanNet's 40 labels, 1,3 with its 200
    #[arg(long, value_name = "LABEL,…", value_delimiter = ',', requires = "instances")]
    pub void_labels: Vec<u64>,
}

/// A mesh and the true instances of its vertices.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshFiles {
    /// The mesh, a binary PLY.
    mesh: PathBuf,
    /// The text file with the instance of each vertex.
    instances: PathBuf,
    /// Labels without instances.
    void_labels: Vec<u64>,
}

impl MeshOptions {
    /// Returns the mesh of a scene, or `None` if the scene has no true instances.
    ///
    /// # Errors
    /// If the scene has true instances but no mesh.
    pub fn of_scene(&self, scene: &Path, name: &str) -> Result<Option<MeshFiles>, Failure> {
        let Some(folder) = &self.instances else { return Ok(None) };
        if !folder.is_dir() {
            return Err(Failure::input(format!("--instances: {}: expected a folder", folder.display())));
        }
        let instances = folder.join(format!("{name}.txt"));
        if !instances.is_file() {
            return Ok(None);
        }
        let of_scene = if scene.is_dir() { Some(scene) } else { scene.parent() };
        let places = [Some(folder.as_path()), of_scene].into_iter().flatten();
        let mut meshes = places.flat_map(|place| MESH_ENDINGS.map(|ending| place.join(format!("{name}{ending}"))));
        let mesh = meshes.find(|mesh| mesh.is_file()).ok_or_else(|| {
            Failure::input(format!(
                "{}: there is no mesh for it: expected {name}_vh_clean_2.ply beside it or in the scene's folder",
                instances.display()
            ))
        })?;
        Ok(Some(MeshFiles { mesh, instances, void_labels: self.void_labels.clone() }))
    }
}

impl MeshFiles {
    /// Paths of the two files.
    pub fn paths(&self) -> Vec<PathBuf> {
        vec![self.mesh.clone(), self.instances.clone()]
    }

    /// Scores the ids of a memory on the mesh.
    pub fn score(&self, map: &MapView<'_>) -> Result<InstanceScorer, String> {
        let truth =
            MeshTruth::read(&self.mesh, &self.instances, &self.void_labels).map_err(|error| error.to_string())?;
        let found = truth.score(&map.gaussians(), map.origin).map_err(|error| error.to_string())?;
        Ok(found.scorer)
    }
}

//! `splatseg export --as mesh`: a triangle mesh of a saved memory, whole or by object, as PLY or binary glTF.

use super::Failure;
use super::export::{Color, ExportArguments, NO_OBJECT, Places, Wait, check_ids};
use super::file_kind::FileKind;
use super::input_paths::real_path;
use super::options::memory_limit;
use super::terminal::counted;
use clap::Args;
use glam::Vec3;
use splatseg::pipeline::NamedMap;
use splatseg_files::{AtomicFile, sync_file_system};
use splatseg_geometry::{SegmentId, UpEstimate};
use splatseg_mesh::{GltfObject, MeshSettings, TriangleMesh, reconstruct, write_glb, write_ply};
use splatseg_odometry::{KeyframeView, keyframe_views};
use splatseg_output::segment_color;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Options of a mesh.
#[derive(Clone, Debug, Default, Args)]
pub struct MeshOptions {
    /// With --as mesh: side of a voxel, metres. By default 0.015, or larger if that does not fit into the memory limit
    #[arg(long, value_name = "METRES")]
    pub voxel: Option<f32>,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

impl MeshOptions {
    /// Refuses options of a mesh where none is written.
    pub fn require_none(&self) -> Result<(), Failure> {
        match self.voxel {
            Some(_) => Err(Failure::input("--voxel: is for --as mesh")),
            None => Ok(()),
        }
    }
}

/// A mesh with what its files need.
struct Export {
    places: Places,
    mesh: TriangleMesh,
    /// Unit vector in world coordinates.
    up: Vec3,
    objects: BTreeMap<SegmentId, GltfObject>,
}

/// Writes the files.
pub fn export_mesh(arguments: &ExportArguments) -> Result<(), Failure> {
    if arguments.min_confidence > 0.0 {
        return Err(Failure::input("--min-confidence: is for Gaussians and points, not for a mesh"));
    }
    let settings = MeshSettings { voxel: arguments.mesh.voxel };
    settings.validate().map_err(|error| Failure::input(format!("--{error}")))?;
    memory_limit(arguments.mesh.memory_limit.as_ref())?.enforce();
    let places = Places::new(arguments);
    if let Some(out) = &arguments.out {
        places.check(out, kind_of(out))?;
    }
    let mut export = reconstructed(arguments, places, &settings)?;
    select(arguments, &mut export.mesh)?;
    let parts = export.mesh.triangles_by_object();
    let object_files = object_files(arguments, &export, parts.keys().copied())?;
    if arguments.color == Color::Id {
        color_by_id(&mut export.mesh);
    }
    let amount = |triangles: usize, objects: usize| {
        format!("{} of {}", counted(triangles, "triangle"), counted(objects, "object"))
    };
    let objects = parts.keys().filter(|id| **id != 0).count();
    if let Some(out) = &arguments.out {
        export.write(out, &export.mesh, Wait::ForDisk)?;
        report!("{}: {}", out.display(), amount(export.mesh.triangles.len(), objects));
    }
    if let Some(folder) = &arguments.object_files {
        let mut triangles = 0;
        for (id, path) in &object_files {
            let part = export.mesh.part(&parts[id]);
            triangles += part.triangles.len();
            export.write(path, &part, Wait::Not)?;
        }
        sync_file_system(folder)
            .map_err(|error| Failure::runtime(format!("{}: cannot be written: {error}", folder.display())))?;
        let files = counted(object_files.len(), "file");
        report!("{}: {files}, {}", folder.display(), amount(triangles, object_files.len()));
    }
    Ok(())
}

/// Loads the map and makes its mesh.
fn reconstructed(arguments: &ExportArguments, places: Places, settings: &MeshSettings) -> Result<Export, Failure> {
    let map = NamedMap::load(&arguments.map).map_err(Failure::input)?;
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", arguments.map.display()));
    let missing = "has no keyframes, whose depth shows the surfaces: save it again with this version";
    let keyframes = map.keyframes.as_ref().ok_or_else(|| wrong(missing.to_owned()))?;
    let keyframes = keyframe_views(keyframes, None).map_err(|error| wrong(error.to_string()))?;
    let mesh = reconstruct(&map.memory.map(), &keyframes, settings).map_err(|error| wrong(error.to_string()))?;
    let label = |id: &SegmentId| map.names.name(*id).and_then(|name| name.label.clone());
    let objects = mesh.object_ids().into_iter().map(|id| (id, GltfObject { label: label(&id) })).collect();
    Ok(Export { places, mesh, up: up_of(&keyframes), objects })
}

/// Where up is, as the cameras were held.
fn up_of(keyframes: &[KeyframeView]) -> Vec3 {
    UpEstimate::of(keyframes.iter().map(|keyframe| &keyframe.world_from_camera)).unwrap_or(Vec3::Z)
}

/// Keeps the triangles of the selected objects.
fn select(arguments: &ExportArguments, mesh: &mut TriangleMesh) -> Result<(), Failure> {
    if arguments.id.is_empty() {
        return Ok(());
    }
    check_ids(arguments, "surface", &mesh.object_ids())?;
    let wanted: BTreeSet<SegmentId> = arguments.id.iter().copied().collect();
    let triangles: Vec<[u32; 3]> =
        mesh.triangles.iter().filter(|triangle| wanted.contains(&mesh.triangle_id(**triangle))).copied().collect();
    *mesh = mesh.part(&triangles);
    Ok(())
}

/// The checked file of each object.
fn object_files(
    arguments: &ExportArguments,
    export: &Export,
    ids: impl Iterator<Item = SegmentId>,
) -> Result<Vec<(SegmentId, PathBuf)>, Failure> {
    let Some(folder) = &arguments.object_files else { return Ok(Vec::new()) };
    let end = if arguments.out.as_ref().is_some_and(|out| is_gltf(out)) { "glb" } else { "ply" };
    let files: Vec<(SegmentId, PathBuf)> =
        ids.filter(|id| *id != 0).map(|id| (id, folder.join(format!("{id}.{end}")))).collect();
    if files.is_empty() {
        return Err(Failure::input(format!("{}: none of its surfaces shows an object", arguments.map.display())));
    }
    for (id, path) in &files {
        export.places.check(path, kind_of(path).with_option("--object-files"))?;
        if arguments.out.as_ref().is_some_and(|out| real_path(out) == real_path(path)) {
            return Err(Failure::input(format!("{}: is also the file of object {id}: choose another", path.display())));
        }
    }
    Ok(files)
}

fn color_by_id(mesh: &mut TriangleMesh) {
    for (color, id) in mesh.colors.iter_mut().zip(&mesh.ids) {
        *color = if *id == 0 { NO_OBJECT } else { segment_color(*id) };
    }
}

/// True for the names of binary glTF files.
fn is_gltf(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb"))
}

fn kind_of(path: &Path) -> FileKind {
    if is_gltf(path) { FileKind::GLTF } else { FileKind::MESH }
}

impl Export {
    fn write(&self, path: &Path, mesh: &TriangleMesh, wait: Wait) -> Result<(), Failure> {
        self.places.write_with(path, wait, |file: &mut AtomicFile| {
            if is_gltf(path) { write_glb(mesh, self.up, &self.objects, file) } else { write_ply(mesh, file) }
        })
    }
}

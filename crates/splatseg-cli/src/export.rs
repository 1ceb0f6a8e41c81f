//! `splatseg export`: writes the objects of a saved memory as PLY files for other programs.

use super::Failure;
use super::export_mesh::{MeshOptions, export_mesh};
use super::export_plan::{PlanOptions, export_plan};
use super::export_scene_graph::export_scene_graph;
use super::file_kind::FileKind;
use super::input_paths::{InputPaths, real_path};
use super::output_folder::{CreatedFolders, OverwritePolicy};
use super::terminal::counted;
use clap::{Args, ValueEnum};
use glam::DVec3;
use splatseg_files::{AtomicFile, sync_file_system};
use splatseg_geometry::{MapGaussian, SegmentId, SurfaceKind};
use splatseg_memory::{ExportedForm, SplatFile, write_exported};
use splatseg_output::segment_color;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Colour of Gaussians without an object when objects are coloured by id.
pub const NO_OBJECT: [u8; 3] = [128; 3];
/// Maximum number of id ranges listed in a message.
const RANGES_IN_MESSAGES: usize = 20;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg export map.ply --out objects.ply --color id --as points\n  \
    splatseg export map.ply --id 7,9 --out two.ply\n  \
    splatseg export map.ply --object-files objects --min-confidence 0.7\n  \
    splatseg export map.ply --as mesh --out home.glb\n  \
    splatseg export map.ply --as scene-graph --out home.json\n  \
    splatseg export map.ply --as occupancy --out floor          # floor.pgm and floor.yaml for map_server and Nav2")]
pub struct ExportArguments {
    /// A memory saved by `run --save-memory`
    pub map: PathBuf,
    /// The file to write; a mesh is written as glTF if the name ends in .glb; with --as occupancy, the names of the files
    /// without their endings
    #[arg(long, value_name = "FILE.ply", required_unless_present = "object_files")]
    pub out: Option<PathBuf>,
    /// Folder for one file per object, named after its id: 7.ply, or 7.glb if --out is a .glb file
    #[arg(long, value_name = "DIR")]
    pub object_files: Option<PathBuf>,
    /// Only these objects; by default all, and in --out also what shows no object
    #[arg(long, value_name = "ID,…", value_delimiter = ',')]
    pub id: Vec<SegmentId>,
    /// Colours of what is written
    #[arg(long, value_enum, default_value_t = Color::True)]
    pub color: Color,
    /// Form of the output
    #[arg(long = "as", value_enum, default_value_t = Form::Gaussians)]
    pub form: Form,
    /// Leave out Gaussians with a lower confidence in their object, from 0 to 1
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    pub min_confidence: f32,
    /// Replace existing files of the same kind
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    pub mesh: MeshOptions,
    #[command(flatten, next_help_heading = "Options of --as occupancy")]
    pub plan: PlanOptions,
}

/// Colours of the exported Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// As seen by the camera
    True,
    /// By object, as in overlays; grey without an object
    Id,
}

/// Form of what is exported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Form {
    /// 3D Gaussian splatting, for splat viewers
    Gaussians,
    /// A point cloud, for all other programs
    Points,
    /// A triangle mesh of the surfaces, from the depth of the map's keyframes
    Mesh,
    /// Rooms, objects and their relations, as JSON
    SceneGraph,
    /// Free space on the floor for robots: map_server's image and YAML, a picture, and JSON with rooms and footprints
    Occupancy,
}

/// Writes the files.
pub fn export(arguments: &ExportArguments) -> Result<(), Failure> {
    let min_confidence = arguments.min_confidence;
    if !(0.0..=1.0).contains(&min_confidence) {
        return Err(Failure::input(format!("--min-confidence: found {min_confidence}, expected a number from 0 to 1")));
    }
    if arguments.form != Form::Mesh {
        arguments.mesh.require_none()?;
    }
    if arguments.form != Form::Occupancy {
        arguments.plan.require_none()?;
    }
    match arguments.form {
        Form::Mesh => return export_mesh(arguments),
        Form::SceneGraph => return export_scene_graph(arguments),
        Form::Occupancy => return export_plan(arguments),
        Form::Gaussians | Form::Points => {}
    }
    let places = Places::new(arguments);
    if let Some(out) = &arguments.out {
        places.check(out, FileKind::EXPORTED)?;
    }
    let file = SplatFile::load(&arguments.map).map_err(Failure::input)?;
    let mut gaussians = exported(&file, arguments)?;
    let origin = file.origin;
    drop(file);
    select(arguments, &mut gaussians)?;
    if arguments.color == Color::Id {
        for gaussian in &mut gaussians {
            gaussian.color = if gaussian.segment_id == 0 { NO_OBJECT } else { segment_color(gaussian.segment_id) };
        }
    }
    let objects = object_ids(&gaussians);
    let object_files: Vec<(SegmentId, PathBuf)> = match &arguments.object_files {
        Some(folder) => objects.iter().map(|id| (*id, folder.join(format!("{id}.ply")))).collect(),
        None => Vec::new(),
    };
    if arguments.object_files.is_some() && object_files.is_empty() {
        return Err(Failure::input(format!("{}: none of the Gaussians left shows an object", arguments.map.display())));
    }
    for (id, path) in &object_files {
        places.check(path, FileKind::EXPORTED.with_option("--object-files"))?;
        if arguments.out.as_ref().is_some_and(|out| real_path(out) == real_path(path)) {
            return Err(Failure::input(format!("{}: is also the file of object {id}: choose another", path.display())));
        }
    }
    let amount = |gaussians: usize, objects: usize| {
        let thing = if arguments.form == Form::Points { "point" } else { "Gaussian" };
        format!("{} of {}", counted(gaussians, thing), counted(objects, "object"))
    };
    if let Some(out) = &arguments.out {
        places.write(out, arguments.form, origin, &gaussians, Wait::ForDisk)?;
        report!("{}: {}", out.display(), amount(gaussians.len(), objects.len()));
    }
    if let Some(folder) = &arguments.object_files {
        gaussians.retain(|gaussian| gaussian.segment_id != 0);
        // A stable sort keeps the map's order within an object.
        gaussians.sort_by_key(|gaussian| gaussian.segment_id);
        let parts = gaussians.chunk_by(|a, b| a.segment_id == b.segment_id);
        for ((_, path), part) in object_files.iter().zip(parts) {
            places.write(path, arguments.form, origin, part, Wait::Not)?;
        }
        // Once, as there can be thousands of files.
        sync_file_system(folder)
            .map_err(|error| Failure::runtime(format!("{}: cannot be written: {error}", folder.display())))?;
        report!("{}: {}, {}", folder.display(), counted(objects.len(), "file"), amount(gaussians.len(), objects.len()));
    }
    Ok(())
}

/// The Gaussians of a file; as points only those that have a place.
fn exported(file: &SplatFile, arguments: &ExportArguments) -> Result<Vec<MapGaussian>, Failure> {
    let map = arguments.map.display();
    let surfaces = file.surfaces().map_err(|error| Failure::input(format!("{map}: {error}")))?;
    let is_wanted = |surface: &SurfaceKind| arguments.form == Form::Gaussians || surface.has_place();
    let all = file.gaussians().zip(surfaces);
    let wanted: Vec<MapGaussian> = all.filter(|(_, surface)| is_wanted(surface)).map(|(one, _)| one).collect();
    let left_out = file.segment_ids.len() - wanted.len();
    if left_out > 0 {
        say_error!("left out: {} without depth, whose distance is not known", counted(left_out, "Gaussian"));
    }
    Ok(wanted)
}

/// Checks that all selected objects are among those that are known. `what` shows them.
pub fn check_ids(arguments: &ExportArguments, what: &str, known: &BTreeSet<SegmentId>) -> Result<(), Failure> {
    let unknown: BTreeSet<SegmentId> = arguments.id.iter().filter(|id| !known.contains(id)).copied().collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let (ids, are) =
        if known.is_empty() { ("no objects".to_owned(), "there are") } else { (ranges(known), "the ids are") };
    let map = arguments.map.display();
    Err(Failure::input(format!("{map}: no {what} shows object {}; {are} {ids}", ranges(&unknown))))
}

/// Keeps the selected Gaussians.
fn select(arguments: &ExportArguments, gaussians: &mut Vec<MapGaussian>) -> Result<(), Failure> {
    let map = arguments.map.display();
    check_ids(arguments, "Gaussian", &object_ids(gaussians))?;
    if !arguments.id.is_empty() {
        let wanted: BTreeSet<SegmentId> = arguments.id.iter().copied().collect();
        gaussians.retain(|gaussian| wanted.contains(&gaussian.segment_id));
    }
    let before = object_ids(gaussians);
    let surest = gaussians.iter().map(|gaussian| gaussian.confidence).fold(0.0, f32::max);
    gaussians.retain(|gaussian| gaussian.confidence >= arguments.min_confidence);
    if gaussians.is_empty() {
        return Err(Failure::input(format!(
            "{map}: no Gaussian is left with --min-confidence {}: the largest confidence is {surest:.3}",
            arguments.min_confidence
        )));
    }
    let left_out: BTreeSet<SegmentId> = before.difference(&object_ids(gaussians)).copied().collect();
    if !left_out.is_empty() {
        say_error!("left out: object {}, which no Gaussian shows with that confidence", ranges(&left_out));
    }
    Ok(())
}

/// Returns the objects that Gaussians show.
fn object_ids(gaussians: &[MapGaussian]) -> BTreeSet<SegmentId> {
    gaussians.iter().map(|gaussian| gaussian.segment_id).filter(|id| *id != 0).collect()
}

/// Formats ids as ranges: `1 to 5, 7, 9`.
fn ranges(ids: &BTreeSet<SegmentId>) -> String {
    let ids: Vec<SegmentId> = ids.iter().copied().collect();
    let range = |range: &[SegmentId]| match range {
        [first, .., last] if range.len() > 2 => format!("{first} to {last}"),
        _ => range.iter().map(SegmentId::to_string).collect::<Vec<_>>().join(", "),
    };
    let mut words: Vec<String> = ids.chunk_by(|a, b| a.checked_add(1) == Some(*b)).map(range).collect();
    if words.len() > RANGES_IN_MESSAGES {
        words.truncate(RANGES_IN_MESSAGES);
        words.push("…".to_owned());
    }
    words.join(", ")
}

/// Whether a file is on the disk when it has been written.
#[derive(Clone, Copy)]
pub enum Wait {
    ForDisk,
    Not,
}

/// Checks where files may be written, and writes them.
pub struct Places {
    inputs: InputPaths,
    existing: OverwritePolicy,
}

impl Places {
    pub fn new(arguments: &ExportArguments) -> Self {
        let mut inputs = InputPaths::default();
        inputs.add("the map", &arguments.map);
        Self { inputs, existing: OverwritePolicy::from_flag(arguments.overwrite) }
    }

    /// Checks that a file may be written, and replaces at most one of its kind.
    pub fn check(&self, path: &Path, kind: FileKind) -> Result<(), Failure> {
        self.inputs.check_output_file(path)?;
        kind.check(path, self.existing)
    }

    /// Writes Gaussians to a checked file, and creates its folder.
    fn write(
        &self,
        path: &Path,
        form: Form,
        origin: DVec3,
        gaussians: &[MapGaussian],
        wait: Wait,
    ) -> Result<(), Failure> {
        let form = if form == Form::Points { ExportedForm::Points } else { ExportedForm::Gaussians };
        self.write_with(path, wait, |file| write_exported(form, origin, gaussians, file))
    }

    /// Writes a checked file, and creates its folder.
    pub fn write_with(
        &self,
        path: &Path,
        wait: Wait,
        write: impl FnOnce(&mut AtomicFile) -> std::io::Result<()>,
    ) -> Result<(), Failure> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let written = CreatedFolders::create(folder).and_then(|_created| {
            let mut file = AtomicFile::create(path)?;
            write(&mut file)?;
            file.flush()?;
            match (self.existing, wait) {
                (OverwritePolicy::Keep, Wait::ForDisk) => file.commit_new(),
                (OverwritePolicy::Keep, Wait::Not) => file.commit_new_unsynced(),
                (_, Wait::ForDisk) => file.commit(),
                (_, Wait::Not) => file.commit_unsynced(),
            }
        });
        written.map_err(|error| Failure::runtime(format!("{}: cannot be written: {error}", path.display())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_listed_in_ranges() {
        let text = |ids: &[SegmentId]| ranges(&ids.iter().copied().collect());
        assert_eq!(text(&[1, 2, 3, 4, 7, 9, 10]), "1 to 4, 7, 9, 10");
        assert_eq!(text(&[]), "");
        assert_eq!(text(&(0..60).map(|id| 2 * id).collect::<Vec<_>>()).matches(',').count(), RANGES_IN_MESSAGES);
    }
}

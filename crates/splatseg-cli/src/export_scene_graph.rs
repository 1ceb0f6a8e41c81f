//! `splatseg export --as scene-graph`: rooms, objects and relations of a saved memory, as JSON.

use super::Failure;
use super::export::{ExportArguments, Places, Wait};
use super::file_kind::FileKind;
use super::options::memory_limit;
use super::terminal::counted;
use splatseg::pipeline::NamedMap;
use std::io::Write;

/// Writes the file.
pub fn export_scene_graph(arguments: &ExportArguments) -> Result<(), Failure> {
    let refused = [
        ("--object-files", arguments.object_files.is_some()),
        ("--id", !arguments.id.is_empty()),
        ("--min-confidence", arguments.min_confidence > 0.0),
    ];
    if let Some((option, _)) = refused.iter().find(|(_, is_given)| *is_given) {
        return Err(Failure::input(format!("{option}: a scene graph has all objects that count")));
    }
    let Some(out) = &arguments.out else { return Err(Failure::input("--out: is needed for a scene graph")) };
    memory_limit(arguments.mesh.memory_limit.as_ref())?.enforce();
    let places = Places::new(arguments);
    places.check(out, FileKind::SCENE_GRAPH)?;
    let map = NamedMap::load(&arguments.map).map_err(Failure::input)?;
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", arguments.map.display()));
    let graph = map.scene_graph().map_err(|error| wrong(error.to_string()))?;
    if graph.up.is_none() {
        say_error!("warning: {} has no keyframes, which tell where up is: no relations", arguments.map.display());
    }
    let json = graph.to_json().map_err(Failure::runtime)?;
    places.write_with(out, Wait::ForDisk, |file| file.write_all(json.as_bytes()))?;
    let objects = counted(graph.objects.len(), "object");
    report!("{}: {objects}, {}", out.display(), counted(graph.relations.len(), "relation"));
    Ok(())
}

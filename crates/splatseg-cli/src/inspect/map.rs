//! `splatseg inspect MAP`: shows the objects of a saved memory.

use super::{InspectArguments, print_json};
use crate::Failure;
use crate::map_changes::described;
use serde::Serialize;
use splatseg::pipeline::NamedMap;
use splatseg_objects::{Object, ObjectCounts};
use std::path::Path;

/// Maximum number of objects listed without `--all`.
const LISTED: usize = 20;

/// The content of `--json`.
#[derive(Serialize)]
struct PrintedMap<'a> {
    file: &'a Path,
    kind: &'static str,
    gaussians: usize,
    has_keyframes: bool,
    counts: ObjectCounts,
    objects: &'a [Object],
    not_counted: &'a [Object],
}

/// Returns true if a path is that of a saved memory.
pub fn is_map(path: &Path) -> bool {
    path.is_file() && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ply"))
}

/// Prints how large the map is, and its objects, the largest surface first.
pub fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    let path = &arguments.file;
    let map = NamedMap::load(path).map_err(Failure::input)?;
    let mut list = map.objects_with_places().map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
    let gaussians = map.memory.map().gaussian_count();
    let has_keyframes = map.keyframes.is_some();
    if arguments.json {
        let counts = list.counts();
        let (objects, not_counted) = (list.objects.as_slice(), list.not_counted.as_slice());
        return print_json(&PrintedMap {
            file: path,
            kind: "map",
            gaussians,
            has_keyframes,
            counts,
            objects,
            not_counted,
        });
    }
    say!("file           {}", path.display());
    say!("kind           map, {gaussians} Gaussians");
    let keyframes = if has_keyframes { "saved: a later run finds its place in the map" } else { "none" };
    say!("keyframes      {keyframes}");
    say!("objects        {}", list.counts());
    if arguments.all {
        list = list.with_tentative();
    }
    let area = |object: &Object| object.shape.as_ref().map_or(0.0, |shape| shape.area_m2);
    let mut objects: Vec<&Object> = list.objects.iter().collect();
    objects.sort_by(|one, other| area(other).total_cmp(&area(one)).then(one.id.cmp(&other.id)));
    let listed = if arguments.all { objects.len() } else { objects.len().min(LISTED) };
    for object in &objects[..listed] {
        let label = object.label.as_ref().map(|label| format!(" {label}")).unwrap_or_default();
        let shape = object.shape.as_ref().map_or_else(|| "without depth".to_owned(), described);
        say!("  {}{label}: {shape}", object.id);
    }
    if listed < objects.len() {
        say!("  … and {} more (--all lists them)", objects.len() - listed);
    }
    Ok(())
}

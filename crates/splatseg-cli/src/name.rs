//! `splatseg name`: gives the objects and rooms of a saved memory names, by hand, from a file, or with a network.

use super::Failure;
use super::file_kind::FileKind;
use super::input_paths::real_path;
use super::output_folder::OverwritePolicy;
use super::terminal::counted;
use clap::Args;
use splatseg::names::ClipNames;
use splatseg::pipeline::NamedMap;
use splatseg_files::{read_file, text_of};
use splatseg_geometry::SegmentId;
use splatseg_objects::RoomNameSource;
use splatseg_places::{FloorPlan, PlanSettings};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Maximum size of a file of labels, bytes.
const MAX_LABELS_BYTES: u64 = 1 << 20;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg name map.ply                                    # lists the objects and their names\n  \
    splatseg name map.ply 15=mug 7=\"office chair\" 9=          # by hand; `9=` takes a label away\n  \
    splatseg name map.ply room:2=kitchen room:1=             # rooms, with the numbers of the list\n  \
    splatseg name map.ply merge:12=7                         # objects 7 and 12 are one: 7\n  \
    splatseg name map.ply --labels names.csv                 # lines of id,label\n  \
    splatseg name map.ply --names pe-core-s16.safetensors    # from the pictures in the map\n\n\
    The map is changed in place, unless --out names another file. No network replaces a label given by hand:\n\
    docs/NAMES.md. The name of a room belongs to the place where the room is, so that it stays when numbers change.")]
pub struct NameArguments {
    /// The map: a memory saved by `run --save-memory`, `live --map` or a program
    pub map: PathBuf,
    /// Labels by hand: the id of an object, or `room:` and the number of a room, `=`, and its label. `merge:12=7` makes
    /// objects 7 and 12 one, which keeps the lower id
    #[arg(value_name = "ID=LABEL")]
    pub given: Vec<String>,
    /// File of labels by hand: a line for each object or room, with id and label and a comma between, or `merge:12,7`; the
    /// page of a run saves one
    #[arg(long, value_name = "FILE.csv")]
    pub labels: Option<PathBuf>,
    /// Network for images and words: a .safetensors of CLIP or Perception Encoder
    #[arg(long, value_name = "FILE")]
    pub names: Option<PathBuf>,
    /// Labels to choose from, one in each line, by default about 670 household things
    #[arg(long, value_name = "FILE", requires = "names")]
    pub vocabulary: Option<PathBuf>,
    /// Least probability of a label that the network gives
    #[arg(long, value_name = "P", requires = "names")]
    pub min_score: Option<f64>,
    /// File for the named map; by default the map itself
    #[arg(long, value_name = "FILE.ply")]
    pub out: Option<PathBuf>,
    /// Replace the saved map in the file of --out
    #[arg(long, requires = "out")]
    pub overwrite: bool,
}

/// Loads a network for images and words.
pub fn open_network(network: &Path, vocabulary: Option<&Path>) -> Result<ClipNames, Failure> {
    let names = ClipNames::open(network, vocabulary).map_err(Failure::input)?;
    for assumed in &names.network().config().assumed {
        say_error!("{}: {assumed}", network.display());
    }
    Ok(names)
}

/// Names objects, and lists them.
pub fn name(arguments: &NameArguments) -> Result<(), Failure> {
    let path = &arguments.map;
    let mut labels = labels_of_file(arguments.labels.as_deref())?;
    for given in &arguments.given {
        labels.push(label(given, '=').map_err(Failure::input)?);
    }
    if let Some(score) = arguments.min_score.filter(|score| !(0.0..=1.0).contains(score)) {
        return Err(Failure::input(format!("--min-score: found {score}, expected 0 to 1")));
    }
    // The map itself is changed in place.
    if let Some(out) = arguments.out.as_ref().filter(|out| real_path(out) != real_path(path)) {
        FileKind::CHANGED_MAP.check(out, OverwritePolicy::from_flag(arguments.overwrite))?;
    }
    let mut map = NamedMap::load(path).map_err(Failure::input)?;
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let ids = map.memory.map().carried_ids();
    let unknown = |target: &Target| matches!(target, Target::Object(id) | Target::Merge(id) if !ids.contains(id));
    if let Some((Target::Object(id) | Target::Merge(id), _)) = labels.iter().find(|(target, _)| unknown(target)) {
        return Err(wrong(format!("found no object {id}, expected one of {}", listed(&ids))));
    }
    if let Some(network) = &arguments.names {
        let network = open_network(network, arguments.vocabulary.as_deref())?;
        let network = network.with_min_score(arguments.min_score.unwrap_or(ClipNames::MIN_SCORE));
        let named = map.name_from_keyframes(path, &network).map_err(Failure::input)?;
        if named == 0 {
            return Err(wrong("its keyframes show no object in colour, so the network has nothing to see".to_owned()));
        }
    }
    let plan = apply(&mut map, &labels).map_err(wrong)?;
    if arguments.names.is_some() || !labels.is_empty() {
        let out = arguments.out.as_ref().unwrap_or(path);
        map.save(out).map_err(Failure::runtime)?;
        inform!("{}: {} with a label", out.display(), counted(map.names.labels().count(), "object"));
    }
    list(&map, &map.memory.map().carried_ids());
    match plan {
        Some(mut plan) => {
            // Labels that were given after it may tell what a room is.
            plan.name_rooms(&map.names);
            list_rooms(&plan);
        }
        // A map without a floor has no rooms to list.
        None if labels.is_empty() && arguments.names.is_none() => floor_plan(&map).iter().for_each(list_rooms),
        None => {}
    }
    Ok(())
}

/// Changes a map as the labels say. Returns the plan of its rooms if that was needed.
fn apply(map: &mut NamedMap, labels: &[(Target, Option<String>)]) -> Result<Option<FloorPlan>, String> {
    let mut plan = None;
    for (target, label) in labels {
        let label = label.as_deref();
        match target {
            Target::Object(id) => {
                map.names.set_by_hand(*id, label).map_err(|error| format!("object {id}: {error}"))?;
            }
            Target::Merge(id) => {
                let other = merged_with(*id, label)?;
                map.merge_objects(&[*id, other]).map_err(|error| format!("merge:{id}: {error}"))?;
            }
            Target::Room(number) => {
                if plan.is_none() {
                    plan = Some(floor_plan(map)?);
                }
                if let Some(plan) = &mut plan {
                    map.name_room(plan, *number, label).map_err(|error| error.to_string())?;
                }
            }
        }
    }
    Ok(plan)
}

/// Target of a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Object(SegmentId),
    Room(u32),
    /// The object becomes one with that whose id is in the place of a label.
    Merge(SegmentId),
}

/// The id in the place of a label.
fn merged_with(id: SegmentId, label: Option<&str>) -> Result<SegmentId, String> {
    let label = label.unwrap_or_default();
    label
        .parse()
        .map_err(|_| format!("merge:{id}: found {label:?}, expected the id of another object, e.g. merge:{id}=7"))
}

fn floor_plan(map: &NamedMap) -> Result<FloorPlan, String> {
    map.floor_plan(PlanSettings::default()).map_err(|error| error.to_string())
}

/// Lists the rooms with their names and areas.
fn list_rooms(plan: &FloorPlan) {
    for room in plan.rooms() {
        let name = match (&room.name, room.name_source) {
            (Some(name), Some(RoomNameSource::Derived)) => format!("{name} (from its objects)"),
            (Some(name), _) => format!("{name} (by hand)"),
            (None, _) => "without a name".to_owned(),
        };
        say!("room:{} {name}, {:.1} m²", room.id, room.area_m2);
    }
}

/// Lists everything that has a label, and counts the objects without one.
fn list(map: &NamedMap, ids: &BTreeSet<SegmentId>) {
    let named = |id: SegmentId| map.names.name(id).filter(|name| name.label.is_some());
    for id in ids {
        let Some(name) = named(*id) else { continue };
        let score = match name.score {
            Some(score) => format!(" ({score:.2})"),
            None if name.by_hand => " (by hand)".to_owned(),
            None => String::new(),
        };
        say!("{id} {}{score}", name.label.as_deref().unwrap_or_default());
    }
    let unknown = map.object_list().objects.iter().filter(|object| named(object.id).is_none()).count();
    if unknown > 0 {
        say!("{} without a label: `splatseg inspect` lists all with their ids", counted(unknown, "object"));
    }
}

/// The labels in a file.
fn labels_of_file(path: Option<&Path>) -> Result<Vec<(Target, Option<String>)>, Failure> {
    let Some(path) = path else { return Ok(Vec::new()) };
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let bytes = read_file(path, MAX_LABELS_BYTES).map_err(|error| wrong(error.to_string()))?;
    let text = text_of(bytes).map_err(|error| wrong(error.to_string()))?;
    let lines = text.lines().enumerate().map(|(index, line)| (index, line.trim()));
    let mut labels = Vec::new();
    for (index, line) in lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        // A table may begin with names of its columns.
        if index == 0 && line.to_lowercase().starts_with("id,") {
            continue;
        }
        labels.push(label(line, ',').map_err(|problem| wrong(format!("line {}: {problem}", index + 1)))?);
    }
    Ok(labels)
}

/// An object or a room and its label, with a character between; without a label, that of before is taken away.
fn label(text: &str, between: char) -> Result<(Target, Option<String>), String> {
    let wrong = || {
        format!(
            "found {text:?}, expected the id of an object or of a room, {between:?} and a label, e.g. 15{between}mug"
        )
    };
    let (id, label) = text.split_once(between).ok_or_else(wrong)?;
    let id = id.trim().trim_matches('"');
    let target = match id.split_once(':') {
        Some(("room", number)) => number.parse().map(Target::Room),
        Some(("merge", id)) => id.parse().map(Target::Merge),
        _ => id.parse().map(Target::Object),
    };
    let label = label.trim();
    let label = label.strip_prefix('"').and_then(|label| label.strip_suffix('"')).unwrap_or(label);
    Ok((target.map_err(|_| wrong())?, (!label.is_empty()).then(|| label.replace("\"\"", "\""))))
}

/// The first ids, for a message.
fn listed(ids: &BTreeSet<SegmentId>) -> String {
    let first: Vec<String> = ids.iter().take(10).map(ToString::to_string).collect();
    let more = if ids.len() > first.len() { format!(" and {} more", ids.len() - first.len()) } else { String::new() };
    format!("{}{more}", first.join(", "))
}

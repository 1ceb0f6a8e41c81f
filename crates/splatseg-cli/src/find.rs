//! `splatseg find`: objects of a saved memory by words.

use super::Failure;
use super::map_changes::described;
use super::name::open_network;
use clap::Args;
use serde::Serialize;
use splatseg::names::{FoundObject, Query, find_objects};
use splatseg::pipeline::NamedMap;
use splatseg_objects::{ObjectList, ObjectNames, ObjectShape};
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Maximum number of labels listed when none fits.
const LABELS: usize = 20;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg find map.ply mug\n  \
    splatseg find map.ply \"the small red one\"\n  \
    splatseg find map.ply \"something to drink from\" --names pe-core-s16.safetensors --json\n  \
    splatseg find map.ply \"something to drink from\" --text-encoder ./clip_text.py\n\n\
    Labels come from `run --names`, `splatseg name`, or a function of yours: docs/NAMES.md. Words for colours and sizes\n\
    need none. With --names, objects are also compared with the text itself; those of a map that was saved without\n\
    names are first named from its keyframes.")]
pub struct FindArguments {
    /// The map: a memory saved by `run --save-memory`, `live --map` or a program
    pub map: PathBuf,
    /// What to find, e.g. `red mug`, `chairs` or `the largest one`
    pub text: String,
    /// Network for images and words, with which the objects were or are to be named
    #[arg(long, value_name = "FILE", conflicts_with = "text_encoder")]
    pub names: Option<PathBuf>,
    /// Program that prints the embedding of its argument, the text, as a JSON list of numbers; the objects most similar to
    /// it are found, whatever their labels
    #[arg(long, value_name = "PROGRAM")]
    pub text_encoder: Option<PathBuf>,
    /// Maximum number of objects
    #[arg(long, value_name = "N", default_value = "5")]
    pub top: NonZeroUsize,
    /// Also find tentative objects, which were seen in one frame only and may be mistakes
    #[arg(long)]
    pub all: bool,
    /// Print the objects as JSON: a list with id, label, score, and shape as in objects.json
    #[arg(long)]
    pub json: bool,
}

/// An object in the output of `--json`.
#[derive(Serialize)]
struct Printed<'a> {
    #[serde(flatten)]
    found: &'a FoundObject,
    color: Option<[u8; 3]>,
    shape: Option<&'a ObjectShape>,
}

/// Prints the objects that fit the text.
pub fn find(arguments: &FindArguments) -> Result<(), Failure> {
    let FindArguments { map: path, text, names: network, text_encoder, top, all, json } = arguments;
    let query = Query::new(text);
    let says_nothing = query.thing.is_empty() && query.color.is_none() && query.size.is_none();
    if text.trim().is_empty() || (says_nothing && network.is_none() && text_encoder.is_none()) {
        let expected = "expected a name, a colour or a size, e.g. \"red mug\"";
        return Err(Failure::input(format!("{text:?} says nothing of an object, {expected}")));
    }
    let mut map = NamedMap::load(path).map_err(Failure::input)?;
    let wrong = |problem: &str| Failure::input(format!("{}: {problem}", path.display()));
    let found = match text_encoder {
        Some(encoder) => {
            let list = objects(&map, *all);
            let found = similar(&map, &encoded(encoder, text)?).map_err(|problem| wrong(&problem))?;
            found.into_iter().filter(|found| list.objects.iter().any(|object| object.id == found.id)).collect()
        }
        None => {
            let network = network.as_deref().map(|network| open_network(network, None)).transpose()?;
            if let Some(network) = network.as_ref().filter(|_| map.names.embeddings().next().is_none()) {
                let named = map.name_from_keyframes(path, network).map_err(Failure::input)?;
                if named == 0 {
                    return Err(wrong("its keyframes show no object in colour, so the network has nothing to see"));
                }
            }
            if map.names.all().next().is_none() && !query.thing.is_empty() {
                let how = "give them with --names FILE or `splatseg name` (docs/NAMES.md)";
                return Err(wrong(&format!("its objects have no names: {how}")));
            }
            find_objects(&query, &objects(&map, *all), &map.names, network.as_ref())
                .map_err(|error| wrong(&error.to_string()))?
        }
    };
    let list = objects(&map, *all);
    let shown = &found[..found.len().min(top.get())];
    if *json {
        return print_json(&list, shown);
    }
    if found.is_empty() {
        say!("nothing fits {text:?}; {}", known_labels(&map.names));
    }
    for found in shown {
        let label = found.label.as_deref().unwrap_or("without label");
        let shape = list.get(found.id).and_then(|object| object.shape.as_ref());
        let shape = shape.map_or_else(|| "without depth".to_owned(), described);
        let by = found.by.join(", ");
        say!("{} {label}, score {:.2} ({by}): {shape}", found.id, found.score);
    }
    // By similarity every object is found, so that there are more says nothing.
    if found.len() > shown.len() && text_encoder.is_none() {
        say!("… and {} more: --top shows them", found.len() - shown.len());
    }
    Ok(())
}

/// The objects most similar to an embedding.
fn similar(map: &NamedMap, embedding: &[f32]) -> Result<Vec<FoundObject>, String> {
    let found = map.names.find(embedding).map_err(|error| error.to_string())?;
    if found.is_empty() {
        return Err("its objects have no embeddings, but labels at most".to_owned());
    }
    let found = found.into_iter().map(|(id, score)| {
        let label = map.names.label(id).map(str::to_owned);
        FoundObject { id, label, score, by: vec!["similarity"] }
    });
    Ok(found.collect())
}

/// The objects of a map, with its tentative ones if `all` is true.
fn objects(map: &NamedMap, all: bool) -> ObjectList {
    let list = map.object_list();
    if all { list.with_tentative() } else { list }
}

fn print_json(list: &ObjectList, found: &[FoundObject]) -> Result<(), Failure> {
    let printed: Vec<Printed<'_>> = found
        .iter()
        .map(|found| {
            let object = list.get(found.id);
            let (color, shape) =
                (object.and_then(|object| object.color), object.and_then(|object| object.shape.as_ref()));
            Printed { found, color, shape }
        })
        .collect();
    say!("{}", serde_json::to_string_pretty(&printed).map_err(Failure::runtime)?);
    Ok(())
}

/// The embedding that a user's program prints for a text.
fn encoded(program: &Path, text: &str) -> Result<Vec<f32>, Failure> {
    let failed = |problem: String| Failure::input(format!("--text-encoder {}: {problem}", program.display()));
    let mut command = Command::new(program);
    command.arg(text).stdin(Stdio::null()).stderr(Stdio::inherit());
    let output = command.output().map_err(|error| failed(error.to_string()))?;
    if !output.status.success() {
        return Err(failed(format!("ended with {}", output.status)));
    }
    serde_json::from_slice(&output.stdout)
        .map_err(|error| failed(format!("printed no JSON list of numbers, e.g. [0.1, -0.3]: {error}")))
}

fn known_labels(names: &ObjectNames) -> String {
    let labels: BTreeSet<&str> = names.labels().map(|(_, label)| label).collect();
    if labels.is_empty() {
        return "no object has a label".to_owned();
    }
    let rest = labels.len().saturating_sub(LABELS);
    let first: Vec<&str> = labels.into_iter().take(LABELS).collect();
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("the labels are {}{more}", first.join(", "))
}

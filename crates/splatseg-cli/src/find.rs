//! `splatseg find`: objects of a saved memory by their names.

use super::Failure;
use super::map_changes::described;
use super::terminal::counted;
use clap::Args;
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;
use splatseg_objects::{ObjectNames, object_shapes};
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Maximum number of labels listed when none fits.
const LABELS: usize = 20;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  splatseg find map.ply mug\n  \
    splatseg find map.ply \"something to drink from\" --text-encoder ./clip_text.py\n\n\
    Names come from a function of yours (name_objects of the libraries for Python and Rust) and are saved with the map:\n\
    docs/OBJECTS.md.")]
pub struct FindArguments {
    /// The map: a memory saved by `run --save-memory`, `live --map` or a program
    pub map: PathBuf,
    /// Text that the label contains, in upper or lower case
    pub text: String,
    /// Program that prints the embedding of its argument, the text, as a JSON list of numbers; the objects most similar to
    /// it are found, whatever their labels
    #[arg(long, value_name = "PROGRAM")]
    pub text_encoder: Option<PathBuf>,
    /// Maximum number of objects found by --text-encoder
    #[arg(long, value_name = "N", default_value = "5", requires = "text_encoder")]
    pub top: NonZeroUsize,
}

/// Prints the objects that fit the text.
pub fn find(arguments: &FindArguments) -> Result<(), Failure> {
    let FindArguments { map: path, text, text_encoder, top } = arguments;
    let map = NamedMap::load(path).map_err(Failure::input)?;
    let wrong = |problem: &str| Failure::input(format!("{}: {problem}", path.display()));
    if map.names.is_empty() {
        return Err(wrong("its objects have no names: a program gives them (docs/OBJECTS.md)"));
    }
    match text_encoder {
        Some(encoder) => {
            let embedding = encoded(encoder, text)?;
            let found = map.names.find(&embedding).map_err(|error| wrong(&error.to_string()))?;
            if found.is_empty() {
                return Err(wrong("its objects have labels, but no embeddings"));
            }
            let similar = found.iter().take(top.get()).map(|(id, similarity)| (*id, Some(*similarity)));
            print(&map, similar);
        }
        None => {
            let found = map.names.find_label(text);
            match found.len() {
                0 => say!("no label contains {text:?}; {}", known_labels(&map.names)),
                count => say!("{} with {text:?} in the label", counted(count, "object")),
            }
            print(&map, found.into_iter().map(|id| (id, None)));
        }
    }
    Ok(())
}

fn print(map: &NamedMap, found: impl Iterator<Item = (SegmentId, Option<f32>)>) {
    let shapes = object_shapes(&map.memory.map());
    for (id, similarity) in found {
        let label = map.names.label(id).unwrap_or("without label");
        let similarity = similarity.map_or_else(String::new, |similarity| format!(", similarity {similarity:.2}"));
        let shape = shapes.get(&id).map_or_else(|| "without depth".to_owned(), described);
        say!("{id} {label}{similarity}: {shape}");
    }
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
        return "the objects have embeddings, but no labels (see --text-encoder)".to_owned();
    }
    let rest = labels.len().saturating_sub(LABELS);
    let first: Vec<&str> = labels.into_iter().take(LABELS).collect();
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    format!("the labels are {}{more}", first.join(", "))
}

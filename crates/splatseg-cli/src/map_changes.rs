//! Changes between two maps of a place: `splatseg diff`, and `changes.json` of a run with a loaded memory.

use super::Failure;
use super::file_kind::FileKind;
use super::options::memory_limit;
use super::output_folder::OverwritePolicy;
use super::terminal::counted;
use clap::Args;
use splatseg::pipeline::depth_views;
use splatseg::settings::SettingsLayers;
use splatseg_files::AtomicFile;
use splatseg_geometry::MapView;
use splatseg_memory::SplatMemory;
use splatseg_objects::{ChangedObject, MapChanges, ObjectShape, ObservedMap};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Lines per kind of change in the terminal.
const LINES: usize = 30;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg run monday --out monday-out --save-memory monday.ply\n  \
    splatseg run tuesday --out tuesday-out --load-memory monday.ply --save-memory tuesday.ply\n  \
    splatseg diff monday.ply tuesday.ply\n\n\
    Both maps must have the same world coordinates: the later one continues the earlier one (--load-memory), or their\n\
    poses come from the same system. docs/MAP_CHANGES.md describes the file of --out.")]
pub struct DiffArguments {
    /// The earlier map: a memory saved by `run --save-memory`
    pub before: PathBuf,
    /// The later map
    pub after: PathBuf,
    /// File for the changes, JSON
    #[arg(long, value_name = "FILE.json")]
    pub out: Option<PathBuf>,
    /// Replace an existing file of changes
    #[arg(long)]
    pub overwrite: bool,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

/// The state of a map before a run.
pub struct MapBefore {
    memory: SplatMemory,
    observed: ObservedMap,
    keyframes: Vec<u8>,
}

impl MapBefore {
    /// Loads a saved memory. `None` if it has no keyframes: it was saved by an earlier version, and does not tell what was
    /// looked at.
    pub fn load(path: &Path) -> Result<Option<Self>, Failure> {
        load_with_keyframes(path)?.map(|saved| Self::new(path, saved)).transpose()
    }

    /// The state in a saved memory and its keyframes, which were loaded from `path`.
    fn new(path: &Path, (memory, keyframes): (SplatMemory, Vec<u8>)) -> Result<Self, Failure> {
        let views =
            depth_views(&keyframes, None).map_err(|error| Failure::input(format!("{}: {error}", path.display())))?;
        let observed = ObservedMap::new(&memory.map(), views);
        Ok(Self { memory, observed, keyframes })
    }

    /// The map itself.
    pub fn map(&self) -> MapView<'_> {
        self.memory.map()
    }

    /// Compares it with a later map. `keyframes` are those of the later map.
    pub fn changes(&self, after: &MapView<'_>, keyframes: &[u8]) -> Result<MapChanges, Failure> {
        let views = depth_views(keyframes, Some(&self.keyframes)).map_err(Failure::runtime)?;
        Ok(MapChanges::between(&self.observed, &ObservedMap::new(after, views)))
    }
}

/// Loads a saved memory and its keyframes, bytes for `splatseg_odometry`. `None` if it has no keyframes.
pub fn load_with_keyframes(path: &Path) -> Result<Option<(SplatMemory, Vec<u8>)>, Failure> {
    let mut layers = SettingsLayers::default();
    layers.add_saved_memory(path).map_err(Failure::input)?;
    let settings = layers.resolve().map_err(Failure::input)?;
    let Some(memory) = settings.method.memory() else { return Ok(None) };
    let mut memory = SplatMemory::load(path, memory.clone()).map_err(Failure::input)?;
    Ok(memory.take_keyframes().map(|keyframes| (memory, keyframes)))
}

/// Compares two saved maps.
pub fn diff(arguments: &DiffArguments) -> Result<(), Failure> {
    memory_limit(arguments.memory_limit.as_ref())?.enforce();
    let out = arguments.out.as_ref();
    if let Some(out) = out {
        FileKind::CHANGES.check(out, OverwritePolicy::from_flag(arguments.overwrite))?;
    }
    let load = |path: &Path| {
        load_with_keyframes(path)?.ok_or_else(|| {
            let reason = "has no keyframes, so it does not tell what was looked at: save it again with this version";
            Failure::input(format!("{}: {reason}", path.display()))
        })
    };
    let before = load(&arguments.before)?;
    let (after, keyframes_after) = load(&arguments.after)?;
    let views = depth_views(&keyframes_after, Some(&before.1)).map_err(Failure::input)?;
    if views.is_empty() {
        let (before, after) = (arguments.before.display(), arguments.after.display());
        return Err(Failure::input(format!("{after}: has no keyframes besides those of {before}")));
    }
    let before = MapBefore::new(&arguments.before, before)?;
    let changes = MapChanges::between(&before.observed, &ObservedMap::new(&after.map(), views));
    if let Some(out) = out {
        write(out, &json(&changes)?).map_err(|error| Failure::runtime(format!("{}: {error}", out.display())))?;
    }
    for line in lines(&changes) {
        say!("{line}");
    }
    Ok(())
}

/// The changes as JSON.
pub fn json(changes: &MapChanges) -> Result<Vec<u8>, Failure> {
    let mut text = serde_json::to_vec_pretty(changes).map_err(Failure::runtime)?;
    text.push(b'\n');
    Ok(text)
}

fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.commit()
}

/// A summary of the changes, and a line for each.
pub fn lines(changes: &MapChanges) -> Vec<String> {
    let MapChanges { gone, new, moved, unchanged, not_looked_at, newly_seen, .. } = changes;
    let counts = [
        (gone.len(), "gone"),
        (new.len(), "new"),
        (moved.len(), "moved"),
        (unchanged.len(), "unchanged"),
        (not_looked_at.len(), "not looked at"),
        (newly_seen.len(), "seen for the first time"),
    ];
    let counts = counts.map(|(count, kind)| format!("{count} {kind}"));
    let mut lines = vec![format!("objects: {}", counts.join(", "))];
    let of = |kind: &str, objects: &[ChangedObject]| -> Vec<String> {
        objects.iter().map(|object| format!("{kind} {}: {}", object.id, described(&object.shape))).collect()
    };
    let moves = moved.iter().map(|moved| {
        let (before, after) = (&moved.before, &moved.after);
        let to = position(&after.shape);
        format!("moved {}: {} to {to}, {:.2} m, now {}", before.id, described(&before.shape), moved.distance, after.id)
    });
    for part in [of("gone", gone), of("new", new), moves.collect()] {
        let rest = part.len().saturating_sub(LINES);
        lines.extend(part.into_iter().take(LINES));
        if rest > 0 {
            lines.push(format!("… and {} more", counted(rest, "object")));
        }
    }
    lines
}

/// Size and position of an object.
pub fn described(shape: &ObjectShape) -> String {
    let [x, y, z] = shape.oriented_box.size.to_array();
    format!("{x:.2} x {y:.2} x {z:.2} m at {}", position(shape))
}

fn position(shape: &ObjectShape) -> String {
    let centre = shape.oriented_box.center;
    format!("({:.2}, {:.2}, {:.2})", centre.x, centre.y, centre.z)
}

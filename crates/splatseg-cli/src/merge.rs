//! `splatseg merge`: makes one map of two of the same place.

use super::Failure;
use super::file_kind::FileKind;
use super::map_changes;
use super::options::memory_limit;
use super::output_folder::OverwritePolicy;
use super::terminal::counted;
use clap::Args;
use glam::{DQuat, DVec3};
use splatseg::merging::{MergeError, MergeOptions, MergeReport, MergedObject, merge_maps};
use splatseg::pipeline::NamedMap;
use splatseg_geometry::{Pose, SegmentId};
use std::path::{Path, PathBuf};

/// Lines of the table of objects without `--all`.
const LINES: usize = 30;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg merge monday.ply tuesday.ply --out home.ply\n  \
    splatseg merge kitchen.ply hall.ply --out home.ply --json > merged.json\n  \
    splatseg run scene --out out --load-memory home.ply --save-memory home.ply --overwrite\n\n\
    The maps need not have the same world coordinates, but must show a common place. Where they differ, the second map is\n\
    right. Exit code 1 if they do not fit: no file is written. docs/MERGING.md explains it.")]
pub struct MergeArguments {
    /// The earlier map: a memory saved by `run --save-memory`, `live --map` or a program. The merged map has its world
    /// coordinates and its ids
    pub earlier: PathBuf,
    /// The later map. What it looked through is gone, and things that it shows elsewhere have moved
    pub later: PathBuf,
    /// File for the merged map
    #[arg(long, value_name = "FILE.ply")]
    pub out: PathBuf,
    /// Replace the saved map in the file of --out
    #[arg(long)]
    pub overwrite: bool,
    /// Pose of the later map's world in the earlier one's, if it is known: metres and a quaternion as in TUM's files, `0 0 0
    /// 0 0 0 1` if both have the same coordinates. Then the maps need not show a common place
    #[arg(long, value_name = "X Y Z QX QY QZ QW", allow_hyphen_values = true)]
    pub transform: Option<String>,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
    /// List all objects
    #[arg(long)]
    pub all: bool,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

/// Merges two saved maps.
pub fn merge(arguments: &MergeArguments) -> Result<(), Failure> {
    memory_limit(arguments.memory_limit.as_ref())?.enforce();
    let MergeArguments { earlier, later, out, .. } = arguments;
    FileKind::CHANGED_MAP.check(out, OverwritePolicy::from_flag(arguments.overwrite))?;
    let transform = arguments.transform.as_deref().map(pose).transpose().map_err(Failure::input)?;
    let options = MergeOptions { earlier_from_later: transform };
    let load = |path: &Path| NamedMap::load(path).map_err(Failure::input);
    let merged = merge_maps(load(earlier)?, load(later)?, &options).map_err(|error| failure(earlier, later, &error))?;
    merged.map.save(out).map_err(Failure::runtime)?;
    if arguments.json {
        return super::inspect::print_json(&merged.report);
    }
    lines(&merged.report, arguments.all).iter().for_each(|line| say!("{line}"));
    report!("{}", out.display());
    Ok(())
}

fn failure(earlier: &Path, later: &Path, error: &MergeError) -> Failure {
    let mut text = format!("{} and {}: {error}", earlier.display(), later.display());
    if let MergeError::Contradiction { earlier_from_later, .. } = error {
        text += &format!("; if it is one place: --transform '{}'", written(earlier_from_later));
    }
    if error.is_misfit() { Failure::runtime(text) } else { Failure::input(text) }
}

/// A pose: position and quaternion.
fn pose(text: &str) -> Result<Pose, String> {
    let wrong = || format!("--transform: found {text:?}, expected 7 numbers: x y z qx qy qz qw");
    let numbers: Vec<f64> = text
        .split([' ', ','])
        .filter(|part| !part.is_empty())
        .map(|part| part.parse().ok().filter(|number: &f64| number.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(wrong)?;
    let [x, y, z, qx, qy, qz, qw] = numbers[..] else { return Err(wrong()) };
    Pose::from_quaternion(DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw))
        .map_err(|error| format!("--transform: {error}"))
}

/// A pose as [`pose`] reads it.
fn written(pose: &Pose) -> String {
    let (position, rotation) = (pose.translation(), DQuat::from_mat3(&pose.rotation()));
    let numbers = position.to_array().into_iter().chain(rotation.to_array());
    numbers.map(|number| format!("{number:.4}")).collect::<Vec<_>>().join(" ")
}

/// The summary.
fn lines(report: &MergeReport, all: bool) -> Vec<String> {
    let MergeReport { keyframes, transform, objects, .. } = report;
    let mut lines = vec![format!(
        "recognised: {} of {} keyframes of the later map in the earlier one, {} of {} the other way, {} elsewhere",
        keyframes.later_recognised,
        keyframes.later,
        keyframes.earlier_recognised,
        keyframes.earlier,
        keyframes.elsewhere
    )];
    lines.push(format!(
        "fit: {} aligned, {:.1} mm and {:.2} degrees apart, {:.0} % of depth and image agree",
        counted(keyframes.aligned, "pair"),
        report.residual_m * 1e3,
        report.residual_deg,
        report.agreement * 100.0
    ));
    let row = |row: &[f64; 4]| format!("{:.4} {:.4} {:.4} {:.4}", row[0], row[1], row[2], row[3]);
    lines.push(format!("transform: [{}]", transform[..3].iter().map(row).collect::<Vec<_>>().join("; ")));
    if report.unjoined_parts > 0 {
        lines.push(format!("{} of the later map not joined: beside the rest", counted(report.unjoined_parts, "part")));
    }
    let is_of =
        |object: &&MergedObject, sides: [bool; 2]| [!object.earlier.is_empty(), !object.later.is_empty()] == sides;
    // What of the later map was absorbed by others is none of the merged map's objects.
    let is_left = |object: &&MergedObject| object.id.is_some() || !object.earlier.is_empty();
    let count = |sides: [bool; 2]| objects.iter().filter(|object| is_of(object, sides) && is_left(object)).count();
    lines.push(format!(
        "objects: {} in both maps, {} only in the earlier one, {} only in the later one",
        report.united(),
        count([true, false]),
        count([false, true])
    ));
    lines.push("  earlier + later -> merged".to_owned());
    let shown = if all { objects.len() } else { objects.len().min(LINES) };
    lines.extend(objects[..shown].iter().map(described));
    if shown < objects.len() {
        lines.push(format!("  … and {} more (--all lists them)", objects.len() - shown));
    }
    for conflict in &report.label_conflicts {
        lines.push(format!("{}: {:?} stays, {:?} is dropped", conflict.id, conflict.kept, conflict.dropped));
    }
    lines.extend(map_changes::lines(&report.changes));
    lines
}

fn described(object: &MergedObject) -> String {
    let ids = |ids: &[SegmentId]| match ids {
        [] => "-".to_owned(),
        ids => ids.iter().map(ToString::to_string).collect::<Vec<_>>().join(","),
    };
    let absorbed = if object.earlier.is_empty() { "absorbed by others" } else { "gone" };
    let now = object.id.map_or_else(|| absorbed.to_owned(), |id| id.to_string());
    let label = object.label.as_ref().map(|label| format!(" {label}")).unwrap_or_default();
    format!("  {} + {} -> {now}{label}", ids(&object.earlier), ids(&object.later))
}

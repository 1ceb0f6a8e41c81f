//! Pictures and curves for the scenes in the report, read from the scenes and the stored results.

use super::pictures;
use super::results::Results;
use super::store::stored_drawings;
use splatseg_report::{PageSelection, RunDrawings, SceneDrawings, ScenePicture};
use std::path::Path;

/// Returns the drawings of the selected scenes, in the selection's order.
pub fn drawings(results: &Results<'_>, selection: &PageSelection, out: &Path) -> Vec<SceneDrawings> {
    selection.scenes.iter().map(|scene| scene_drawings(results, selection, *scene, out)).collect()
}

fn scene_drawings(results: &Results<'_>, selection: &PageSelection, scene: usize, out: &Path) -> SceneDrawings {
    let plan = results.plan;
    let pictures = pictures::scene_pictures(&plan.scenes[scene], &plan.settings.dataset, selection.frames);
    let mut runs: Vec<RunDrawings> = Vec::new();
    for entry in plan.entries.iter().filter(|entry| entry.scene == scene) {
        // Only the first seed with a result is drawn.
        let is_known = runs.iter().any(|run| run.variant == entry.variant);
        if is_known || !selection.variants.contains(&entry.variant) {
            continue;
        }
        if let Ok(outcome) = &results.outcomes[entry.job] {
            runs.extend(run_drawings(&outcome.key, entry.variant, &pictures, out));
        }
    }
    SceneDrawings { scene, pictures, runs }
}

/// Reads the curves of a stored result, and its thumbnails of the frames in `pictures`.
fn run_drawings(key: &str, variant: usize, pictures: &[ScenePicture], out: &Path) -> Option<RunDrawings> {
    // A result that was deleted in the meantime does not stop the report.
    let mut stored =
        stored_drawings(out, key).inspect_err(|error| tracing::warn!("{key}: no pictures: {error}")).ok()?;
    stored.strip.retain(|thumbnail| pictures.iter().any(|picture| picture.frame == thumbnail.frame));
    Some(RunDrawings { variant, series: stored.series, thumbnails: stored.strip })
}

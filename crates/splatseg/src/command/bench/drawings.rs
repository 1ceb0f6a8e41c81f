//! Pictures and curves of the scenes that the report shows, read again from the scenes and the stored results.

use super::pictures;
use super::results::Results;
use super::store::stored_drawings;
use splatseg_report::{PageSelection, RunDrawings, SceneDrawings, ScenePicture};
use std::path::Path;

/// The drawings of the selection's scenes, in its order.
pub fn drawings(results: &Results<'_>, selection: &PageSelection, out: &Path) -> Vec<SceneDrawings> {
    selection.scenes.iter().map(|scene| of_scene(results, selection, *scene, out)).collect()
}

fn of_scene(results: &Results<'_>, selection: &PageSelection, scene: usize, out: &Path) -> SceneDrawings {
    let plan = results.plan;
    let pictures = pictures::of_scene(&plan.scenes[scene], &plan.settings.dataset, selection.frames);
    let mut runs: Vec<RunDrawings> = Vec::new();
    for entry in plan.entries.iter().filter(|entry| entry.scene == scene) {
        // The first seed with a result.
        let is_known = runs.iter().any(|run| run.variant == entry.variant);
        if is_known || !selection.variants.contains(&entry.variant) {
            continue;
        }
        if let Ok(outcome) = &results.outcomes[entry.job] {
            runs.extend(of_run(&outcome.key, entry.variant, &pictures, out));
        }
    }
    SceneDrawings { scene, pictures, runs }
}

/// The curves of a stored result, and its thumbnails of the frames that are shown.
fn of_run(key: &str, variant: usize, pictures: &[ScenePicture], out: &Path) -> Option<RunDrawings> {
    // A result that has disappeared since does not stop the report.
    let mut stored =
        stored_drawings(out, key).inspect_err(|error| tracing::warn!("{key}: no pictures: {error}")).ok()?;
    stored.strip.retain(|thumbnail| pictures.iter().any(|picture| picture.frame == thumbnail.frame));
    Some(RunDrawings { variant, series: stored.series, thumbnails: stored.strip })
}

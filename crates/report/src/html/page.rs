//! The page, from its title to its scripts.

use super::strips::Strip;
use super::{PageSelection, charts, scenes, tables};
use crate::markdown::count;
use crate::{Benchmark, FrameTable, Measurement, MissingResult, SceneDrawings, ScoreTable, SizeTable, StageTable};
use chrono::Utc;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Maximum number of listed missing results.
const MAX_MISSING: usize = 100;

/// Data for the page's script.
#[derive(Serialize)]
struct Embedded<'a> {
    strips: &'a [Strip],
}

/// The page. `drawings` belong to the selection's scenes, in the same order; a scene without pictures has no strip.
///
/// # Errors
/// If the pictures cannot be written as JSON.
pub fn html_page(
    benchmark: &Benchmark,
    selection: &PageSelection,
    drawings: &[SceneDrawings],
) -> Result<String, serde_json::Error> {
    let strips: Vec<Strip> = drawings.iter().map(|of_scene| Strip::new(benchmark, selection, of_scene)).collect();
    let data = script_safe(&serde_json::to_string(&Embedded { strips: &strips })?);
    let scripts = html! {
        script type="application/json" id="benchmark" { (PreEscaped(data)) }
        script { (PreEscaped(SCRIPT)) }
    };
    let scenes = scenes::scenes(benchmark, selection, drawings, &strips);
    Ok(document("splatseg benchmark", &content(benchmark, &scenes), &scripts))
}

/// A page with a title, content and scripts, in that order.
pub(super) fn document(title: &str, content: &Markup, scripts: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                main { (content) }
                (scripts)
            }
        }
    };
    page.into_string()
}

/// Escapes JSON so that it cannot end its script element.
fn script_safe(json: &str) -> String {
    json.replace('<', "\\u003c")
}

fn content(benchmark: &Benchmark, scenes: &Markup) -> Markup {
    let main_table = ScoreTable::over_all_scenes(benchmark, benchmark.protocol);
    let other_table = ScoreTable::over_all_scenes(benchmark, benchmark.other_protocol());
    html! {
        (heading(benchmark))
        (missing_results(&benchmark.missing))
        h2 { (main_table.title) }
        (tables::scores(&main_table))
        details { summary { "How to read this" } (how_to_read()) }
        details { summary { (other_table.title) } (tables::scores(&other_table)) }
        (tables::sizes(&SizeTable::new(benchmark, benchmark.protocol)))
        (tables::frames(&FrameTable::new(benchmark)))
        (tables::stages(&StageTable::new(benchmark)))
        h2 { "Comparison" }
        div class="charts" { @for chart in charts::comparison(benchmark) { (chart) } }
        (scenes)
        h2 { "Settings" }
        details {
            summary { "All settings except method and seed" }
            pre { (benchmark.settings) }
        }
        p class="facts" { "Every result is a row of results.json and results.csv, beside this page." }
    }
}

fn heading(benchmark: &Benchmark) -> Markup {
    let first = |scene| benchmark.of_scene(scene).first();
    let frames: usize =
        (0..benchmark.scenes.len()).filter_map(first).map(|measurement: &Measurement| measurement.frames).sum();
    html! {
        h1 { "splatseg benchmark" }
        p class="facts" {
            (count(benchmark.scenes.len(), "scene")) ", " (count(frames, "frame")) ", "
            (count(benchmark.variants.len(), "method")) ", " (count(benchmark.seeds.len(), "seed")) "; "
            (benchmark.setup) "; protocol " (benchmark.protocol.name()) "; splatseg " (benchmark.version) ", "
            (Utc::now().date_naive())
        }
    }
}

fn missing_results(missing: &[MissingResult]) -> Markup {
    html! {
        @if !missing.is_empty() {
            section class="failures" {
                details {
                    summary { (missing.len()) " results are missing" }
                    ul { @for result in missing.iter().take(MAX_MISSING) { li { (result.text()) } } }
                    @if missing.len() > MAX_MISSING { p { "The others are in failures.json." } }
                }
            }
        }
    }
}

fn how_to_read() -> Markup {
    html! {
        p {
            "Every method gives the objects of an RGB-D video ids, and an object should keep its id. "
            b { "VSQ" sup { "k" } } " compares true and predicted tubes, an object's masks over time, in windows of k \
            frames: with k = 1 ids do not matter, with k = 15 they must persist. " b { "VSQ" } " is the mean over k. "
            b { "STQ" } " covers the whole video: the geometric mean of " b { "AQ" } ", how well ids stay with their \
            objects, and " b { "SQ" } ", how well pixels are covered. All scores are percentages; higher is better."
        }
        p {
            "Protocol " b { "paper" } " computes the same as the paper's evaluation code (Opipari et al., Explicit \
            Memory through Online 3D Gaussian Splatting Improves Class-Agnostic Video Segmentation, RA-L 2025, arXiv \
            2510.23521): any overlap can be a match, and SQ is about half of the recall. Protocol " b { "strict" }
            " follows the printed formulas: a match needs an IoU above one half. Over several scenes, tubes, tracks and \
            pixels are summed before dividing. ± is the sample standard deviation over seeds. The paper's rows were \
            measured on " em { "other data" } " and only show the order of magnitude."
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn json_cannot_end_its_script_element() {
        assert_eq!(super::script_safe("{\"a\":\"</script>\"}"), "{\"a\":\"\\u003c/script>\"}");
    }
}

//! The page, from its title to its scripts.

use super::strips::Strip;
use super::{ScenePicture, charts, tables};
use crate::markdown::count;
use crate::{Benchmark, Measurement, MissingResult, ScoreTable, SizeTable, StageTable};
use jiff::Timestamp;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde::Serialize;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// What scripts can read from the page.
#[derive(Serialize)]
struct Embedded<'a, Rows> {
    rows: &'a Rows,
    failures: &'a [MissingResult<'a>],
    strips: &'a [Strip],
}

/// The page. `pictures` are those of each scene, in the order of [`Benchmark::scenes`]; a scene without any has no
/// strip. `rows` go into the page as JSON, for scripts that read it.
///
/// # Errors
/// If `rows` cannot be written as JSON.
pub fn html_page(
    benchmark: &Benchmark,
    pictures: &[Vec<ScenePicture>],
    rows: &impl Serialize,
) -> Result<String, serde_json::Error> {
    let scenes = 0..benchmark.scenes.len();
    let strips: Vec<Strip> = scenes.zip(pictures).map(|(scene, of)| Strip::new(benchmark, scene, of)).collect();
    let embedded = Embedded { rows, failures: &benchmark.missing, strips: &strips };
    let data = script_safe(&serde_json::to_string(&embedded)?);
    let scripts = html! {
        script type="application/json" id="benchmark" { (PreEscaped(data)) }
        script { (PreEscaped(SCRIPT)) }
    };
    Ok(document("splatseg benchmark", &content(benchmark, &strips), &scripts))
}

/// A page with a title, what it shows, and the scripts after that.
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

/// JSON that cannot end the script element which holds it.
fn script_safe(json: &str) -> String {
    json.replace('<', "\\u003c")
}

fn content(benchmark: &Benchmark, strips: &[Strip]) -> Markup {
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
        (tables::stages(&StageTable::new(benchmark)))
        h2 { "Comparison" }
        div class="charts" { @for chart in charts::comparison(benchmark) { (chart) } }
        @for (scene, name) in benchmark.scenes.iter().enumerate() {
            section {
                h2 { (name) }
                (scene_content(benchmark, scene, strips.get(scene)))
            }
        }
        h2 { "Settings" }
        details {
            summary { "All settings except method and seed" }
            pre { (benchmark.settings) }
        }
        p class="facts" {
            "The rows of results.json are also in this page: the element " code { "#benchmark" } " holds them as JSON."
        }
    }
}

fn heading(benchmark: &Benchmark) -> Markup {
    let scenes = 0..benchmark.scenes.len();
    let of_scene = |scene| benchmark.measurements.iter().find(|measurement| measurement.scene == scene);
    let frames: usize = scenes.filter_map(of_scene).map(|measurement: &Measurement| measurement.frames).sum();
    html! {
        h1 { "splatseg benchmark" }
        p class="facts" {
            (count(benchmark.scenes.len(), "scene")) ", " (count(frames, "frame")) ", "
            (count(benchmark.variants.len(), "method")) ", " (count(benchmark.seeds.len(), "seed")) "; "
            (benchmark.setup) "; protocol " (benchmark.protocol.name()) "; splatseg " (benchmark.version) ", "
            (Timestamp::now().strftime("%Y-%m-%d").to_string())
        }
    }
}

fn missing_results(missing: &[MissingResult]) -> Markup {
    html! {
        @if !missing.is_empty() {
            section class="failures" {
                details {
                    summary { (missing.len()) " results are missing" }
                    ul { @for result in missing { li { (result.text()) } } }
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
            frames: with k = 1 ids do not matter, with k = 15 they have to hold. " b { "VSQ" } " is the mean over k. "
            b { "STQ" } " is about the whole video: the geometric mean of " b { "AQ" } ", how well ids stay with their \
            objects, and " b { "SQ" } ", how well pixels are covered. All scores are percentages; higher is better."
        }
        p {
            "Protocol " b { "paper" } " computes what the evaluation code of the paper does (Opipari et al., Explicit \
            Memory through Online 3D Gaussian Splatting Improves Class-Agnostic Video Segmentation, RA-L 2025, arXiv \
            2510.23521): any overlap can be a match, and SQ is about half of the recall. Protocol " b { "strict" }
            " follows the printed formulas: a match needs an IoU above one half. Over several scenes, tubes, tracks and \
            pixels are summed before dividing. ± is the sample standard deviation over seeds. The paper's rows were \
            measured on " em { "other data" } " and only show the order of magnitude."
        }
    }
}

fn scene_content(benchmark: &Benchmark, scene: usize, strip: Option<&Strip>) -> Markup {
    if benchmark.measurements.iter().all(|measurement| measurement.scene != scene) {
        return html! { p { "No results." } };
    }
    let table = ScoreTable::of_scene(benchmark, scene, benchmark.protocol);
    html! {
        @if let Some(strip) = strip { (strip.markup(scene)) }
        details { summary { (table.title) } (tables::scores(&table)) }
        div class="charts" { @for chart in charts::of_scene(benchmark, scene) { (chart) } }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn json_cannot_end_its_script_element() {
        assert_eq!(super::script_safe("{\"a\":\"</script>\"}"), "{\"a\":\"\\u003c/script>\"}");
    }
}

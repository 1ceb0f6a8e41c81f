//! Results by scene: scores of all scenes, pictures and curves of some.

use super::strips::{Strip, chooser};
use super::{PageSelection, charts, tables};
use crate::paper::Reference;
use crate::{Benchmark, RunDrawings, SceneDrawings, ScoreTable, Spread};
use maud::{Markup, html};

/// The scores of all scenes, then the scenes with pictures.
pub(super) fn scenes(
    benchmark: &Benchmark,
    selection: &PageSelection,
    drawings: &[SceneDrawings],
    strips: &[Strip],
) -> Markup {
    html! {
        h2 { "Scenes" }
        @if benchmark.scenes.len() > 1 { (all_scenes(benchmark)) }
        (what_is_shown(benchmark, selection))
        (chooser(benchmark, selection))
        @for (index, (drawn, strip)) in drawings.iter().zip(strips).enumerate() {
            @let table = ScoreTable::of_scene(benchmark, drawn.scene, benchmark.protocol);
            @let runs: Vec<&RunDrawings> =
                drawn.runs.iter().filter(|run| selection.open.contains(&run.variant)).collect();
            section {
                h2 { (benchmark.scenes[drawn.scene]) }
                (strip.markup(index))
                details { summary { (table.title) } (tables::scores(&table)) }
                div class="charts" { @for chart in charts::of_runs(benchmark, &runs) { (chart) } }
            }
        }
    }
}

/// VSQ of every scene, collapsed: a row for each scene, a column for each variant.
fn all_scenes(benchmark: &Benchmark) -> Markup {
    let labels: Vec<String> = benchmark.variants.iter().map(|variant| variant.label()).collect();
    let cell = |scene: usize, variant: usize| {
        let scores = benchmark.of(scene, variant).iter();
        let values: Vec<f64> =
            scores.filter_map(|measurement| measurement.score(benchmark.protocol).scores().vsq).collect();
        Spread::from_values(&values).map_or_else(|| "–".to_owned(), |spread| format!("{:.2}", spread.mean))
    };
    let rows = html! {
        @for (scene, name) in benchmark.scenes.iter().enumerate() {
            tr { th scope="row" { (name) } @for variant in 0..labels.len() { td { (cell(scene, variant)) } } }
        }
    };
    html! {
        details {
            summary { "VSQ of each scene, protocol " (benchmark.protocol.name()) }
            p { "Means over seeds, percent. results.csv has every score of every result." }
            (tables::table("scene", labels.iter().map(String::as_str), &rows))
        }
    }
}

/// States which part of the benchmark has pictures and curves, and how to see the rest.
fn what_is_shown(benchmark: &Benchmark, selection: &PageSelection) -> Markup {
    let (shown, all) = (selection.scenes.len(), benchmark.scenes.len());
    let variants = benchmark.variants.len();
    html! {
        p class="facts" {
            @if shown < all {
                "Pictures and curves are of " (shown) " of " (all) " scenes, evenly spaced. "
                @match benchmark.reference {
                    Reference::ScannetMv => {
                        "For another scene's, copy this folder with results/ in it, and start " code { "splatseg bench" }
                        " there with the same options but " code { "--scenes SCENE" }
                        ": it makes the page from the stored results. "
                    }
                    Reference::Mvpd => {
                        "For another video's, measure it: "
                        code { "splatseg bench --preset mvpd --method-preset paper --scenes FOLDER:VIDEO --methods METHODS" }
                        ". "
                    }
                }
            }
            @if selection.open.len() < variants {
                (selection.open.len()) " of " (variants) " methods are side by side at first, and only these have curves. "
            }
            @if selection.variants.len() < variants {
                (selection.variants.len()) " have pictures. "
            }
            "A colour stands for an id: an object whose colour changes from frame to frame has lost its id. Colours are not \
            comparable between pictures side by side. Pictures and curves are those of the first seed."
        }
    }
}

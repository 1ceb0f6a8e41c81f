//! `paper.md`: the paper's tables, the measured rows next to its own.

use super::{FRAMES_PER_SECOND, MILLION_PARAMETERS, MVPD_VSQ, PaperRow, PaperTable};
use crate::columns::COLUMNS;
use crate::spread::cell_text;
use crate::{Benchmark, ScoreRow, ScoreTable, Spread, markdown};
use splatseg_metrics::Protocol;

/// All tables that could be measured as Markdown. `notes` say how the inputs differ from the paper's, `missing_inputs`
/// which inputs were not found; both are one Markdown list item each.
pub fn document(benchmark: &Benchmark, rows: &[PaperRow], notes: &[String], missing_inputs: &[String]) -> String {
    let mut text = format!(
        "# The paper's tables\n\nPercent, protocol `paper`, {}, {}, {}, splatseg {}. The paper's own rows \
         (*in italics*) were measured on the whole validation split of ScanNet, and its speeds on a GPU.\n\n",
        markdown::count(benchmark.scenes.len(), "scene"),
        markdown::count(benchmark.seeds.len(), "seed"),
        benchmark.setup,
        benchmark.version,
    );
    text.push_str(&list(notes));
    let ScoreTable { rows: measured, notes, .. } = ScoreTable::over_all_scenes(benchmark, Protocol::Paper);
    text.push_str(&list(&notes));
    for table in PaperTable::ALL {
        text.push_str(&format!("\n## {}\n\n{}", table.title(), markdown::head("", &COLUMNS)));
        for row in rows.iter().filter(|row| row.table == table) {
            text.push_str(&score_lines(row, measured_row(row, &measured)));
        }
    }
    text.push_str(&efficiency(benchmark, rows, &measured));
    text.push_str(&mvpd());
    text.push_str(&format!("\n## What is missing\n\n{}", list(missing_inputs)));
    text
}

fn list(items: &[String]) -> String {
    items.iter().map(|item| format!("- {item}\n")).collect()
}

/// What was measured for a row.
fn measured_row<'a>(row: &PaperRow, measured: &'a [ScoreRow]) -> Option<&'a ScoreRow> {
    measured.get(row.variant?)
}

/// The measured line of a row, and the paper's where we have it.
fn score_lines(row: &PaperRow, measured: Option<&ScoreRow>) -> String {
    let (cells, note) = match measured {
        Some(measured) => (measured.cell_texts(), measured.note.clone()),
        None => ([None; 8].map(cell_text), row.obstacle.clone()),
    };
    let note = note.map(|note| format!(" ({note})")).unwrap_or_default();
    let mut text = markdown::row(&format!("{}{note}", row.name), &cells);
    if row.published.iter().any(Option::is_some) {
        let cells = row.published.map(|value| value.map_or_else(String::new, |value| format!("*{value:.2}*")));
        text.push_str(&markdown::row(&format!("*{}, the paper*", row.name), &cells));
    }
    text
}

fn efficiency(benchmark: &Benchmark, rows: &[PaperRow], measured: &[ScoreRow]) -> String {
    let columns = ["frames/s", "*the paper*", "parameters", "*the paper*"];
    let mut text = format!(
        "\n## Efficiency\n\nParameters are the numbers stored in the splat at the end of a video, in millions, for the \
         video with the most.\n\n{}",
        markdown::head("", &columns)
    );
    let published = |numbers: &[(&str, f64)], name: &str| {
        let number = numbers.iter().find(|(known, _)| *known == name);
        number.map_or_else(String::new, |(_, value)| format!("*{value:.2}*"))
    };
    for row in rows.iter().filter(|row| row.table == PaperTable::Methods) {
        let measurements = row.variant.map(|variant| benchmark.of_variant(variant)).unwrap_or_default();
        let parameters = measurements.iter().map(|measurement| measurement.parameters).max();
        let parameters = parameters.filter(|count| *count > 0).map(|count| Spread::from_mean(count as f64 / 1e6));
        let cells = [
            cell_text(measured_row(row, measured).and_then(|row| row.speed)),
            published(&FRAMES_PER_SECOND, &row.name),
            cell_text(parameters),
            published(&MILLION_PARAMETERS, &row.name),
        ];
        text.push_str(&markdown::row(&row.name, &cells));
    }
    text
}

/// The table that needs other data and other methods' predictions.
fn mvpd() -> String {
    let rows = MVPD_VSQ.map(|(name, vsq)| markdown::row(&format!("*{name}*"), &[format!("*{vsq:.2}*")]));
    format!(
        "\n## MVPd\n\nNot measured here: `splatseg bench --scenes FOLDER:VIDEO` runs our methods on MVPd, `splatseg \
         eval` scores the predictions of others.\n\n{}{}",
        markdown::head("", &["VSQ"]),
        rows.concat()
    )
}

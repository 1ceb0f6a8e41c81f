//! `paper.md`: the paper's tables, ours beside its own.

use super::PaperBenchmark;
use super::numbers::{FRAMES_PER_SECOND, MILLION_PARAMETERS, MVPD_VSQ};
use super::rows::{PaperRow, PaperTable};
use crate::command::bench::Results;
use crate::command::bench::tables::{TableRow, cell, over_all_scenes, spread};
use crate::command::score_table::COLUMNS;
use splatseg_metrics::Protocol;

/// All tables that could be measured, and what is missing.
pub fn document(paper: &PaperBenchmark, results: &Results) -> String {
    let plan = results.plan;
    let mut text = format!(
        "# The paper's tables\n\nPercent, protocol `paper`, {} scenes and {} seeds, segmenter {}, splatseg {}. The \
         paper's own rows (*in italics*) are of ScanNet's whole validation split, and its speeds of a GPU.\n\n",
        plan.scenes.len(),
        plan.seeds.len(),
        plan.settings.segmenter.name(),
        env!("CARGO_PKG_VERSION"),
    );
    for note in &paper.inputs.notes {
        text.push_str(&format!("- {note}\n"));
    }
    let measured = over_all_scenes(results, Protocol::Paper).rows;
    for table in PaperTable::ALL {
        text.push_str(&format!("\n## {}\n\n| | {} |\n|---|{}\n", table.title(), COLUMNS.join(" | "), rules(8)));
        for (row, obstacle) in paper.rows.iter().filter(|(row, _)| row.table == table) {
            text.push_str(&score_lines(row, *obstacle, ours(row, results, &measured)));
        }
    }
    text.push_str(&efficiency(paper, results, &measured));
    text.push_str(&mvpd());
    text.push_str("\n## What is missing\n\n");
    text.push_str(&paper.missing_list());
    text
}

fn rules(columns: usize) -> String {
    "---:|".repeat(columns)
}

/// What was measured for a row.
fn ours<'a>(row: &PaperRow, results: &Results, measured: &'a [TableRow]) -> Option<&'a TableRow> {
    let variant = results.plan.variants.iter().position(|variant| *variant == row.variant)?;
    measured.get(variant)
}

/// Our line of a row, and the paper's where it is at hand.
fn score_lines(row: &PaperRow, obstacle: Option<&str>, ours: Option<&TableRow>) -> String {
    let mut cells = vec![cell(None); COLUMNS.len()];
    let mut note = obstacle.map(str::to_owned);
    if let Some(ours) = ours {
        cells = ours.cells.iter().map(|value| cell(*value)).collect();
        note = ours.note.clone();
    }
    let note = note.map(|note| format!(" ({note})")).unwrap_or_default();
    let mut text = format!("| {}{note} | {} |\n", row.name, cells.join(" | "));
    if row.paper.iter().any(Option::is_some) {
        let cells = row.paper.map(|value| value.map_or_else(String::new, |value| format!("*{value:.2}*")));
        text.push_str(&format!("| *{}, the paper* | {} |\n", row.name, cells.join(" | ")));
    }
    text
}

fn efficiency(paper: &PaperBenchmark, results: &Results, measured: &[TableRow]) -> String {
    let mut text = format!(
        "\n## Efficiency\n\nParameters are the numbers in the splat at the end of a video, in millions, the largest of \
         all videos.\n\n| | frames/s | *the paper* | parameters | *the paper* |\n|---|{}\n",
        rules(4)
    );
    let known = |numbers: &[(&str, f64)], name: &str| {
        let number = numbers.iter().find(|(known, _)| *known == name);
        number.map_or_else(String::new, |(_, value)| format!("*{value:.2}*"))
    };
    for (row, _) in paper.rows.iter().filter(|(row, _)| row.table == PaperTable::Methods) {
        let speed = ours(row, results, measured).and_then(|row| row.speed);
        let variant = results.plan.variants.iter().position(|variant| *variant == row.variant);
        let of_row = results.finished.iter().filter(|finished| Some(finished.variant) == variant);
        let parameters = of_row.map(|finished| finished.result.parameters).max().filter(|count| *count > 0);
        let parameters = parameters.and_then(|count| spread(&[count as f64 / 1e6]));
        text.push_str(&format!(
            "| {} | {} | {} | {} | {} |\n",
            row.name,
            cell(speed),
            known(&FRAMES_PER_SECOND, &row.name),
            cell(parameters),
            known(&MILLION_PARAMETERS, &row.name),
        ));
    }
    text
}

/// The table that needs other data and others' predictions.
fn mvpd() -> String {
    let rows = MVPD_VSQ.iter().map(|(name, vsq)| format!("| *{name}* | *{vsq:.2}* |\n"));
    format!(
        "\n## MVPd\n\nNot measured here: `splatseg bench --scenes FOLDER:VIDEO` runs our methods on MVPd, `splatseg \
         eval` scores the predictions of others.\n\n| | VSQ |\n|---|---:|\n{}",
        rows.collect::<String>()
    )
}

//! `tables.md`.

use crate::{
    Benchmark, FRAME_COLUMNS_EXPLAINED, FrameTable, SIZE_COLUMNS_EXPLAINED, ScoreTable, SizeTable, StageTable,
};

/// All tables, followed by the missing results.
pub fn markdown_tables(benchmark: &Benchmark) -> String {
    let mut text = format!(
        "# Benchmark\n\nScores are percentages: mean ± sample standard deviation over {}. Over several scenes, \
         tubes, tracks and pixels are summed before dividing; scores of scenes are not averaged. {}. splatseg {}.\n\n\
         Tables by size: {SIZE_COLUMNS_EXPLAINED}\n\n{}: {FRAME_COLUMNS_EXPLAINED}\n\n",
        count(benchmark.seeds.len(), "seed"),
        benchmark.setup,
        benchmark.version,
        FrameTable::TITLE,
    );
    let protocols = [benchmark.protocol, benchmark.other_protocol()];
    let mut tables: Vec<String> = Vec::new();
    tables.extend(protocols.map(|protocol| ScoreTable::over_all_scenes(benchmark, protocol).markdown()));
    tables.extend(protocols.map(|protocol| SizeTable::new(benchmark, protocol).markdown()));
    tables.push(FrameTable::new(benchmark).markdown());
    tables.push(StageTable::new(benchmark).markdown());
    if benchmark.scenes.len() > 1 {
        let scenes = 0..benchmark.scenes.len();
        tables.extend(scenes.map(|scene| ScoreTable::of_scene(benchmark, scene, benchmark.protocol).markdown()));
    }
    if let Some(again) = benchmark.of_final_pass() {
        tables.extend(protocols.map(|protocol| ScoreTable::of_final_pass(&again, protocol).markdown()));
    }
    text.push_str(&tables.join("\n"));
    text.push('\n');
    if !benchmark.missing.is_empty() {
        text.push_str("## Missing results\n\n");
        for missing in &benchmark.missing {
            text.push_str(&format!("- {}\n", missing.text().replace('\n', " ")));
        }
    }
    text
}

/// A table row; `|` in the name is escaped.
pub(crate) fn row(name: &str, cells: &[String]) -> String {
    format!("| {} | {} |\n", name.replace('|', "\\|"), cells.join(" | "))
}

/// A table's header: the column names and the rule below them. All columns but the first are right-aligned.
pub(crate) fn head(first: &str, columns: &[&str]) -> String {
    format!("| {first} | {} |\n|---|{}\n", columns.join(" | "), "---:|".repeat(columns.len()))
}

/// `1 seed`, `2 seeds`.
pub(crate) fn count(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

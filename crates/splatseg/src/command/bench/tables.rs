//! Tables in the paper's shape, from rows to text.

use super::Results;
use super::paper;
use super::rows::Finished;
use crate::command::score_table::{COLUMNS, columns, protocol_name};
use splatseg_metrics::{DatasetScore, Protocol, ScoreSettings, Scores};
use std::collections::BTreeSet;

/// Mean and sample standard deviation over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The deviation; `None` with one seed.
    pub deviation: Option<f64>,
}

/// Whose numbers a row holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// This benchmark's.
    Measured,
    /// The paper's, of other data.
    Paper,
}

/// A row of a table.
#[derive(Clone, Debug)]
pub struct TableRow {
    /// The method.
    pub label: String,
    /// Whose numbers these are.
    pub origin: Origin,
    /// Scores in the order of [`COLUMNS`].
    pub cells: [Option<Spread>; 8],
    /// Frames per second, all in all.
    pub speed: Option<Spread>,
    /// What is missing.
    pub note: Option<String>,
}

/// A table.
#[derive(Clone, Debug)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// Its rows.
    pub rows: Vec<TableRow>,
}

/// Every method over all scenes: tubes, tracks and pixels are summed for each seed, then seeds are averaged.
pub fn over_all_scenes(results: &Results, protocol: Protocol) -> Table {
    let count = results.plan.scenes.len();
    let measured: BTreeSet<usize> = results.finished.iter().map(|finished| finished.scene).collect();
    let scenes = match (measured.len(), count) {
        (1, 1) => "1 scene".to_owned(),
        (some, all) if some < all => format!("{some} of {all} scenes"),
        (_, all) => format!("{all} scenes"),
    };
    let mut rows: Vec<TableRow> = (0..results.plan.variants.len())
        .map(|variant| {
            let of_variant = |finished: &&Finished| finished.variant == variant;
            let finished: Vec<&Finished> = results.finished.iter().filter(of_variant).collect();
            measured_row(results, variant, &finished, About { protocol, scenes: count })
        })
        .collect();
    if protocol == Protocol::Paper {
        rows.extend(paper::SCANNET_MV.iter().map(|(name, cells)| TableRow {
            label: (*name).to_owned(),
            origin: Origin::Paper,
            cells: cells.map(|mean| Some(Spread { mean, deviation: None })),
            speed: None,
            note: None,
        }));
    }
    Table { title: format!("All tracks of {scenes}, protocol {}", protocol_name(protocol)), rows }
}

/// Every method on one scene.
pub fn of_scene(results: &Results, scene: usize, protocol: Protocol) -> Table {
    let rows = (0..results.plan.variants.len())
        .map(|variant| {
            let finished: Vec<&Finished> = results.of(scene, variant).collect();
            measured_row(results, variant, &finished, About { protocol, scenes: 1 })
        })
        .collect();
    let name = &results.plan.scenes[scene].name;
    Table { title: format!("{name}, protocol {}", protocol_name(protocol)), rows }
}

/// What a row is about.
#[derive(Clone, Copy, Debug)]
struct About {
    protocol: Protocol,
    scenes: usize,
}

fn measured_row(results: &Results, variant: usize, finished: &[&Finished], about: About) -> TableRow {
    let wanted = about.scenes * results.plan.seeds.len();
    let scores = totals_by_seed(results, finished, about.protocol);
    let cells = std::array::from_fn(|column| {
        spread(&scores.iter().filter_map(|scores| columns(scores)[column]).collect::<Vec<f64>>())
    });
    TableRow {
        label: results.plan.variants[variant].label(),
        origin: Origin::Measured,
        cells,
        speed: spread(&finished.iter().map(|finished| finished.result.fps.total).collect::<Vec<f64>>()),
        note: what_is_missing(finished, wanted),
    }
}

/// What a row of these results lacks, of which there should be `wanted`.
pub fn what_is_missing(finished: &[&Finished], wanted: usize) -> Option<String> {
    let skipped: usize = finished.iter().map(|finished| finished.result.skipped_frames).sum();
    let failed: usize = finished.iter().map(|finished| finished.result.failed_frames).sum();
    let mut notes = Vec::new();
    if finished.len() < wanted {
        notes.push(format!("{} of {wanted} results", finished.len()));
    }
    if skipped > 0 {
        notes.push(format!("{skipped} frames could not be read"));
    }
    if failed > 0 {
        notes.push(format!("{failed} frames without result"));
    }
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// Scores over the scenes for each seed.
pub fn totals_by_seed(results: &Results, finished: &[&Finished], protocol: Protocol) -> Vec<Scores> {
    let mut totals = Vec::new();
    for seed in &results.plan.seeds {
        let mut of_seed = finished.iter().filter(|finished| finished.seed == *seed).peekable();
        let Some(first) = of_seed.peek() else {
            continue;
        };
        let settings: ScoreSettings = *first.result.score(protocol).settings();
        let mut total = DatasetScore::new(settings);
        for finished in of_seed {
            // All jobs of a benchmark share the settings of scores, so none is refused.
            let _ = total.add(finished.result.score(protocol));
        }
        totals.push(total.total());
    }
    totals
}

/// `None` without values.
pub fn spread(values: &[f64]) -> Option<Spread> {
    let count = values.len() as f64;
    let mean = (!values.is_empty()).then(|| values.iter().sum::<f64>() / count)?;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    Some(Spread { mean, deviation: (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt()) })
}

impl Spread {
    /// With two digits, `43.74 ± 0.21`.
    pub fn text(&self) -> String {
        match self.deviation {
            Some(deviation) => format!("{:.2} ± {deviation:.2}", self.mean),
            None => format!("{:.2}", self.mean),
        }
    }
}

/// A cell's text.
pub fn cell(spread: Option<Spread>) -> String {
    spread.map_or_else(|| "–".to_owned(), |spread| spread.text())
}

impl TableRow {
    /// The method, and what to know about the row.
    pub fn name(&self) -> String {
        let note = self.note.as_ref().map(|note| format!(" ({note})")).unwrap_or_default();
        match self.origin {
            Origin::Measured => format!("{}{note}", self.label),
            Origin::Paper => format!("{} ({})", self.label, paper::MARK),
        }
    }
}

impl Table {
    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let mut text = format!("## {}\n\n| method | {} | frames/s |\n|---|", self.title, COLUMNS.join(" | "));
        text.push_str(&"---:|".repeat(COLUMNS.len() + 1));
        text.push('\n');
        for row in &self.rows {
            let cells: Vec<String> = row.cells.iter().chain([&row.speed]).map(|value| cell(*value)).collect();
            let name = row.name().replace('|', "\\|");
            let name = if row.origin == Origin::Paper { format!("*{name}*") } else { name };
            text.push_str(&format!("| {name} | {} |\n", cells.join(" | ")));
        }
        text
    }

    /// For a terminal: the measured rows, means only.
    pub fn terminal(&self) -> String {
        let measured: Vec<&TableRow> = self.rows.iter().filter(|row| row.origin == Origin::Measured).collect();
        let width = measured.iter().map(|row| row.name().chars().count()).max().unwrap_or(0);
        let mut text = format!("{}\n{:width$}", self.title, "");
        text.extend(COLUMNS.iter().map(|name| format!("{name:>8}")));
        for row in measured {
            text.push_str(&format!("\n{:width$}", row.name()));
            let means =
                row.cells.iter().map(|cell| cell.map_or_else(|| "-".to_owned(), |cell| format!("{:.2}", cell.mean)));
            text.extend(means.map(|mean| format!("{mean:>8}")));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_are_sample_deviations() {
        assert_eq!(spread(&[]), None);
        assert_eq!(spread(&[4.0]), Some(Spread { mean: 4.0, deviation: None }));
        let three = spread(&[1.0, 2.0, 3.0]).unwrap();
        assert_eq!(three.text(), "2.00 ± 1.00");
        assert_eq!(cell(None), "–");
    }
}

//! Tables of scores in the shape of the paper's.

use crate::benchmark::missing_note;
use crate::columns::{COLUMNS, columns, overcount_mark, overcount_note, terminal_cell, windows_note};
use crate::spread::cell_text;
use crate::{Benchmark, Measurement, Spread, markdown, paper};
use splatseg_metrics::Protocol;
use std::collections::BTreeSet;

/// Whose numbers a row holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Origin {
    /// This benchmark's.
    Measured,
    /// The paper's, from other data.
    Paper,
}

/// A row of a table.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ScoreRow {
    /// The method.
    pub label: String,
    /// Whose numbers these are.
    pub origin: Origin,
    /// VSQ^1, VSQ^5, VSQ^10, VSQ^15, VSQ, STQ, AQ and SQ, percent.
    pub cells: [Option<Spread>; 8],
    /// Frames per second.
    pub speed: Option<Spread>,
    /// True objects that AQ and STQ count more than once; the most of any seed.
    pub overcounted_tracks: u64,
    /// What is missing.
    pub note: Option<String>,
}

/// A table of scores.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ScoreTable {
    /// What it shows.
    pub title: String,
    /// Its rows: one for each variant, then the paper's, if any.
    pub rows: Vec<ScoreRow>,
    /// What its marks mean, and why cells are empty; one line each.
    pub notes: Vec<String>,
}

impl ScoreTable {
    /// Every method over all scenes: tubes, tracks and pixels are summed for each seed, then seeds are averaged. With
    /// the paper's protocol, the paper's rows follow.
    pub fn over_all_scenes(benchmark: &Benchmark, protocol: Protocol) -> Self {
        let count = benchmark.scenes.len();
        let measured: BTreeSet<usize> = benchmark.measurements.iter().map(|measurement| measurement.scene).collect();
        let scenes = match (measured.len(), count) {
            (1, 1) => "1 scene".to_owned(),
            (some, all) if some < all => format!("{some} of {all} scenes"),
            (_, all) => format!("All {all} scenes"),
        };
        let variants = 0..benchmark.variants.len();
        let mut rows: Vec<ScoreRow> = variants
            .map(|variant| measured_row(benchmark, variant, &benchmark.of_variant(variant), protocol, count))
            .collect();
        if protocol == Protocol::Paper {
            rows.extend(paper::SCANNET_MV.iter().map(|(name, cells)| ScoreRow {
                label: (*name).to_owned(),
                origin: Origin::Paper,
                cells: cells.map(|mean| Some(Spread::from_mean(mean))),
                speed: None,
                overcounted_tracks: 0,
                note: None,
            }));
        }
        let notes = notes(&rows, benchmark.measurements.iter(), protocol);
        Self { title: format!("{scenes}, protocol {}", protocol.name()), rows, notes }
    }

    /// Every method on one scene.
    pub fn of_scene(benchmark: &Benchmark, scene: usize, protocol: Protocol) -> Self {
        let rows: Vec<ScoreRow> = (0..benchmark.variants.len())
            .map(|variant| {
                let measurements: Vec<&Measurement> = benchmark.of(scene, variant).collect();
                measured_row(benchmark, variant, &measurements, protocol, 1)
            })
            .collect();
        let of_scene = benchmark.measurements.iter().filter(|measurement| measurement.scene == scene);
        let notes = notes(&rows, of_scene, protocol);
        Self { title: format!("{}, protocol {}", benchmark.scenes[scene], protocol.name()), rows, notes }
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let columns: Vec<&str> = COLUMNS.into_iter().chain(["frames/s"]).collect();
        let mut text = format!("## {}\n\n{}", self.title, markdown::head("method", &columns));
        for row in &self.rows {
            let cells: Vec<String> = row.cell_texts().into_iter().chain([cell_text(row.speed)]).collect();
            let name = if row.origin == Origin::Paper { format!("*{}*", row.name()) } else { row.name() };
            text.push_str(&markdown::row(&name, &cells));
        }
        text.extend(self.notes.iter().map(|note| format!("\n{note}\n")));
        text
    }

    /// For a terminal: the measured rows, means only.
    pub fn terminal(&self) -> String {
        let measured: Vec<&ScoreRow> = self.rows.iter().filter(|row| row.origin == Origin::Measured).collect();
        let width = measured.iter().map(|row| row.name().chars().count()).max().unwrap_or(0);
        let mut text = format!("{}\n{:width$}", self.title, "");
        text.extend(COLUMNS.iter().map(|name| format!("{name:>8}")));
        for row in measured {
            text.push_str(&format!("\n{:width$}", row.name()));
            for (column, cell) in row.cells.iter().enumerate() {
                let mean = terminal_cell(cell.map(|cell| cell.mean));
                text.push_str(&format!("{:>8}", format!("{mean}{}", row.mark(column))));
            }
        }
        text.extend(self.notes.iter().map(|note| format!("\n{note}")));
        text
    }

    /// The largest measured mean of each column.
    pub(crate) fn best_of_columns(&self) -> [Option<f64>; 8] {
        std::array::from_fn(|column| {
            let measured = self.rows.iter().filter(|row| row.origin == Origin::Measured);
            measured.filter_map(|row| row.cells[column].map(|cell| cell.mean)).max_by(f64::total_cmp)
        })
    }
}

impl ScoreRow {
    /// The cells as text, with their marks.
    pub(crate) fn cell_texts(&self) -> [String; 8] {
        std::array::from_fn(|column| format!("{}{}", cell_text(self.cells[column]), self.mark(column)))
    }

    /// What stands behind the score of a column.
    pub(crate) fn mark(&self, column: usize) -> &'static str {
        overcount_mark(column, self.overcounted_tracks)
    }

    /// The method, and what to know about the row.
    pub(crate) fn name(&self) -> String {
        match (self.origin, &self.note) {
            (Origin::Paper, _) => format!("{} ({})", self.label, paper::MARK),
            (Origin::Measured, Some(note)) => format!("{} ({note})", self.label),
            (Origin::Measured, None) => self.label.clone(),
        }
    }
}

fn measured_row(
    benchmark: &Benchmark,
    variant: usize,
    measurements: &[&Measurement],
    protocol: Protocol,
    scenes: usize,
) -> ScoreRow {
    let scores = benchmark.totals_by_seed(measurements, protocol);
    let overcounted_tracks = scores.iter().map(|scores| scores.overcounted_tracks).max().unwrap_or(0);
    let of_column = |column: usize| {
        let values: Vec<f64> = scores.iter().filter_map(|scores| columns(scores)[column]).collect();
        Spread::from_values(&values)
    };
    let speeds: Vec<f64> = measurements.iter().map(|measurement| measurement.frames_per_second).collect();
    ScoreRow {
        label: benchmark.variants[variant].label(),
        origin: Origin::Measured,
        cells: std::array::from_fn(of_column),
        speed: Spread::from_values(&speeds),
        overcounted_tracks,
        note: missing_note(measurements, scenes * benchmark.seeds.len()),
    }
}

/// What the marks of these rows mean, and why some of their cells are empty.
fn notes<'m>(
    rows: &[ScoreRow],
    measurements: impl Iterator<Item = &'m Measurement<'m>>,
    protocol: Protocol,
) -> Vec<String> {
    let overcounted = rows.iter().map(|row| row.overcounted_tracks).max().and_then(overcount_note);
    let windows = windows_note(measurements.map(|measurement| measurement.score(protocol)));
    overcounted.into_iter().chain(windows).collect()
}

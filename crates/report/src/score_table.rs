//! Tables of scores in the shape of the paper's.

use crate::benchmark::missing_note;
use crate::columns::{COLUMNS, columns, terminal_cell};
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
                note: None,
            }));
        }
        Self { title: format!("{scenes}, protocol {}", protocol.name()), rows }
    }

    /// Every method on one scene.
    pub fn of_scene(benchmark: &Benchmark, scene: usize, protocol: Protocol) -> Self {
        let rows = (0..benchmark.variants.len())
            .map(|variant| {
                let measurements: Vec<&Measurement> = benchmark.of(scene, variant).collect();
                measured_row(benchmark, variant, &measurements, protocol, 1)
            })
            .collect();
        Self { title: format!("{}, protocol {}", benchmark.scenes[scene], protocol.name()), rows }
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let columns: Vec<&str> = COLUMNS.into_iter().chain(["frames/s"]).collect();
        let mut text = format!("## {}\n\n{}", self.title, markdown::head("method", &columns));
        for row in &self.rows {
            let cells: Vec<String> = row.cells.iter().chain([&row.speed]).map(|value| cell_text(*value)).collect();
            let name = if row.origin == Origin::Paper { format!("*{}*", row.name()) } else { row.name() };
            text.push_str(&markdown::row(&name, &cells));
        }
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
            let means = row.cells.iter().map(|cell| terminal_cell(cell.map(|cell| cell.mean)));
            text.extend(means.map(|mean| format!("{mean:>8}")));
        }
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
        note: missing_note(measurements, scenes * benchmark.seeds.len()),
    }
}

//! Tables of scores in the format of the paper's.

use crate::benchmark::missing_note;
use crate::columns::{COLUMNS, MESH_COLUMNS, columns, mesh_columns};
use crate::columns::{overcount_mark, overcount_note, terminal_cell, windows_note};
use crate::spread::cell_text;
use crate::{Benchmark, Measurement, Spread, markdown, paper};
use splatseg_metrics::Protocol;
use std::collections::BTreeSet;

/// Source of a row's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Origin {
    /// Measured by this benchmark.
    Measured,
    /// Published in a paper.
    Paper,
}

/// A row of a table.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ScoreRow {
    /// The method.
    pub label: String,
    /// Source of the numbers.
    pub origin: Origin,
    /// VSQ^1, VSQ^5, VSQ^10, VSQ^15, VSQ, STQ, AQ and SQ, percent.
    pub cells: [Option<Spread>; 8],
    /// AP, AP50 and AP25 of 3D instances on the vertices of meshes, percent.
    pub mesh: [Option<Spread>; 3],
    /// Frames per second: for each seed the frames of all scenes by their time.
    pub speed: Option<Spread>,
    /// Number of true objects that AQ and STQ count more than once; the maximum over the seeds.
    pub overcounted_tracks: u64,
    /// Note on missing results.
    pub note: Option<String>,
}

/// A table of scores.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ScoreTable {
    /// The title.
    pub title: String,
    /// Its rows: one for each variant, then published ones, if any.
    pub rows: Vec<ScoreRow>,
    /// Mark of published rows, which were measured on other data.
    pub mark: &'static str,
    /// Explanations of its marks and empty cells, one line each.
    pub notes: Vec<String>,
}

impl ScoreTable {
    /// All methods over all scenes: tubes, tracks and pixels are summed for each seed, then seeds are averaged. With
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
            rows.extend(
                benchmark.reference.rows().into_iter().map(|(name, cells)| published_row(name, cells, [None; 3])),
            );
        }
        if rows.iter().any(ScoreRow::has_mesh) {
            let (name, scores) = paper::MESH_INSTANCES;
            let name = format!("{name} (ScanNet200, its paper)");
            rows.push(published_row(&name, [None; 8], scores.map(Some)));
        }
        let notes = notes(&rows, benchmark.measurements.iter(), protocol);
        let title = format!("{scenes}, protocol {}", protocol.name());
        Self { title, rows, mark: benchmark.reference.mark(), notes }
    }

    /// As [`Self::over_all_scenes`], for the benchmark that [`Benchmark::of_final_pass`] returns. No published score can be
    /// compared with it.
    pub fn of_final_pass(benchmark: &Benchmark, protocol: Protocol) -> Self {
        let mut table = Self::over_all_scenes(benchmark, protocol);
        table.rows.retain(|row| row.origin == Origin::Measured);
        Self { title: format!("{}, after the final pass", table.title), ..table }
    }

    /// All methods on one scene.
    pub fn of_scene(benchmark: &Benchmark, scene: usize, protocol: Protocol) -> Self {
        let rows: Vec<ScoreRow> = (0..benchmark.variants.len())
            .map(|variant| {
                let measurements: Vec<&Measurement> = benchmark.of(scene, variant).iter().collect();
                measured_row(benchmark, variant, &measurements, protocol, 1)
            })
            .collect();
        let notes = notes(&rows, benchmark.of_scene(scene).iter(), protocol);
        let title = format!("{}, protocol {}", benchmark.scenes[scene], protocol.name());
        Self { title, rows, mark: benchmark.reference.mark(), notes }
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let mut text = format!("## {}\n\n{}", self.title, markdown::head("method", &self.columns()));
        for row in &self.rows {
            let cells: Vec<String> =
                self.cells_of(row).into_iter().map(|(value, mark)| cell_text(value) + mark).collect();
            let name = self.name_of(row);
            let name = if row.origin == Origin::Paper { format!("*{name}*") } else { name };
            text.push_str(&markdown::row(&name, &cells));
        }
        text.extend(self.notes.iter().map(|note| format!("\n{note}\n")));
        text
    }

    /// For a terminal: the measured rows, means only.
    pub fn terminal(&self) -> String {
        let measured: Vec<&ScoreRow> = self.rows.iter().filter(|row| row.origin == Origin::Measured).collect();
        let width = measured.iter().map(|row| self.name_of(row).chars().count()).max().unwrap_or(0);
        let mesh: &[&str] = if self.has_mesh() { &MESH_COLUMNS } else { &[] };
        let mut text = format!("{}\n{:width$}", self.title, "");
        text.extend(COLUMNS.iter().chain(mesh).map(|name| format!("{name:>8}")));
        for row in measured {
            text.push_str(&format!("\n{:width$}", self.name_of(row)));
            for (column, cell) in row.cells.iter().enumerate() {
                let mean = terminal_cell(cell.map(|cell| cell.mean));
                text.push_str(&format!("{:>8}", format!("{mean}{}", row.mark(column))));
            }
            text.extend(
                row.mesh.iter().zip(mesh).map(|(cell, _)| format!("{:>8}", terminal_cell(cell.map(|cell| cell.mean)))),
            );
        }
        text.extend(self.notes.iter().map(|note| format!("\n{note}")));
        text
    }

    /// The largest measured mean of each column of [`Self::columns`] except the speed.
    pub(crate) fn best_of_columns(&self) -> Vec<Option<f64>> {
        let best = |column: usize| {
            let measured = self.rows.iter().filter(|row| row.origin == Origin::Measured);
            measured.filter_map(|row| self.cells_of(row)[column].0.map(|cell| cell.mean)).max_by(f64::total_cmp)
        };
        (0..self.columns().len() - 1).map(best).collect()
    }

    /// True if there are 3D scores; otherwise their columns are omitted.
    fn has_mesh(&self) -> bool {
        self.rows.iter().any(ScoreRow::has_mesh)
    }

    /// The headings of the columns after the method.
    pub(crate) fn columns(&self) -> Vec<&'static str> {
        let mesh: &[&str] = if self.has_mesh() { &MESH_COLUMNS } else { &[] };
        COLUMNS.iter().chain(mesh).copied().chain(["frames/s"]).collect()
    }

    /// A row's numbers in the order of [`Self::columns`], each with its mark.
    pub(crate) fn cells_of(&self, row: &ScoreRow) -> Vec<(Option<Spread>, &'static str)> {
        let scores = (0..).zip(row.cells).map(|(column, cell)| (cell, row.mark(column)));
        let mesh = row.mesh.into_iter().filter(|_| self.has_mesh());
        scores.chain(mesh.chain([row.speed]).map(|cell| (cell, ""))).collect()
    }

    /// The method, with the row's note.
    fn name_of(&self, row: &ScoreRow) -> String {
        match (row.origin, &row.note) {
            (Origin::Paper, _) if row.has_mesh() => row.label.clone(),
            (Origin::Paper, _) => format!("{} ({})", row.label, self.mark),
            (Origin::Measured, Some(note)) => format!("{} ({note})", row.label),
            (Origin::Measured, None) => row.label.clone(),
        }
    }
}

fn published_row(name: &str, cells: [Option<f64>; 8], mesh: [Option<f64>; 3]) -> ScoreRow {
    ScoreRow {
        label: name.to_owned(),
        origin: Origin::Paper,
        cells: cells.map(|mean| mean.map(Spread::from_mean)),
        mesh: mesh.map(|mean| mean.map(Spread::from_mean)),
        speed: None,
        overcounted_tracks: 0,
        note: None,
    }
}

impl ScoreRow {
    fn has_mesh(&self) -> bool {
        self.mesh.iter().any(Option::is_some)
    }

    /// The mark of a column's score.
    pub(crate) fn mark(&self, column: usize) -> &'static str {
        overcount_mark(column, self.overcounted_tracks)
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
    let mesh_totals = benchmark.mesh_totals_by_seed(measurements);
    let of_mesh_column = |column: usize| {
        let values: Vec<f64> = mesh_totals.iter().filter_map(|scores| mesh_columns(scores)[column]).collect();
        Spread::from_values(&values)
    };
    ScoreRow {
        label: benchmark.variants[variant].label(),
        origin: Origin::Measured,
        cells: std::array::from_fn(of_column),
        mesh: std::array::from_fn(of_mesh_column),
        speed: Spread::from_values(&benchmark.speeds_by_seed(measurements)),
        overcounted_tracks,
        note: missing_note(measurements, scenes * benchmark.seeds.len()),
    }
}

/// Explanations of the rows' marks and empty cells.
fn notes<'m>(
    rows: &[ScoreRow],
    measurements: impl Iterator<Item = &'m Measurement<'m>>,
    protocol: Protocol,
) -> Vec<String> {
    let overcounted = rows.iter().map(|row| row.overcounted_tracks).max().and_then(overcount_note);
    let windows = windows_note(measurements.map(|measurement| measurement.score(protocol)));
    overcounted.into_iter().chain(windows).collect()
}

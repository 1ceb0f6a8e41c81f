//! How well each method keeps the ids of small, medium and large objects, as a table.

use super::Results;
use super::rows::Finished;
use super::tables::{Spread, cell, spread, totals_by_seed, what_is_missing};
use crate::command::score_table::{SIZE_COLUMNS, protocol_name, size_columns};
use splatseg_metrics::{Protocol, Scores, SizeClass};

/// A row for each method and size, over all scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct SizeTable {
    /// What it shows.
    pub title: String,
    /// Its rows, by method and then size.
    pub rows: Vec<SizeRow>,
}

/// One method on the objects of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct SizeRow {
    /// The method, and what is missing.
    pub method: String,
    /// The size.
    pub class: SizeClass,
    /// True objects of this size; of the seed with the most, should results be missing.
    pub objects: u64,
    /// Scores in the order of [`SIZE_COLUMNS`].
    pub cells: [Option<Spread>; 4],
}

impl SizeTable {
    /// The table of a benchmark: objects are summed over scenes for each seed, then seeds are averaged.
    pub fn new(results: &Results, protocol: Protocol) -> Self {
        let rows = (0..results.plan.variants.len()).flat_map(|variant| rows_of(results, variant, protocol)).collect();
        Self { title: format!("By size of the object, protocol {}", protocol_name(protocol)), rows }
    }

    /// The heading of each column after the method.
    pub fn columns() -> impl Iterator<Item = &'static str> {
        ["size", "objects"].into_iter().chain(SIZE_COLUMNS)
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let columns: Vec<&str> = Self::columns().collect();
        let mut text = format!(
            "## {}\n\n| method | {} |\n|---|---|{}\n",
            self.title,
            columns.join(" | "),
            "---:|".repeat(columns.len() - 1)
        );
        for row in &self.rows {
            let (method, class) = (row.method.replace('|', "\\|"), row.class.label());
            let cells = row.cells.map(cell).join(" | ");
            text.push_str(&format!("| {method} | {class} | {} | {cells} |\n", row.objects));
        }
        text
    }
}

fn rows_of(results: &Results, variant: usize, protocol: Protocol) -> [SizeRow; 3] {
    let finished: Vec<&Finished> = results.finished.iter().filter(|finished| finished.variant == variant).collect();
    let totals = totals_by_seed(results, &finished, protocol);
    let label = results.plan.variants[variant].label();
    let missing = what_is_missing(&finished, results.plan.scenes.len() * results.plan.seeds.len());
    let method = missing.map_or_else(|| label.clone(), |missing| format!("{label} ({missing})"));
    SizeClass::ALL.map(|class| {
        let sizes = || totals.iter().filter_map(|scores: &Scores| scores.by_size.get(&class));
        let of_column = |column: usize| {
            let values: Vec<f64> = sizes().filter_map(|scores| size_columns(scores)[column]).collect();
            spread(&values)
        };
        SizeRow {
            method: method.clone(),
            class,
            objects: sizes().map(|scores| scores.objects).max().unwrap_or(0),
            cells: std::array::from_fn(of_column),
        }
    })
}

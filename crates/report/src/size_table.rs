//! Scores by object size: how well each method keeps the ids of small, medium and large objects.

use crate::benchmark::missing_note;
use crate::columns::{SIZE_COLUMNS, size_columns};
use crate::spread::cell_text;
use crate::{Benchmark, Spread, markdown};
use splatseg_metrics::{Protocol, Scores, SizeClass};

/// A row for each method and size, over all scenes.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SizeTable {
    /// The title.
    pub title: String,
    /// Its rows, by method and then by size.
    pub rows: Vec<SizeRow>,
}

/// One method on the objects of one size.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SizeRow {
    /// The method, with a note on missing results.
    pub method: String,
    /// The size.
    pub class: SizeClass,
    /// Number of true objects of this size. Seeds differ only if results are missing; then the largest number.
    pub objects: u64,
    /// AQ, found, ids per object and main id.
    pub cells: [Option<Spread>; 4],
}

impl SizeTable {
    /// The table of a benchmark: objects are summed over scenes for each seed, then seeds are averaged.
    pub fn new(benchmark: &Benchmark, protocol: Protocol) -> Self {
        let rows = (0..benchmark.variants.len()).flat_map(|variant| rows_of(benchmark, variant, protocol)).collect();
        Self { title: format!("By size of the object, protocol {}", protocol.name()), rows }
    }

    /// The heading of each column after the method.
    pub(crate) fn columns() -> [&'static str; 6] {
        let [aq, found, ids, main_id] = SIZE_COLUMNS;
        ["size", "objects", aq, found, ids, main_id]
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let mut text = format!("## {}\n\n{}", self.title, markdown::head("method", &Self::columns()));
        for row in &self.rows {
            let mut cells = vec![row.class.label(), row.objects.to_string()];
            cells.extend(row.cells.map(cell_text));
            text.push_str(&markdown::row(&row.method, &cells));
        }
        text
    }
}

fn rows_of(benchmark: &Benchmark, variant: usize, protocol: Protocol) -> [SizeRow; 3] {
    let measurements = benchmark.of_variant(variant);
    let totals = benchmark.totals_by_seed(&measurements, protocol);
    let label = benchmark.variants[variant].label();
    let missing = missing_note(&measurements, benchmark.scenes.len() * benchmark.seeds.len());
    let method = missing.map_or_else(|| label.clone(), |missing| format!("{label} ({missing})"));
    SizeClass::ALL.map(|class| {
        let sizes = || totals.iter().filter_map(|scores: &Scores| scores.by_size.get(&class));
        let of_column = |column: usize| {
            let values: Vec<f64> = sizes().filter_map(|scores| size_columns(scores)[column]).collect();
            Spread::from_values(&values)
        };
        SizeRow {
            method: method.clone(),
            class,
            objects: sizes().map(|scores| scores.objects).max().unwrap_or(0),
            cells: std::array::from_fn(of_column),
        }
    })
}

//! Scores of single frames.

use crate::benchmark::missing_note;
use crate::columns::{FRAME_COLUMNS, frame_columns};
use crate::spread::cell_text;
use crate::{Benchmark, Spread, markdown};

/// A row for each method, over all frames of all scenes.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct FrameTable {
    /// The method, with a note on missing results, and its scores in the order of the columns.
    pub rows: Vec<(String, [Option<Spread>; 11])>,
}

impl FrameTable {
    /// The title.
    pub const TITLE: &'static str = "Single frames";

    /// The table of a benchmark: counts are summed over scenes for each seed, then seeds are averaged. The scores do
    /// not depend on the protocol.
    pub fn new(benchmark: &Benchmark) -> Self {
        let expected = benchmark.scenes.len() * benchmark.seeds.len();
        let rows = (0..benchmark.variants.len()).map(|variant| {
            let measurements = benchmark.of_variant(variant);
            let totals = benchmark.totals_by_seed(&measurements, benchmark.protocol);
            let of_column = |column: usize| {
                let values: Vec<f64> =
                    totals.iter().filter_map(|scores| frame_columns(&scores.single_frames)[column]).collect();
                Spread::from_values(&values)
            };
            let label = benchmark.variants[variant].label();
            let missing = missing_note(&measurements, expected);
            let method = missing.map_or_else(|| label.clone(), |missing| format!("{label} ({missing})"));
            (method, std::array::from_fn(of_column))
        });
        Self { rows: rows.collect() }
    }

    /// As Markdown, with a heading.
    pub fn markdown(&self) -> String {
        let mut text = format!("## {}\n\n{}", Self::TITLE, markdown::head("method", &FRAME_COLUMNS));
        for (method, cells) in &self.rows {
            text.push_str(&markdown::row(method, &cells.map(cell_text)));
        }
        text
    }
}

//! The paper's tables as data: the measured line of each row, and the paper's below it.

use super::{EfficiencyRow, PaperCurve, PaperRow, PaperTable, curves, efficiency};
use crate::columns::{COLUMN_KEYS, COLUMNS};
use crate::{Benchmark, Origin, ScoreTable, Spread};
use splatseg_metrics::Protocol;

/// Inputs of the paper's tables.
#[derive(Clone, Copy, Debug)]
pub struct PaperResults<'a> {
    /// The benchmark on ScanNet-MV, if any.
    pub scannet: Option<&'a Benchmark<'a>>,
    /// The benchmark on MVPd, if any.
    pub mvpd: Option<&'a Benchmark<'a>>,
    /// The rows of the tables of scores.
    pub rows: &'a [PaperRow],
    /// Our rows of the efficiency table.
    pub efficiency: &'a [EfficiencyRow],
    /// Differences between the inputs and the paper's; one sentence each.
    pub notes: &'a [String],
    /// Inputs that were not found.
    pub missing: &'a [String],
}

/// A table with measured rows and the paper's.
#[derive(Clone, Debug, PartialEq)]
pub struct PublishedTable {
    /// The title.
    pub title: String,
    /// Notes; one sentence or more each.
    pub notes: Vec<String>,
    /// The headings of its columns after the name.
    pub columns: Vec<&'static str>,
    /// The same columns as keys of CSV files.
    pub keys: Vec<&'static str>,
    /// Its rows, the paper's below ours.
    pub rows: Vec<TableRow>,
    /// Its rows as curves, if they differ in a number.
    pub curves: Vec<PaperCurve>,
}

/// A row of a [`PublishedTable`].
#[derive(Clone, Debug, PartialEq)]
pub struct TableRow {
    /// Its name in the paper.
    pub name: String,
    /// Source of its numbers.
    pub origin: Origin,
    /// Reason why it has no numbers, or note on missing results.
    pub note: Option<String>,
    /// A cell for each column.
    pub cells: Vec<Cell>,
}

/// A number of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// The number, if there is one.
    pub value: Option<Spread>,
    /// Its mark.
    pub mark: &'static str,
}

/// All of the paper's tables, in its order.
pub fn paper_tables(results: &PaperResults<'_>) -> Vec<PublishedTable> {
    let scores = PaperTable::ALL.iter().map(|table| scores(results, *table));
    scores.chain([efficiency::table(results)]).collect()
}

fn scores(results: &PaperResults<'_>, table: PaperTable) -> PublishedTable {
    let benchmark = if table.is_of_mvpd() { results.mvpd } else { results.scannet };
    let measured = benchmark.map(|benchmark| ScoreTable::over_all_scenes(benchmark, Protocol::Paper));
    let rows: Vec<&PaperRow> = results.rows.iter().filter(|row| row.table == table).collect();
    let uses = |column: usize| !table.is_of_mvpd() || column <= crate::columns::VSQ;
    let columns: Vec<usize> = (0..COLUMNS.len()).filter(|column| uses(*column)).collect();
    let lines: Vec<TableRow> = rows.iter().flat_map(|row| lines(row, measured.as_ref(), &columns)).collect();
    let mut notes: Vec<String> = measured.map(|measured| measured.notes).unwrap_or_default();
    if table.is_of_mvpd() {
        notes.push(
            "Images of 320x240, true segments under 0.1 % of the image dropped in that frame. The paper could not run \
             SAM2 and SAM2-Splat here. The other systems' rows are the paper's; `splatseg eval` scores their predictions."
                .to_owned(),
        );
    }
    PublishedTable {
        title: table.title().to_owned(),
        notes,
        columns: columns.iter().map(|column| COLUMNS[*column]).collect(),
        keys: columns.iter().map(|column| COLUMN_KEYS[*column]).collect(),
        curves: curves::curves(&rows, &lines),
        rows: lines,
    }
}

/// The measured line of a row, if it is one of our methods, and the paper's line, if there is one.
fn lines(row: &PaperRow, measured: Option<&ScoreTable>, columns: &[usize]) -> Vec<TableRow> {
    let mut lines = Vec::new();
    let measured = row.variant.and_then(|variant| measured?.rows.get(variant));
    if measured.is_some() || row.obstacle.is_some() {
        let cell = |column: &usize| Cell {
            value: measured.and_then(|row| row.cells[*column]),
            mark: measured.map_or("", |row| row.mark(*column)),
        };
        lines.push(TableRow {
            name: row.name.clone(),
            origin: Origin::Measured,
            note: measured.map_or(row.obstacle.clone(), |row| row.note.clone()),
            cells: columns.iter().map(cell).collect(),
        });
    }
    if row.published.iter().any(Option::is_some) {
        let cell = |column: &usize| Cell { value: row.published[*column].map(Spread::from_mean), mark: "" };
        lines.push(TableRow {
            name: row.name.clone(),
            origin: Origin::Paper,
            note: None,
            cells: columns.iter().map(cell).collect(),
        });
    }
    lines
}

impl TableRow {
    /// The name in tables.
    pub(crate) fn label(&self) -> String {
        match (self.origin, &self.note) {
            (Origin::Paper, _) => format!("{}, the paper", self.name),
            (Origin::Measured, Some(note)) => format!("{} ({note})", self.name),
            (Origin::Measured, None) => self.name.clone(),
        }
    }
}

impl Cell {
    /// Its text; empty if the paper has no number in its row.
    pub(crate) fn text(&self, origin: Origin) -> String {
        match (self.value, origin) {
            (Some(value), _) => format!("{}{}", value.text(), self.mark),
            (None, Origin::Measured) => "–".to_owned(),
            (None, Origin::Paper) => String::new(),
        }
    }
}

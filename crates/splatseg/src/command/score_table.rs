//! The columns of the paper's tables.

use splatseg_metrics::{Protocol, Scores};

/// The columns, in the paper's order.
pub const COLUMNS: [&str; 8] = ["k=1", "k=5", "k=10", "k=15", "VSQ", "STQ", "AQ", "SQ"];

/// The same columns as keys of CSV files, in the words of the JSON keys.
pub const COLUMN_KEYS: [&str; 8] = ["vsq_1", "vsq_5", "vsq_10", "vsq_15", "vsq", "stq", "aq", "sq"];

/// Scores in the order of [`COLUMNS`], percent; `None` where there is nothing to divide by.
pub fn columns(scores: &Scores) -> [Option<f64>; 8] {
    let mut columns = [None; 8];
    for (column, quality) in columns.iter_mut().zip(scores.vsq_k.values()) {
        *column = *quality;
    }
    columns[4..].copy_from_slice(&[scores.vsq, scores.stq, scores.aq, scores.sq]);
    columns
}

/// A protocol's name, as on the command line and in JSON.
pub fn protocol_name(protocol: Protocol) -> &'static str {
    match protocol {
        Protocol::Paper => "paper",
        Protocol::Strict => "strict",
    }
}

/// Two lines for a terminal: the columns' names and one row of scores.
pub fn terminal_table(scores: &Scores) -> String {
    let cell = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    let line = |cells: Vec<String>| cells.iter().map(|cell| format!("{cell:>8}")).collect::<String>();
    let names = COLUMNS.iter().map(|name| (*name).to_owned()).collect();
    format!("{}\n{}", line(names), line(columns(scores).map(cell).to_vec()))
}

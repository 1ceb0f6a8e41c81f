//! The columns of the paper's tables.

use splatseg_metrics::{Protocol, Scores, SizeScores};

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

/// The columns of tables by the size of the object, after the number of objects.
pub const SIZE_COLUMNS: [&str; 4] = ["AQ", "found", "ids per object", "main id"];

/// The same columns as keys of CSV files, in the words of the JSON keys.
pub const SIZE_COLUMN_KEYS: [&str; 4] = ["aq", "found", "ids_per_object", "main_id"];

/// What the columns of tables by the size of the object mean.
pub const SIZE_COLUMNS_EXPLAINED: &str = "The size of an object is its mean area in the frames that show it. Its id in \
    a frame is the predicted id on more than half of its pixels, be it a larger neighbour's. AQ: as in STQ, over these \
    objects. Found: objects that have an id in any frame, percent. Ids per object: different ids of a found object over \
    the video; 1 is best. Main id: frames in which an object has the id that it has most often, percent of the frames \
    that show one.";

/// Scores of a size in the order of [`SIZE_COLUMNS`]; `None` where there is nothing to divide by.
pub fn size_columns(scores: &SizeScores) -> [Option<f64>; 4] {
    [scores.aq, scores.found, scores.ids_per_object, scores.main_id]
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
    let line = |cells: Vec<String>| cells.iter().map(|cell| format!("{cell:>8}")).collect::<String>();
    let names = COLUMNS.iter().map(|name| (*name).to_owned()).collect();
    format!("{}\n{}", line(names), line(columns(scores).map(terminal_cell).to_vec()))
}

/// Lines for a terminal: a row of scores for each size of object.
pub fn terminal_size_table(scores: &Scores) -> String {
    let width = scores.by_size.keys().map(|class| class.label().len()).max().unwrap_or(0);
    let mut text = format!("{:width$}{:>9}", "", "objects");
    text.extend(SIZE_COLUMNS.map(|name| format!("{name:>16}")));
    for (class, sizes) in &scores.by_size {
        text.push_str(&format!("\n{:width$}{:>9}", class.label(), sizes.objects));
        text.extend(size_columns(sizes).map(|value| format!("{:>16}", terminal_cell(value))));
    }
    text
}

/// A cell's text for a terminal.
fn terminal_cell(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

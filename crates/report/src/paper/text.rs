//! `paper.md` and `paper.csv`.

use super::tables::{PaperResults, PublishedTable, TableRow, paper_tables};
use crate::{Benchmark, Origin, markdown};
use splatseg_files::csv_cell;

/// All tables as Markdown, the paper's rows in italics.
pub fn markdown(results: &PaperResults<'_>) -> String {
    let mut text = format!("# The paper's tables\n\n{}\n\n", heading(results));
    text.push_str(&list(results.notes));
    for table in paper_tables(results) {
        text.push_str(&format!("\n## {}\n\n{}", table.title, markdown::head("", &table.columns)));
        table.rows.iter().for_each(|row| text.push_str(&line(row)));
        text.extend(table.notes.iter().map(|note| format!("\n{note}\n")));
    }
    text.push_str(&format!("\n## What is missing\n\n{}", list(results.missing)));
    text
}

/// All numbers of the tables for spreadsheets: a header line, then one number per line.
pub fn csv(results: &PaperResults<'_>) -> String {
    let mut text = "table,row,origin,column,mean,deviation\n".to_owned();
    for table in paper_tables(results) {
        for row in &table.rows {
            text.push_str(&csv_lines(&table, row));
        }
    }
    text
}

fn csv_lines(table: &PublishedTable, row: &TableRow) -> String {
    let origin = match row.origin {
        Origin::Measured => "measured",
        Origin::Paper => "paper",
    };
    let cells = table.keys.iter().zip(&row.cells).filter_map(|(key, cell)| Some((key, cell.value?)));
    cells
        .map(|(key, value)| {
            let deviation = value.deviation.map_or_else(String::new, |deviation| deviation.to_string());
            format!("{},{},{origin},{key},{},{deviation}\n", csv_cell(&table.title), csv_cell(&row.name), value.mean)
        })
        .collect()
}

/// Summary of the measurements in one or two sentences.
pub(crate) fn heading(results: &PaperResults<'_>) -> String {
    let of = |name: &str, benchmark: Option<&Benchmark<'_>>| match benchmark {
        Some(benchmark) => format!(
            "{name}: {}, {}, {}.",
            markdown::count(benchmark.scenes.len(), if name == "MVPd" { "video" } else { "scene" }),
            markdown::count(benchmark.seeds.len(), "seed"),
            benchmark.setup
        ),
        None => format!("{name}: nothing measured."),
    };
    let version = results.scannet.or(results.mvpd).map(|benchmark| benchmark.version);
    format!(
        "Percent, protocol `paper`, splatseg {}. {} {} The paper's own rows were measured on the whole validation split of \
         ScanNet, on MVPd, and its speeds on a GPU.",
        version.unwrap_or("(nothing measured)"),
        of("ScanNet-MV", results.scannet),
        of("MVPd", results.mvpd)
    )
}

fn line(row: &TableRow) -> String {
    let texts = row.cells.iter().map(|cell| cell.text(row.origin));
    match row.origin {
        Origin::Measured => markdown::row(&row.label(), &texts.collect::<Vec<_>>()),
        Origin::Paper => {
            let italics = |text: String| if text.is_empty() { text } else { format!("*{text}*") };
            markdown::row(&format!("*{}*", row.label()), &texts.map(italics).collect::<Vec<_>>())
        }
    }
}

fn list(items: &[String]) -> String {
    items.iter().map(|item| format!("- {item}\n")).collect()
}

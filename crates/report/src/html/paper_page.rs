//! `paper.html`: the paper's tables.

use super::chart::{COLORS, Chart, Curve, Style};
use super::charts::{curves_by_name, end_of_axis};
use super::page::document;
use super::tables;
use crate::paper::{CurveRow, PaperCurve, PaperResults, heading, paper_tables};
use maud::{Markup, html};

/// The paper's tables on a page that needs no network and no other file.
pub fn paper_page(results: &PaperResults<'_>) -> String {
    let content = html! {
        h1 { "The paper's tables" }
        p class="facts" { (heading(results).replace('`', "")) }
        @if !results.notes.is_empty() { ul { @for note in results.notes { li { (note) } } } }
        @for table in paper_tables(results) {
            h2 { (table.title) }
            (tables::published(&table))
            @if !table.curves.is_empty() {
                div class="charts" { @for curve in &table.curves { (chart(curve)) } }
            }
        }
        h2 { "What is missing" }
        ul { @for missing in results.missing { li { (missing) } } }
    };
    document("The paper's tables, splatseg", &content, &html! {})
}

/// The chart of VSQ and STQ of a curve's rows; the paper's values are dashed.
fn chart(curve: &PaperCurve) -> Markup {
    let of = |label: &str, color: usize, value: fn(&CurveRow) -> Option<f64>| {
        let known = (0..).zip(&curve.rows).filter_map(|(index, row)| Some((index, row, value(row)?)));
        let (points, notes) = known
            .map(|(index, row, percent): (usize, _, _)| {
                ((index as f64, percent), format!("{}: {percent:.2}", row.value))
            })
            .unzip();
        Curve { label: label.to_owned(), color, points, notes }
    };
    let curves = [
        of("VSQ, measured", 0, |row| row.measured[0]),
        of("STQ, measured", 1, |row| row.measured[1]),
        of("VSQ, the paper", COLORS, |row| row.published[0]),
        of("STQ, the paper", COLORS + 1, |row| row.published[1]),
    ];
    let curves: Vec<Curve> = curves.into_iter().filter(|curve| !curve.points.is_empty()).collect();
    let names = curve.rows.iter().map(|row| row.value.to_string()).collect();
    let axes = curves_by_name(names, curve.x_label, end_of_axis(&curves));
    Chart { title: curve.title.clone(), axes, curves, style: Style::Lines }.markup()
}

//! Tables of the page.

use crate::columns::COLUMNS;
use crate::{Origin, SIZE_COLUMNS_EXPLAINED, ScoreRow, ScoreTable, SizeTable, Spread, StageTable, paper};
use maud::{Markup, html};

/// A table with the heads of its columns.
fn table<'a>(columns: impl IntoIterator<Item = &'a str>, rows: &Markup) -> Markup {
    html! {
        div class="wide" {
            table {
                thead { tr {
                    th scope="col" { "method" }
                    @for column in columns { th scope="col" { (column) } }
                } }
                tbody { (rows) }
            }
        }
    }
}

/// A table of scores; the best measured score of each column is bold.
pub(super) fn scores(scores: &ScoreTable) -> Markup {
    let best = scores.best_of_columns();
    let (measured, published): (Vec<&ScoreRow>, Vec<&ScoreRow>) =
        scores.rows.iter().partition(|row| row.origin == Origin::Measured);
    let rows = html! {
        @for row in measured {
            tr {
                th scope="row" { (row.label) @if let Some(note) = &row.note { " " small { "(" (note) ")" } } }
                @for (column, (value, best)) in row.cells.iter().zip(best).enumerate() {
                    @let is_best = value.is_some_and(|value| Some(value.mean) == best);
                    td class=[is_best.then_some("best")] { (cell(*value)) (row.mark(column)) }
                }
                td { (cell(row.speed)) }
            }
        }
        @if !published.is_empty() { tr class="paper" { th colspan="10" { (paper::MARK) } } }
        @for row in published {
            tr class="paper" {
                th scope="row" { (row.label) }
                @for value in row.cells { td { (cell(value)) } }
                td { (cell(row.speed)) }
            }
        }
    };
    html! {
        (table(COLUMNS.into_iter().chain(["frames/s"]), &rows))
        @for note in &scores.notes { p { small { (note) } } }
    }
}

/// The table by size of the object, folded.
pub(super) fn sizes(sizes: &SizeTable) -> Markup {
    let rows = html! {
        @for row in &sizes.rows {
            tr {
                th scope="row" { (row.method) }
                td { (row.class.label()) }
                td { (row.objects) }
                @for value in row.cells { td { (cell(value)) } }
            }
        }
    };
    html! {
        details {
            summary { (sizes.title) }
            p { (SIZE_COLUMNS_EXPLAINED) }
            (table(SizeTable::columns(), &rows))
        }
    }
}

/// The table of times, folded.
pub(super) fn stages(stages: &StageTable) -> Markup {
    let rows = html! {
        @for (label, times) in &stages.rows {
            tr {
                th scope="row" { (label) }
                @for time in times { td { (format_args!("{time:.2}")) } }
            }
        }
    };
    let columns: Vec<String> = stages.columns.iter().map(|column| column.replace('_', " ")).collect();
    html! {
        details {
            summary { (StageTable::TITLE) }
            (table(columns.iter().map(String::as_str), &rows))
        }
    }
}

/// The mean, and the standard deviation below it.
fn cell(value: Option<Spread>) -> Markup {
    html! {
        @match value {
            None => { "–" }
            Some(Spread { mean, deviation }) => {
                (format_args!("{mean:.2}"))
                @if let Some(deviation) = deviation { small { "± " (format_args!("{deviation:.2}")) } }
            }
        }
    }
}

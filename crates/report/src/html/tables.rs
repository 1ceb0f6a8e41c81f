//! Tables of the page.

use crate::columns::FRAME_COLUMNS;
use crate::paper::PublishedTable;
use crate::{FRAME_COLUMNS_EXPLAINED, FrameTable, Origin, SIZE_COLUMNS_EXPLAINED};
use crate::{ScoreRow, ScoreTable, SizeTable, Spread, StageTable};
use maud::{Markup, html};

/// A table with column headers; `first` is the header of the rows' names.
pub(super) fn table<'a>(first: &str, columns: impl IntoIterator<Item = &'a str>, rows: &Markup) -> Markup {
    html! {
        div class="wide" {
            table {
                thead { tr {
                    th scope="col" { (first) }
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
                @for (column, (value, mark)) in scores.cells_of(row).into_iter().enumerate() {
                    @let best = best.get(column).copied().flatten();
                    @let is_best = value.is_some_and(|value| Some(value.mean) == best);
                    td class=[is_best.then_some("best")] { (cell(value)) (mark) }
                }
            }
        }
        @if !published.is_empty() { tr class="paper" { th colspan=(scores.columns().len() + 1) { (scores.mark) } } }
        @for row in published {
            tr class="paper" {
                th scope="row" { (row.label) }
                @for (value, _) in scores.cells_of(row) { td { (cell(value)) } }
            }
        }
    };
    html! {
        (table("method", scores.columns(), &rows))
        @for note in &scores.notes { p { small { (note) } } }
    }
}

/// One of the paper's tables.
pub(super) fn published(published: &PublishedTable) -> Markup {
    let rows = html! {
        @for row in &published.rows {
            tr class=[(row.origin == Origin::Paper).then_some("paper")] {
                th scope="row" { (row.label()) }
                @for cell in &row.cells { td { (cell.text(row.origin)) } }
            }
        }
    };
    html! {
        (table("method", published.columns.iter().copied(), &rows))
        @for note in &published.notes { p { small { (note) } } }
    }
}

/// The table by object size, collapsed.
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
            (table("method", SizeTable::columns(), &rows))
        }
    }
}

/// The single-frame table, collapsed.
pub(super) fn frames(frames: &FrameTable) -> Markup {
    let rows = html! {
        @for (method, cells) in &frames.rows {
            tr {
                th scope="row" { (method) }
                @for value in cells { td { (cell(*value)) } }
            }
        }
    };
    html! {
        details {
            summary { (FrameTable::TITLE) }
            p { (FRAME_COLUMNS_EXPLAINED) }
            (table("method", FRAME_COLUMNS, &rows))
        }
    }
}

/// The table of times, collapsed.
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
            (table("method", columns.iter().map(String::as_str), &rows))
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

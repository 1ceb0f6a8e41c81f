//! `paper.html`: the paper's tables.

use super::page::document;
use super::tables;
use crate::paper::{PaperResults, heading, paper_tables};
use maud::html;

/// The paper's tables on a page that needs no network and no other file.
pub fn paper_page(results: &PaperResults<'_>) -> String {
    let content = html! {
        h1 { "The paper's tables" }
        p class="facts" { (heading(results).replace('`', "")) }
        @if !results.notes.is_empty() { ul { @for note in results.notes { li { (note) } } } }
        @for table in paper_tables(results) {
            h2 { (table.title) }
            (tables::published(&table))
        }
        h2 { "What is missing" }
        ul { @for missing in results.missing { li { (missing) } } }
    };
    document("The paper's tables, splatseg", &content, &html! {})
}

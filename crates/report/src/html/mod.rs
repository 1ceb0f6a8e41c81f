//! `report.html` and `paper.html`: single pages that need only a browser: no network and no other file.
//!
//! The size of a page does not grow with the benchmark: `selection.rs` limits the scenes, variants and frames with
//! pictures, `charts.rs` the dots. So its pictures and curves are read only when the page is written, for the selected
//! scenes.

mod ablations;
mod axes;
mod chart;
mod charts;
mod page;
mod paper_page;
mod scenes;
mod selection;
mod strips;
mod tables;

pub use page::html_page;
pub use paper_page::paper_page;
pub use selection::PageSelection;

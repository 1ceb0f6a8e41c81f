//! `report.html` and `paper.html`: single pages that need only a browser: no network and no other file.

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

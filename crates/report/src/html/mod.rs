//! `report.html` and `paper.html`: everything on one page that needs no network, no other file and no program but a
//! browser.

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

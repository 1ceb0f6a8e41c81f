//! Reports on video segmentation benchmarks: tables as Markdown, CSV and plain text, and one HTML page with charts.
//!
//! Plain data in, text out. A [`Benchmark`] lists the compared methods and holds the measurements, independent of how
//! they were made. From it come
//!
//! - [`html_page`]: a page with tables, charts and pictures, in a single file that needs no network;
//! - [`markdown_tables`] and [`csv_table`];
//! - [`ScoreTable`], [`SizeTable`], [`FrameTable`] and [`StageTable`], the tables themselves;
//! - [`paper::paper_tables`]: the tables of the methods' paper, with its numbers next to the measured ones; written by
//!   [`paper::markdown`], [`paper::csv`] and [`paper_page`].

mod benchmark;
mod columns;
mod csv;
mod drawings;
mod frame_table;
mod html;
mod markdown;
pub mod paper;
mod score_table;
mod size_table;
mod spread;
mod stage_table;

pub use benchmark::{Benchmark, Measurement, MissingResult, Variant};
pub use columns::{FRAME_COLUMNS_EXPLAINED, SIZE_COLUMNS_EXPLAINED};
pub use columns::{overcount_note, terminal_frame_table, terminal_size_table, terminal_table, windows_note};
pub use csv::csv_table;
pub use drawings::{RunDrawings, SceneDrawings, ScenePicture, Series, Thumbnail};
pub use frame_table::FrameTable;
pub use html::{PageSelection, html_page, paper_page};
pub use markdown::markdown_tables;
pub use score_table::{Origin, ScoreRow, ScoreTable};
pub use size_table::{SizeRow, SizeTable};
pub use spread::Spread;
pub use stage_table::StageTable;

//! The integration tests of this crate, in one program: it is linked once.

mod batch;
mod benchmark;
#[path = "support/browser.rs"]
mod browser;
mod command;
mod convert;
mod coordinates;
mod crate_count;
mod default_out;
mod devices;
mod evaluation;
mod export;
mod final_pass;
mod find;
mod help;
mod input;
mod inspect;
mod late_failures;
mod live;
mod live_view;
mod locate;
mod map_changes;
mod mcp;
mod memory_helps;
mod mesh;
mod name;
mod objects;
mod output_folder;
mod page_browser;
mod page_controls;
mod page_large;
mod page_map;
mod paper;
mod poses;
mod recording;
mod report_browser;
mod resume;
mod save_mcap;
mod segmenter_fastsam;
mod settings;
#[path = "../../../../xtask/src/standins.rs"]
mod standins;
mod support;
mod terminal;
mod trajectory;
mod tutorial;

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
mod export_mesh;
mod export_scene_graph;
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
mod merge;
mod mesh;
mod name;
mod objects;
mod output_folder;
mod page_browser;
mod page_controls;
mod page_large;
mod page_map;
mod page_plan;
mod paper;
mod places;
mod poses;
mod recording;
mod report_browser;
mod resume;
mod route;
mod save_mcap;
mod segmenter_fastsam;
mod settings;
#[path = "../../../../xtask/src/standins.rs"]
mod standins;
mod support;
mod terminal;
#[path = "../../../splatseg/tests/it/tiny_clip.rs"]
mod tiny_clip;
mod trajectory;
mod tutorial;

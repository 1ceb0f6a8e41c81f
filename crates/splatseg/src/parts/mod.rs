//! The parts that settings choose: methods, segmenters, trackers, namers and depth predictors.
//!
//! A part of each kind can be chosen by its name once it is in the table of its kind. A part is one type: its
//! settings, declared with `settings!`, which implement [`PartSection`]. The built-in parts are in `segmenters.rs` and
//! `trackers.rs`; other crates add theirs with [`register_segmenter`](crate::settings::register_segmenter),
//! [`register_tracker`](crate::settings::register_tracker) and [`register_namer`](crate::settings::register_namer).
//!
//! Nothing here depends on the pipeline or on the settings of a whole run: both are made of parts.

mod context;
mod depth_anything;
pub(crate) mod depth_predictors;
mod error;
mod files;
pub(crate) mod methods;
pub(crate) mod namers;
mod networks;
mod part;
mod part_settings;
mod requirements;
mod section;
pub(crate) mod segmenters;
mod table;
pub(crate) mod trackers;
mod values;

pub use context::PartContext;
pub use depth_anything::{DepthAnythingOutput, DepthAnythingSettings};
pub use depth_predictors::DepthPredictorSettings;
pub use error::PartError;
pub use files::{MissingFile, PartFile, PartFiles, SettingsInput};
pub use methods::{MethodName, MethodSettings};
pub use namers::{Namer, NamerSettings, ObjectToName, Pacer};
pub use networks::LoadedNetworks;
pub use part::Part;
pub use part_settings::PartSettings;
pub use requirements::{ChosenValues, Entry, Requirement};
pub use section::PartSection;
pub use segmenters::{MaskFolderSettings, SegmenterSettings};
pub use table::{PartKind, PartTable, RegisterError};
pub use trackers::TrackerSettings;

pub(crate) use methods::MethodParts;
pub(crate) use requirements::Registry;
pub(crate) use values::section;

//! An online 3D Gaussian splat that remembers segments: growth, removal, evidence or features, PLY files.
//!
//! For every frame, [`SplatMemory::recall`] renders the segments that the memory expects, [`SplatMemory::fuse`]
//! combines them with the frame's predictions, and [`SplatMemory::update`] learns from the predictions. The crate does
//! not depend on any segmenter.
//!
//! `segment_store.rs` defines the trait of a kind of memory; `evidence/` and `features/` implement it.
//!
//! Both kinds of memory share the map: Gaussians are opaque balls (`map.rs`), the view is rasterised once per frame
//! (`recall.rs`), and there is one implementation of growth (`growth.rs`, `borders.rs`, `depth_completion.rs`), removal
//! (`removal.rs`), contradictions between frames and map (`recent/`), corrections (`correction.rs`), the union of two maps (`joining.rs`) and ids
//! (`segments.rs`).

mod belief;
mod borders;
mod co_visible;
mod correction;
mod depth_completion;
mod doubles;
mod error;
mod evidence;
mod features;
mod growth;
mod joining;
mod kind_definitions;
mod map;
mod memory_kind;
mod memory_rules;
mod old_saved_state;
mod origin;
mod patches;
mod persistence;
mod ply;
mod recall;
mod recent;
mod removal;
mod replaced;
mod saved_state;
mod segment_store;
mod segments;
mod settings;
mod splat_memory;
mod tile_surface;

pub use belief::SegmentBelief;
pub use error::{LoadMemoryError, MemoryError};
pub use evidence::Votes;
pub use features::{Codebook, CodebookError, CodebookSettings};
pub use joining::JoinedIds;
pub use kind_definitions::{
    CreateStore, MemoryKindDefinition, NewStore, RestoreStore, SavedStore, register_memory_kind,
};
pub use map::{NewGaussian, SplatMap};
pub use memory_kind::{MemoryKind, RegisterKindError, RegisteredKind};
pub use memory_rules::MemoryRules;
pub use persistence::Attached;
pub use ply::{ExportedForm, write_exported};
pub use ply::{SavedCodes, SavedMemorySettings};
pub use ply::{SplatContent, SplatContentView, SplatFile, SplatFileError, SplatFileView};
pub use recall::{Recall, StoreTile};
pub use replaced::Replacements;
pub use segment_store::{LearningStats, SegmentStore, Verdict};
pub use segments::SegmentHold;
pub use settings::{GrowthRule, MemorySettings};
pub use splat_memory::{FrameUpdate, SplatMemory};
pub use tile_surface::TileSurface;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

//! An online 3D Gaussian splat that remembers segments: growth, removal, evidence or features, PLY files.
//!
//! [`SplatMemory`] is asked three things for every frame: which segments it expects there ([`SplatMemory::recall`]), what
//! the frame shows once that and the predictions are brought together ([`SplatMemory::fuse`]), and to take in what was
//! seen ([`SplatMemory::update`]). It knows nothing of segmenters.
//!
//! What a memory must do with segments is in `segment_store.rs`; `evidence/` and `features/` are the two that do it. Where it
//! is done is in `backend.rs`: on the CPU (`host_map.rs`), or on a device that [`SplatMemory::on_device`] is given.

mod backend;
mod belief;
mod borders;
mod depthless;
mod evidence;
mod features;
mod growth;
mod host_map;
mod map;
mod origin;
mod persistence;
mod ply;
mod recall;
mod recent;
mod recolored;
mod recurring;
mod removal;
mod segment_store;
mod segments;
mod settings;
mod short_term;
mod splat_memory;

pub use backend::{FrameTrust, MapBackend, MapContent, MapDevice, MapUpdate, RememberedSegments, VisibleGaussian};
pub use belief::SegmentBelief;
pub use evidence::Votes;
pub use features::{Codebook, CodebookError, CodebookSettings, LearningExtent, SegmentCodes, target as feature_target};
pub use map::{NewGaussian, SplatMap};
pub use persistence::LoadMemoryError;
pub use ply::{ExportedForm, ExportedGaussian, write_exported};
pub use ply::{SavedCodes, SavedMemorySettings};
pub use ply::{SplatContent, SplatContentView, SplatFile, SplatFileError, SplatFileView};
pub use recall::{DeviceImages, Recall, TileSurface};
pub use removal::longest_unseen;
pub use segment_store::{SegmentStore, StoreTile};
pub use segments::{MAX_16_BIT_ID, MAX_SEGMENT_ID, SegmentHold};
pub use settings::{GrowthRule, MemoryKind, MemorySettings};
pub use short_term::Appearances;
pub use splat_memory::{ABSTAIN, FrameUpdate, MemoryError, SplatMemory};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

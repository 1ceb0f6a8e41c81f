//! An online 3D Gaussian splat that remembers segments: codebook, growth, decoding, learning, PLY files.
//!
//! [`SplatMemory`] is asked three things for every frame: how its Gaussians look from there ([`SplatMemory::view`]),
//! which segments it expects there ([`SplatMemory::expect`]), and to take in what was seen
//! ([`SplatMemory::learn_frame`]). It knows nothing of segmenters.

mod belief;
mod codebook;
mod decoding;
mod growth;
mod learning;
mod loss;
mod persistence;
mod ply;
mod settings;
mod splat_memory;

pub use belief::{Expectation, SegmentBelief};
pub use codebook::{Codebook, CodebookError, CodebookSettings};
pub use learning::LearningExtent;
pub use persistence::LoadMemoryError;
pub use ply::{SplatFile, SplatFileError, SplatFileView};
pub use settings::{MemorySettings, SettingsError};
pub use splat_memory::{FrameUpdate, MAX_SEGMENT_ID, MemoryError, SplatMemory};

//! The memory as one file: a PLY that any splat viewer opens, with what belongs to no Gaussian behind its vertices.
//!
//! A binary little-endian PLY with the properties of 3D Gaussian splatting in their usual order, spherical harmonics of
//! degree 0, then what the memory needs to go on:
//!
//! ```text
//! ply
//! format binary_little_endian 1.0
//! comment splatseg memory 4 kind evidence segments 40 short_term 812
//! element vertex 120000
//! property float x, y, z            metres
//! property float nx, ny, nz         zero
//! property float f_dc_0..2          (colour / 255 − 0.5) / 0.28209479177387814
//! property float opacity            logit: 20, whose sigmoid is exactly 1 in f32
//! property float scale_0..2         natural logarithm of the radius, three times
//! property float rot_0..3           1, 0, 0, 0
//! property float radius             metres: that of `scale`, to the last bit
//! property uint last_seen           number of the last frame that saw the Gaussian
//! property int seen_through         frames that have seen through it since, 0 to 255
//! property int vote_id_0            a segment, 0 for "none"...
//! property float votes_0            ...and the votes for it, 0 in an empty slot
//! ...                               the same for slots 1 to 3
//! property int segment_id           the segment that the Gaussian shows, 0 for none; for viewers
//! end_header
//! ```
//!
//! (one property a line). Far from the world's origin, coordinates are relative to another one, which a further comment states
//! (world coordinates, metres): add it to `x`, `y` and `z`.
//!
//! ```text
//! comment origin 500000 5400000 0
//! ```
//!
//! A memory of features has another comment, and features in place of votes:
//!
//! ```text
//! comment splatseg memory 4 kind features feature_dim 28 codes 512 segments 40 short_term 812
//! property float feature_0..27
//! ```
//!
//! `segments` is the number of ids that the file lists; Gaussians have votes for these and for 0 only. A block follows
//! the vertices, all little-endian:
//!
//! | Field | Type | |
//! |---|---|---|
//! | mark | `[u8; 8]` | `SPLATSEG` |
//! | version | `u32` | 4 |
//! | kind | `u32` | 0 evidence, 1 features |
//! | segments | `u32` | as in the comment |
//! | frames | `u32` | frames taken in |
//! | feature_dim | `u32` | features only |
//! | codes | `u64` | features only |
//! | seed | `u64` | features only: what the codes were made from |
//! | blocks | `u32` | features only: how many times codes were made |
//! | the codes | `f32` `[codes, feature_dim]` | features only |
//! | ids | `u32` `[segments]` | the ids that the memory has anything of, in increasing order |
//! | sightings | `u32` `[segments]` | frames in which a prediction had the id |
//! | carried | `u8` `[segments]` | 1 if anything carried the id when that was last looked at, else 0 |
//! | short term | `u8` `[short_term]` | what the memory keeps besides its Gaussians |
//! | checksum | `u32` | CRC-32 (zlib's) of every byte of the file before it |
//!
//! Segments without depth are regions of an image, not Gaussians. They, and what else a memory keeps for a few frames,
//! are in the text at the end of the block (`short_term` bytes of JSON, see `short_term.rs`).
//!
//! The block is not a second element of the PLY because browser viewers (antimatter15/splat, gsplat.js) count every `property`
//! line of the header as part of a vertex; like PlayCanvas/SuperSplat, GaussianSplats3D and plyfile, they ignore what
//! follows the vertices. The two also look for the end of the header in the first 10 KB: features of more than about
//! 300 dimensions are too much for them. All properties have four bytes, so that no viewer takes a wrong offset.
//!
//! Without `f_rest_*`, loaders that take the degree from the file (all of the above) see degree 0. Inria's `load_ply`
//! has to be told (`--sh_degree 0`, its assertion counts them); SIBR and other readers of fixed records cannot read it.

mod error;
mod export;
mod header;
mod layout;
mod reader;
mod record;
mod saved_settings;
mod trailer;
mod writer;

pub use error::SplatFileError;
pub use export::{ExportedForm, ExportedGaussian, write_exported};
pub use saved_settings::{SavedCodes, SavedMemorySettings};

use crate::{Codebook, MemoryKind, SplatMap, Votes};
use glam::DVec3;
use splatseg_geometry::SegmentId;
use std::path::Path;

/// Version of the format, in the header's comment and in the block behind the vertices.
const VERSION: u32 = 4;
/// Records pass through memory in pieces of about this size.
const CHUNK_BYTES: usize = 1 << 18;

/// A splat memory as it is loaded from a file: N Gaussians, S segment ids.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatFile {
    /// Origin of the Gaussians' coordinates: world coordinates, metres.
    pub origin: DVec3,
    /// The Gaussians, N entries.
    pub map: SplatMap,
    /// What they remember of segments, N entries.
    pub content: SplatContent,
    /// Segment that each Gaussian shows by itself, 0 for none, `[N]`; for viewers.
    pub segment_ids: Vec<u32>,
    /// The ids, in increasing order, `[S]`.
    pub ids: Vec<SegmentId>,
    /// Frames in which a prediction had each id, `[S]`.
    pub sightings: Vec<u32>,
    /// Whether anything carried each id when that was last looked at, `[S]`.
    pub carried: Vec<bool>,
    /// Frames taken in.
    pub frames: u32,
    /// What the memory keeps besides its Gaussians, as text that only it understands; may be empty.
    pub short_term: Vec<u8>,
}

/// What Gaussians remember of segments.
#[derive(Clone, Debug, PartialEq)]
pub enum SplatContent {
    /// A memory of [`MemoryKind::Evidence`].
    Evidence {
        /// `[N]`.
        votes: Vec<Votes>,
    },
    /// A memory of [`MemoryKind::Features`].
    Features {
        /// Row-major `[N, D]`.
        features: Vec<f32>,
        /// The codes, of dimension D; that of an id is number id − 1.
        codebook: Codebook,
    },
}

/// A splat memory to be saved, borrowed: the same fields as [`SplatFile`], without a copy of the memory.
#[derive(Clone, Copy, Debug)]
pub struct SplatFileView<'a> {
    /// Origin of the Gaussians' coordinates: world coordinates, metres.
    pub origin: DVec3,
    /// The Gaussians, N entries.
    pub map: &'a SplatMap,
    /// What they remember of segments, N entries.
    pub content: SplatContentView<'a>,
    /// Segment that each Gaussian shows by itself, 0 for none, `[N]`; for viewers.
    pub segment_ids: &'a [u32],
    /// The ids, in increasing order, `[S]`.
    pub ids: &'a [SegmentId],
    /// Frames in which a prediction had each id, `[S]`.
    pub sightings: &'a [u32],
    /// Whether anything carried each id when that was last looked at, `[S]`.
    pub carried: &'a [bool],
    /// Frames taken in.
    pub frames: u32,
    /// What the memory keeps besides its Gaussians, as text that only it understands; may be empty.
    pub short_term: &'a [u8],
}

/// [`SplatContent`], borrowed.
#[derive(Clone, Copy, Debug)]
pub enum SplatContentView<'a> {
    /// A memory of [`MemoryKind::Evidence`].
    Evidence {
        /// `[N]`.
        votes: &'a [Votes],
    },
    /// A memory of [`MemoryKind::Features`].
    Features {
        /// Row-major `[N, D]`.
        features: &'a [f32],
        /// The codes, of dimension D; that of an id is number id − 1.
        codebook: &'a Codebook,
    },
}

impl SplatContent {
    /// The kind of memory that has such content.
    pub fn kind(&self) -> MemoryKind {
        match self {
            Self::Evidence { .. } => MemoryKind::Evidence,
            Self::Features { .. } => MemoryKind::Features,
        }
    }

    /// The same, borrowed.
    pub fn view(&self) -> SplatContentView<'_> {
        match self {
            Self::Evidence { votes } => SplatContentView::Evidence { votes },
            Self::Features { features, codebook } => SplatContentView::Features { features, codebook },
        }
    }
}

impl SplatFile {
    /// The same, borrowed.
    pub fn view(&self) -> SplatFileView<'_> {
        SplatFileView {
            origin: self.origin,
            map: &self.map,
            content: self.content.view(),
            segment_ids: &self.segment_ids,
            ids: &self.ids,
            sightings: &self.sightings,
            carried: &self.carried,
            frames: self.frames,
            short_term: &self.short_term,
        }
    }

    /// Writes the file; see [`SplatFileView::save`].
    ///
    /// # Errors
    /// As [`SplatFileView::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        self.view().save(path)
    }

    /// Reads a file that [`SplatFileView::save`] wrote. Everything comes back as it was, to the last bit.
    ///
    /// # Errors
    /// [`SplatFileError`] if the file cannot be read, is another kind of PLY, was cut off or altered, or holds values
    /// that no memory has. No more memory is taken than the file is long.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SplatFileError> {
        reader::load(path.as_ref())
    }
}

impl SplatFileView<'_> {
    /// Writes the file at `path`, in place of one that may be there: first under another name in the same folder, so
    /// that a half-written file never stands at `path`.
    ///
    /// # Errors
    /// [`SplatFileError`] if array lengths or ids contradict each other, a value is not finite or out of its range, or
    /// the file cannot be written. What stood at `path` is then unchanged.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        writer::save(self, path.as_ref())
    }
}

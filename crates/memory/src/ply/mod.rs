//! The memory as a file: a PLY that any splat viewer opens, with a block for data of the whole memory after its
//! vertices.
//!
//! It is a binary little-endian PLY with the properties of 3D Gaussian splatting in their usual order, spherical
//! harmonics of degree 0, and then the properties that the memory needs to continue:
//!
//! ```text
//! ply
//! format binary_little_endian 1.0
//! comment splatseg memory 5 kind evidence segments 40 state 812
//! element vertex 120000
//! property float x, y, z            metres
//! property float nx, ny, nz         zero
//! property float f_dc_0..2          (colour / 255 − 0.5) / 0.28209479177387814
//! property float opacity            logit: 20, whose sigmoid is exactly 1 in f32
//! property float scale_0..2         natural logarithm of the radius, three times
//! property float rot_0..3           1, 0, 0, 0
//! property float radius             metres: exactly the radius that `scale` encodes
//! property uint last_seen           number of the last frame that saw the Gaussian
//! property int seen_through         frames that have seen through it since then, 0 to 255
//! property int vote_id_0            a segment, 0 for "none"...
//! property float votes_0            ...and the votes for it, 0 in an empty slot
//! ...                               the same for slots 1 to 3
//! property int segment_id           the segment that the Gaussian shows, 0 for none; for viewers
//! end_header
//! ```
//!
//! (one property per line). Far from the world's origin, coordinates are relative to another origin, stated in a
//! further comment (world coordinates, metres): add it to `x`, `y` and `z`.
//!
//! ```text
//! comment origin 500000 5400000 0
//! ```
//!
//! A kind of memory that another crate has registered has the content of a built-in one or arrays of its own, and its name
//! in a further comment:
//!
//! ```text
//! comment kind last-seen
//! ```
//!
//! A memory of features has another comment, and features in place of votes:
//!
//! ```text
//! comment splatseg memory 5 kind features feature_dim 28 codes 512 segments 40 state 812
//! property float feature_0..27
//! ```
//!
//! One with arrays has `kind arrays` and neither votes nor features; its arrays are those of the state whose names begin
//! with `content.`.
//!
//! `segments` is the number of ids in the file's list. Gaussians have votes only for these ids and for 0. A
//! little-endian block follows the vertices:
//!
//! | Field | Type | |
//! |---|---|---|
//! | mark | `[u8; 8]` | `SPLATSEG` |
//! | version | `u32` | 5 |
//! | kind | `u32` | 0 evidence, 1 features, 2 arrays |
//! | segments | `u32` | as in the comment |
//! | frames | `u32` | frames learnt |
//! | feature_dim | `u32` | features only |
//! | codes | `u64` | features only |
//! | seed | `u64` | features only: seed of the codes |
//! | blocks | `u32` | features only: number of blocks of codes |
//! | the codes | `f32` `[codes, feature_dim]` | features only |
//! | ids | `u32` `[segments]` | the live ids, in increasing order |
//! | sightings | `u32` `[segments]` | frames in which a prediction had the id |
//! | carried | `u8` `[segments]` | 1 if the id was carried at the last check, else 0 |
//! | state | `u8` `[state]` | named arrays: a safetensors file, as [`StateBlock`] describes it; no bytes if there are none |
//! | checksum | `u32` | CRC-32 (zlib's) of every byte of the file before it |
//!
//! The state is what the memory keeps besides its Gaussians (`saved_state.rs` lists its arrays), the camera's keyframes,
//! and the names of objects. It is the last thing before the checksum, and the header tells its length, so that few
//! lines of Python read it (`splatseg.read_state` does the same):
//!
//! ```python
//! import re, safetensors.numpy
//! data = open("map.ply", "rb").read()
//! length = int(re.search(rb"splatseg memory 5 .* state (\d+)\n", data)[1])
//! arrays = safetensors.numpy.load(data[len(data) - 4 - length : -4])
//! print(arrays["keyframes.world_from_camera"])
//! ```
//!
//! [`StateBlock`] lists the changes that need no new version. The version here goes up only if programs that
//! read 5 would misunderstand the rest of the file. In version 4, `short_term` stands in the comment in place of `state`,
//! and the state is text. Such files are read, but not written any more.
//!
//! The block is not a second PLY element because two browser viewers (antimatter15/splat, gsplat.js) count every
//! `property` line of the header as part of a vertex. Like PlayCanvas/SuperSplat, GaussianSplats3D and plyfile, they
//! ignore data after the vertices. The two also search for the end of the header only in the first 10 KB, so they fail
//! for features of more than about 300 dimensions. All properties have four bytes, so that no viewer computes a wrong
//! offset.
//!
//! Without `f_rest_*`, loaders that derive the degree from the file (all of the above) find degree 0. Inria's
//! `load_ply` needs `--sh_degree 0`, since its assertion counts these properties. SIBR and other readers of fixed
//! records cannot read the file.

mod checked_stream;
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
pub use export::{ExportedForm, write_exported};
pub use saved_settings::{SavedCodes, SavedMemorySettings};

use crate::{Codebook, MemoryKind, SplatMap, Votes};
use glam::DVec3;
use splatseg_files::StateBlock;
use splatseg_geometry::SegmentId;
use std::borrow::Cow;
use std::path::Path;

/// Version of the format, in the header's comment and in the block after the vertices.
const VERSION: u32 = 5;
/// The earlier version that is still read. Its state besides the Gaussians is text.
const OLD_VERSION: u32 = 4;
/// Records are read and written in chunks of about this many bytes.
const CHUNK_BYTES: usize = 1 << 18;
/// Name of content that consists of arrays of another crate.
const ARRAYS: &str = "arrays";
/// The beginning of the names that such arrays have in the state.
const CONTENT: &str = "content";

/// A splat memory loaded from a file: N Gaussians, S segment ids.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatFile {
    /// Origin of the Gaussians' coordinates: world coordinates, metres.
    pub origin: DVec3,
    /// The Gaussians, N entries.
    pub map: SplatMap,
    /// Votes or features of the Gaussians, N entries, or arrays of another kind.
    pub content: SplatContent,
    /// Name of the kind of memory, if it is one that another crate has registered.
    pub registered_kind: Option<String>,
    /// Segment that each Gaussian shows by itself, 0 for none, `[N]`; for viewers.
    pub segment_ids: Vec<u32>,
    /// The live ids, in increasing order, `[S]`.
    pub ids: Vec<SegmentId>,
    /// Number of frames in which a prediction had each id, `[S]`.
    pub sightings: Vec<u32>,
    /// True for each id that was carried at the last check, `[S]`.
    pub carried: Vec<bool>,
    /// Number of frames learnt.
    pub frames: u32,
    /// State of the memory besides its Gaussians; may be empty. That of an older file is converted when it is loaded.
    pub saved_state: StateBlock,
}

/// The segments that Gaussians remember.
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
        /// The codes, of dimension D. The code of an id has index id − 1.
        codebook: Codebook,
    },
    /// A memory of a kind that another crate has registered, in a form of its own.
    Arrays {
        /// Only the kind knows what they mean.
        arrays: StateBlock,
    },
}

/// A borrowed splat memory to be saved: the same fields as [`SplatFile`], without copying the memory.
#[derive(Clone, Debug)]
pub struct SplatFileView<'a> {
    /// Origin of the Gaussians' coordinates: world coordinates, metres.
    pub origin: DVec3,
    /// The Gaussians, N entries.
    pub map: &'a SplatMap,
    /// Votes or features of the Gaussians, N entries, or arrays of another kind.
    pub content: SplatContentView<'a>,
    /// Name of the kind of memory, if it is one that another crate has registered.
    pub registered_kind: Option<&'a str>,
    /// Segment that each Gaussian shows by itself, 0 for none, `[N]`; for viewers.
    pub segment_ids: &'a [u32],
    /// The live ids, in increasing order, `[S]`.
    pub ids: &'a [SegmentId],
    /// Number of frames in which a prediction had each id, `[S]`.
    pub sightings: &'a [u32],
    /// True for each id that was carried at the last check, `[S]`.
    pub carried: &'a [bool],
    /// Number of frames learnt.
    pub frames: u32,
    /// State of the memory besides its Gaussians; may be empty.
    pub saved_state: &'a StateBlock,
}

/// Borrowed [`SplatContent`].
#[derive(Clone, Debug)]
pub enum SplatContentView<'a> {
    /// A memory of [`MemoryKind::Evidence`].
    Evidence {
        /// `[N]`. Owned if they are made to be saved.
        votes: Cow<'a, [Votes]>,
    },
    /// A memory of [`MemoryKind::Features`].
    Features {
        /// Row-major `[N, D]`.
        features: &'a [f32],
        /// The codes, of dimension D. The code of an id has index id − 1.
        codebook: &'a Codebook,
    },
    /// A memory of a kind that another crate has registered, in a form of its own.
    Arrays {
        /// Only the kind knows what they mean. Owned if they are made to be saved.
        arrays: Cow<'a, StateBlock>,
    },
}

impl SplatContent {
    /// Name of the content in files: that of the built-in kind of memory that has it, or `arrays`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Evidence { .. } => MemoryKind::Evidence.name(),
            Self::Features { .. } => MemoryKind::Features.name(),
            Self::Arrays { .. } => ARRAYS,
        }
    }

    /// Borrows the content.
    pub fn view(&self) -> SplatContentView<'_> {
        match self {
            Self::Evidence { votes } => SplatContentView::Evidence { votes: Cow::Borrowed(votes) },
            Self::Features { features, codebook } => SplatContentView::Features { features, codebook },
            Self::Arrays { arrays } => SplatContentView::Arrays { arrays: Cow::Borrowed(arrays) },
        }
    }
}

impl SplatFile {
    /// Borrows the memory.
    pub fn view(&self) -> SplatFileView<'_> {
        SplatFileView {
            origin: self.origin,
            map: &self.map,
            content: self.content.view(),
            registered_kind: self.registered_kind.as_deref(),
            segment_ids: &self.segment_ids,
            ids: &self.ids,
            sightings: &self.sightings,
            carried: &self.carried,
            frames: self.frames,
            saved_state: &self.saved_state,
        }
    }

    /// Writes the file; see [`SplatFileView::save`].
    ///
    /// # Errors
    /// As [`SplatFileView::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        self.view().save(path)
    }

    /// Reads a file written by [`SplatFileView::save`]. All values are restored exactly.
    ///
    /// # Errors
    /// [`SplatFileError`] if the file cannot be read, is another kind of PLY, was cut off or altered, or contains
    /// invalid values. Allocates memory only in proportion to the length of the file.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SplatFileError> {
        reader::load(path.as_ref())
    }
}

impl SplatFileView<'_> {
    /// Writes the file at `path`, replacing any existing file. It is written under another name in the same folder
    /// first, so that `path` never contains a partial file.
    ///
    /// # Errors
    /// [`SplatFileError`] if array lengths or ids contradict each other, a value is not finite or out of range, or the
    /// file cannot be written. An existing file at `path` is then unchanged.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        writer::save(self, path.as_ref())
    }
}

//! The memory as one file: a PLY that any splat viewer opens, with the codebook behind its vertices.
//!
//! A binary little-endian PLY with the properties of 3D Gaussian splatting in their usual order, spherical harmonics of
//! degree 0, then the segment feature and the decoded segment id:
//!
//! ```text
//! ply
//! format binary_little_endian 1.0
//! comment splatseg memory 1 feature_dim 28 codes 512 used 40
//! element vertex 120000
//! property float x, y, z            metres
//! property float nx, ny, nz         zero
//! property float f_dc_0..2          (colour − 0.5) / 0.28209479177387814
//! property float opacity            logit; beyond ±16 for 1 and 0, see below
//! property float scale_0..2         natural logarithms of metres
//! property float rot_0..3           w, x, y, z
//! property float feature_0..27
//! property int segment_id           0 for none
//! end_header
//! ```
//!
//! (one property a line). A block that the comment announces follows the vertices, all little-endian: `SPLATSEG`,
//! version `u32`, feature_dim `u32`, codes `u64`, used codes `u64`, seed `u64`, blocks `u32`, the codes `f32`
//! `[codes, feature_dim]`, and the CRC-32 (zlib's) `u32` of every byte of the file before it. It is no second element
//! of the PLY because browser viewers (antimatter15/splat, gsplat.js) count every `property` line of the header as part
//! of a vertex; like PlayCanvas/SuperSplat, GaussianSplats3D and plyfile, they ignore what follows the vertices. The
//! two also look for the end of the header in the first 10 KB: features of more than about 300 dimensions are too
//! much for them.
//!
//! Without `f_rest_*`, loaders that take the degree from the file (all of the above) see degree 0. Inria's `load_ply`
//! has to be told (`--sh_degree 0`, its assertion counts them); SIBR and other readers of fixed records cannot read it.
//!
//! An opacity of 1 is stored as logit 20 and 0 as −110, whose sigmoids are exactly 1 and 0 in `f32`.

mod crc32;
mod error;
mod header;
mod reader;
mod record;
mod writer;

pub use error::SplatFileError;

use crate::Codebook;
use splatseg_render::Gaussians;
use std::path::Path;

/// Version of the format, in the header's comment and in the block behind the vertices.
const VERSION: u32 = 1;
/// Starts the block behind the vertices.
const TRAILER_MAGIC: [u8; 8] = *b"SPLATSEG";
/// Bytes of that block before the codes.
const TRAILER_HEAD_BYTES: usize = 44;
/// Bytes of the checksum that ends the file.
const CHECKSUM_BYTES: usize = 4;
/// Records pass through memory in pieces of about this size.
const CHUNK_BYTES: usize = 1 << 18;

/// A splat memory as it is loaded from a file; `N` Gaussians, features of dimension `D = codebook.feature_dim()`.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatFile {
    /// Geometry, N entries.
    pub gaussians: Gaussians,
    /// Red, green and blue in [0, 1], `[N]`.
    pub colors: Vec<[f32; 3]>,
    /// Segment features, row-major `[N, D]`.
    pub features: Vec<f32>,
    /// Decoded segment of each Gaussian, 0 for none, `[N]`; for viewers.
    pub segment_ids: Vec<u32>,
    /// The codes.
    pub codebook: Codebook,
    /// How many codes, from the first on, are given to segments.
    pub used_codes: usize,
}

/// A splat memory to be saved, borrowed: the same fields as [`SplatFile`], without a copy of the memory.
#[derive(Clone, Copy, Debug)]
pub struct SplatFileView<'a> {
    /// Geometry, N entries.
    pub gaussians: &'a Gaussians,
    /// Red, green and blue, `[N]`; clamped to [0, 1].
    pub colors: &'a [[f32; 3]],
    /// Segment features, row-major `[N, D]`.
    pub features: &'a [f32],
    /// Decoded segment of each Gaussian, 0 for none, `[N]`; for viewers.
    pub segment_ids: &'a [u32],
    /// The codes.
    pub codebook: &'a Codebook,
    /// How many codes, from the first on, are given to segments.
    pub used_codes: usize,
}

impl SplatFile {
    /// The same, borrowed.
    pub fn view(&self) -> SplatFileView<'_> {
        SplatFileView {
            gaussians: &self.gaussians,
            colors: &self.colors,
            features: &self.features,
            segment_ids: &self.segment_ids,
            codebook: &self.codebook,
            used_codes: self.used_codes,
        }
    }

    /// Writes the file; see [`SplatFileView::save`].
    ///
    /// # Errors
    /// As [`SplatFileView::save`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        self.view().save(path)
    }

    /// Reads a file that [`SplatFileView::save`] wrote.
    ///
    /// Means, orientations, features, ids and codes come back bit for bit; colours and opacities within 1e-6, scales
    /// within a relative 1e-6.
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

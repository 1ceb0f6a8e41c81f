//! Layout of a file: its properties and sizes.

use super::error::SplatFileError;
use super::{ARRAYS, SplatContentView, SplatFileView, VERSION};
use crate::saved_state::MAX_BYTES;
use crate::{MemoryKind, Votes};
use splatseg_geometry::MAX_SEGMENT_ID;
use std::path::Path;

/// Float properties at the beginning of every vertex, in the order of the file.
pub const FLOAT_PROPERTIES: [&str; 18] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3", "radius",
];
/// Number of further properties of every vertex: `last_seen`, `seen_through` and `segment_id`.
const OTHER_PROPERTIES: usize = 3;
/// Bytes of every property.
const PROPERTY_BYTES: u64 = 4;

/// The kind of content, and the sizes specific to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Votes per Gaussian.
    Evidence,
    /// Features per Gaussian and a codebook.
    Features {
        /// Dimension of features and codes.
        feature_dim: usize,
        /// Number of codes.
        codes: u64,
    },
    /// Arrays of another crate, in the state.
    Arrays,
}

/// The sizes that determine the length of a file after its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Version of the format.
    pub version: u32,
    /// Number of Gaussians.
    pub gaussians: u64,
    /// Number of segment ids in the file's list.
    pub segments: u64,
    /// Kind of content and its sizes.
    pub layout: Layout,
    /// Bytes of the state besides the Gaussians.
    pub saved_state: u64,
}

impl Layout {
    /// The built-in kind of memory with this content.
    pub fn kind(self) -> Option<MemoryKind> {
        match self {
            Self::Evidence => Some(MemoryKind::Evidence),
            Self::Features { .. } => Some(MemoryKind::Features),
            Self::Arrays => None,
        }
    }

    /// Name in the header.
    pub fn name(self) -> &'static str {
        self.kind().map_or(ARRAYS, MemoryKind::name)
    }

    /// Number in the block after the vertices.
    pub fn number(self) -> u32 {
        match self {
            Self::Evidence => 0,
            Self::Features { .. } => 1,
            Self::Arrays => 2,
        }
    }

    /// Returns the vertex properties in the order of the file: type and name.
    pub fn properties(self) -> impl Iterator<Item = (&'static str, String)> {
        let named = |(kind, name): (&'static str, &str)| (kind, name.to_owned());
        let floats = FLOAT_PROPERTIES.map(|name| ("float", name));
        let visibility = [("uint", "last_seen"), ("int", "seen_through")];
        let (slots, feature_dim) = match self {
            Self::Evidence => (Votes::SLOTS, 0),
            Self::Features { feature_dim, .. } => (0, feature_dim),
            Self::Arrays => (0, 0),
        };
        let votes = |slot| [("int", format!("vote_id_{slot}")), ("float", format!("votes_{slot}"))];
        let features = (0..feature_dim).map(|channel| ("float", format!("feature_{channel}")));
        let fixed = floats.into_iter().chain(visibility).map(named);
        fixed.chain((0..slots).flat_map(votes)).chain(features).chain(std::iter::once(named(("int", "segment_id"))))
    }

    /// Bytes of a vertex; `u64::MAX` on overflow.
    pub fn record_bytes(self) -> u64 {
        let own = match self {
            Self::Evidence => 2 * Votes::SLOTS,
            Self::Features { feature_dim, .. } => feature_dim,
            Self::Arrays => 0,
        };
        PROPERTY_BYTES.saturating_mul((FLOAT_PROPERTIES.len() + OTHER_PROPERTIES).saturating_add(own) as u64)
    }

    /// Maximum number of segment ids.
    pub fn max_segments(self) -> u64 {
        match self {
            Self::Evidence | Self::Arrays => u64::from(MAX_SEGMENT_ID),
            Self::Features { codes, .. } => codes.min(u64::from(MAX_SEGMENT_ID)),
        }
    }
}

impl Sizes {
    /// Returns the sizes of a memory to be saved, whose state besides the Gaussians has `saved_state` bytes.
    pub fn of(view: &SplatFileView<'_>, saved_state: usize) -> Self {
        let layout = match &view.content {
            SplatContentView::Evidence { .. } => Layout::Evidence,
            SplatContentView::Features { codebook, .. } => {
                Layout::Features { feature_dim: codebook.feature_dim(), codes: codebook.len() as u64 }
            }
            SplatContentView::Arrays { .. } => Layout::Arrays,
        };
        Self {
            version: VERSION,
            gaussians: view.map.len() as u64,
            segments: view.ids.len() as u64,
            layout,
            saved_state: saved_state as u64,
        }
    }

    /// Returns an error if there are more segments than possible, or too much besides the Gaussians. Checked by the reader
    /// and by the writer, so that every file that is written can be read.
    pub fn check(&self, path: &Path) -> Result<(), SplatFileError> {
        let (found, max) = (self.segments, self.layout.max_segments());
        if found > max {
            return Err(SplatFileError::Segments { path: path.to_owned(), found, max });
        }
        let (found, max) = (self.saved_state, MAX_BYTES);
        if found > max {
            return Err(SplatFileError::SavedState { path: path.to_owned(), found, max });
        }
        Ok(())
    }

    /// Describes the content for error messages.
    pub fn description(&self) -> String {
        let Self { gaussians, segments, layout, .. } = self;
        match layout {
            Layout::Evidence => format!("{gaussians} Gaussians with votes and {segments} segments"),
            Layout::Arrays => format!("{gaussians} Gaussians and {segments} segments"),
            Layout::Features { feature_dim, codes } => {
                format!("{gaussians} Gaussians and {codes} codes of dimension {feature_dim}, and {segments} segments")
            }
        }
    }
}

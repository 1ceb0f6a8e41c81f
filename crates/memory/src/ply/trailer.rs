//! The block after the vertices: data of the whole memory.

use super::checked_stream::{Input, Output};
use super::error::SplatFileError;
use super::layout::{Layout, Sizes};
use super::{OLD_VERSION, SplatContentView, SplatFileView};
use crate::{Codebook, old_saved_state};
use splatseg_files::StateBlock;
use splatseg_geometry::SegmentId;
use std::io::Write;
use std::path::Path;

/// First bytes of the block.
const MAGIC: [u8; 8] = *b"SPLATSEG";
/// Bytes of the fields common to all kinds: mark, version, kind, segments, frames.
const HEAD_BYTES: u64 = 24;
/// Bytes of the fields before the codes: feature_dim, codes, seed, blocks.
const CODEBOOK_HEAD_BYTES: u64 = 24;
/// Offset of the number of blocks of codes in the block of a memory of features.
pub const BLOCKS_OFFSET: u64 = HEAD_BYTES + CODEBOOK_HEAD_BYTES - 4;
/// Bytes of id, sightings and carried per segment.
const SEGMENT_BYTES: u64 = 9;
/// Bytes of the checksum that ends the file.
const CHECKSUM_BYTES: u64 = 4;

/// Length of a file with a header of `header_bytes`; `u64::MAX` on overflow.
pub fn file_bytes(sizes: &Sizes, header_bytes: usize) -> u64 {
    let records = sizes.gaussians.saturating_mul(sizes.layout.record_bytes());
    records.saturating_add(bytes(sizes)).saturating_add(header_bytes as u64)
}

/// Length of the block, including the checksum; `u64::MAX` on overflow.
fn bytes(sizes: &Sizes) -> u64 {
    let codebook = match sizes.layout {
        Layout::Evidence | Layout::Arrays => 0,
        Layout::Features { feature_dim, codes } => {
            codes.saturating_mul(feature_dim as u64).saturating_mul(4).saturating_add(CODEBOOK_HEAD_BYTES)
        }
    };
    let segments = sizes.segments.saturating_mul(SEGMENT_BYTES);
    segments.saturating_add(sizes.saved_state).saturating_add(codebook).saturating_add(HEAD_BYTES + CHECKSUM_BYTES)
}

/// Writes the block up to the checksum.
pub fn write<W: Write>(
    view: &SplatFileView<'_>,
    sizes: &Sizes,
    saved_state: &[u8],
    output: &mut Output<W>,
) -> Result<(), SplatFileError> {
    output.write(&MAGIC)?;
    for field in [sizes.version, sizes.layout.number(), sizes.segments as u32, view.frames] {
        output.write(&field.to_le_bytes())?;
    }
    if let SplatContentView::Features { codebook, .. } = &view.content {
        output.write(&(codebook.feature_dim() as u32).to_le_bytes())?;
        output.write(&(codebook.len() as u64).to_le_bytes())?;
        output.write(&codebook.seed().to_le_bytes())?;
        output.write(&codebook.blocks().to_le_bytes())?;
        output.write_words(codebook.vectors().iter().map(|value| value.to_le_bytes()))?;
    }
    output.write_words(view.ids.iter().map(|id| id.to_le_bytes()))?;
    output.write_words(view.sightings.iter().map(|count| count.to_le_bytes()))?;
    let carried: Vec<u8> = view.carried.iter().copied().map(u8::from).collect();
    output.write(&carried)?;
    output.write(saved_state)
}

/// The block as read from a file, before it is checked.
pub struct Trailer {
    magic: [u8; 8],
    version: u32,
    kind: u32,
    segments: u32,
    frames: u32,
    codes: Option<Codes>,
    ids: Vec<SegmentId>,
    sightings: Vec<u32>,
    carried: Vec<u8>,
    saved_state: Vec<u8>,
}

struct Codes {
    feature_dim: u32,
    count: u64,
    seed: u64,
    blocks: u32,
    /// Their number is taken from the header, not from the block.
    vectors: Vec<f32>,
}

/// The checked contents of the block.
pub struct Contents {
    /// Number of frames learnt.
    pub frames: u32,
    /// The codes, in a file of features.
    pub codebook: Option<Codebook>,
    /// The live ids, in increasing order.
    pub ids: Vec<SegmentId>,
    /// Number of sightings of each id.
    pub sightings: Vec<u32>,
    /// True for each id that was carried.
    pub carried: Vec<bool>,
    /// State of the memory besides its Gaussians.
    pub saved_state: StateBlock,
}

impl Trailer {
    /// Reads the block up to the checksum. The length of the file must have been checked.
    pub fn read(sizes: &Sizes, input: &mut Input<'_>) -> Result<Self, SplatFileError> {
        Ok(Self {
            magic: input.array()?,
            version: u32::from_le_bytes(input.array()?),
            kind: u32::from_le_bytes(input.array()?),
            segments: u32::from_le_bytes(input.array()?),
            frames: u32::from_le_bytes(input.array()?),
            codes: match sizes.layout {
                Layout::Evidence | Layout::Arrays => None,
                Layout::Features { feature_dim, codes } => Some(Codes {
                    feature_dim: u32::from_le_bytes(input.array()?),
                    count: u64::from_le_bytes(input.array()?),
                    seed: u64::from_le_bytes(input.array()?),
                    blocks: u32::from_le_bytes(input.array()?),
                    vectors: input.words(codes * feature_dim as u64, f32::from_le_bytes)?,
                }),
            },
            ids: input.words(sizes.segments, SegmentId::from_le_bytes)?,
            sightings: input.words(sizes.segments, u32::from_le_bytes)?,
            carried: {
                let mut carried = vec![0; sizes.segments as usize];
                input.read(&mut carried)?;
                carried
            },
            saved_state: {
                let mut saved_state = vec![0; sizes.saved_state as usize];
                input.read(&mut saved_state)?;
                saved_state
            },
        })
    }

    /// Returns the contents if they are consistent with the header.
    pub fn checked(mut self, sizes: &Sizes, path: &Path) -> Result<Contents, SplatFileError> {
        let text = |magic: &[u8]| format!("{:?}", String::from_utf8_lossy(magic));
        check_field("the mark after the vertices", text(&self.magic), text(&MAGIC), path)?;
        check_field("the version after the vertices", self.version, sizes.version, path)?;
        check_field("the kind after the vertices", self.kind, sizes.layout.number(), path)?;
        check_field("the number of segments after the vertices", u64::from(self.segments), sizes.segments, path)?;
        let codebook = self.codes.take().map(|codes| codes.checked(sizes, path)).transpose()?;
        if let Some(&strange) = self.carried.iter().find(|&&carried| carried > 1) {
            return Err(field_error("carried", strange, "0 or 1", path));
        }
        check_ids(&self.ids, sizes, path)?;
        let carried = self.carried.into_iter().map(|carried| carried == 1).collect();
        let saved_state = match (&self.saved_state[..], sizes.version) {
            ([], _) => Ok(StateBlock::default()),
            (text, OLD_VERSION) => old_saved_state::converted(text),
            (bytes, _) => StateBlock::from_bytes(bytes).map_err(|error| error.to_string()),
        };
        let saved_state = saved_state.map_err(|found| SplatFileError::State { path: path.to_owned(), found })?;
        let Self { frames, ids, sightings, .. } = self;
        Ok(Contents { frames, codebook, ids, sightings, carried, saved_state })
    }
}

impl Codes {
    fn checked(self, sizes: &Sizes, path: &Path) -> Result<Codebook, SplatFileError> {
        let (feature_dim, count) = match sizes.layout {
            Layout::Evidence | Layout::Arrays => (0, 0),
            Layout::Features { feature_dim, codes } => (feature_dim, codes),
        };
        check_field("the codebook's feature_dim", u64::from(self.feature_dim), feature_dim as u64, path)?;
        check_field("the codebook's number of codes", self.count, count, path)?;
        Codebook::from_vectors(feature_dim, self.vectors, self.seed, self.blocks)
            .map_err(|source| SplatFileError::Codebook { path: path.to_owned(), source })
    }
}

/// Returns an error if ids do not increase or exceed the maximum.
pub fn check_ids(ids: &[SegmentId], sizes: &Sizes, path: &Path) -> Result<(), SplatFileError> {
    let mut before = 0;
    for id in ids {
        if *id <= before || u64::from(*id) > sizes.layout.max_segments() {
            let expected = format!("a number from {} to {}", before + 1, sizes.layout.max_segments());
            return Err(field_error("an id", id, expected, path));
        }
        before = *id;
    }
    Ok(())
}

fn check_field<T: PartialEq + std::fmt::Display>(
    field: &'static str,
    found: T,
    expected: T,
    path: &Path,
) -> Result<(), SplatFileError> {
    if found == expected { Ok(()) } else { Err(field_error(field, found, expected, path)) }
}

fn field_error(
    field: &'static str,
    found: impl std::fmt::Display,
    expected: impl std::fmt::Display,
    path: &Path,
) -> SplatFileError {
    let (found, expected) = (found.to_string(), expected.to_string());
    SplatFileError::Trailer { path: path.to_owned(), field, found, expected }
}

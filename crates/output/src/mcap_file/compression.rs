//! Compression of a recording's chunks.

use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
use std::borrow::Cow;
use std::io::{self, Write};

/// How the chunks of an MCAP file are compressed. The same bytes always give the same compressed bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// As an LZ4 frame.
    #[default]
    Lz4,
}

impl Compression {
    /// MCAP's name: <https://mcap.dev/spec/registry#well-known-compression-formats>.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Lz4 => "lz4",
        }
    }

    /// Compresses the content of a chunk.
    pub(super) fn compress(self, content: &[u8]) -> io::Result<Cow<'_, [u8]>> {
        Ok(match self {
            Self::None => Cow::Borrowed(content),
            Self::Lz4 => Cow::Owned(lz4_frame(content)?),
        })
    }
}

/// Returns an LZ4 frame. It has no checksums, as the chunk has one.
fn lz4_frame(content: &[u8]) -> io::Result<Vec<u8>> {
    let info = FrameInfo::new()
        .block_mode(BlockMode::Independent)
        .block_size(BlockSize::Max1MB)
        .content_size(Some(content.len() as u64));
    let mut encoder = FrameEncoder::with_frame_info(info, Vec::new());
    encoder.write_all(content)?;
    encoder.finish().map_err(io::Error::other)
}

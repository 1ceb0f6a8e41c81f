//! Decompression and checking of a recording's chunks.

use bzip2::read::BzDecoder;
use lz4_flex::frame::FrameDecoder;
use ruzstd::decoding::StreamingDecoder;
use splatseg_files::{MemoryLimit, display_bytes};
use std::borrow::Cow;
use std::io::Read;

/// Maximum chunk size, whatever the memory limit. Recorders write chunks of a few megabytes.
const MAX_CHUNK_BYTES: u64 = 1 << 30;
/// Divisor of the memory limit that gives the limit of an unpacked chunk.
const MEMORY_PART: u64 = 4;
/// Usual ratio of a chunk's unpacked to stored size.
const USUAL_RATIO: usize = 8;

/// Compression of a chunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Zstd,
    Lz4,
    Bz2,
}

/// Location of a chunk in the file, and the expected size and CRC of its content.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chunk {
    /// Offset of its stored bytes, from the start of the recording.
    pub(super) offset: u64,
    /// Number of stored bytes.
    pub(super) stored: u64,
    /// Number of bytes that it should unpack to.
    pub(super) unpacked: u64,
    /// 0 if there is none.
    pub(super) crc: u32,
    pub(super) compression: Compression,
}

impl Chunk {
    /// Returns the chunk if it can be unpacked.
    ///
    /// # Errors
    /// Description of the unsupported size.
    pub(super) fn checked(self) -> Result<Self, String> {
        too_large(self.unpacked).map_or(Ok(self), Err)
    }

    /// Returns true if its content is stored uncompressed.
    pub(super) fn is_plain(&self) -> bool {
        self.compression == Compression::None
    }

    /// Unpacks and checks the content of a chunk.
    ///
    /// # Errors
    /// Description of the damage.
    pub(super) fn unpack<'s>(&self, stored: &'s [u8]) -> Result<Cow<'s, [u8]>, String> {
        let content = match self.compression {
            Compression::None => Cow::Borrowed(stored),
            Compression::Zstd => Cow::Owned(self.unpack_zstd(stored)?),
            Compression::Lz4 => {
                let content = self.read_content(FrameDecoder::new(stored), stored.len(), Vec::new());
                Cow::Owned(content.map_err(|error| format!("damaged lz4 data: {error}"))?)
            }
            Compression::Bz2 => {
                let content = self.read_content(BzDecoder::new(stored), stored.len(), Vec::new());
                Cow::Owned(content.map_err(|error| format!("damaged bz2 data: {error}"))?)
            }
        };
        if content.len() as u64 != self.unpacked {
            return Err(format!("it has {} bytes, but its header says {}", content.len(), self.unpacked));
        }
        let crc = crc32fast::hash(&content);
        if self.crc != 0 && crc != self.crc {
            return Err(format!("its CRC is {crc:08x}, but its header says {:08x}", self.crc));
        }
        Ok(content)
    }

    fn unpack_zstd(&self, stored: &[u8]) -> Result<Vec<u8>, String> {
        let mut rest = stored;
        let mut content = Vec::new();
        // Usually one zstd frame. Data after the last one is padding.
        while (content.len() as u64) < self.unpacked && !rest.is_empty() {
            let decoder = StreamingDecoder::new(&mut rest).map_err(|error| format!("damaged zstd data: {error}"))?;
            content = self
                .read_content(decoder, stored.len(), content)
                .map_err(|error| format!("damaged zstd data: {error}"))?;
        }
        Ok(content)
    }

    /// Appends the decoder's output to `content`, up to one byte more than expected.
    fn read_content(&self, decoder: impl Read, stored: usize, mut content: Vec<u8>) -> std::io::Result<Vec<u8>> {
        let left = self.unpacked.saturating_sub(content.len() as u64);
        // A header may be wrong: reserve no more than such data usually unpacks to.
        content.reserve(usize::try_from(left).unwrap_or(usize::MAX).min(stored.saturating_mul(USUAL_RATIO)));
        decoder.take(left.saturating_add(1)).read_to_end(&mut content)?;
        Ok(content)
    }
}

/// Describes a chunk that is too large to be read, stored or unpacked; `None` if it is not.
pub(super) fn too_large(bytes: u64) -> Option<String> {
    let limit = (MemoryLimit::in_force() / MEMORY_PART).min(MAX_CHUNK_BYTES);
    (bytes > limit)
        .then(|| format!("it would take {}, at most {} are read", display_bytes(bytes), display_bytes(limit)))
}

//! zstd data outside chunks: rosbag2 compresses whole files, or each message. Sizes are checked before memory is taken.

use ruzstd::decoding::FrameDecoder;
use ruzstd::decoding::StreamingDecoder;
use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use splatseg_files::{MemoryLimit, display_bytes};
use std::io::{BufRead, Read, Write};

/// First bytes of a frame. No CDR message and no MCAP file starts so.
pub(super) const MAGIC: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];
/// First bytes of a frame to skip, without the last four bits of the first one.
const SKIPPABLE: [u8; 4] = [0x50, 0x2A, 0x4D, 0x18];
/// Maximum window, bytes: more than `zstd --long` uses. Also at most a part of the memory limit.
const MAX_WINDOW: u64 = 256 << 20;
const MEMORY_PART: u64 = 8;
/// Number of bytes copied at once.
const COPIED_BYTES: usize = 256 << 10;

/// Why zstd data cannot be unpacked.
#[derive(Debug)]
pub(super) enum ZstdError {
    /// They are damaged, or their sizes or checksums are wrong. What was unpacked before has been written.
    Damaged(String),
    /// They would unpack to more than the limit.
    TooLarge(String),
    /// The unpacked data cannot be written.
    Write(std::io::Error),
}

/// Returns true if data begin like zstd's.
pub(super) fn is_zstd(data: &[u8]) -> bool {
    let is_skippable = |start: &[u8; 4]| start[0] & 0xF0 == SKIPPABLE[0] && start[1..] == SKIPPABLE[1..];
    data.starts_with(MAGIC) || data.first_chunk().is_some_and(is_skippable)
}

/// Unpacks a message of at most `limit` bytes.
///
/// # Errors
/// Description of the damage.
pub(super) fn unpack_message(stored: &[u8], limit: u64) -> Result<Vec<u8>, String> {
    let (mut rest, mut content) = (stored, Vec::new());
    unpack(&mut rest, &mut content, limit).map_err(|error| match error {
        ZstdError::Damaged(what) | ZstdError::TooLarge(what) => what,
        ZstdError::Write(error) => error.to_string(),
    })?;
    Ok(content)
}

/// Unpacks all frames of `stored` into `out`, at most `limit` bytes. Returns the number of bytes.
pub(super) fn unpack(stored: &mut impl BufRead, out: &mut impl Write, limit: u64) -> Result<u64, ZstdError> {
    let mut written = 0;
    let damaged = |what: &dyn std::fmt::Display| ZstdError::Damaged(format!("damaged zstd data: {what}"));
    while !stored.fill_buf().map_err(|error| damaged(&error))?.is_empty() {
        let mut decoder = FrameDecoder::new();
        decoder.set_max_window_size(MAX_WINDOW.min(MemoryLimit::in_force() / MEMORY_PART));
        let mut frame = match StreamingDecoder::new_with_decoder(&mut *stored, decoder) {
            Ok(frame) => frame,
            Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                skip(stored, u64::from(length)).map_err(|error| damaged(&error))?;
                continue;
            }
            Err(error) => return Err(damaged(&error)),
        };
        let stated = frame.decoder.content_size();
        let left = limit.saturating_sub(written);
        if stated > left {
            return Err(too_large(stated.saturating_add(written), limit));
        }
        let unpacked = copy(&mut frame, out, left).map_err(|error| match error {
            CopyError::Read(error) => damaged(&error),
            CopyError::Write(error) => ZstdError::Write(error),
            CopyError::TooLarge => too_large(limit.saturating_add(1), limit),
        })?;
        written += unpacked;
        if stated != 0 && stated != unpacked {
            return Err(damaged(&format!("it has {unpacked} bytes, but its header says {stated}")));
        }
        let (expected, found) = (frame.decoder.get_checksum_from_data(), frame.decoder.get_calculated_checksum());
        if let (Some(expected), Some(found)) = (expected, found)
            && expected != found
        {
            return Err(damaged(&format!("its checksum is {found:08x}, but it says {expected:08x}")));
        }
    }
    Ok(written)
}

fn too_large(needed: u64, limit: u64) -> ZstdError {
    let (needed, limit) = (display_bytes(needed), display_bytes(limit));
    ZstdError::TooLarge(format!("it would unpack to {needed} or more, at most {limit} are read"))
}

fn skip(stored: &mut impl Read, length: u64) -> std::io::Result<()> {
    let skipped = std::io::copy(&mut stored.take(length), &mut std::io::sink())?;
    if skipped == length { Ok(()) } else { Err(std::io::ErrorKind::UnexpectedEof.into()) }
}

enum CopyError {
    Read(std::io::Error),
    Write(std::io::Error),
    TooLarge,
}

/// Copies at most `limit` bytes. Returns their number.
fn copy(from: &mut impl Read, to: &mut impl Write, limit: u64) -> Result<u64, CopyError> {
    let (mut buffer, mut copied) = (vec![0; COPIED_BYTES], 0u64);
    loop {
        let read = from.read(&mut buffer).map_err(CopyError::Read)?;
        let Some(part) = buffer.get(..read).filter(|part| !part.is_empty()) else { return Ok(copied) };
        copied += read as u64;
        if copied > limit {
            return Err(CopyError::TooLarge);
        }
        to.write_all(part).map_err(CopyError::Write)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of 256 blocks of 128 KiB that repeat one byte: 32 MiB in a kilobyte.
    fn bomb(frames: usize) -> Vec<u8> {
        let block = |is_last: u32| [&(131_072u32 << 3 | 0b010 | is_last).to_le_bytes()[..3], &[7]].concat();
        let frame = [&[0x28, 0xB5, 0x2F, 0xFD, 0x00, 0x58][..], &block(0).repeat(255), &block(1)].concat();
        frame.repeat(frames)
    }

    #[test]
    fn unpacking_stops_at_the_limit() {
        let mut content = Vec::new();
        assert_eq!(unpack(&mut bomb(1).as_slice(), &mut content, 32 << 20).unwrap(), 32 << 20);
        assert!(content.iter().all(|byte| *byte == 7));
        for (frames, limit) in [(1, (32 << 20) - 1), (3, 64 << 20), (1, 0)] {
            let mut content = Vec::new();
            let error = unpack(&mut bomb(frames).as_slice(), &mut content, limit).unwrap_err();
            assert!(matches!(error, ZstdError::TooLarge(_)) && content.len() as u64 <= limit, "{error:?}");
        }
    }

    #[test]
    fn data_are_recognised() {
        assert!(is_zstd(MAGIC) && is_zstd(&[0x5F, 0x2A, 0x4D, 0x18]));
        assert!(!is_zstd(b"") && !is_zstd(&[0x60, 0x2A, 0x4D, 0x18]) && !is_zstd(mcap::MAGIC));
        assert!(unpack_message(&bomb(1)[..40], 1 << 30).unwrap_err().starts_with("damaged zstd data: "));
    }
}

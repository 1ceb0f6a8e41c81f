//! OpenEXR with one channel of half or float, or one named `Z` or `depth` among others: scan lines, uncompressed or packed
//! with RLE, ZIPS or ZIP, which writers choose unless told otherwise.
//!
//! A library would read the rarer compressions too, but takes longer to build than all other readers together.

use super::exr_header::{Compression, Header, PixelType, read_header};
use super::{DepthFile, StoredDepth, numbers};
use crate::DatasetError;
use std::io::Read;

/// Returns the `(width, height)` that the header states.
pub(super) fn size(file: &DepthFile<'_>) -> Result<(usize, usize), DatasetError> {
    Ok(read_header(file)?.size)
}

/// Reads the depth.
pub(super) fn read(file: &DepthFile<'_>) -> Result<StoredDepth, DatasetError> {
    let header = read_header(file)?;
    let (width, height) = header.size;
    let lines = header.compression.lines();
    let table = file.slice("the table of blocks", header.table_start, height.div_ceil(lines).saturating_mul(8))?;
    // The file is long enough for the table, so there is at least a byte for each block of the image.
    let mut depth = vec![0.0; width * height];
    let mut is_filled = vec![false; height];
    for start in numbers(table, u64::from_le_bytes) {
        let start = usize::try_from(start).unwrap_or(usize::MAX);
        let (first, rows) = read_block(file, &header, start)?;
        for (index, row) in rows.chunks_exact(header.row_bytes).enumerate() {
            let channel = &row[header.bytes_before..header.bytes_before + width * header.pixel_type.bytes()];
            let values = match header.pixel_type {
                PixelType::Half => numbers(channel, |bytes| half(u16::from_le_bytes(bytes))),
                PixelType::Float | PixelType::Uint => numbers(channel, f32::from_le_bytes),
            };
            depth[(first + index) * width..][..width].copy_from_slice(&values);
            is_filled[first + index] = true;
        }
    }
    if let Some(row) = is_filled.iter().position(|is_filled| !is_filled) {
        return Err(file.wrong("blocks", format!("none for row {row}"), "one for each row"));
    }
    Ok(StoredDepth::Floats(file.image(header.size, depth)?))
}

/// Reads a block: the index of its first row, and its rows with all channels.
fn read_block(file: &DepthFile<'_>, header: &Header, start: usize) -> Result<(usize, Vec<u8>), DatasetError> {
    let (lines, height) = (header.compression.lines(), header.size.1);
    let head = file.slice("a block", start, 8)?;
    let [row, len] = [&head[..4], &head[4..]].map(|bytes| numbers(bytes, i32::from_le_bytes)[0]);
    let first = usize::try_from(i64::from(row) - i64::from(header.first_row)).unwrap_or(usize::MAX);
    if first >= height || first % lines != 0 {
        return Err(file.wrong(
            "row of a block",
            row.to_string(),
            format!("one of {height} from {}", header.first_row),
        ));
    }
    let packed = file.slice("a block", start.saturating_add(8), usize::try_from(len).unwrap_or(usize::MAX))?;
    let expected = header.row_bytes.saturating_mul(lines.min(height - first));
    let most = (packed.len() as u64).saturating_mul(crate::decode::MAX_DEFLATE_RATIO).saturating_add(1024);
    let wrong = |found: usize| file.wrong("block", format!("{found} bytes"), format!("{expected}"));
    // A block that would not shrink is stored as it is.
    if packed.len() == expected {
        return Ok((first, packed.to_vec()));
    }
    if expected as u64 > most {
        return Err(wrong(packed.len()));
    }
    let shuffled = match header.compression {
        Compression::None => return Err(wrong(packed.len())),
        Compression::Rle => unpack_runs(packed, expected),
        Compression::Zip { .. } => {
            let mut bytes = Vec::new();
            let mut decoder = flate2::read::ZlibDecoder::new(packed).take(expected as u64 + 1);
            decoder.read_to_end(&mut bytes).map_err(|error| file.wrong("block", error.to_string(), "zlib"))?;
            bytes
        }
    };
    if shuffled.len() != expected {
        return Err(wrong(shuffled.len()));
    }
    Ok((first, ordered(shuffled)))
}

/// Unpacks at most one byte more than `expected`. A negative length is that of bytes as they are, others are one less than
/// the times a byte is repeated.
fn unpack_runs(packed: &[u8], expected: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = packed;
    while let [length, after @ ..] = rest {
        let length = i32::from(length.cast_signed());
        if length < 0 {
            let (plain, after) = after.split_at(after.len().min(length.unsigned_abs() as usize));
            bytes.extend(plain);
            rest = after;
        } else {
            let Some((value, after)) = after.split_first() else { break };
            bytes.extend(std::iter::repeat_n(*value, length as usize + 1));
            rest = after;
        }
        if bytes.len() > expected {
            break;
        }
    }
    bytes
}

/// Undoes what makes blocks easier to pack: each byte is the difference to the one before, and the bytes at even places come
/// before those at odd places.
fn ordered(mut shuffled: Vec<u8>) -> Vec<u8> {
    let mut before = 128u8;
    for (index, byte) in shuffled.iter_mut().enumerate() {
        if index > 0 {
            *byte = byte.wrapping_add(before).wrapping_sub(128);
        }
        before = *byte;
    }
    let (even, odd) = shuffled.split_at(shuffled.len().div_ceil(2));
    let byte = |index: usize| if index.is_multiple_of(2) { even[index / 2] } else { odd[index / 2] };
    (0..shuffled.len()).map(byte).collect()
}

/// Converts an IEEE 754 half to a float, exactly.
pub(super) fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1F), f32::from(bits & 0x3FF));
    sign * match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (fraction + 1024.0) * 2f32.powi(exponent - 25),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_exact() {
        for (bits, value) in
            [(0, 0.0), (1, 2f32.powi(-24)), (0x3C00, 1.0), (0x3E00, 1.5), (0xC000, -2.0), (0x7BFF, 65504.0)]
        {
            assert_eq!(half(bits), value);
        }
        assert!(half(0x7C00) == f32::INFINITY && half(0xFC00) == f32::NEG_INFINITY && half(0x7E00).is_nan());
    }

    #[test]
    fn runs_are_repeated_or_copied() {
        assert_eq!(unpack_runs(&[2, 7, 0xFE, 1, 2], 5), [7, 7, 7, 1, 2]);
        assert!(unpack_runs(&[127, 7, 127, 7, 127, 7], 200).len() <= 256);
        assert_eq!(unpack_runs(&[0xFE, 1], 2), [1]);
    }
}

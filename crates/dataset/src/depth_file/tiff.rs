//! TIFF with one channel of 16-bit integers or 32- or 64-bit floats, in any byte order and layout that the decoder knows.

use super::{DepthFile, StoredDepth};
use crate::DatasetError;
use crate::error::DEPTH_IMAGE;
use image::error::{DecodingError, ImageFormatHint};
use image::{ImageError, ImageFormat};
use std::io::Cursor;
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// Kinds of pixels, for messages.
const EXPECTED: &str = "one channel of 16-bit integers or 32-bit floats";

/// A header has some tens of entries.
const MAX_ENTRIES: usize = 4096;

/// Bytes of the longest list in a header: of the strips of an image with one strip in each row.
const MAX_LIST_BYTES: usize = 1 << 20;

type TiffDecoder<'a> = Decoder<Cursor<&'a [u8]>>;

/// Returns the `(width, height)` that the header states.
pub(super) fn size(file: &DepthFile<'_>) -> Result<(usize, usize), DatasetError> {
    Ok(decoder(file)?.1)
}

/// Reads the numbers of the first image.
pub(super) fn read(file: &DepthFile<'_>) -> Result<StoredDepth, DatasetError> {
    let (mut decoder, size) = decoder(file)?;
    let color_type = decoder.colortype().map_err(|error| damaged(file, error))?;
    if !matches!(color_type, tiff::ColorType::Gray(16 | 32 | 64)) {
        return Err(pixel_kind(file, format!("{color_type:?}")));
    }
    let mut limits = Limits::default();
    // The decoded image, and a strip or tile of it before its bytes are put in order.
    limits.decoding_buffer_size = size.0.saturating_mul(size.1).saturating_mul(8);
    limits.intermediate_buffer_size = limits.decoding_buffer_size.saturating_add(MAX_LIST_BYTES);
    limits.ifd_value_size = MAX_LIST_BYTES;
    decoder = decoder.with_limits(limits);
    match decoder.read_image().map_err(|error| damaged(file, error))? {
        DecodingResult::U16(values) => Ok(StoredDepth::Integers(file.image(size, values)?)),
        DecodingResult::F32(values) => Ok(StoredDepth::Floats(file.image(size, values)?)),
        DecodingResult::F64(values) => {
            Ok(StoredDepth::Floats(file.image(size, values.into_iter().map(|value| value as f32).collect())?))
        }
        _ => Err(pixel_kind(file, format!("{color_type:?} of other numbers"))),
    }
}

/// Reads the header.
fn decoder<'a>(file: &DepthFile<'a>) -> Result<(TiffDecoder<'a>, (usize, usize)), DatasetError> {
    require_lists_in_file(file)?;
    let mut decoder = Decoder::new(Cursor::new(file.bytes)).map_err(|error| damaged(file, error))?;
    let (width, height) = decoder.dimensions().map_err(|error| damaged(file, error))?;
    let size = file.check_size((width as usize, height as usize))?;
    Ok((decoder, size))
}

/// Checks that each list in the header ends inside the file. The decoder takes memory for as many entries as a header states
/// before anything can be limited, up to 256 MB.
fn require_lists_in_file(file: &DepthFile<'_>) -> Result<(), DatasetError> {
    let is_little_endian = file.bytes.first() == Some(&b'I');
    let number = |start: usize, len: usize| -> Result<usize, DatasetError> {
        let bytes = file.slice("the header", start, len)?;
        let append = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        let number = match is_little_endian {
            true => bytes.iter().rev().fold(0, append),
            false => bytes.iter().fold(0, append),
        };
        Ok(usize::try_from(number).unwrap_or(usize::MAX))
    };
    // BigTIFF has the version 43, and wider numbers.
    let is_big = number(2, 2)? == 43;
    let (count_bytes, offset_bytes) = if is_big { (8, 8) } else { (2, 4) };
    let start = if is_big { number(8, 8)? } else { number(4, 4)? };
    let count = number(start, count_bytes)?;
    if count > MAX_ENTRIES {
        return Err(file.wrong("entries of the header", count.to_string(), format!("at most {MAX_ENTRIES}")));
    }
    for index in 0..count {
        let entry = start.saturating_add(count_bytes + index * (4 + 2 * offset_bytes));
        let values = number(entry.saturating_add(4), offset_bytes)?;
        let bytes = values.saturating_mul(type_bytes(number(entry.saturating_add(2), 2)?));
        if bytes > offset_bytes {
            file.slice("a list in the header", number(entry.saturating_add(4 + offset_bytes), offset_bytes)?, bytes)?;
        }
    }
    Ok(())
}

/// Returns the bytes of a value of a type.
fn type_bytes(code: usize) -> usize {
    match code {
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 1,
    }
}

fn pixel_kind(file: &DepthFile<'_>, found: String) -> DatasetError {
    DatasetError::PixelKind { path: file.path.to_owned(), what: DEPTH_IMAGE, found, expected: EXPECTED }
}

fn damaged(file: &DepthFile<'_>, error: tiff::TiffError) -> DatasetError {
    let hint = ImageFormatHint::Exact(ImageFormat::Tiff);
    let source = ImageError::Decoding(DecodingError::new(hint, error));
    DatasetError::Image { path: file.path.to_owned(), what: DEPTH_IMAGE, source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn lists_beyond_the_file_are_refused_before_they_take_memory() {
        // One entry: the offsets of 8 million strips.
        let header = b"II*\0\x08\0\0\0\x01\0\x11\x01\x04\0\0\0\x80\0\x1A\0\0\0\0\0\0\0";
        let error = read(&DepthFile { path: Path::new("a.tiff"), bytes: header }).unwrap_err().to_string();
        assert_eq!(
            error,
            "a.tiff: a list in the header would end at byte 33554458, but the file has 26 bytes: it is cut off, or a size in \
             it is wrong"
        );
    }
}

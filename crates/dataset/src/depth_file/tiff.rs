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
    let mut limits = Limits::default();
    limits.ifd_value_size = MAX_LIST_BYTES;
    let decoder = Decoder::new(Cursor::new(file.bytes)).map_err(|error| damaged(file, error))?;
    let mut decoder = decoder.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(|error| damaged(file, error))?;
    let size = file.check_size((width as usize, height as usize))?;
    Ok((decoder, size))
}

fn pixel_kind(file: &DepthFile<'_>, found: String) -> DatasetError {
    DatasetError::PixelKind { path: file.path.to_owned(), what: DEPTH_IMAGE, found, expected: EXPECTED }
}

fn damaged(file: &DepthFile<'_>, error: tiff::TiffError) -> DatasetError {
    let hint = ImageFormatHint::Exact(ImageFormat::Tiff);
    let source = ImageError::Decoding(DecodingError::new(hint, error));
    DatasetError::Image { path: file.path.to_owned(), what: DEPTH_IMAGE, source }
}

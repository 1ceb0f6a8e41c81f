//! Grey PNG files whose pixel values are ids.

use super::check_size;
use crate::SegmenterError;
use image::{DynamicImage, ImageDecoder, ImageReader};
use splatseg_geometry::{Mask, ScoredMask, SegmentMap};
use std::path::Path;

const EXPECTED: &str = "an 8-bit or 16-bit grey PNG";

/// Reads every id above 0 as a mask of score 1, by increasing id.
pub(super) fn read(path: &Path) -> Result<Vec<ScoredMask>, SegmenterError> {
    let wrong = |found: String| SegmenterError::IdImage { path: path.to_owned(), found, expected: EXPECTED };
    let read_error = |source| SegmenterError::Read { path: path.to_owned(), source };
    let mut reader = ImageReader::open(path).map_err(read_error)?;
    reader.set_format(image::ImageFormat::Png);
    let decoder = reader.into_decoder().map_err(|error| wrong(error.to_string()))?;
    let (width, height) = decoder.dimensions();
    check_size(path, (width as usize, height as usize))?;
    let pixels: Vec<u32> = match DynamicImage::from_decoder(decoder).map_err(|error| wrong(error.to_string()))? {
        DynamicImage::ImageLuma8(image) => image.into_raw().into_iter().map(u32::from).collect(),
        DynamicImage::ImageLuma16(image) => image.into_raw().into_iter().map(u32::from).collect(),
        other => return Err(wrong(format!("pixels of type {:?}", other.color()))),
    };
    let map =
        SegmentMap::from_pixels(width as usize, height as usize, pixels).map_err(|error| wrong(error.to_string()))?;
    Ok(Mask::of_segments(&map).into_iter().map(|(_, mask)| ScoredMask { mask, score: 1.0 }).collect())
}

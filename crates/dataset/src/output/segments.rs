//! Segment maps as 16-bit PNGs.

use super::{OutputError, write_atomically};
use crate::DatasetError;
use crate::decode::read_labels;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_geometry::SegmentMap;
use std::path::Path;

/// Writes a segment map as a 16-bit grey PNG, atomically. The folder must exist.
///
/// # Errors
/// [`OutputError::IdTooLarge`] for ids above 65535, [`OutputError::Encode`] for an empty map, [`OutputError::Io`] if
/// the file cannot be written; then no partial file is left.
pub fn write_segments_png(path: &Path, segments: &SegmentMap) -> Result<(), OutputError> {
    if let Some(id) = segments.pixels().iter().find(|id| **id > u32::from(u16::MAX)) {
        return Err(OutputError::IdTooLarge { path: path.to_owned(), id: *id });
    }
    let bytes: Vec<u8> = segments.pixels().iter().flat_map(|id| (*id as u16).to_ne_bytes()).collect();
    let mut encoded = Vec::new();
    PngEncoder::new(&mut encoded)
        .write_image(&bytes, segments.width() as u32, segments.height() as u32, ExtendedColorType::L16)
        .map_err(|source| OutputError::Encode { path: path.to_owned(), source })?;
    write_atomically(path, &encoded)
}

/// Reads a segment map from a grey PNG with 8 or 16 bits, as [`write_segments_png`] writes it.
///
/// # Errors
/// [`DatasetError`] if the file is missing or damaged or is any other kind of image: palettes, colours and fewer bits
/// do not hold ids.
pub fn read_segments_png(path: &Path) -> Result<SegmentMap, DatasetError> {
    read_labels(path)
}

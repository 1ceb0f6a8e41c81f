//! Segment maps as 16-bit PNGs.

use crate::{OutputError, ResultFolder, write_atomically};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_dataset::read_segments_png;
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

/// The ids of a frame whose images are in the folder.
///
/// # Errors
/// [`OutputError::IdImage`].
pub(crate) fn written_ids(folder: &dyn ResultFolder, file_name: &str) -> Result<SegmentMap, OutputError> {
    Ok(read_segments_png(&folder.path_of(&format!("segments/{file_name}.png")))?)
}

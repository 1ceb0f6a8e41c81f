//! Id images: segment maps as PNGs.

use crate::WriteIdsError;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_files::write_unsynced;
use splatseg_geometry::{SegmentId, SegmentMap};
use std::path::Path;

/// The largest id of a 16-bit image.
const MAX_16_BIT_ID: SegmentId = u16::MAX as SegmentId;

/// The largest id of an RGB image.
const MAX_RGB_ID: SegmentId = (1 << 24) - 1;

/// Writes a segment map as a PNG, atomically: 16-bit grey if all ids fit, otherwise 8-bit RGB as in COCO's panoptic
/// format, id = R + 256 G + 65536 B. The folder must exist.
///
/// # Errors
/// [`WriteIdsError::IdTooLarge`] for ids above 2²⁴ − 1, which no method of this workspace assigns,
/// [`WriteIdsError::Encode`] for an empty map, [`WriteIdsError::Io`] if the file cannot be written; no partial file is
/// left.
pub fn write_segments_png(path: &Path, segments: &SegmentMap) -> Result<(), WriteIdsError> {
    let largest = segments.pixels().iter().copied().max().unwrap_or(0);
    let pixels = segments.pixels().iter();
    let (bytes, kind): (Vec<u8>, ExtendedColorType) = match largest {
        0..=MAX_16_BIT_ID => (pixels.flat_map(|id| (*id as u16).to_ne_bytes()).collect(), ExtendedColorType::L16),
        id if id > MAX_RGB_ID => {
            return Err(WriteIdsError::IdTooLarge { path: path.to_owned(), id, limit: MAX_RGB_ID });
        }
        _ => {
            let channels = |id: &SegmentId| [*id as u8, (*id >> 8) as u8, (*id >> 16) as u8];
            (pixels.flat_map(channels).collect(), ExtendedColorType::Rgb8)
        }
    };
    let mut encoded = Vec::new();
    PngEncoder::new(&mut encoded)
        .write_image(&bytes, segments.width() as u32, segments.height() as u32, kind)
        .map_err(|source| WriteIdsError::Encode { path: path.to_owned(), source })?;
    write_unsynced(path, &encoded).map_err(|source| WriteIdsError::Io { path: path.to_owned(), source })
}

//! Segment maps as PNGs.

use crate::{OutputError, ResultFolder, write_atomically};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_dataset::read_segments_png;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{MAX_16_BIT_ID, MAX_SEGMENT_ID};
use std::path::Path;

/// Writes a segment map as a PNG, atomically: 16-bit grey if all ids fit, otherwise 8-bit RGB as in COCO's panoptic
/// format, id = R + 256 G + 65536 B. The folder must exist.
///
/// # Errors
/// [`OutputError::IdTooLarge`] for ids above [`MAX_SEGMENT_ID`], which no method of this workspace gives, [`OutputError::Encode`] for an empty map, [`OutputError::Io`] if
/// the file cannot be written; then no partial file is left.
pub fn write_segments_png(path: &Path, segments: &SegmentMap) -> Result<(), OutputError> {
    let largest = segments.pixels().iter().copied().max().unwrap_or(0);
    let pixels = segments.pixels().iter();
    let (bytes, kind): (Vec<u8>, ExtendedColorType) = match largest {
        0..=MAX_16_BIT_ID => (pixels.flat_map(|id| (*id as u16).to_ne_bytes()).collect(), ExtendedColorType::L16),
        id if id > MAX_SEGMENT_ID => return Err(OutputError::IdTooLarge { path: path.to_owned(), id }),
        _ => {
            let channels = |id: &SegmentId| [*id as u8, (*id >> 8) as u8, (*id >> 16) as u8];
            (pixels.flat_map(channels).collect(), ExtendedColorType::Rgb8)
        }
    };
    let mut encoded = Vec::new();
    PngEncoder::new(&mut encoded)
        .write_image(&bytes, segments.width() as u32, segments.height() as u32, kind)
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

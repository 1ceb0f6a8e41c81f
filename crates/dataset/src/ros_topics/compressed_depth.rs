//! Depth in the format of ROS's `compressed_depth_image_transport`: 12 bytes of parameters, then 16-bit values as PNG
//! or in RVL (Wilson, "Fast Lossless Depth Image Compression", 2017).
//!
//! The values are millimetres if the original images were `16UC1`. If they were `32FC1`, a value n means a depth of
//! `a / (n − b)` metres, with `a` and `b` among the parameters; 0 is missing.

use crate::DatasetError;
use crate::decode::{MAX_PIXELS, decode_grey16, require_decoding_memory};
use crate::depth_scale::DepthScale;
use crate::error::DEPTH_IMAGE;
use splatseg_geometry::Image;
use std::path::Path;

/// Format number and two parameters, 4 bytes each.
const PARAMETER_BYTES: usize = 12;
/// First bytes of every PNG.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Maximum number of 3-bit parts in a 32-bit number.
const MAX_PARTS: u32 = 11;

/// Decodes a compressed depth image, metres. `format` is that of the message; `path` is named in errors. Without `scale`,
/// whole numbers are millimetres.
pub(crate) fn decode_compressed_depth(
    path: &Path,
    format: &str,
    data: &[u8],
    scale: Option<DepthScale>,
) -> Result<Image<f32>, DatasetError> {
    let Some((parameters, stored)) = data.split_at_checked(PARAMETER_BYTES) else {
        return Err(wrong(path, format!("{} bytes", data.len()), "12 bytes of parameters and an image"));
    };
    let number =
        |at: usize| parameters.get(at..at + 4).and_then(|bytes| Some(f32::from_le_bytes(*bytes.first_chunk()?)));
    let (a, b) = (number(4).unwrap_or_default(), number(8).unwrap_or_default());
    // Check the content rather than the format, because older versions do not state the compression.
    let numbers = if stored.starts_with(PNG) {
        decode_grey16(path, DEPTH_IMAGE, stored)?
    } else if format.contains("rvl") {
        decode_rvl(path, stored)?
    } else {
        return Err(wrong(path, format!("format {format:?} with other bytes than PNG's"), "png or rvl"));
    };
    let encoding = format.split(';').next().unwrap_or_default().trim();
    if encoding.eq_ignore_ascii_case("32FC1") {
        let scale = scale.unwrap_or(DepthScale::METRES);
        let stored = |number: u16| if number == 0 { 0.0 } else { a / (f32::from(number) - b) };
        return Ok(numbers.map(|number| scale.measured(stored(*number))));
    }
    let scale = scale.unwrap_or(DepthScale::MILLIMETRES);
    Ok(numbers.map(|number| scale.metres(*number)))
}

/// Returns the image after the parameters.
pub(crate) fn image_part(data: &[u8]) -> &[u8] {
    data.get(PARAMETER_BYTES..).unwrap_or_default()
}

/// Returns the size stated before RVL data, `(width, height)`.
pub(crate) fn rvl_size(stored: &[u8]) -> Option<(usize, usize)> {
    let side = |at: usize| Some(u32::from_le_bytes(*stored.get(at..)?.first_chunk()?) as usize);
    side(0).zip(side(4))
}

fn wrong(path: &Path, found: String, expected: &str) -> DatasetError {
    let field = "compressed depth image".to_owned();
    DatasetError::Field { path: path.to_owned(), field, found, expected: expected.to_owned() }
}

/// Decodes width and height, 4 bytes each, and RVL data: alternating runs of zeros and of other numbers, stored as
/// differences.
fn decode_rvl(path: &Path, stored: &[u8]) -> Result<Image<u16>, DatasetError> {
    let side = |at: usize| stored.get(at..at + 4).and_then(|bytes| Some(u32::from_le_bytes(*bytes.first_chunk()?)));
    let (Some(width), Some(height)) = (side(0), side(4)) else {
        return Err(wrong(path, format!("{} bytes of RVL", stored.len()), "width, height and numbers"));
    };
    let count = u64::from(width) * u64::from(height);
    if count > MAX_PIXELS {
        return Err(DatasetError::ImplausibleSize {
            path: path.to_owned(),
            what: DEPTH_IMAGE,
            width,
            height,
            bytes: stored.len(),
            limit: MAX_PIXELS,
        });
    }
    let size = (width as usize, height as usize);
    require_decoding_memory(path, DEPTH_IMAGE, size)?;
    let count = count as usize;
    let cut_off = || wrong(path, "RVL data that end early or are damaged".to_owned(), &format!("{count} numbers"));
    let mut parts = RvlParts { words: stored.get(8..).unwrap_or_default(), word: 0, left: 0 };
    let (mut numbers, mut previous) = (Vec::with_capacity(count), 0u16);
    while numbers.len() < count {
        let zeros = parts.number().ok_or_else(cut_off)? as usize;
        let others = parts.number().ok_or_else(cut_off)? as usize;
        // Empty runs are errors too, to avoid an endless loop.
        if zeros.saturating_add(others) > count - numbers.len() || zeros.saturating_add(others) == 0 {
            return Err(cut_off());
        }
        numbers.resize(numbers.len() + zeros, 0);
        for _ in 0..others {
            let folded = parts.number().ok_or_else(cut_off)?;
            let difference = (folded >> 1) as i32 ^ -((folded & 1) as i32);
            previous = previous.wrapping_add(difference as u16);
            numbers.push(previous);
        }
    }
    Image::from_pixels(size.0, size.1, numbers).map_err(|_| cut_off())
}

/// Reader of 4-bit parts, most significant first in each 32-bit word.
struct RvlParts<'a> {
    words: &'a [u8],
    word: u32,
    /// Number of parts left in the word.
    left: u32,
}

impl RvlParts<'_> {
    /// Reads the next number: parts with 3 bits each, least significant first. The top bit of a part is set if more
    /// follow.
    fn number(&mut self) -> Option<u32> {
        let mut number = 0u32;
        for part in 0..MAX_PARTS {
            if self.left == 0 {
                // The next word; `None` at the end of the stream.
                let (word, rest) = self.words.split_first_chunk::<4>()?;
                self.word = u32::from_le_bytes(*word);
                self.words = rest;
                self.left = 8;
            }
            let bits = self.word >> 28;
            self.word <<= 4;
            self.left -= 1;
            number |= (bits & 7).checked_shl(3 * part).unwrap_or_default();
            if bits & 8 == 0 {
                return Some(number);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Encodes RVL as described in the paper.
    fn encode_rvl(numbers: &[u16], width: u32) -> Vec<u8> {
        let mut parts = Vec::new();
        let mut push = |mut number: u32| loop {
            let more = number >> 3 != 0;
            parts.push((number & 7) | if more { 8 } else { 0 });
            number >>= 3;
            if !more {
                break;
            }
        };
        let (mut rest, mut previous) = (numbers, 0i32);
        while !rest.is_empty() {
            let zeros = rest.iter().take_while(|number| **number == 0).count();
            let others = rest[zeros..].iter().take_while(|number| **number != 0).count();
            push(zeros as u32);
            push(others as u32);
            for number in &rest[zeros..zeros + others] {
                let difference = i32::from(*number) - previous;
                push(((difference << 1) ^ (difference >> 31)) as u32);
                previous = i32::from(*number);
            }
            rest = &rest[zeros + others..];
        }
        let mut bytes = [width.to_le_bytes(), (numbers.len() as u32 / width.max(1)).to_le_bytes()].concat();
        for word in parts.chunks(8) {
            let value = word.iter().enumerate().fold(0, |value, (at, part)| value | part << (28 - 4 * at));
            bytes.extend(value.to_le_bytes());
        }
        bytes
    }

    fn message(parameters: [f32; 2], image: &[u8]) -> Vec<u8> {
        [&[0; 4], &parameters[0].to_le_bytes()[..], &parameters[1].to_le_bytes(), image].concat()
    }

    #[test]
    fn inverse_depth_is_metres() {
        // Default parameters of the transport: 100, and at most 10 m.
        let (a, b) = (100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0);
        let stored: Vec<u16> = [0.5f32, 2.0, 7.5].iter().map(|z| (a / z + b) as u16).chain([0]).collect();
        let data = message([a, b], &encode_rvl(&stored, 2));
        let depth = decode_compressed_depth(Path::new("a"), "32FC1; compressedDepth rvl", &data, None).unwrap();
        for (found, expected) in depth.pixels().iter().zip([0.5, 2.0, 7.5, 0.0]) {
            assert!((found - expected).abs() < 0.01, "{found} {expected}");
        }
    }

    #[test]
    fn depth_that_no_camera_measures_is_missing() {
        // The parameters make 100 infinitely far, 99 negative, and 101 too far.
        let data = message([1e10, 100.0], &encode_rvl(&[99, 100, 101], 3));
        let depth = decode_compressed_depth(Path::new("a"), "32FC1; compressedDepth rvl", &data, None).unwrap();
        assert_eq!(depth.pixels(), [0.0; 3]);
    }

    #[test]
    fn false_sizes_take_no_memory() {
        let huge = [u32::MAX.to_le_bytes(), 3u32.to_le_bytes()].concat();
        for image in [&huge[..], &huge[..5], b"", &[0; 8], &[1, 0, 0, 0, 1, 0, 0, 0]] {
            let result =
                decode_compressed_depth(Path::new("a"), "16UC1; compressedDepth rvl", &message([0.0; 2], image), None);
            assert!(result.is_err() || result.unwrap().pixels().is_empty());
        }
        assert!(decode_compressed_depth(Path::new("a"), "16UC1; compressedDepth", &[0; 11], None).is_err());
        assert!(decode_compressed_depth(Path::new("a"), "16UC1; compressedDepth jxl", &[9; 60], None).is_err());
    }

    proptest! {
        #[test]
        fn rvl_is_read_back(numbers in prop::collection::vec(prop_oneof![Just(0u16), any::<u16>(), 900u16..1100], 1..200)) {
            let data = message([0.0; 2], &encode_rvl(&numbers, numbers.len() as u32));
            let depth = decode_compressed_depth(Path::new("a"), "16UC1; compressedDepth rvl", &data, None).unwrap();
            let expected: Vec<f32> = numbers.iter().map(|number| DepthScale::MILLIMETRES.metres(*number)).collect();
            prop_assert_eq!(depth.pixels(), &expected[..]);
        }

        #[test]
        fn any_bytes_end(data in prop::collection::vec(any::<u8>(), 0..200), width in 0u8..40, height in 0u8..40) {
            let image = [&[width, 0, 0, 0, height, 0, 0, 0], &data[..]].concat();
            let _ = decode_compressed_depth(Path::new("a"), "16UC1; compressedDepth rvl", &message([0.0; 2], &image), None);
        }
    }
}

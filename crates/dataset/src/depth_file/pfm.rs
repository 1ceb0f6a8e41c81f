//! PFM, the portable float map: `Pf`, width, height and a scale as text, then 32-bit floats row by row from the bottom up. A
//! negative scale means little-endian numbers; its size is not used.

use super::{DepthFile, StoredDepth, numbers};
use crate::DatasetError;
use crate::text::shortened;

/// A number in the header has at most this many letters.
const MAX_WORD_BYTES: usize = 40;

/// The fields of the header.
struct Header {
    /// `(width, height)`.
    size: (usize, usize),
    is_little_endian: bool,
    /// Where the numbers start.
    data_start: usize,
}

/// Returns the `(width, height)` that the header states.
pub(super) fn size(file: &DepthFile<'_>) -> Result<(usize, usize), DatasetError> {
    Ok(read_header(file)?.size)
}

/// Reads the numbers.
pub(super) fn read(file: &DepthFile<'_>) -> Result<StoredDepth, DatasetError> {
    let Header { size: (width, height), is_little_endian, data_start } = read_header(file)?;
    let data = file.slice("the numbers", data_start, width.saturating_mul(height).saturating_mul(4))?;
    let number = if is_little_endian { f32::from_le_bytes } else { f32::from_be_bytes };
    let rows = data.chunks_exact(width * 4).rev().flat_map(|row| numbers(row, number));
    Ok(StoredDepth::Floats(file.image((width, height), rows.collect())?))
}

fn read_header(file: &DepthFile<'_>) -> Result<Header, DatasetError> {
    let mut at = 0;
    let kind = next_word(file, &mut at)?;
    if kind != "Pf" {
        return Err(file.wrong("kind of PFM", shortened(kind), "Pf, which has one channel"));
    }
    let mut side = |what: &str| {
        let word = next_word(file, &mut at)?;
        word.parse().map_err(|_| file.wrong(what, shortened(word), "a number of pixels"))
    };
    let size = (side("width")?, side("height")?);
    let word = next_word(file, &mut at)?;
    let scale: f32 = word.parse().unwrap_or(0.0);
    if !scale.is_finite() || scale == 0.0 {
        return Err(file.wrong("scale", shortened(word), "-1.0 for little-endian numbers, 1.0 for big-endian ones"));
    }
    Ok(Header { size: file.check_size(size)?, is_little_endian: scale < 0.0, data_start: at })
}

/// Returns the next word of the header and moves past it and the one whitespace letter that ends it.
fn next_word<'a>(file: &DepthFile<'a>, at: &mut usize) -> Result<&'a str, DatasetError> {
    let rest = file.bytes.get(*at..).unwrap_or_default();
    let skipped = rest.iter().take(MAX_WORD_BYTES).take_while(|byte| byte.is_ascii_whitespace()).count();
    let rest = rest.get(skipped..).unwrap_or_default();
    let len = rest.iter().take(MAX_WORD_BYTES).position(u8::is_ascii_whitespace);
    let word = len.and_then(|len| std::str::from_utf8(rest.get(..len)?).ok());
    let word = word.ok_or_else(|| file.wrong("header", "no text", "width, height and scale"))?;
    *at += skipped + word.len() + 1;
    Ok(word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn stored(header: &str, data: &[u8]) -> Result<Vec<f32>, String> {
        let bytes = [header.as_bytes(), data].concat();
        match read(&DepthFile { path: Path::new("a.pfm"), bytes: &bytes }) {
            Ok(StoredDepth::Floats(image)) => Ok(image.pixels().to_vec()),
            Ok(StoredDepth::Integers(_)) => panic!("floats"),
            Err(error) => Err(error.to_string()),
        }
    }

    #[test]
    fn rows_are_stored_from_the_bottom_up_in_either_byte_order() {
        let little = [3.0f32, 4.0, 1.0, 2.0].map(f32::to_le_bytes).concat();
        let big = [3.0f32, 4.0, 1.0, 2.0].map(f32::to_be_bytes).concat();
        assert_eq!(stored("Pf\n2 2\n-1.0\n", &little).unwrap(), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(stored("Pf 2 2 1\r", &big).unwrap(), [1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn wrong_headers_are_named() {
        let refused = |header: &str| stored(header, &[0; 16]).unwrap_err();
        assert!(refused("PF\n2 2\n-1.0\n").contains("kind of PFM: found \"PF\""));
        assert!(refused("Pf\n2 -2\n-1.0\n").contains("height: found \"-2\""));
        assert!(refused("Pf\n2 2\nnan\n").contains("scale: found \"nan\""));
        assert!(refused("Pf\n2 3\n-1.0\n").contains("the numbers would end at byte 36, but the file has 28"));
        assert!(refused("Pf\n2").contains("header: found no text"));
    }
}

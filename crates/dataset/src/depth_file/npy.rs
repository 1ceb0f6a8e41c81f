//! NumPy's `.npy`, versions 1 to 3: little-endian, in C order, of 16-bit integers or of 16-, 32- or 64-bit floats.
//!
//! After the magic bytes and the version comes the length of a header, a Python dictionary such as
//! `{'descr': '<u2', 'fortran_order': False, 'shape': (192, 256), }`, and then the numbers, row by row.

use super::{DepthFile, StoredDepth, numbers};
use crate::DatasetError;
use crate::text::shortened;

/// NumPy limits headers it has not written itself to 10000 bytes.
const MAX_HEADER_BYTES: usize = 10_000;

/// Types of the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NumberType {
    U16,
    F16,
    F32,
    F64,
}

impl NumberType {
    fn of(descr: &str) -> Option<Self> {
        match descr {
            "<u2" => Some(Self::U16),
            "<f2" => Some(Self::F16),
            "<f4" => Some(Self::F32),
            "<f8" => Some(Self::F64),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// The fields of the header.
struct Header {
    number_type: NumberType,
    /// `(width, height)`.
    size: (usize, usize),
    /// Where the numbers start.
    data_start: usize,
}

/// Returns the `(width, height)` that the header states.
pub(super) fn size(file: &DepthFile<'_>) -> Result<(usize, usize), DatasetError> {
    Ok(read_header(file)?.size)
}

/// Reads the numbers.
pub(super) fn read(file: &DepthFile<'_>) -> Result<StoredDepth, DatasetError> {
    let Header { number_type, size, data_start } = read_header(file)?;
    let len = size.0.saturating_mul(size.1).saturating_mul(number_type.bytes());
    let data = file.slice("the array", data_start, len)?;
    let floats = match number_type {
        NumberType::U16 => return Ok(StoredDepth::Integers(file.image(size, numbers(data, u16::from_le_bytes))?)),
        NumberType::F16 => numbers(data, |bytes| super::exr::half(u16::from_le_bytes(bytes))),
        NumberType::F32 => numbers(data, f32::from_le_bytes),
        NumberType::F64 => numbers(data, |bytes| f64::from_le_bytes(bytes) as f32),
    };
    Ok(StoredDepth::Floats(file.image(size, floats)?))
}

fn read_header(file: &DepthFile<'_>) -> Result<Header, DatasetError> {
    let version = file.slice("the version", 6, 2)?;
    let (start, len) = match version[0] {
        1 => (10, numbers(file.slice("the header's length", 8, 2)?, u16::from_le_bytes)[0] as usize),
        2 | 3 => (12, numbers(file.slice("the header's length", 8, 4)?, u32::from_le_bytes)[0] as usize),
        other => return Err(file.wrong("version of the .npy file", other.to_string(), "1, 2 or 3")),
    };
    if len > MAX_HEADER_BYTES {
        return Err(file.wrong("length of the header", len.to_string(), format!("at most {MAX_HEADER_BYTES}")));
    }
    let text = String::from_utf8_lossy(file.slice("the header", start, len)?);
    let descr = value_of(&text, "descr").unwrap_or("nothing");
    let number_type = NumberType::of(descr.trim_matches(['\'', '"'])).ok_or_else(|| {
        file.wrong("type of the numbers", shortened(descr), "'<u2', '<f2', '<f4' or '<f8': uint16 or float")
    })?;
    let order = value_of(&text, "fortran_order").unwrap_or("nothing");
    if order != "False" {
        return Err(file.wrong("fortran_order", shortened(order), "False: numbers row by row"));
    }
    let shape = value_of(&text, "shape").unwrap_or("nothing");
    let size = size_of(shape).ok_or_else(|| file.wrong("shape", shortened(shape), "(height, width)"))?;
    Ok(Header { number_type, size: file.check_size(size)?, data_start: start + len })
}

/// Returns the text of a value in a Python dictionary of plain values: up to the next comma outside brackets.
fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let at = ["'", "\""].into_iter().find_map(|quote| {
        let key = format!("{quote}{key}{quote}");
        Some(text.find(&key)? + key.len())
    })?;
    let value = text.get(at..)?.trim_start().strip_prefix(':')?.trim_start();
    let mut depth = 0_usize;
    let end = value.find(|letter: char| {
        match letter {
            '(' | '[' => depth += 1,
            ')' | ']' => depth = depth.saturating_sub(1),
            ',' | '}' => return depth == 0,
            _ => {}
        }
        false
    });
    Some(value.get(..end.unwrap_or(value.len()))?.trim_end())
}

/// Parses a shape as `(width, height)`. A last side of 1 is a channel.
fn size_of(shape: &str) -> Option<(usize, usize)> {
    let sides = shape.strip_prefix('(')?.strip_suffix(')')?.split(',').map(str::trim).filter(|side| !side.is_empty());
    match sides.map(|side| side.parse().ok()).collect::<Option<Vec<usize>>>()?.as_slice() {
        [height, width] | [height, width, 1] => Some((*width, *height)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Returns a file with this header.
    fn npy(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend([version, 0]);
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        [&bytes, header.as_bytes(), data].concat()
    }

    fn error(header: &str) -> String {
        read(&DepthFile { path: Path::new("a.npy"), bytes: &npy(1, header, &[0; 12]) }).unwrap_err().to_string()
    }

    #[test]
    fn all_versions_are_read() {
        let data = [1u16, 2, 3, 4, 5, 6].map(u16::to_le_bytes).concat();
        for version in 1..=3 {
            let bytes = npy(version, "{'descr': '<u2', 'fortran_order': False, 'shape': (2, 3), }    \n", &data);
            let file = DepthFile { path: Path::new("a.npy"), bytes: &bytes };
            let StoredDepth::Integers(image) = read(&file).unwrap() else { panic!("integers") };
            assert_eq!((image.size(), image.pixels()), ((3, 2), &[1, 2, 3, 4, 5, 6][..]));
            assert_eq!(size(&file).unwrap(), (3, 2));
        }
    }

    #[test]
    fn other_arrays_are_refused_with_what_they_are() {
        let header = |descr: &str, order: &str, shape: &str| {
            error(&format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}"))
        };
        let told = header("'>u2'", "False", "(2, 3)");
        assert!(told.starts_with("a.npy: depth image, type of the numbers: found \"'>u2'\", expected '<u2'"), "{told}");
        assert!(header("'<u2'", "True", "(2, 3)").contains("fortran_order: found \"True\", expected False"));
        assert!(header("'<u2'", "False", "(2, 3, 3)").contains("shape: found \"(2, 3, 3)\", expected (height, width)"));
        assert!(header("'<u2'", "False", "()").contains("shape: found \"()\""));
        assert!(header("'<u2'", "False", "(0, 3)").contains("size: found 3x0 pixels"));
        assert!(header("'<u2'", "False", "(2, 4)").contains("the array would end at byte"));
        assert!(header("'<u2'", "False", "(99999999999, 4)").contains("claims to have"));
        assert!(header("[('x', '<u2'), ('y', '<f4')]", "False", "(2, 3)").contains("type of the numbers"));
        assert!(error("no dictionary").contains("type of the numbers: found \"nothing\""));
    }

    #[test]
    fn a_channel_of_its_own_and_other_quotes_are_read() {
        assert_eq!(size_of("(2, 3, 1)"), Some((3, 2)));
        assert_eq!(value_of("{\"shape\": (2, 3), \"descr\": \"<f4\"}", "shape"), Some("(2, 3)"));
        assert_eq!(value_of("{\"shape\": (2, 3), \"descr\": \"<f4\"}", "descr"), Some("\"<f4\""));
    }
}

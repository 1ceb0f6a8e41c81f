//! The text at the beginning of the file.

use super::error::SplatFileError;
use super::record::FLOAT_PROPERTIES;
use super::{SplatFileView, VERSION};
use std::fmt::Write;
use std::io::{BufRead, Read};
use std::path::Path;

/// Longer headers are none of ours: the largest feature has 2^16 dimensions.
const MAX_HEADER_BYTES: u64 = 1 << 22;
/// How much of a strange line an error shows.
const SHOWN_CHARS: usize = 60;

/// What the header says.
pub struct Header {
    /// The text itself, as it was read.
    pub bytes: Vec<u8>,
    /// Number of Gaussians it announces.
    pub gaussians: u64,
    /// Dimension of the features.
    pub feature_dim: usize,
}

/// The header of a file.
pub fn format(view: &SplatFileView<'_>) -> String {
    let (dim, codes, used) = (view.codebook.feature_dim(), view.codebook.len(), view.used_codes);
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "comment splatseg memory {VERSION} feature_dim {dim} codes {codes} used {used}");
    let _ = writeln!(text, "element vertex {}", view.gaussians.len());
    for line in property_lines(dim) {
        text.push_str(&line);
        text.push('\n');
    }
    text.push_str("end_header\n");
    text
}

fn property_lines(feature_dim: usize) -> impl Iterator<Item = String> {
    let fixed = FLOAT_PROPERTIES.iter().map(|name| format!("property float {name}"));
    let features = (0..feature_dim).map(|index| format!("property float feature_{index}"));
    fixed.chain(features).chain(std::iter::once("property int segment_id".to_owned()))
}

/// Reads the header and leaves `reader` at the first vertex.
pub fn read(reader: &mut impl BufRead, path: &Path) -> Result<Header, SplatFileError> {
    let bytes = read_text(reader, path)?;
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().skip(1).collect();
    let format = lines.iter().find_map(|line| line.strip_prefix("format ")).unwrap_or_default();
    if format != "binary_little_endian 1.0" {
        return Err(SplatFileError::Format { path: path.to_owned(), found: shown(format) });
    }
    let announced = lines.iter().find_map(|line| line.strip_prefix("comment splatseg memory "));
    let Some(announced) = announced else {
        return Err(SplatFileError::NotAMemory { path: path.to_owned() });
    };
    let version = announced.split(' ').next().unwrap_or_default();
    if version.parse() != Ok(VERSION) {
        return Err(SplatFileError::Version { path: path.to_owned(), found: shown(version), expected: VERSION });
    }
    let mut body = lines.into_iter().filter(|line| !line.starts_with("comment ") && !line.starts_with("format "));
    let element = body.next().unwrap_or_default();
    let Some(Ok(gaussians)) = element.strip_prefix("element vertex ").map(str::parse) else {
        return Err(header_error(path, element, "element vertex and a count"));
    };
    let properties: Vec<&str> = body.collect();
    // All lines but the fixed floats, the id and `end_header` are features.
    let feature_dim = properties.len().saturating_sub(FLOAT_PROPERTIES.len() + 2).max(1);
    let expected = property_lines(feature_dim).chain(std::iter::once("end_header".to_owned()));
    for (index, expected) in expected.enumerate() {
        let found = properties.get(index).copied().unwrap_or_default();
        if found != expected {
            return Err(header_error(path, found, &format!("{expected:?}")));
        }
    }
    Ok(Header { gaussians, feature_dim, bytes })
}

/// The bytes up to the line `end_header`, that included.
fn read_text(reader: &mut impl BufRead, path: &Path) -> Result<Vec<u8>, SplatFileError> {
    let mut reader = reader.take(MAX_HEADER_BYTES);
    let mut bytes = Vec::new();
    loop {
        let start = bytes.len();
        // A file that is no PLY may have no line ends: look at little of it.
        if start == 0 {
            (&mut reader).take(4).read_until(b'\n', &mut bytes).map_err(SplatFileError::io(path, "read"))?;
            if bytes != b"ply\n" {
                let found = shown(&String::from_utf8_lossy(&bytes));
                return Err(SplatFileError::NotPly { path: path.to_owned(), found });
            }
            continue;
        }
        let read = reader.read_until(b'\n', &mut bytes).map_err(SplatFileError::io(path, "read"))?;
        if &bytes[start..] == b"end_header\n" {
            return Ok(bytes);
        }
        if read == 0 {
            let last = bytes[..start].split(|&byte| byte == b'\n').rfind(|line| !line.is_empty());
            let found = String::from_utf8_lossy(last.unwrap_or_default()).into_owned();
            return Err(header_error(path, &found, "\"end_header\" after it"));
        }
    }
}

fn header_error(path: &Path, found: &str, expected: &str) -> SplatFileError {
    SplatFileError::Header { path: path.to_owned(), found: shown(found), expected: expected.to_owned() }
}

fn shown(text: &str) -> String {
    text.chars().take(SHOWN_CHARS).collect()
}

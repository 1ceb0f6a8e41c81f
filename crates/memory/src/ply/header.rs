//! The header: text at the beginning of the file.

use super::error::SplatFileError;
use super::layout::{Layout, Sizes};
use super::{ARRAYS, OLD_VERSION, SplatFileView, VERSION};
use glam::DVec3;
use splatseg_geometry::Pose;
use std::fmt::Write;
use std::io::{BufRead, Read};
use std::path::Path;

/// Maximum length of a header: the largest feature has 2^16 dimensions.
const MAX_HEADER_BYTES: u64 = 1 << 22;
/// Beginning of the comment that states the origin of the coordinates.
const ORIGIN: &str = "comment origin ";
/// Beginning of the comment with the name of a kind of memory that another crate has registered.
const REGISTERED_KIND: &str = "comment kind ";
/// Maximum number of characters of an invalid line in an error.
const SHOWN_CHARS: usize = 100;

/// A parsed header.
pub struct Header {
    /// The text as it was read.
    pub bytes: Vec<u8>,
    /// Sizes of the content.
    pub sizes: Sizes,
    /// Origin of the Gaussians' coordinates: world coordinates, metres.
    pub origin: DVec3,
    /// Name of the kind of memory, if it is one that another crate has registered.
    pub registered_kind: Option<String>,
}

/// Formats the header of a file.
///
/// # Errors
/// If [`read`] would refuse it.
pub fn checked(view: &SplatFileView<'_>, sizes: &Sizes, path: &Path) -> Result<String, SplatFileError> {
    sizes.check(path)?;
    let (origin, text) = (view.origin, format(view, sizes));
    let (found, max) = (text.len() as u64, MAX_HEADER_BYTES);
    if found > max {
        return Err(SplatFileError::HeaderLength { path: path.to_owned(), found, max });
    }
    if !is_possible_origin(origin) {
        return Err(origin_error(origin_comment(origin).trim_end(), path));
    }
    if let Some(name) = view.registered_kind.filter(|name| !is_kind(name)) {
        return Err(kind_error(name, path));
    }
    check_owner(sizes.layout, view.registered_kind, path)?;
    Ok(text)
}

fn format(view: &SplatFileView<'_>, sizes: &Sizes) -> String {
    let (kind, segments) = (sizes.layout.name(), sizes.segments);
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    // Writing to a string cannot fail.
    let _ = write!(text, "comment splatseg memory {VERSION} kind {kind} ");
    if let Layout::Features { feature_dim, codes } = sizes.layout {
        let _ = write!(text, "feature_dim {feature_dim} codes {codes} ");
    }
    let _ = writeln!(text, "segments {segments} {} {}", size_word(VERSION), sizes.saved_state);
    text.push_str(&origin_comment(view.origin));
    if let Some(name) = view.registered_kind {
        let _ = writeln!(text, "{REGISTERED_KIND}{name}");
    }
    let _ = writeln!(text, "element vertex {}", sizes.gaussians);
    for (kind, name) in sizes.layout.properties() {
        let _ = writeln!(text, "property {kind} {name}");
    }
    text.push_str("end_header\n");
    text
}

/// Returns the line that states the origin of the coordinates; empty for the world's origin.
pub fn origin_comment(origin: DVec3) -> String {
    if origin == DVec3::ZERO { String::new() } else { format!("{ORIGIN}{} {} {}\n", origin.x, origin.y, origin.z) }
}

/// Reads the origin from its comment; zero without one.
fn read_origin(lines: &[&str], path: &Path) -> Result<DVec3, SplatFileError> {
    let Some((line, numbers)) = lines.iter().find_map(|line| Some((line, line.strip_prefix(ORIGIN)?))) else {
        return Ok(DVec3::ZERO);
    };
    let numbers: Option<Vec<f64>> = numbers.split(' ').map(|number| number.parse().ok()).collect();
    let origin = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok()).map(DVec3::from_array);
    origin.filter(|origin| is_possible_origin(*origin)).ok_or_else(|| origin_error(line, path))
}

/// Reads the name of a registered kind of memory from its comment, if there is one.
fn read_registered_kind(lines: &[&str], path: &Path) -> Result<Option<String>, SplatFileError> {
    let Some(name) = lines.iter().find_map(|line| line.strip_prefix(REGISTERED_KIND)) else { return Ok(None) };
    if is_kind(name) { Ok(Some(name.to_owned())) } else { Err(kind_error(name, path)) }
}

/// Returns an error if there are arrays and no kind whose they are.
fn check_owner(layout: Layout, registered_kind: Option<&str>, path: &Path) -> Result<(), SplatFileError> {
    if layout == Layout::Arrays && registered_kind.is_none() {
        return Err(header_error(path, "", &format!("{:?} and the name of the kind", REGISTERED_KIND.trim_end())));
    }
    Ok(())
}

fn is_kind(name: &str) -> bool {
    splatseg_settings::is_name(name) && name.len() <= SHOWN_CHARS
}

fn kind_error(name: &str, path: &Path) -> SplatFileError {
    header_error(path, &format!("{REGISTERED_KIND}{name}"), "up to 100 lower-case letters, digits, - and _")
}

fn is_possible_origin(origin: DVec3) -> bool {
    origin.abs().cmple(DVec3::splat(Pose::MAX_DISTANCE)).all()
}

fn origin_error(line: &str, path: &Path) -> SplatFileError {
    header_error(path, line, &format!("three numbers up to {:e}", Pose::MAX_DISTANCE))
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
    let announced = read_announcement(announced, path)?;
    let origin = read_origin(&lines, path)?;
    let registered_kind = read_registered_kind(&lines, path)?;
    check_owner(announced.layout, registered_kind.as_deref(), path)?;
    let mut body = lines.into_iter().filter(|line| !line.starts_with("comment ") && !line.starts_with("format "));
    let element = body.next().unwrap_or_default();
    let Some(Ok(gaussians)) = element.strip_prefix("element vertex ").map(str::parse) else {
        return Err(header_error(path, element, "element vertex and a count"));
    };
    let properties = announced.layout.properties().map(|(kind, name)| format!("property {kind} {name}"));
    for expected in properties.chain(std::iter::once("end_header".to_owned())) {
        let found = body.next().unwrap_or_default();
        if found != expected {
            return Err(header_error(path, found, &format!("{expected:?}")));
        }
    }
    let sizes = Sizes { gaussians, ..announced };
    sizes.check(path)?;
    Ok(Header { sizes, origin, registered_kind, bytes })
}

/// The word before the length of the state in the comment of a version.
fn size_word(version: u32) -> &'static str {
    if version == OLD_VERSION { "short_term" } else { "state" }
}

/// Parses the rest of the comment "splatseg memory": version, kind of content, number of segments, and length of the state
/// besides the Gaussians. The number of Gaussians is not part of it.
fn read_announcement(announced: &str, path: &Path) -> Result<Sizes, SplatFileError> {
    let words: Vec<&str> = announced.split(' ').collect();
    let (number, words) = words.split_first().unwrap_or((&"", &[]));
    let known = [OLD_VERSION, VERSION].into_iter().find(|known| number.parse() == Ok(*known));
    let version = known.ok_or_else(|| SplatFileError::Version { path: path.to_owned(), found: shown(number) })?;
    let (words, rest) = words.split_at(words.len().saturating_sub(4));
    let layout = match *words {
        ["kind", "evidence"] => Some(Layout::Evidence),
        ["kind", ARRAYS] => Some(Layout::Arrays),
        ["kind", "features", "feature_dim", dim, "codes", codes] => match (dim.parse(), codes.parse()) {
            (Ok(feature_dim @ 1..), Ok(codes)) => Some(Layout::Features { feature_dim, codes }),
            _ => None,
        },
        _ => None,
    };
    let size_word = size_word(version);
    let counts = match *rest {
        ["segments", segments, word, state] if word == size_word => segments.parse().ok().zip(state.parse().ok()),
        _ => None,
    };
    let sizes = layout.zip(counts).map(|(layout, (segments, saved_state))| Sizes {
        version,
        gaussians: 0,
        segments,
        layout,
        saved_state,
    });
    sizes.ok_or_else(|| {
        let expected = format!(
            "version, kind evidence or {ARRAYS}, segments and {size_word}, or version, kind features, feature_dim, codes, \
             segments and {size_word}"
        );
        header_error(path, announced, &expected)
    })
}

/// Reads the bytes up to and including the line `end_header`.
fn read_text(reader: &mut impl BufRead, path: &Path) -> Result<Vec<u8>, SplatFileError> {
    let mut reader = reader.take(MAX_HEADER_BYTES);
    let mut bytes = Vec::new();
    loop {
        let start = bytes.len();
        // Other files may have no line ends: read only their first bytes.
        if start == 0 {
            (&mut reader).take(4).read_until(b'\n', &mut bytes).map_err(SplatFileError::io(path, "read"))?;
            if bytes == b"ply\r" {
                return Err(SplatFileError::CopiedAsText { path: path.to_owned() });
            }
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

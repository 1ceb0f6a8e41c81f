//! Mesh vertices and their instance labels, for scoring 3D instances.

use glam::DVec3;
use splatseg_dataset::DatasetError;
use splatseg_files::{MemoryLimit, read_file};
use splatseg_geometry::SegmentId;
use std::path::Path;

/// Maximum file size. Meshes of rooms are smaller.
const MAX_MESH_BYTES: u64 = 8 << 30;
/// Factor that combines label and instance in one number, as in ScanNet's files: `label * 1000 + instance`.
const LABEL: u64 = 1000;
/// Maximum length of the header.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// Storage type of a vertex property.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Float,
    Double,
    /// Any other type, with its size in bytes.
    Other(usize),
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            "char" | "int8" | "uchar" | "uint8" => Self::Other(1),
            "short" | "int16" | "ushort" | "uint16" => Self::Other(2),
            "int" | "int32" | "uint" | "uint32" => Self::Other(4),
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::Float => 4,
            Self::Double => 8,
            Self::Other(bytes) => bytes,
        }
    }

    fn number(self, bytes: &[u8]) -> Option<f64> {
        match self {
            Self::Float => bytes.first_chunk().map(|bytes| f64::from(f32::from_le_bytes(*bytes))),
            Self::Double => bytes.first_chunk().map(|bytes| f64::from_le_bytes(*bytes)),
            Self::Other(_) => None,
        }
    }
}

/// Layout of the vertices in a PLY file. They must be the first element.
struct VertexLayout {
    count: usize,
    /// Bytes per vertex.
    stride: usize,
    /// Offset within a vertex and type of x, y and z.
    axes: [(usize, Kind); 3],
    /// Offset of the first vertex in the file.
    start: usize,
}

/// Reads the vertices of a mesh, world coordinates, metres. The file is a binary little-endian PLY whose vertices have
/// x, y and z, such as ScanNet's `*_vh_clean_2.ply`.
///
/// # Errors
/// If the file cannot be read, is not such a PLY, is cut off, or has a vertex that is not finite.
pub fn read_mesh_vertices(path: &Path) -> Result<Vec<DVec3>, DatasetError> {
    let limit = MAX_MESH_BYTES.min(MemoryLimit::in_force() / 4);
    let bytes = read_file(path, limit).map_err(|source| DatasetError::Io { path: path.to_owned(), source })?;
    let layout = layout(path, &bytes)?;
    let body = bytes.get(layout.start..).unwrap_or_default();
    let stored = body.len() / layout.stride;
    if stored < layout.count {
        return Err(wrong(path, "element vertex", layout.count, format!("at most {stored}, as the file ends there")));
    }
    let vertex = |(index, record): (usize, &[u8])| {
        let axis = |(offset, kind): (usize, Kind)| record.get(offset..).and_then(|bytes| kind.number(bytes));
        let [x, y, z] = layout.axes.map(axis);
        match x.zip(y).zip(z).map(|((x, y), z)| DVec3::new(x, y, z)) {
            Some(vertex) if vertex.is_finite() => Ok(vertex),
            _ => Err(wrong(path, format!("vertex {index}"), "a number that is not finite", "x, y and z in metres")),
        }
    };
    body.chunks_exact(layout.stride).take(layout.count).enumerate().map(vertex).collect()
}

/// Reads the instance of each of a mesh's `count` vertices, 0 if unlabelled, from a text file with one number per line:
/// `label * 1000 + instance`, as in ScanNet's benchmark. Numbers below 1000 and those with a label in `void` count as
/// unlabelled.
///
/// # Errors
/// If the file cannot be read, a line is not such a number, or the number of lines is not `count`.
pub fn read_vertex_instances(path: &Path, count: usize, void: &[u64]) -> Result<Vec<SegmentId>, DatasetError> {
    // Nine digits and the end of the line.
    let limit = (count as u64).saturating_mul(11).saturating_add(16);
    let bytes = read_file(path, limit).map_err(|source| DatasetError::Io { path: path.to_owned(), source })?;
    let text = String::from_utf8_lossy(&bytes);
    let expected = "label * 1000 + instance, at most 4294967295";
    let instance = |(index, line): (usize, &str)| {
        let number: SegmentId =
            line.trim().parse().map_err(|_| wrong(path, format!("line {}", index + 1), excerpt(line), expected))?;
        let label = u64::from(number) / LABEL;
        Ok(if label == 0 || void.contains(&label) { 0 } else { number })
    };
    let instances: Vec<SegmentId> = text.lines().enumerate().map(instance).collect::<Result<_, DatasetError>>()?;
    if instances.len() != count {
        return Err(wrong(path, "lines", instances.len(), format!("{count}, the number of the mesh's vertices")));
    }
    Ok(instances)
}

fn layout(path: &Path, bytes: &[u8]) -> Result<VertexLayout, DatasetError> {
    let expected = "a binary little-endian PLY whose first element is vertex, with x, y and z";
    let bad = |field: &str, found: &str| wrong(path, field, excerpt(found), expected);
    const END: &[u8] = b"end_header\n";
    let head = bytes.get(..bytes.len().min(MAX_HEADER_BYTES)).unwrap_or_default();
    let end = head.windows(END.len()).position(|window| window == END).ok_or_else(|| bad("header", "no end_header"))?;
    let text = String::from_utf8_lossy(head.get(..end).unwrap_or_default());
    let mut lines = text.lines().map(str::trim_end).filter(|line| !line.starts_with("comment"));
    for expected_line in ["ply", "format binary_little_endian 1.0"] {
        let line = lines.next().unwrap_or_default();
        if line != expected_line {
            return Err(bad("header", line));
        }
    }
    let element = lines.by_ref().find(|line| !line.starts_with("obj_info")).unwrap_or_default();
    let count = element.strip_prefix("element vertex ").and_then(|count| count.trim().parse().ok());
    let count = count.ok_or_else(|| bad("header", element))?;
    let (mut stride, mut axes) = (0, [None; 3]);
    for line in lines.take_while(|line| !line.starts_with("element")) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let ["property", kind, name] = words[..] else { return Err(bad("header", line)) };
        let kind = Kind::of(kind).ok_or_else(|| bad("header", line))?;
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) {
            axes[axis] = Some((stride, kind)).filter(|(_, kind)| !matches!(kind, Kind::Other(_)));
        }
        stride += kind.bytes();
    }
    match axes {
        [Some(x), Some(y), Some(z)] => Ok(VertexLayout { count, stride, axes: [x, y, z], start: end + END.len() }),
        _ => Err(bad("header", "no x, y and z of type float or double")),
    }
}

fn wrong(path: &Path, field: impl Into<String>, found: impl ToString, expected: impl Into<String>) -> DatasetError {
    DatasetError::Field {
        path: path.to_owned(),
        field: field.into(),
        found: found.to_string(),
        expected: expected.into(),
    }
}

/// Returns the beginning of a line, for messages.
fn excerpt(line: &str) -> String {
    line.chars().take(60).collect()
}

//! Mesh vertices and their instance labels, for scoring 3D instances.

use glam::DVec3;
use splatseg_dataset::DatasetError;
use splatseg_files::{MemoryLimit, read_file, text_of};
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
    // Nine digits and the end of the line, in UTF-16.
    let limit = (count as u64).saturating_mul(22).saturating_add(32);
    let bytes = read_file(path, limit).map_err(|source| DatasetError::Io { path: path.to_owned(), source })?;
    let text = text_of(bytes).map_err(|error| wrong(path, "content", error, "UTF-8 text"))?;
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
    let head = bytes.get(..bytes.len().min(MAX_HEADER_BYTES)).unwrap_or_default();
    // Lines end in LF or CR LF.
    let place = |end: &[u8]| Some((head.windows(end.len()).position(|window| window == end)?, end.len()));
    let ends = [b"\nend_header\n".as_slice(), b"\nend_header\r\n"];
    let (end, end_len) = ends.into_iter().filter_map(place).min().ok_or_else(|| bad("header", "no end_header"))?;
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
        [Some(x), Some(y), Some(z)] => Ok(VertexLayout { count, stride, axes: [x, y, z], start: end + end_len }),
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn ply(end: &str) -> Vec<u8> {
        let lines = [
            "ply",
            "format binary_little_endian 1.0",
            "comment with end_header in it",
            "element vertex 2",
            "property float x",
            "property float y",
            "property float z",
            "property uchar red",
            "element face 0",
            "property list uchar int vertex_indices",
            "end_header",
        ];
        let mut bytes: Vec<u8> = lines.iter().flat_map(|line| [*line, end].concat().into_bytes()).collect();
        for vertex in [[1.0f32, 2.0, 3.0], [10.0, -13.0, 0.5]] {
            vertex.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
            bytes.push(b'\n');
        }
        bytes
    }

    #[test]
    fn header_lines_may_end_in_cr_lf() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        for end in ["\n", "\r\n"] {
            fs::write(&path, ply(end)).unwrap();
            let expected = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(10.0, -13.0, 0.5)];
            assert_eq!(read_mesh_vertices(&path).unwrap(), expected, "{end:?}");
        }
        fs::write(&path, ply("\r")).unwrap();
        assert!(read_mesh_vertices(&path).unwrap_err().to_string().contains("no end_header"));
    }

    #[test]
    fn labels_of_other_systems_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("instances.txt");
        let text = "\u{FEFF}3001\r\n999\r\n4000002\r\n";
        for bytes in [text.as_bytes().to_vec(), text.encode_utf16().flat_map(u16::to_le_bytes).collect()] {
            fs::write(&path, bytes).unwrap();
            assert_eq!(read_vertex_instances(&path, 3, &[]).unwrap(), [3001, 0, 4_000_002]);
        }
    }
}

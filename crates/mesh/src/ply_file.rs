//! A mesh as a PLY file.

use crate::TriangleMesh;
use glam::DVec3;
use std::io::{self, Write};

/// Writes a mesh as a binary little-endian PLY file: `x y z red green blue segment_id` for each vertex, and the vertices of
/// each triangle. Positions are world coordinates, metres: `float`, or `double` if the mesh's origin is not zero.
///
/// # Errors
/// If `output` cannot be written.
pub fn write_ply(mesh: &TriangleMesh, output: &mut impl Write) -> io::Result<()> {
    let is_double = mesh.origin != DVec3::ZERO;
    let number = if is_double { "double" } else { "float" };
    write!(output, "ply\nformat binary_little_endian 1.0\ncomment exported by splatseg\n")?;
    writeln!(output, "element vertex {}", mesh.positions.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(output, "property {number} {axis}")?;
    }
    for channel in ["red", "green", "blue"] {
        writeln!(output, "property uchar {channel}")?;
    }
    write!(output, "property int segment_id\nelement face {}\n", mesh.triangles.len())?;
    write!(output, "property list uchar int vertex_indices\nend_header\n")?;
    for ((position, color), id) in mesh.positions.iter().zip(&mesh.colors).zip(&mesh.ids) {
        if is_double {
            for part in (position.as_dvec3() + mesh.origin).to_array() {
                output.write_all(&part.to_le_bytes())?;
            }
        } else {
            for part in position.to_array() {
                output.write_all(&part.to_le_bytes())?;
            }
        }
        output.write_all(color)?;
        output.write_all(&id.to_le_bytes())?;
    }
    for triangle in &mesh.triangles {
        output.write_all(&[3])?;
        for vertex in triangle {
            output.write_all(&vertex.to_le_bytes())?;
        }
    }
    Ok(())
}

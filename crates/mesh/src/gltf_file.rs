//! A mesh as a binary glTF 2.0 file (`.glb`), with a node for each object.
//!
//! The Khronos specification (glTF 2.0, sections 3.6, 3.7 and 4.4) says: a header of 12 bytes, a chunk of JSON padded with
//! spaces, and a chunk of binary data padded with zeros, each to a multiple of 4 bytes. +Y is up and lengths are metres.
//! `COLOR_0` is linear, so sRGB colours are converted; 16 bits keep dark ones apart.

use crate::TriangleMesh;
use glam::{DQuat, DVec3, Vec3};
use serde_json::{Value, json};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;
use std::io::{self, Write};

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Sizes in a file are 32-bit numbers.
const MAX_BYTES: usize = u32::MAX as usize / 2;

/// Data about an object in a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GltfObject {
    /// Its label, if it has one.
    pub label: Option<String>,
}

/// The growing content of a file.
#[derive(Default)]
struct Content {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
}

/// Writes a mesh as a binary glTF file. Each object is a node of its own, named after its label and id, with both in
/// `extras`; what shows no object is the node `no object`. They are children of the node `map`, which turns `up`, a unit
/// vector in world coordinates, into glTF's +Y and puts the mesh's origin at its place.
///
/// # Errors
/// If `output` cannot be written, or the mesh is too large for such a file.
pub fn write_glb(
    mesh: &TriangleMesh,
    up: Vec3,
    objects: &BTreeMap<SegmentId, GltfObject>,
    output: &mut impl Write,
) -> io::Result<()> {
    let mut content = Content::default();
    // The first node is the parent of the others.
    content.nodes.push(Value::Null);
    for (id, triangles) in mesh.triangles_by_object() {
        content.add(&mesh.part(&triangles), id, objects.get(&id))?;
    }
    content.finish(up, mesh.origin, output)
}

impl Content {
    /// Adds a node for an object.
    fn add(&mut self, part: &TriangleMesh, id: SegmentId, object: Option<&GltfObject>) -> io::Result<()> {
        let floats =
            |values: &[Vec3]| values.iter().flat_map(|value| value.to_array()).flat_map(f32::to_le_bytes).collect();
        let count = part.positions.len();
        let position = self.array(floats(&part.positions), ARRAY_BUFFER, (FLOAT, "VEC3", count))?;
        let (min, max) = part
            .positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), place| (min.min(*place), max.max(*place)));
        self.accessors[position]["min"] = json!(min.to_array());
        self.accessors[position]["max"] = json!(max.to_array());
        let normal = self.array(floats(&part.normals()), ARRAY_BUFFER, (FLOAT, "VEC3", count))?;
        let linear = part.colors.iter().flat_map(|[red, green, blue]| {
            [linear(*red), linear(*green), linear(*blue), u16::MAX].into_iter().flat_map(u16::to_le_bytes)
        });
        let color = self.array(linear.collect(), ARRAY_BUFFER, (UNSIGNED_SHORT, "VEC4", count))?;
        self.accessors[color]["normalized"] = json!(true);
        let corners = part.triangles.as_flattened();
        let indices = corners.iter().flat_map(|vertex| vertex.to_le_bytes()).collect();
        let indices = self.array(indices, ELEMENT_ARRAY_BUFFER, (UNSIGNED_INT, "SCALAR", corners.len()))?;
        let name = name(id, object);
        self.nodes.push(json!({ "name": name, "mesh": self.meshes.len(), "extras": extras(id, object) }));
        self.meshes.push(json!({
            "name": name,
            "primitives": [{
                "attributes": { "POSITION": position, "NORMAL": normal, "COLOR_0": color },
                "indices": indices,
                "material": 0,
            }],
        }));
        Ok(())
    }

    /// Adds an array, and returns the number of its accessor.
    fn array(&mut self, bytes: Vec<u8>, target: u32, (kind, form, count): (u32, &str, usize)) -> io::Result<usize> {
        // All elements are multiples of 4 bytes long, so every array begins at one.
        let start = self.binary.len();
        if start + bytes.len() > MAX_BYTES {
            return Err(io::Error::other("the mesh is too large for a glTF file: choose larger voxels, or PLY"));
        }
        self.views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": bytes.len(), "target": target }));
        self.binary.extend(bytes);
        let view = self.views.len() - 1;
        self.accessors.push(json!({ "bufferView": view, "componentType": kind, "count": count, "type": form }));
        Ok(self.accessors.len() - 1)
    }

    fn finish(mut self, up: Vec3, origin: DVec3, output: &mut impl Write) -> io::Result<()> {
        let turn = DQuat::from_rotation_arc(up.as_dvec3().normalize_or(DVec3::Y), DVec3::Y);
        let children: Vec<usize> = (1..self.nodes.len()).collect();
        self.nodes[0] = json!({
            "name": "map",
            "rotation": turn.to_array(),
            "translation": (turn * origin).to_array(),
            "children": children,
        });
        let document = json!({
            "asset": { "version": "2.0", "generator": concat!("splatseg ", env!("CARGO_PKG_VERSION")) },
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": [{
                "name": "colours of the vertices",
                "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
                "doubleSided": true,
                "extensions": { "KHR_materials_unlit": {} },
            }],
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{ "byteLength": self.binary.len() }],
        });
        let mut text = serde_json::to_vec(&document)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.binary.len();
        let length = u32::try_from(length).map_err(io::Error::other)?;
        output.write_all(b"glTF")?;
        output.write_all(&2u32.to_le_bytes())?;
        output.write_all(&length.to_le_bytes())?;
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.binary)] {
            output.write_all(&(chunk.len() as u32).to_le_bytes())?;
            output.write_all(kind)?;
            output.write_all(chunk)?;
        }
        Ok(())
    }
}

fn name(id: SegmentId, object: Option<&GltfObject>) -> String {
    match object.and_then(|object| object.label.as_ref()) {
        _ if id == 0 => "no object".to_owned(),
        Some(label) => format!("{label} ({id})"),
        None => format!("object {id}"),
    }
}

fn extras(id: SegmentId, object: Option<&GltfObject>) -> Value {
    match object.and_then(|object| object.label.as_ref()) {
        Some(label) => json!({ "id": id, "label": label }),
        None => json!({ "id": id }),
    }
}

/// An sRGB value as a linear one, 0 to 65535 (IEC 61966-2-1).
fn linear(value: u8) -> u16 {
    let value = f64::from(value) / 255.0;
    let linear = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    (linear * 65535.0).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(bytes: &[u8], place: usize) -> usize {
        u32::from_le_bytes(bytes[place..place + 4].try_into().unwrap()) as usize
    }

    #[test]
    fn a_file_has_a_node_for_each_object_and_y_up() {
        let mesh = TriangleMesh {
            origin: DVec3::new(3e6, 0.0, 7.0),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::Y],
            colors: vec![[0, 128, 255]; 4],
            ids: vec![7, 7, 7, 0],
            triangles: vec![[0, 1, 2], [3, 0, 3]],
        };
        let mug = GltfObject { label: Some("mug".to_owned()) };
        let mut file = Vec::new();
        write_glb(&mesh, Vec3::Z, &BTreeMap::from([(7, mug)]), &mut file).unwrap();
        assert_eq!((&file[..4], number(&file, 4), number(&file, 8)), (b"glTF".as_slice(), 2, file.len()));
        let length = number(&file, 12);
        assert_eq!((&file[16..20], length % 4), (b"JSON".as_slice(), 0));
        let document: Value = serde_json::from_slice(&file[20..20 + length]).unwrap();
        assert_eq!(&file[20 + length + 4..20 + length + 8], b"BIN\0");
        let binary = &file[20 + length + 8..];
        assert_eq!(document["buffers"][0]["byteLength"], json!(binary.len()));
        let names: Vec<&str> =
            document["nodes"].as_array().unwrap().iter().map(|node| node["name"].as_str().unwrap()).collect();
        assert_eq!(names, ["map", "no object", "mug (7)"]);
        assert_eq!(document["nodes"][2]["extras"], json!({ "id": 7, "label": "mug" }));
        // World z becomes y: (3e6, 0, 7) is at (3e6, 7, 0).
        let map = &document["nodes"][0];
        let parts = |key: &str| -> Vec<f64> { serde_json::from_value(map[key].clone()).unwrap() };
        let place = DVec3::from_slice(&parts("translation"));
        assert!(place.abs_diff_eq(DVec3::new(3e6, 7.0, 0.0), 1e-6), "{place}");
        let turn = DQuat::from_slice(&parts("rotation"));
        assert!((turn * DVec3::Z).abs_diff_eq(DVec3::Y, 1e-12));
        // Linear colours, 16 bits.
        let primitive = &document["meshes"][1]["primitives"][0]["attributes"];
        let accessor = &document["accessors"][primitive["COLOR_0"].as_u64().unwrap() as usize];
        let start = document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize]["byteOffset"].as_u64();
        let color = &binary[start.unwrap() as usize..][..8];
        assert_eq!(color, [0u16, 14146, 65535, 65535].map(u16::to_le_bytes).as_flattened());
        let position = &document["accessors"][primitive["POSITION"].as_u64().unwrap() as usize];
        assert_eq!((&position["min"], &position["max"]), (&json!([0.0, 0.0, 0.0]), &json!([1.0, 0.0, 1.0])));
    }
}

//! `splatseg export --as mesh`: the files, and errors.

use crate::export::{exported, place, refused};
use crate::support::{finish, splatseg};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// A PLY file of a mesh: each vertex with its colour and id, and the triangles.
struct Mesh {
    vertices: Vec<([f32; 3], [u8; 3], u32)>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn read(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let start = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..start]).unwrap();
        let count = |element: &str| -> usize {
            header.lines().find_map(|line| line.strip_prefix(element)).unwrap().trim().parse().unwrap()
        };
        let (vertices, triangles) = (count("element vertex"), count("element face"));
        let body = &bytes[start..];
        assert_eq!(body.len(), 19 * vertices + 13 * triangles, "{header}");
        let word = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap());
        let vertex = |vertex: &[u8]| {
            let place = [0, 4, 8].map(|start| f32::from_bits(word(&vertex[start..start + 4])));
            (place, vertex[12..15].try_into().unwrap(), word(&vertex[15..19]))
        };
        let triangle = |triangle: &[u8]| {
            assert_eq!(triangle[0], 3);
            [1, 5, 9].map(|start| word(&triangle[start..start + 4]))
        };
        let (first, second) = body.split_at(19 * vertices);
        let mesh = Self {
            vertices: first.chunks(19).map(vertex).collect(),
            triangles: second.chunks(13).map(triangle).collect(),
        };
        assert!(mesh.triangles.iter().flatten().all(|corner| (*corner as usize) < vertices));
        mesh
    }

    fn ids(&self) -> BTreeSet<u32> {
        self.vertices.iter().map(|(_, _, id)| *id).filter(|id| *id != 0).collect()
    }
}

/// The JSON of a binary glTF file.
fn document(path: &Path) -> Value {
    let bytes = fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

#[test]
fn a_mesh_is_the_same_for_any_number_of_threads_and_in_both_forms() {
    let folder = place();
    let ended = exported(folder.path(), &["--as", "mesh", "--out", "home.ply"]);
    let mesh = Mesh::read(&folder.path().join("home.ply"));
    assert!(mesh.triangles.len() > 5000 && mesh.ids().len() >= 4, "{}", ended.out);
    assert!(ended.out.starts_with(&format!("home.ply: {} triangles of", mesh.triangles.len())), "{}", ended.out);
    let colors: BTreeSet<[u8; 3]> = mesh.vertices.iter().map(|(_, color, _)| *color).collect();
    assert!(colors.len() > 500);
    let mut again = splatseg();
    again.current_dir(folder.path()).env("RAYON_NUM_THREADS", "1");
    assert_eq!(finish(again.args(["export", "map.ply", "--as", "mesh", "--out", "again.ply"])).code, 0);
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(read("home.ply") == read("again.ply"));

    exported(folder.path(), &["--as", "mesh", "--out", "home.glb", "--voxel", "0.05"]);
    let document = document(&folder.path().join("home.glb"));
    let nodes = document["nodes"].as_array().unwrap();
    let ids: BTreeSet<u64> = nodes.iter().filter_map(|node| node["extras"]["id"].as_u64()).collect();
    assert!(ids.len() >= 4 && ids.iter().all(|id| *id == 0 || mesh.ids().contains(&(*id as u32))), "{ids:?}");
    // z is up in the room, so the map is turned about x.
    let turn: Vec<f64> = serde_json::from_value(nodes[0]["rotation"].clone()).unwrap();
    assert!((turn[0] + 0.5f64.sqrt()).abs() < 1e-6 && (turn[3] - 0.5f64.sqrt()).abs() < 1e-6, "{turn:?}");
}

#[test]
fn objects_have_meshes_of_their_own() {
    let folder = place();
    let arguments =
        ["--as", "mesh", "--voxel", "0.04", "--color", "id", "--out", "all.ply", "--object-files", "objects"];
    exported(folder.path(), &arguments);
    let all = Mesh::read(&folder.path().join("all.ply"));
    let mut triangles = 0;
    for id in all.ids() {
        let path = folder.path().join(format!("objects/{id}.ply"));
        let Ok(true) = path.try_exists() else { continue };
        let part = Mesh::read(&path);
        triangles += part.triangles.len();
        let own = part.vertices.iter().filter(|(_, color, other)| {
            let expected = if *other == 0 { [128; 3] } else { splatseg_output::segment_color(*other) };
            assert_eq!(*color, expected);
            *other == id
        });
        // At its border, a triangle has a vertex of another object.
        assert!(2 * own.count() > part.vertices.len(), "object {id}");
    }
    assert!(triangles > all.triangles.len() * 9 / 10, "{triangles} of {}", all.triangles.len());
    let id = all.ids().into_iter().next().unwrap().to_string();
    exported(folder.path(), &["--as", "mesh", "--voxel", "0.04", "--id", &id, "--out", "one.glb"]);
    let nodes = document(&folder.path().join("one.glb"))["nodes"].as_array().unwrap().len();
    assert_eq!(nodes, 2, "the map and its object");
}

#[test]
fn what_is_wrong_is_said_in_one_line() {
    let folder = place();
    let mesh = ["--as", "mesh", "--out", "home.ply"];
    let with = |more: &[&'static str]| refused(folder.path(), &[mesh.as_slice(), more].concat());
    assert!(with(&["--voxel", "9"]).contains("--voxel: found 9, expected 0.002 to 0.5 metres"));
    assert!(with(&["--min-confidence", "0.5"]).contains("--min-confidence: is for Gaussians and points"));
    assert!(with(&["--id", "4000"]).contains("no surface shows object 4000; the ids are"));
    assert!(with(&["--voxel", "0.002", "--memory-limit", "20MB"]).contains("choose larger ones"));
    assert!(refused(folder.path(), &["--out", "x.ply", "--voxel", "0.1"]).contains("--voxel: is for --as mesh"));
    fs::write(folder.path().join("notes.glb"), "text").unwrap();
    let error = refused(folder.path(), &["--as", "mesh", "--out", "notes.glb", "--overwrite"]);
    assert!(error.contains("exists and is not a glTF file by splatseg"), "{error}");
}

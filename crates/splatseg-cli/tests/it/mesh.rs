//! 3D instances on the vertices of a mesh.

use crate::support::{Ended, finish, read_json, splatseg};
use glam::Vec2;
use splatseg_test_scenes::{recording, room};
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=24,width=160,height=120,objects=10";

/// Returns a binary PLY with further properties between and after the coordinates, as in real meshes.
fn ply(vertices: &[[f32; 3]]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment a mesh\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n\
         element face 0\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len()
    )
    .into_bytes();
    for vertex in vertices {
        vertex.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
        bytes.extend([200, 100, 50, 255]);
    }
    bytes
}

/// Returns the surface visible in the room's frames, with its true instances.
fn surface() -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut vertices, mut instances) = (Vec::new(), Vec::new());
    for (frame, truth) in recording(ROOM) {
        for row in (0..frame.height()).step_by(3) {
            for column in (0..frame.width()).step_by(3) {
                let (depth, id) = (frame.depth()[(column, row)], truth[(column, row)]);
                let point = frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                vertices.push(frame.world_from_camera().to_world(point).as_vec3().to_array());
                instances.push(3000 + id);
            }
        }
    }
    (vertices, instances)
}

fn eval(mesh: &Path, instances: &Path, map: &Path, more: &[&str]) -> Ended {
    let mut command = splatseg();
    command.arg("eval").arg("--mesh").arg(mesh).arg("--instances").arg(instances).arg("--pred").arg(map);
    finish(command.args(more))
}

#[test]
fn the_ids_of_a_memory_are_scored_on_a_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, instances, map, json] =
        ["mesh.ply", "instances.txt", "map.ply", "scores.json"].map(|name| folder.path().join(name));
    let (vertices, ids) = surface();
    fs::write(&mesh, ply(&vertices)).unwrap();
    fs::write(&instances, ids.iter().map(|id| format!("{id}\n")).collect::<String>()).unwrap();
    let mut run = splatseg();
    run.args(["run", ROOM, "--segmenter", "oracle", "--no-page", "--save-memory"]).arg(&map).arg("--out");
    assert_eq!(finish(run.arg(folder.path().join("out"))).code, 0);

    let ended = eval(&mesh, &instances, &map, &["--void-labels", "1,2", "--json", json.to_str().unwrap()]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let scores = read_json(&json);
    let [ap, ap50, ap25] = ["ap", "ap50", "ap25"].map(|key| scores[key].as_f64().unwrap());
    assert!(ap > 40.0 && ap <= ap50 + 1e-9 && ap50 <= 100.0 && ap25 > 60.0, "{scores}");
    assert!(ended.out.contains(&format!("AP {ap:.2}, AP50 {ap50:.2}, AP25 {ap25:.2}")), "{}", ended.out);
    assert!(scores["unseen_vertices"].as_u64().unwrap() < vertices.len() as u64 / 20, "{scores}");
    // A void label excludes all of its vertices.
    let ended =
        eval(&mesh, &instances, &map, &["--void-labels", "1,3", "--json", json.to_str().unwrap(), "--overwrite"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let without = read_json(&json);
    assert_eq!((&without["true_instances"], &without["ap"]), (&0.into(), &serde_json::Value::Null), "{without}");
    assert!(ended.out.contains("AP -, AP50 -, AP25 -"), "{}", ended.out);
}

#[test]
fn a_benchmark_has_the_scores_of_its_scenes_meshes_as_columns() {
    let folder = tempfile::tempdir().unwrap();
    let (instances, map, out) =
        (folder.path().join("instances"), folder.path().join("map.ply"), folder.path().join("bench"));
    let name = room(ROOM).name().to_owned();
    let [mesh, text] = ["_vh_clean_2.ply", ".txt"].map(|ending| instances.join(format!("{name}{ending}")));
    let (vertices, ids) = surface();
    fs::create_dir(&instances).unwrap();
    fs::write(&text, ids.iter().map(|id| format!("{id}\n")).collect::<String>()).unwrap();
    let bench = |more: &[&str]| {
        let mut command = splatseg();
        command.args(["bench", "--scenes", ROOM, "--methods", "fastsam,fastsam-splat", "--segmenter", "oracle"]);
        command.arg("--instances").arg(&instances).arg("--out").arg(&out);
        finish(command.args(more))
    };
    let ended = bench(&[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("there is no mesh for it"), "{}", ended.err);
    fs::write(&mesh, ply(&vertices)).unwrap();
    let ended = bench(&["--void-labels", "1,2"]);
    assert_eq!(ended.code, 0, "{}", ended.err);

    // The same scores as with `run` and `eval --mesh`; none for a method without memory.
    let mut run = splatseg();
    run.args(["run", ROOM, "--segmenter", "oracle", "--no-page", "--save-memory"]).arg(&map).arg("--out");
    assert_eq!(finish(run.arg(folder.path().join("out"))).code, 0);
    let json = folder.path().join("scores.json");
    let ended = eval(&mesh, &text, &map, &["--void-labels", "1,2", "--json", json.to_str().unwrap()]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let (rows, scores) = (read_json(&out.join("results.json")), read_json(&json));
    assert!(rows[0]["mesh"].is_null(), "{}", rows[0]);
    for key in ["ap", "ap50", "ap25"] {
        assert_eq!(rows[1]["mesh"][key], scores[key], "{key}");
    }
    let ap25 = scores["ap25"].as_f64().unwrap();
    let tables = fs::read_to_string(out.join("tables.md")).unwrap();
    assert!(
        tables.contains("| AP | AP50 | AP25 | frames/s |") && tables.contains(&format!("| {ap25:.2} |")),
        "{tables}"
    );
    assert!(
        fs::read_to_string(out.join("results.csv")).unwrap().contains(",overcounted_tracks,ap,ap50,ap25,fps_total,")
    );
    // A changed ground truth is a changed input.
    fs::write(&text, ids.iter().map(|id| format!("{}\n", id + 1000)).collect::<String>()).unwrap();
    let ended = bench(&["--void-labels", "1,2"]);
    assert!(ended.out.contains("has changed") && !ended.out.contains(": reused\n"), "{}", ended.out);
}

#[test]
fn wrong_meshes_and_instances_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, instances, map] = ["mesh.ply", "instances.txt", "map.ply"].map(|name| folder.path().join(name));
    let mut run = splatseg();
    run.args(["run", "synthetic:frames=2,width=64,height=48", "--no-page", "--save-memory"]).arg(&map).arg("--out");
    assert_eq!(finish(run.arg(folder.path().join("out"))).code, 0);
    let good = ply(&[[0.0; 3], [1.0; 3]]);
    let text = String::from_utf8_lossy(&good).into_owned();
    let ascii = text.replace("binary_little_endian", "ascii").into_bytes();
    for (bytes, lines, expected) in [
        (good.clone(), "3001\n0\n3001\n", "lines: found 3, expected 2"),
        (good.clone(), "3001\nchair\n", "line 2: found chair"),
        (good.clone(), "3001\n-1\n", "line 2: found -1"),
        (good[..good.len() - 1].to_vec(), "0\n0\n", "element vertex: found 2, expected at most 1"),
        (ply(&[[f32::NAN; 3], [1.0; 3]]), "0\n0\n", "vertex 0: found a number that is not finite"),
        (ascii, "0\n0\n", "header: found format ascii 1.0"),
        (b"solid cube".to_vec(), "0\n0\n", "header: found no end_header"),
        (text.replace("float z", "uchar z").into_bytes(), "0\n0\n", "no x, y and z of type float"),
        (text.replace("vertex 2", "vertex 99999999999").into_bytes(), "0\n0\n", "element vertex: found 99999999999"),
    ] {
        fs::write(&mesh, bytes).unwrap();
        fs::write(&instances, lines).unwrap();
        let ended = eval(&mesh, &instances, &map, &[]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{expected}: {}", ended.err);
        assert!(ended.err.contains(expected), "{expected}: {}", ended.err);
    }
    let ended = finish(splatseg().args(["eval", "--pred"]).arg(&map));
    assert!(ended.code == 2 && ended.err.contains("--gt"), "{}", ended.err);
}

//! `splatseg mcp`, with the clients of the official SDKs for Rust and Python.

use crate::support::{ROOM, finish, splatseg};
use rmcp::ServiceExt;
use rmcp::model::CallToolRequestParams;
use rmcp::transport::TokioChildProcess;
use serde_json::json;
use splatseg::pipeline::NamedMap;
use std::fs;
use std::path::Path;
use std::process::Command;

/// The script that talks to the command with Python's SDK.
const CHECK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tools/check_mcp.py");

/// Saves a map of the room; its first object is a mug.
fn save_map(folder: &Path) -> std::path::PathBuf {
    let (out, map) = (folder.join("out"), folder.join("map.ply"));
    let mut command = splatseg();
    command.args(["run", ROOM, "--no-page"]).arg("--out").arg(&out).arg("--save-memory").arg(&map);
    assert_eq!(finish(&mut command).code, 0);
    let mut named = NamedMap::load(&map).unwrap();
    let id = named.object_list().objects[0].id;
    named.names.set_by_hand(id, Some("mug")).unwrap();
    named.save(&map).unwrap();
    map
}

#[test]
fn the_sdk_of_rust_lists_and_calls_the_tools_of_a_process() {
    let folder = tempfile::tempdir().unwrap();
    let map = save_map(folder.path());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let mut command = tokio::process::Command::new(assert_cmd::cargo::cargo_bin!("splatseg"));
        command.arg("mcp").arg(&map).arg("--objects").arg(folder.path().join("out/objects.json")).arg("--allow-write");
        let client = ().serve(TokioChildProcess::new(command).unwrap()).await.unwrap();
        assert_eq!(client.list_all_tools().await.unwrap().len(), 11);
        let call = async |name: &'static str, arguments: serde_json::Value| {
            let arguments = arguments.as_object().unwrap().clone();
            client.call_tool(CallToolRequestParams::new(name).with_arguments(arguments)).await.unwrap()
        };
        let place = call("where_is", json!({ "object": "mug" })).await;
        let text = place.content[0].as_text().unwrap().text.clone();
        assert!(text.starts_with("mug (") && text.contains("last seen in frame "), "{text}");
        let picture = call("plan_view", json!({})).await;
        assert_eq!(picture.content[1].as_image().unwrap().mime_type, "image/png");
        let named = call("name_object", json!({ "object": "mug", "name": "cup" })).await;
        assert_eq!(named.structured_content.unwrap()["name"], "cup");
        client.cancel().await.unwrap();
    });
    assert!(NamedMap::load(&map).unwrap().names.labels().any(|(_, label)| label == "cup"));
}

#[test]
fn the_sdk_of_python_lists_and_calls_the_tools() {
    let test = "the_sdk_of_python_lists_and_calls_the_tools";
    let python = std::env::var("SPLATSEG_MCP_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_sdk = Command::new(&python).args(["-c", "import mcp"]).output().is_ok_and(|output| output.status.success());
    if !has_sdk {
        return splatseg_test_scenes::skipped(test, "python3 has no package mcp (pip install mcp)");
    }
    let folder = tempfile::tempdir().unwrap();
    let map = save_map(folder.path());
    let output = Command::new(python)
        .arg(CHECK)
        .arg(assert_cmd::cargo::cargo_bin!("splatseg"))
        .arg(&map)
        .output()
        .expect("it has just run");
    let (out, error) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{error}");
    assert!(out.contains("all tools answer"), "{out}{error}");
}

#[test]
fn what_cannot_be_served_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.ply");
    let mcp = |more: &[&str]| finish(splatseg().arg("mcp").arg(&map).args(more).write_stdin(""));
    let ended = mcp(&[]);
    assert!(ended.code == 2 && ended.err.contains("map.ply") && ended.err.lines().count() == 1, "{}", ended.err);
    fs::write(&map, "ply\nnothing").unwrap();
    assert_eq!(mcp(&[]).code, 2);
    fs::remove_file(&map).unwrap();
    let map = save_map(folder.path());
    assert!(map.is_file());
    for option in ["--objects", "--earlier", "--names"] {
        let ended = mcp(&[option, "nowhere"]);
        assert!(ended.code == 2 && ended.err.contains("nowhere") && ended.err.lines().count() == 1, "{}", ended.err);
        assert!(ended.out.is_empty());
    }
    // A client that leaves at once.
    let ended = mcp(&[]);
    assert!(ended.out.is_empty() && ended.err.lines().count() == 1, "{}{}", ended.code, ended.err);
}

//! `name_object`, the only tool that writes.

use crate::support::{by_size, options, room, with_client};
use serde_json::json;
use splatseg::pipeline::NamedMap;
use splatseg_mcp::Assistant;
use std::fs;

#[test]
fn names_are_saved_in_the_file_if_that_is_allowed() {
    let (_folder, map) = room();
    let before = NamedMap::load(&map).unwrap();
    let id = by_size(&before)[3];
    let mut options = options(&map);
    options.allow_write = true;
    with_client(Assistant::open(options).unwrap(), async |client| {
        let tools = client.0.list_all_tools().await.unwrap();
        let tool = tools.iter().find(|tool| tool.name == "name_object").unwrap();
        assert_eq!(tool.annotations.as_ref().unwrap().read_only_hint, Some(false));
        let (text, data) = client.ask("name_object", json!({ "object": id, "name": " office chair " })).await;
        assert!(text.contains("office chair") && data["name_before"].is_null(), "{text}");
        let (_, data) = client.ask("find_objects", json!({ "words": "office chair" })).await;
        assert_eq!(data["objects"][0]["object"]["id"], id);
        let after = NamedMap::load(&map).unwrap();
        assert_eq!(after.names.label(id), Some("office chair"));
        assert_eq!(after.memory.map().means, before.memory.map().means);
        // The server's own change is none to tell.
        assert!(client.ask("what_changed", json!({})).await.0.contains("has not changed"));

        let (_, data) = client.ask("name_object", json!({ "object": "office chair", "name": "" })).await;
        assert_eq!((&data["name"], &data["name_before"]), (&json!(null), &json!("office chair")));
        assert_eq!(NamedMap::load(&map).unwrap().names.label(id), None);
        client.refused("name_object", json!({ "object": id, "name": "x".repeat(301) })).await;
        client.refused("name_object", json!({ "object": 9999, "name": "x" })).await;
        client.refused("name_object", json!({ "object": id, "name": "a\u{0}b" })).await;
        fs::remove_file(&map).unwrap();
        let refused = client.refused("name_object", json!({ "object": id, "name": "x" })).await;
        assert!(refused.contains("was not named"), "{refused}");
        assert!(!map.exists());
    });
}

#[test]
fn nothing_is_written_without_leave() {
    let (_folder, map) = room();
    let before = fs::read(&map).unwrap();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let call = rmcp::model::CallToolRequestParams::new("name_object");
        let error = client.0.call_tool(call).await.unwrap_err().to_string();
        assert!(error.contains("there is no tool") && error.contains("where_is"), "{error}");
    });
    assert_eq!(fs::read(&map).unwrap(), before);
}

//! `name_object`, the only tool that writes.

use crate::support::{by_size, options, room, with_client};
use serde_json::json;
use splatseg::pipeline::NamedMap;
use splatseg_mcp::{Assistant, floor_places};
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
fn rooms_are_listed_named_and_driven_to() {
    let (_folder, map) = room();
    let mut options = options(&map);
    options.allow_write = true;
    with_client(Assistant::with_places(options, Box::new(floor_places)).unwrap(), async |client| {
        let (text, data) = client.ask("list_rooms", json!({})).await;
        let rooms = data["rooms"].as_array().unwrap();
        assert!(!rooms.is_empty() && rooms[0]["name"].is_null() && text.contains("room 1"), "{text}");
        let count = if rooms.len() == 1 { "1 room:\n".to_owned() } else { format!("{} rooms:\n", rooms.len()) };
        assert!(text.starts_with(&count), "{text}");
        let object = rooms[0]["objects"][0].as_u64().unwrap();
        client.ask("name_object", json!({ "object": object, "name": "toilet" })).await;
        let (text, data) = client.ask("list_rooms", json!({})).await;
        assert_eq!(
            (&data["rooms"][0]["name"], &data["rooms"][0]["name_is_derived"]),
            (&json!("bathroom"), &json!(true))
        );
        assert!(text.contains("bathroom (room 1), named by its objects"), "{text}");

        let (_, data) = client.ask("name_room", json!({ "room": 1, "name": " guest bathroom " })).await;
        assert_eq!((&data["name"], &data["name_before"]), (&json!("guest bathroom"), &json!("bathroom")));
        let (text, data) = client.ask("where_is", json!({ "object": object })).await;
        assert!(text.contains("guest bathroom"), "{text} {data}");
        let saved = NamedMap::load(&map).unwrap().names;
        assert_eq!(saved.rooms().iter().next().unwrap().name, "guest bathroom");
        let (_, data) = client.ask("name_room", json!({ "room": 1, "name": "" })).await;
        assert_eq!(data["name"], "bathroom");
        for wrong in [json!({ "room": 99, "name": "x" }), json!({ "room": 1, "name": "x".repeat(301) })] {
            client.refused("name_room", wrong).await;
        }
        let middle = middle_of_first(client).await;
        let (text, data) = client.ask("route", json!({ "from": middle, "to": { "room": 1 }, "radius_m": 0.1 })).await;
        assert!(text.contains("bathroom (room 1)") && data["length_m"].as_f64().unwrap() < 0.5, "{text}");
        client.refused("route", json!({ "from": { "room": 99 }, "to": { "room": 1 } })).await;
    });
}

/// The middle of the first room.
async fn middle_of_first(client: &crate::support::Client) -> serde_json::Value {
    client.ask("list_rooms", json!({})).await.1["rooms"][0]["middle_m"].clone()
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

//! Each tool, called by the SDK's own client.

use crate::support::{by_size, options, room, save_map, save_times, text, with_client};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use image::RgbImage;
use rmcp::model::CallToolResult;
use serde_json::{Value, json};
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;
use splatseg_mcp::{Assistant, Destination, PlaceRoom, Places};
use splatseg_objects::{FrameStamp, ObjectList};
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The picture of an answer, decoded.
fn picture(result: &CallToolResult) -> RgbImage {
    let content = result.content.iter().find_map(|content| content.as_image()).expect("a picture");
    let bytes = STANDARD.decode(&content.data).unwrap();
    image::load_from_memory(&bytes).unwrap().to_rgb8()
}

/// Number of pixels of about a colour.
fn pixels(picture: &RgbImage, color: [u8; 3]) -> usize {
    let is_near = |pixel: &image::Rgb<u8>| (0..3).all(|channel| pixel.0[channel].abs_diff(color[channel]) < 50);
    picture.pixels().filter(|pixel| is_near(pixel)).count()
}

#[test]
fn tools_are_listed_with_schemas_and_hints() {
    let (_folder, map) = room();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let about = client.0.peer_info().unwrap();
        assert!(about.instructions.as_ref().unwrap().contains("Nothing can be changed"), "{about:?}");
        assert!(!about.instructions.as_ref().unwrap().contains("objects ("), "counts change with the map: {about:?}");
        let tools = client.0.list_all_tools().await.unwrap();
        let names: Vec<&str> = tools.iter().map(|tool| tool.name.as_ref()).collect();
        let objects =
            ["list_objects", "find_objects", "where_is", "what_is_near", "what_changed", "picture_of", "plan_view"];
        assert_eq!(names, [&objects[..], &["list_rooms", "route"]].concat());
        for tool in &tools {
            assert_eq!(tool.annotations.as_ref().unwrap().read_only_hint, Some(true), "{}", tool.name);
            assert!(tool.description.as_ref().is_some_and(|text| text.len() > 40), "{}", tool.name);
            assert_eq!(tool.input_schema["type"], "object");
            assert_eq!(tool.output_schema.as_ref().unwrap()["type"], "object");
            // `list_rooms` has no arguments.
            let properties = tool.input_schema.get("properties").and_then(Value::as_object);
            for (name, property) in properties.into_iter().flatten() {
                let described = property.get("description").is_some() || property.get("$ref").is_some();
                assert!(described, "{}: {name} has no description", tool.name);
            }
        }
    });
}

#[test]
fn objects_are_listed_page_by_page_and_narrowed() {
    let (_folder, map) = room();
    let list = NamedMap::load(&map).unwrap().object_list();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let (mut ids, mut offset) = (Vec::new(), Some(0));
        while let Some(from) = offset {
            let (text, data) = client.ask("list_objects", json!({ "limit": 3, "offset": from })).await;
            assert!(text.lines().count() <= 5, "{text}");
            assert_eq!(data["total"], list.objects.len());
            ids.extend(data["objects"].as_array().unwrap().iter().map(|object| object["id"].as_u64().unwrap() as u32));
            offset = data["next_offset"].as_u64();
        }
        assert_eq!(ids, list.objects.iter().map(|object| object.id).collect::<Vec<_>>());

        let (_, data) = client.ask("list_objects", json!({ "name": "TAB" })).await;
        assert_eq!(data["total"], 2);
        let (_, large) = client.ask("list_objects", json!({ "min_size_m": 1.0, "limit": 100 })).await;
        let (_, small) = client.ask("list_objects", json!({ "max_size_m": 1.0, "limit": 100 })).await;
        assert!(large["total"].as_u64().unwrap() > 0 && small["total"].as_u64().unwrap() > 0);
        assert!(large["objects"].as_array().unwrap().iter().all(|object| object["size_m"][0].as_f64().unwrap() >= 1.0));

        assert!(client.refused("list_objects", json!({ "limit": 0 })).await.contains("expected 1 to 100"));
        assert!(client.refused("list_objects", json!({ "colour": 3 })).await.contains("unknown field `colour`"));
        assert!(client.refused("list_objects", json!({ "seen_since_s": 1 })).await.contains("not known"));
        let (_, data) = client.ask("list_objects", json!({ "offset": u64::MAX })).await;
        assert!(data["objects"].as_array().unwrap().is_empty() && data["next_offset"].is_null());
    });
}

#[test]
fn objects_are_found_by_words_and_nothing_is_made_up() {
    let (_folder, map) = room();
    let mug = by_size(&NamedMap::load(&map).unwrap())[0];
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let (text, data) = client.ask("find_objects", json!({ "words": "where is the mug?" })).await;
        assert!(text.contains(&format!("{mug} mug")), "{text}");
        assert_eq!((&data["total"], &data["objects"][0]["object"]["id"]), (&json!(1), &json!(mug)));
        // A synonym of the built-in vocabulary.
        let (_, data) = client.ask("find_objects", json!({ "words": "tables" })).await;
        assert_eq!(data["total"], 2);
        let (text, data) = client.ask("find_objects", json!({ "words": "elephant" })).await;
        assert!(text.contains("No object fits") && text.contains("mug, table"), "{text}");
        assert_eq!(data["total"], 0);
        let (_, data) = client.ask("find_objects", json!({ "words": "the smallest", "limit": 1 })).await;
        assert_eq!(data["objects"][0]["object"]["id"], mug);
        assert!(client.refused("find_objects", json!({ "words": " " })).await.contains("no words"));
        assert!(client.refused("find_objects", json!({ "words": "something" })).await.contains("says nothing"));
        assert!(client.refused("find_objects", json!({ "words": "x".repeat(301) })).await.contains("at most 300"));
    });
}

#[test]
fn places_are_those_of_the_map() {
    let (_folder, map) = room();
    let named = NamedMap::load(&map).unwrap();
    let (mug, list) = (by_size(&named)[0], named.object_list());
    let shape = list.get(mug).unwrap().shape.clone().unwrap();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        for reference in [json!(mug), json!(mug.to_string()), json!(format!("#{mug}")), json!("mug"), json!("smallest")]
        {
            let (text, data) = client.ask("where_is", json!({ "object": reference })).await;
            assert!(
                text.starts_with(&format!("mug ({mug}) is at (")) && text.contains("last seen is not known"),
                "{text}"
            );
            let found = DVec3::from_array(std::array::from_fn(|axis| data["box"]["center_m"][axis].as_f64().unwrap()));
            assert!(found.distance(shape.oriented_box.center) < 1e-3, "{found}");
            assert!(data["min_m"][0].as_f64().unwrap() < data["max_m"][0].as_f64().unwrap());
            assert!(data["object"]["room"].is_null() && data["object"]["last_seen"].is_null());
        }
        let refused = client.refused("where_is", json!({ "object": 9999 })).await;
        assert!(refused.contains("no object 9999; it has ") && refused.contains(&mug.to_string()), "{refused}");
        let refused = client.refused("where_is", json!({ "object": "table" })).await;
        assert!(refused.contains("Several objects fit") && refused.lines().count() == 3, "{refused}");
        assert!(client.refused("where_is", json!({})).await.contains("missing field `object`"));
        let refused = client.refused("list_rooms", json!({})).await;
        assert_eq!(refused, "Rooms and free space are not known: this program does not look for them.");
        assert!(client.refused("where_is", json!({ "object": [1] })).await.contains("expected the id of an object"));
    });
}

#[test]
fn what_is_near_is_within_the_radius() {
    let (_folder, map) = room();
    let named = NamedMap::load(&map).unwrap();
    let (mug, list) = (by_size(&named)[0], named.object_list());
    let center = list.get(mug).unwrap().shape.as_ref().unwrap().oriented_box.center;
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let (_, data) = client.ask("what_is_near", json!({ "object": "mug", "radius_m": 0.5 })).await;
        let near = data["near"].as_array().unwrap();
        let distances: Vec<f64> = near.iter().map(|object| object["distance_m"].as_f64().unwrap()).collect();
        assert!(!distances.is_empty() && distances.is_sorted() && distances[distances.len() - 1] <= 0.5);
        assert!(near.iter().all(|object| object["id"] != mug));
        let (_, data) = client.ask("what_is_near", json!({ "point": center.to_array(), "radius_m": 0.0 })).await;
        assert!(data["near"].as_array().unwrap().iter().any(|object| object["id"] == mug), "{data}");
        let (_, all) = client.ask("what_is_near", json!({ "object": mug, "radius_m": 1000, "limit": 2 })).await;
        assert_eq!((all["near"].as_array().unwrap().len(), &all["total"]), (2, &json!(list.objects.len() - 1)));
        for wrong in [
            json!({}),
            json!({ "object": mug, "point": [0, 0, 0] }),
            json!({ "point": [0, 0] }),
            json!({ "point": [1e300, 0, 0] }),
            json!({ "object": mug, "radius_m": -1 }),
        ] {
            client.refused("what_is_near", wrong).await;
        }
    });
}

#[test]
fn objects_are_shown_outlined_and_from_above() {
    let (_folder, map) = room();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let result = client.call("picture_of", json!({ "object": "mug" })).await;
        let whole = picture(&result);
        let outline = pixels(&whole, [255, 0, 200]);
        assert!(outline > 10 && outline < 5000, "{outline} pixels of the outline: {}", text(&result));
        let close = picture(&client.call("picture_of", json!({ "object": "mug", "close_up": true })).await);
        assert!(pixels(&close, [255, 0, 200]) > outline, "a close-up is larger");
        assert!(whole.width().max(whole.height()) <= 640 && close.width().max(close.height()) <= 640);

        let result = client.call("plan_view", json!({})).await;
        let plan = picture(&result);
        let data = result.structured_content.as_ref().unwrap();
        assert_eq!(json!([plan.width(), plan.height()]), data["size_px"]);
        assert!(plan.width().max(plan.height()) <= 1000);
        assert!(data["labelled"].as_array().unwrap().iter().any(|label| label["name"] == "mug"), "{data}");
        let one = client.call("plan_view", json!({ "objects": ["mug"] })).await;
        assert_eq!(one.structured_content.as_ref().unwrap()["labelled"].as_array().unwrap().len(), 1);
        assert_ne!(picture(&one), plan);
        client.refused("plan_view", json!({ "objects": vec![1; 51] })).await;
    });
}

#[test]
fn a_label_is_where_the_object_is() {
    let (_folder, map) = room();
    let named = NamedMap::load(&map).unwrap();
    let center = named.object_list().get(by_size(&named)[0]).unwrap().shape.as_ref().unwrap().oriented_box.center;
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let (_, data) = client.ask("plan_view", json!({ "objects": ["mug"] })).await;
        let vector = |key: &str| DVec3::from_array(std::array::from_fn(|axis| data[key][axis].as_f64().unwrap()));
        let from_corner = center - vector("top_left_m");
        let pixel = [vector("right"), vector("down")]
            .map(|axis| from_corner.dot(axis) / data["meters_per_pixel"].as_f64().unwrap());
        for (axis, pixel) in pixel.into_iter().enumerate() {
            let labelled = data["labelled"][0]["center_px"][axis].as_f64().unwrap();
            assert!((labelled - pixel).abs() < 2.0, "{labelled} and {pixel}");
        }
    });
}

#[test]
fn changes_to_an_earlier_map_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let [before, after] = ["before", "after"].map(|name| folder.path().join(format!("{name}.ply")));
    let visit = |which| format!("synthetic:frames=48,width=160,height=120,seed=202,visit={which}");
    save_map(&visit("before"), &before, None);
    save_map(&visit("after"), &after, Some(&before));
    let mut options = options(&after);
    options.earlier = Some(before.clone());
    with_client(Assistant::open(options).unwrap(), async |client| {
        let (text, data) = client.ask("what_changed", json!({})).await;
        assert!(text.contains("gone: ") && text.contains("before.ply"), "{text}");
        for kind in ["gone", "new", "moved"] {
            let count = data[kind].as_array().unwrap().len();
            assert!(count > 0 && data["counts"][kind] == count, "{kind}: {data}");
        }
        let (_, data) = client.ask("what_changed", json!({ "limit": 1 })).await;
        assert_eq!(data["gone"].as_array().unwrap().len(), 1);
        let (text, _) = client.ask("what_changed", json!({ "since": "server_start" })).await;
        assert!(text.contains("has not changed"), "{text}");

        // The earlier map is put in its place: the server notices, and tells what is different.
        fs::copy(&before, &after).unwrap();
        let refused = client.refused("what_changed", json!({ "since": "server_start" })).await;
        assert!(refused.contains("Nothing was looked at since"), "{refused}");
        fs::write(&after, "ply\nnothing").unwrap();
        let (text, _) = client.ask("list_objects", json!({})).await;
        assert!(text.starts_with("The map's file has changed but cannot be read"), "{text}");
        client.refused("what_changed", json!({ "since": "yesterday" })).await;
    });
}

#[test]
fn sightings_tell_when_objects_were_seen() {
    let (folder, map) = room();
    let named = NamedMap::load(&map).unwrap();
    let (mug, mut list) = (by_size(&named)[0], named.object_list());
    let stamp = |number: usize, time_s: f64| FrameStamp { number, name: None, file: None, time_s: Some(time_s) };
    for object in &mut list.objects {
        let last = if object.id == mug { stamp(40, 1_795_000_010.5) } else { stamp(99, 1_795_000_099.0) };
        (object.frames, object.first_frame, object.last_frame) = (7, Some(stamp(0, 1_795_000_000.0)), Some(last));
    }
    let seen = folder.path().join("seen.json");
    fs::write(&seen, list.to_json().unwrap()).unwrap();
    let mut with_objects = options(&map);
    with_objects.objects = Some(seen.clone());
    with_client(Assistant::open(with_objects).unwrap(), async |client| {
        let (text, data) = client.ask("where_is", json!({ "object": "mug" })).await;
        assert!(text.contains("last seen in frame 40 on 2026-") && text.contains("88.5 s before"), "{text}");
        assert_eq!(data["object"]["last_seen"]["seconds_before_end"], 88.5);
        let (_, data) = client.ask("list_objects", json!({ "seen_since_s": 1_795_000_050.0, "limit": 100 })).await;
        assert_eq!(data["total"], list.objects.len() - 1);
    });
    // A live session keeps it beside the map.
    fs::rename(&seen, map.with_extension("objects.json")).unwrap();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        assert!(client.ask("where_is", json!({ "object": "mug" })).await.0.contains("frame 40"));
    });
    // What it does not know, the map tells.
    list.objects.iter_mut().filter(|object| object.id == mug).for_each(|object| object.last_frame = None);
    fs::write(map.with_extension("objects.json"), list.to_json().unwrap()).unwrap();
    let frames = named.memory.last_seen();
    save_times(&map, |frame| [1_790_000_000.0, 1_790_000_000.0 + f64::from(frame)]);
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let (text, data) = client.ask("where_is", json!({ "object": "mug" })).await;
        assert!(text.contains(&format!("last seen in frame {} on 2026-", frames[&mug])), "{text}");
        let before_end = data["object"]["last_seen"]["seconds_before_end"].as_f64().unwrap();
        assert_eq!(before_end, 5_000_099.0 - f64::from(frames[&mug]), "up to the end of the run of the file");
        let (_, data) = client.ask("list_objects", json!({ "limit": 100 })).await;
        let seen_in = |id: u32| {
            data["objects"].as_array().unwrap().iter().find(|object| object["id"] == id).unwrap()["last_seen"]["frame"]
                .clone()
        };
        let other = by_size(&named)[1];
        assert_eq!((seen_in(mug), seen_in(other)), (json!(frames[&mug]), json!(99)));
    });
    // That of another map is refused if it was named, and said to be useless if it lies there by chance.
    let (_other_folder, map) = room();
    let other = ObjectList { objects: Vec::new(), not_counted: Vec::new(), ..list };
    fs::write(map.with_extension("objects.json"), other.to_json().unwrap()).unwrap();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        assert!(client.ask("where_is", json!({ "object": "mug" })).await.0.contains("of another map"));
    });
    let mut wrong = options(&map);
    wrong.objects = Some(map.with_extension("objects.json"));
    assert!(Assistant::open(wrong).err().unwrap().to_string().contains("of another map"));
}

#[test]
fn times_of_a_map_are_told_if_they_are_dates() {
    let (_folder, map) = room();
    let named = NamedMap::load(&map).unwrap();
    let (mug, frames) = (by_size(&named)[0], named.memory.last_seen());
    let last = *frames.values().max().unwrap();
    let date = 1_795_000_000.0;
    save_times(&map, |frame| [date, date + f64::from(frame)]);
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let (text, data) = client.ask("where_is", json!({ "object": "mug" })).await;
        assert!(text.contains(&format!("last seen in frame {} on 2026-", frames[&mug])), "{text}");
        let before_end = &data["object"]["last_seen"]["seconds_before_end"];
        assert_eq!(before_end.as_f64(), Some(f64::from(last - frames[&mug])));
    });
    // Recordings whose clocks begin at 0, and one of them after one with dates.
    for first in [0.0, 7.0] {
        save_times(&map, |frame| [first, if first > 0.0 { date } else { f64::from(frame) }]);
        with_client(Assistant::open(options(&map)).unwrap(), async |client| {
            let (text, data) = client.ask("where_is", json!({ "object": "mug" })).await;
            assert!(text.contains(&format!(" It was last seen in frame {}.", frames[&mug])), "{text}");
            let seen = json!({ "frame": frames[&mug], "time_s": null, "date": null, "seconds_before_end": null });
            assert_eq!(data["object"]["last_seen"], seen);
            assert!(client.refused("list_objects", json!({ "seen_since_s": 1 })).await.contains("not known"));
        });
    }
}

#[test]
fn words_that_several_objects_fit_are_not_decided_by_their_ending() {
    let (_folder, map) = room();
    let mut named = NamedMap::load(&map).unwrap();
    let ids = by_size(&named);
    for id in &ids[..5] {
        named.names.set_by_hand(*id, Some("chest")).unwrap();
    }
    named.save(&map).unwrap();
    with_client(Assistant::open(options(&map)).unwrap(), async |client| {
        let refused = client.refused("where_is", json!({ "object": "the large chest" })).await;
        assert!(refused.contains("Several objects fit"), "{refused}");
        let (_, data) = client.ask("where_is", json!({ "object": "the largest chest" })).await;
        assert_eq!(data["object"]["id"], ids[4]);
    });
}

/// A house of one room, in which every way is straight.
struct OneRoom;

impl Places for OneRoom {
    fn room_of(&self, _: SegmentId) -> Option<String> {
        Some("the kitchen".to_owned())
    }

    fn rooms(&self) -> Vec<PlaceRoom> {
        let (name, doors, objects) = (Some("the kitchen".to_owned()), Vec::new(), Vec::new());
        vec![PlaceRoom { id: 1, name, is_derived: false, middle: DVec3::ZERO, area_m2: 9.0, doors, objects }]
    }

    fn free_place(&self, room: &PlaceRoom, radius: f64) -> Result<DVec3, String> {
        Ok(room.middle + DVec3::new(2.0, radius, 0.0))
    }

    fn is_free(&self, place: DVec3) -> Option<bool> {
        Some(place.x < 0.0)
    }

    fn route(&self, from: DVec3, to: Destination, radius: f64) -> Result<Vec<DVec3>, String> {
        match to {
            _ if radius > 1.0 => Err("The robot is too wide.".to_owned()),
            Destination::Place(to) if from == to => Ok(vec![from]),
            Destination::Place(to) => Ok((0..=1000).map(|step| from.lerp(to, f64::from(step) / 1000.0)).collect()),
            Destination::Object(_) => Ok(vec![from, from + DVec3::X]),
        }
    }
}

#[test]
fn rooms_and_routes_come_from_whoever_knows_them() {
    let (_folder, map) = room();
    let open = Box::new(|_: &NamedMap| Ok(Box::new(OneRoom) as Box<dyn Places>));
    with_client(Assistant::with_places(options(&map), open).unwrap(), async |client| {
        let tools = client.0.list_all_tools().await.unwrap();
        assert!(tools.iter().any(|tool| tool.name == "route"));
        assert!(client.ask("where_is", json!({ "object": "mug" })).await.0.contains("in the kitchen"));
        let (text, data) = client.ask("route", json!({ "from": [0, 0, 0], "to": [3, 4, 0] })).await;
        assert!(text.contains("5.00 m"), "{text}");
        let points = data["points_m"].as_array().unwrap();
        assert!(points.len() <= 200 && points[0] == json!([0.0, 0.0, 0.0]), "{}", points.len());
        assert_eq!(points[points.len() - 1], json!([3.0, 4.0, 0.0]));
        // A way of one or two points has each once.
        let (text, data) = client.ask("route", json!({ "from": [1, 0, 0], "to": [1, 0, 0] })).await;
        assert!(text.contains(": 0.00 m"), "{text}");
        assert_eq!((&data["points_m"], data["length_m"].to_string()), (&json!([[1.0, 0.0, 0.0]]), "0.0".to_owned()));
        let (_, data) = client.ask("route", json!({ "from": [0, 0, 0], "to": "mug" })).await;
        assert_eq!(data["points_m"], json!([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]));
        // From the free place of a room, not from its middle.
        let (_, data) = client.ask("route", json!({ "from": { "room": 1 }, "to": "mug" })).await;
        assert_eq!(data["points_m"][0], json!([2.0, 0.25, 0.0]));
        let (_, data) = client.ask("route", json!({ "from": [0, 0, 0], "to": "mug" })).await;
        assert_eq!(data["length_m"], 1.0);
        let refused = client.refused("route", json!({ "from": "mug", "to": [0, 0, 0], "radius_m": 2 })).await;
        assert!(refused.contains("too wide"), "{refused}");
        assert!(
            client.refused("route", json!({ "from": {}, "to": 1 })).await.contains("a point, e.g. [1.0, 2.0, 0.0]")
        );
    });
}

#[test]
fn rooms_are_told_once_the_map_shows_them() {
    let (_folder, map) = room();
    let is_furnished = Arc::new(AtomicBool::new(false));
    let shown = Arc::clone(&is_furnished);
    let open = Box::new(move |_: &NamedMap| match shown.load(Ordering::SeqCst) {
        true => Ok(Box::new(OneRoom) as Box<dyn Places>),
        false => Err("no floor was found".to_owned()),
    });
    let mut writing = options(&map);
    writing.allow_write = true;
    with_client(Assistant::with_places(writing, open).unwrap(), async |client| {
        let tools = client.0.list_all_tools().await.unwrap();
        assert!(["list_rooms", "route", "name_room"].iter().all(|name| tools.iter().any(|tool| tool.name == *name)));
        let calls = [
            ("list_rooms", json!({})),
            ("route", json!({ "from": [0, 0, 0], "to": [3, 4, 0] })),
            ("name_room", json!({ "room": 1, "name": "hall" })),
        ];
        for (name, arguments) in calls {
            let refused = client.refused(name, arguments).await;
            assert_eq!(refused, "Rooms and free space are not known: no floor was found.", "{name}");
        }
        // The next version of the file shows a floor.
        is_furnished.store(true, Ordering::SeqCst);
        NamedMap::load(&map).unwrap().save(&map).unwrap();
        assert!(client.ask("list_rooms", json!({})).await.0.contains("the kitchen"));
    });
}

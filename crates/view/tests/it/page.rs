//! The messages of the page, as its script reads them.

use crate::client::{CLOSE, PATIENCE, TEXT, WebSocket, frame, object, pose_at, start, wait_until};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DQuat, DVec3, Vec3};
use serde_json::{Value, json};
use splatseg_geometry::{Image, Pose, SegmentId};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::DepthView;
use splatseg_places::{FloorPlan, PlanSettings};
use splatseg_test_scenes::{camera, recording};
use splatseg_view::{ViewAnswer, ViewFrame, ViewLimits, ViewRequest, ViewServer};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

fn number(value: &Value) -> usize {
    usize::try_from(value.as_u64().unwrap()).unwrap()
}

fn leb128(bytes: &mut impl Iterator<Item = u8>) -> Option<usize> {
    let (mut value, mut shift) = (0, 0);
    loop {
        let byte = bytes.next()?;
        value |= usize::from(byte & 0x7f) << shift;
        shift += 7;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
}

/// Decodes ids: runs equal to the row above, and runs of another id.
fn ids(bytes: &[u8], width: usize, height: usize) -> Vec<SegmentId> {
    let mut bytes = bytes.iter().copied();
    let mut ids: Vec<SegmentId> = Vec::new();
    while let Some(above) = leb128(&mut bytes) {
        for _ in 0..above {
            ids.push(ids.len().checked_sub(width).map_or(0, |above| ids[above]));
        }
        // The last run may be one of pixels equal to those above.
        let Some(run) = leb128(&mut bytes) else { break };
        let id = leb128(&mut bytes).unwrap();
        ids.extend(std::iter::repeat_n(id as SegmentId, run));
    }
    assert_eq!(ids.len(), width * height);
    ids
}

fn watched(server: &ViewServer) -> WebSocket {
    let before = server.viewers();
    let page = WebSocket::page(server);
    wait_until("the page is counted", || server.viewers() > before);
    page
}

#[test]
fn a_frame_arrives_with_picture_ids_and_pose() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    let (hello, _) = page.page_message("hello").unwrap();
    assert_eq!((&hello["scene"], &hello["path"], &hello["frames"]), (&json!("a scene"), &json!(""), &json!(0)));
    let sent = frame(5, 64, 48);
    let expected = sent.segments.pixels().to_vec();
    server.publish_frame(Some(&pose_at(1.0, 2.0, 3.0)), || sent);
    let (header, rest) = page.page_message("frame").unwrap();
    assert_eq!(header["number"], 5);
    assert_eq!(header["name"], "frame 5");
    assert_eq!(header["time"], 0.5);
    assert_eq!(header["pose"], json!([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]));
    assert_eq!(header["pose_state"], "given");
    assert_eq!((&header["dropped"], &header["lines"]), (&json!(3), &json!(["a warning"])));
    let (jpeg, coded) = rest.split_at(number(&header["jpeg"]));
    let picture = image::load_from_memory(jpeg).unwrap();
    assert_eq!((picture.width(), picture.height()), (64, 48));
    assert_eq!(ids(coded, number(&header["width"]), number(&header["height"])), expected);
}

#[test]
fn the_list_of_objects_arrives() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    // Without a frame.
    server.publish_objects(vec![object(5, "mug")], 8);
    let (objects, _) = page.page_message("objects").unwrap();
    let mug = &objects["objects"][0];
    assert_eq!((&mug["id"], &mug["label"], &mug["frames"]), (&json!(7), &json!("mug"), &json!(6)));
    assert_eq!(objects["frames"], 8);
    let mut later = watched(&server);
    assert_eq!(later.page_message("objects").unwrap().0, objects);
}

#[test]
fn after_a_restart_pages_start_again_with_nothing() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    let (first, _) = page.page_message("hello").unwrap();
    server.publish_frame(Some(&pose_at(500.0, 0.0, 0.0)), || frame(5, 32, 24));
    server.publish_objects(vec![object(5, "mug")], 6);
    server.publish_plan(Some(&floor_plan()));
    page.page_message("plan").unwrap();
    server.restart();
    let (second, _) = page.page_message("hello").unwrap();
    assert_ne!(first["session"], second["session"]);
    assert_eq!(
        (&second["path"], &second["frames"], &second["origin"]),
        (&json!(""), &json!(0), &json!([0.0, 0.0, 0.0]))
    );
    // A page that comes now gets nothing of the run before.
    let mut later = watched(&server);
    assert_eq!(later.page_message("hello").unwrap().0, second);
    server.publish_frame(None, || frame(6, 32, 24));
    for page in [&mut page, &mut later] {
        loop {
            let (kind, payload) = page.next().unwrap();
            page.send(TEXT, b"shown");
            if kind != TEXT {
                break;
            }
            let message: Value = serde_json::from_slice(&payload).unwrap();
            assert_eq!(message["kind"], "status", "{message}");
        }
    }
    // The same list is news in this run.
    server.publish_objects(vec![object(5, "mug")], 6);
    assert!(later.page_message("objects").is_some());
}

#[test]
fn every_request_has_an_answer_of_its_own() {
    let server = start(ViewLimits::default());
    server.answer_with(Arc::new(|_| Ok(ViewAnswer::Done)));
    let mut page = watched(&server);
    for id in 1..=5 {
        page.send(TEXT, json!({ "ask": "name", "id": id, "label": "mug" }).to_string().as_bytes());
    }
    for id in 1..=5 {
        assert_eq!(page.page_message("named").unwrap().0["id"], json!(id));
    }
}

#[test]
fn large_frames_are_reduced() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    server.publish_frame(None, || frame(0, 1280, 720));
    let (header, rest) = page.page_message("frame").unwrap();
    assert_eq!((&header["pose"], &header["pose_state"]), (&Value::Null, &json!("lost")));
    let (jpeg, coded) = rest.split_at(number(&header["jpeg"]));
    let picture = image::load_from_memory(jpeg).unwrap();
    assert_eq!((picture.width(), picture.height()), (640, 360));
    let (width, height) = (number(&header["width"]), number(&header["height"]));
    assert_eq!((width, height), (640, 360));
    let ids = ids(coded, width, height);
    assert!(ids.chunks(width).all(|row| row[..160].iter().all(|id| *id == 7) && row[160..].iter().all(|id| *id == 0)));
}

#[test]
fn without_viewers_nothing_is_made() {
    let server = start(ViewLimits::default());
    for index in 0..10_000 {
        server.publish_frame(Some(&pose_at(f64::from(index), 0.0, 0.0)), || -> ViewFrame {
            unreachable!("nobody watches")
        });
    }
}

#[test]
fn a_page_that_comes_later_gets_the_path_and_the_latest_frame() {
    let server = start(ViewLimits::default());
    server.publish_frame(Some(&pose_at(1.0, 0.0, 0.0)), || -> ViewFrame { unreachable!("nobody watches") });
    let mut first = watched(&server);
    server.publish_frame(None, || frame(1, 32, 24));
    server.publish_frame(Some(&pose_at(3.0, 0.0, 0.0)), || frame(2, 32, 24));
    while first.page_message("frame").unwrap().0["number"] != 2 {}
    let mut second = watched(&server);
    let (hello, _) = second.page_message("hello").unwrap();
    let bytes = STANDARD.decode(hello["path"].as_str().unwrap()).unwrap();
    let x: Vec<f32> = bytes.chunks(12).map(|point| f32::from_le_bytes(point[..4].try_into().unwrap())).collect();
    assert_eq!((x[0], x[1].is_nan(), x[2], x.len()), (1.0, true, 3.0, 3));
    let (header, _) = second.page_message("frame").unwrap();
    assert_eq!((&header["number"], &header["index"], &hello["frames"]), (&json!(2), &json!(2), &json!(3)));
}

#[test]
fn a_page_that_comes_later_gets_no_picture_of_an_earlier_time() {
    let server = start(ViewLimits::default());
    let mut first = watched(&server);
    server.publish_frame(None, || frame(0, 32, 24));
    assert_eq!(first.page_message("frame").unwrap().0["number"], 0);
    drop(first);
    wait_until("it has left", || server.viewers() == 0);
    // No frame has come since: the picture is the newest.
    let mut second = watched(&server);
    assert_eq!(second.page_message("frame").unwrap().0["number"], 0);
    drop(second);
    wait_until("it has left", || server.viewers() == 0);
    server.publish_frame(None, || -> ViewFrame { unreachable!("nobody watches") });
    let mut third = watched(&server);
    server.publish_frame(None, || frame(2, 32, 24));
    assert_eq!(third.page_message("frame").unwrap().0["number"], 2);
}

#[test]
fn far_from_the_worlds_origin_coordinates_stay_exact() {
    let server = start(ViewLimits::default());
    let mut early = watched(&server);
    assert_eq!(early.page_message("hello").unwrap().0["origin"], json!([0.0, 0.0, 0.0]));
    let far = [512_345.25, 5_400_001.5, 210.125];
    server.publish_frame(Some(&pose_at(far[0], far[1], far[2])), || frame(0, 32, 24));
    let (header, _) = early.page_message("frame").unwrap();
    for (axis, world) in far.iter().enumerate() {
        let (origin, local) = (header["origin"][axis].as_f64().unwrap(), header["pose"][axis].as_f64().unwrap());
        assert_eq!(origin + local, *world);
        assert!(local.abs() <= 16.0 && local == f64::from(local as f32), "axis {axis}: {local}");
    }
}

/// Where up is in the next map; null if none comes. Messages about the state come all the time.
fn up_of_next_map(page: &mut WebSocket) -> Value {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        let (kind, payload) = page.next().unwrap();
        page.send(TEXT, b"shown");
        if kind == TEXT && payload.starts_with(br#"{"kind":"map""#) {
            return serde_json::from_slice::<Value>(&payload).unwrap()["up"].take();
        }
    }
    Value::Null
}

#[test]
fn the_map_comes_when_it_is_due_and_has_changed() {
    let frames = recording("synthetic:frames=2,width=64,height=48");
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    let (room, ids) = &frames[0];
    let largest = ids.pixels().iter().copied().max().unwrap();
    while memory.new_segment().unwrap() < largest {}
    memory.update(memory.recall(room), ids, &BTreeSet::new()).unwrap();

    let interval = Duration::from_millis(100);
    let server = start(ViewLimits { map_interval: interval, ..ViewLimits::default() });
    let mut page = watched(&server);
    // The second is not due, the third is the same.
    server.publish_map(&memory.map(), None);
    server.publish_map(&memory.map(), None);
    let (map, _) = page.page_message("map").unwrap();
    assert_eq!(map["map"]["total"], memory.gaussian_count());
    std::thread::sleep(3 * interval);
    server.publish_map(&memory.map(), None);
    server.publish_frame(None, || ViewFrame { name: "after the map".to_owned(), ..frame(1, 32, 24) });
    let mut maps = 0;
    let start = Instant::now();
    while start.elapsed() < Duration::from_millis(1500) {
        let (kind, payload) = page.next().unwrap();
        page.send(crate::client::TEXT, b"shown");
        maps += usize::from(kind == crate::client::TEXT && payload.starts_with(br#"{"kind":"map""#));
    }
    assert_eq!(maps, 0, "the same map is not sent again");
    // Before a camera was seen, nothing tells where up is.
    assert_eq!(map["up"], json!([0.0, 0.0, 1.0]));
    server.publish_frame(Some(&pose_at(0.0, 0.0, 0.0)), || frame(2, 32, 24));
    server.publish_map(&memory.map(), None);
    assert_eq!(up_of_next_map(&mut page), json!([0.0, -1.0, 0.0]), "as the camera is held");
    std::thread::sleep(3 * interval);
    server.publish_map(&memory.map(), Some(Vec3::X));
    assert_eq!(up_of_next_map(&mut page), json!([1.0, 0.0, 0.0]), "as the program knows");
    std::thread::sleep(3 * interval);
    memory.update(memory.recall(&frames[1].0), ids, &BTreeSet::new()).unwrap();
    server.publish_map(&memory.map(), None);
    assert_eq!(page.page_message("map").unwrap().0["map"]["total"], memory.gaussian_count());
}

/// A level floor, seen from a height of 1.5 m by a camera that looks 15 degrees down.
fn floor_plan() -> FloorPlan {
    let memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    let (down, across) = 15_f64.to_radians().sin_cos();
    let axes = DMat3::from_cols(DVec3::X, DVec3::new(0.0, -down, -across), DVec3::new(0.0, across, -down));
    let position = DVec3::new(0.0, 0.0, 1.5);
    let world_from_camera = Pose::from_quaternion(position, DQuat::from_mat3(&axes)).unwrap();
    let (intrinsics, (width, height)) = (camera(320, 240, 280.0), (320, 240));
    let depth = Image::from_fn(width, height, |_, row| {
        let below = (row as f64 - f64::from(intrinsics.cy)) / f64::from(intrinsics.fy);
        // Nothing above the horizon.
        if across * below + down > 0.0 { (position.z / (across * below + down)) as f32 } else { 0.0 }
    });
    FloorPlan::new(&memory.map(), &[DepthView { world_from_camera, intrinsics, depth }], PlanSettings::default())
        .unwrap()
}

#[test]
fn the_plan_waits_for_a_viewer_and_goes_with_its_map() {
    let server = start(ViewLimits::default());
    server.publish_plan(Some(&floor_plan()));
    let mut first = watched(&server);
    let (plan, _) = first.page_message("plan").unwrap();
    let [width, height] = ["width", "height"].map(|side| number(&plan["plan"][side]));
    let cells = STANDARD.decode(plan["plan"]["cells"].as_str().unwrap()).unwrap();
    assert!(ids(&cells, width, height).iter().any(|code| *code >= 2), "some cells are free");
    let mut later = watched(&server);
    assert_eq!(later.page_message("plan").unwrap().0, plan);
    server.publish_plan(None);
    for page in [&mut first, &mut later] {
        assert_eq!(page.page_message("plan").unwrap().0["plan"], Value::Null);
    }
}

#[test]
fn the_last_results_reach_viewers_before_the_end_of_the_session() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    // The second list is not due yet when the server ends.
    server.publish_objects(vec![object(1, "first")], 2);
    assert_eq!(page.page_message("objects").unwrap().0["objects"][0]["label"], "first");
    server.publish_objects(vec![object(1, "last")], 2);
    server.publish_plan(Some(&floor_plan()));
    let ending = std::thread::spawn(move || drop(server));
    let mut kinds = BTreeSet::new();
    while let Some((kind, payload)) = page.receive().filter(|(kind, _)| *kind != CLOSE) {
        if kind == TEXT {
            let message: Value = serde_json::from_slice(&payload).unwrap();
            assert!(message["kind"] != "objects" || message["objects"][0]["label"] == "last", "{message}");
            kinds.insert(message["kind"].as_str().unwrap().to_owned());
        }
    }
    assert!(kinds.contains("objects") && kinds.contains("plan"), "{kinds:?}");
    drop(page);
    ending.join().unwrap();
}

#[test]
fn notes_come_without_frames() {
    let server = start(ViewLimits::default());
    let mut page = WebSocket::page(&server);
    assert_eq!(page.page_message("status").unwrap().0["notes"], serde_json::json!([]));
    server.set_notes(vec!["the map is not saved".to_owned()]);
    wait_until("the note comes", || {
        page.page_message("status").unwrap().0["notes"] == serde_json::json!(["the map is not saved"])
    });
}

#[test]
fn the_end_of_the_session_is_told() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    server.publish_frame(None, || frame(5, 32, 24));
    page.page_message("frame").unwrap();
    let ending = std::thread::spawn(move || drop(server));
    let farewell = std::iter::from_fn(|| page.receive()).find(|(kind, _)| *kind == CLOSE).unwrap().1;
    // The code of a normal end (RFC 6455, section 7.4.1): the page does not try to connect again.
    assert_eq!(farewell[..2], 1000_u16.to_be_bytes());
    drop(page);
    ending.join().unwrap();
}

#[test]
fn the_end_is_told_to_a_viewer_that_reads_slowly_and_goes_on_sending() {
    let server = start(ViewLimits::default());
    let mut page = watched(&server);
    // More than the system takes in for a viewer that does not read.
    let objects = (1..20_000).map(|id| object(id, "an object with a label of some length")).collect();
    server.publish_objects(objects, 1);
    for _ in 0..2000 {
        assert!(page.send(TEXT, b"shown"));
    }
    let ending = std::thread::spawn(move || drop(server));
    std::thread::sleep(Duration::from_millis(300));
    let farewell = std::iter::from_fn(|| page.receive()).find(|(kind, _)| *kind == CLOSE);
    assert_eq!(farewell.map(|(_, payload)| payload[..2].to_owned()), Some(1000_u16.to_be_bytes().to_vec()));
    drop(page);
    ending.join().unwrap();
}

#[test]
fn viewers_find_and_name_objects_and_choose_the_detail_if_the_program_answers() {
    let server = start(ViewLimits::default());
    let mut deaf = watched(&server);
    assert_eq!(deaf.page_message("hello").unwrap().0["answers"], json!(false));
    server.answer_with(Arc::new(|request| match request {
        ViewRequest::Find(text) if text == "mug" => Ok(ViewAnswer::Found(vec![(7, 0.5), (3, 0.25)])),
        ViewRequest::Find(_) => Err("no names".to_owned()),
        ViewRequest::Detail(detail) if detail != "fine" => Err("no such detail".to_owned()),
        ViewRequest::Name(..) | ViewRequest::Merge(_) | ViewRequest::Detail(_) => Ok(ViewAnswer::Done),
    }));
    let mut page = watched(&server);
    assert_eq!(page.page_message("hello").unwrap().0["answers"], json!(true));
    let mut ask = |text: &str, kind: &str| {
        page.send(TEXT, text.as_bytes());
        page.page_message(kind).unwrap().0
    };
    let found = ask(r#"{"ask": "find", "text": "mug"}"#, "found");
    assert_eq!(found["objects"], json!([{ "id": 7, "score": 0.5 }, { "id": 3, "score": 0.25 }]));
    assert_eq!((&found["text"], &found["error"]), (&json!("mug"), &json!(null)));
    assert_eq!(ask(r#"{"ask": "find", "text": "x"}"#, "found")["error"], json!("no names"));
    let named = ask(r#"{"ask": "name", "id": 7, "label": "mug"}"#, "named");
    assert_eq!((&named["id"], &named["label"], &named["error"]), (&json!(7), &json!("mug"), &json!(null)));
    let fine = ask(r#"{"ask": "detail", "detail": "fine"}"#, "detail");
    assert_eq!((&fine["detail"], &fine["error"]), (&json!("fine"), &json!(null)));
    assert_eq!(ask(r#"{"ask": "detail", "detail": "finest"}"#, "detail")["error"], json!("no such detail"));
    // Nonsense is counted, and ends nothing.
    let before = server.counts().bad_messages;
    page.send(TEXT, br#"{"ask": "stop"}"#);
    wait_until("nonsense is counted", || server.counts().bad_messages > before);
    page.send(TEXT, br#"{"ask": "find", "text": "mug"}"#);
    assert!(page.page_message("found").is_some());
}

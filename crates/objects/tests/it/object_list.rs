//! The list of objects as JSON and CSV.

use glam::{DVec3, Quat, Vec3};
use splatseg_objects::{
    AxisAlignedBox, BestView, BoundingBox, Conventions, FrameStamp, ListedRoom, Object, ObjectCounts, ObjectList,
    ObjectLog, ObjectShape, ObjectState, OrientedBox,
};
use std::collections::BTreeMap;

fn list() -> ObjectList {
    let frame = FrameStamp {
        number: 4,
        name: Some("a, \"b\"".to_owned()),
        file: Some("a, 'b'".to_owned()),
        time_s: Some(1_305_031_102.175_304),
    };
    let shape = ObjectShape {
        centroid: DVec3::new(0.1, -2.5, 1e-3),
        axis_aligned_box: AxisAlignedBox { min: DVec3::ZERO, max: DVec3::ONE },
        oriented_box: OrientedBox { center: DVec3::ONE, size: Vec3::splat(0.25), rotation: Quat::IDENTITY },
        area_m2: 0.75,
        color: [1, 2, 3],
        points: 17,
        stray_points: 2,
        completed_points: 5,
    };
    let view = BestView {
        frame: frame.clone(),
        bounding_box: BoundingBox { x: 1, y: 2, width: 3, height: 4 },
        area_px: 10,
        confidence: 0.5,
        color: Some([4, 5, 6]),
        crop: Some("objects/7.jpg".to_owned()),
    };
    let known = Object {
        id: 7,
        label: None,
        label_score: None,
        label_alternatives: Vec::new(),
        state: Some(ObjectState::Remembered),
        frames: 3,
        first_frame: Some(frame.clone()),
        last_frame: Some(frame),
        first_seen_s: Some(1_305_031_000.5),
        last_seen_s: Some(1_305_031_102.175_304),
        room: Some(2),
        confidence: Some(0.875),
        color: Some([1, 2, 3]),
        shape: Some(shape),
        best_view: Some(view),
    };
    let unknown = Object { label: Some("cup".to_owned()), state: Some(ObjectState::Forgotten), ..Object::unknown(8) };
    let mut list = ObjectList::new(&ObjectLog::default(), None);
    list.frames = 5;
    list.objects = vec![known];
    list.not_counted = vec![unknown];
    list
}

#[test]
fn json_has_one_line_per_object_and_reads_back() {
    let list = list();
    let json = list.to_json().unwrap();
    assert_eq!(serde_json::from_str::<ObjectList>(&json).unwrap(), list);
    let objects: Vec<&str> = json.lines().filter(|line| line.contains("\"id\":")).collect();
    assert_eq!(objects.len(), 2, "{json}");
    assert!(objects[0].contains(r#""oriented_box": {"center": [1.0, 1.0, 1.0], "size": [0.25, 0.25, 0.25]"#), "{json}");
    assert!(objects[1].contains(r#""state": "forgotten""#), "{json}");
    let empty = ObjectList { objects: Vec::new(), not_counted: Vec::new(), ..list };
    assert_eq!(serde_json::from_str::<ObjectList>(&empty.to_json().unwrap()).unwrap(), empty);
    assert_eq!((empty.format.as_str(), empty.version), (ObjectList::FORMAT, ObjectList::VERSION));
    assert_eq!(empty.conventions, Conventions::default());
}

#[test]
fn rooms_have_the_objects_that_count() {
    let mut list = list();
    let room = |id| ListedRoom {
        id,
        name: None,
        name_source: None,
        area_m2: 12.5,
        middle: DVec3::ONE,
        outlines: vec![vec![DVec3::ZERO, DVec3::X, DVec3::Y]],
        objects: Vec::new(),
    };
    list.set_rooms(vec![room(1), room(4)], &BTreeMap::from([(7, 4), (8, 1), (9, 1)]));
    assert_eq!((list.objects[0].room, list.not_counted[0].room), (Some(4), Some(1)));
    assert_eq!(list.rooms.iter().map(|room| room.objects.clone()).collect::<Vec<_>>(), [vec![], vec![7]]);
    assert_eq!(serde_json::from_str::<ObjectList>(&list.to_json().unwrap()).unwrap(), list);
    // A room that the list does not have is none.
    list.set_rooms(vec![room(1)], &BTreeMap::from([(7, 4)]));
    assert_eq!((list.objects[0].room, list.not_counted[0].room), (None, None));
}

#[test]
fn lists_of_earlier_versions_have_no_completed_points() {
    let json = list().to_json().unwrap().replace(", \"completed_points\": 5", "");
    let read: ObjectList = serde_json::from_str(&json).unwrap();
    assert_eq!(read.objects[0].shape.as_ref().map(|shape| shape.completed_points), Some(0));
}

#[test]
fn keys_of_later_versions_are_ignored() {
    let json = list().to_json().unwrap().replace("\"frames\": 3", "\"frames\": 3, \"weight_kg\": 2");
    assert_eq!(serde_json::from_str::<ObjectList>(&json).unwrap(), list());
}

#[test]
fn csv_has_a_name_for_every_cell() {
    let csv = list().to_csv();
    let lines: Vec<&str> = csv.lines().collect();
    let name = "\"a, \"\"b\"\"\"";
    let expected = format!(
        "7,,remembered,3,0.875,4,{name},1305031102.175304,4,{name},1305031102.175304,1,2,3,0.1,-2.5,0.001,0,0,0,1,1,1,\
         1,1,1,0.25,0.25,0.25,0,0,0,1,0.75,17,2,4,{name},1,2,3,4,objects/7.jpg,5,,,2,1305031000.5,1305031102.175304"
    );
    assert_eq!(lines[1], expected);
    assert_eq!(lines[0].split(',').count(), expected.replace(name, "").split(',').count());
    assert_eq!(lines.len(), 2, "a forgotten object is not counted: {csv}");
}

#[test]
fn an_object_counts_if_the_memory_has_it_from_two_frames() {
    let mut list = list();
    assert_eq!(list.counts(), ObjectCounts { objects: 1, tentative: 0, forgotten: 1 });
    assert_eq!(list.counts().to_string(), "1 object (1 forgotten one not counted)");
    let known = list.objects[0].clone();
    for (id, state) in [(3, ObjectState::Tentative), (5, ObjectState::Tentative)] {
        list.not_counted.push(Object { id, state: Some(state), ..known.clone() });
    }
    assert_eq!(list.counts().to_string(), "1 object (2 tentative and 1 forgotten ones not counted)");
    let ids = |objects: &[Object]| objects.iter().map(|object| object.id).collect::<Vec<_>>();
    // The longest seen first: 9 frames show object 5.
    list.set_frames(&BTreeMap::from([(5, 9)]));
    assert_eq!((ids(&list.objects), ids(&list.not_counted)), (vec![7], vec![5, 3, 8]));
    let all = list.with_tentative();
    assert_eq!((ids(&all.objects), ids(&all.not_counted)), (vec![5, 3, 7], vec![8]));
    assert_eq!(all.get(8).map(|object| object.label.as_deref()), Some(Some("cup")));
    // Without a memory, everything that was seen counts.
    assert!(Object { state: None, ..known }.counts());
}

#[test]
fn lists_of_version_1_have_all_objects_under_one_key() {
    let mut list = list();
    list.not_counted.clear();
    let json = list.to_json().unwrap().replace("\"version\": 2", "\"version\": 1");
    let json = format!("{}\n}}", json.split_once(",\n  \"not_counted\"").unwrap().0);
    assert!(!json.contains("not_counted"), "{json}");
    let read: ObjectList = serde_json::from_str(&json).unwrap();
    assert_eq!((read.version, read.objects), (1, list.objects));
}

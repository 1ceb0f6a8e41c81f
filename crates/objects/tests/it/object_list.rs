//! The list of objects as JSON and CSV.

use glam::{DVec3, Quat, Vec3};
use splatseg_objects::{
    AxisAlignedBox, BestView, BoundingBox, Conventions, FrameStamp, Object, ObjectList, ObjectLog, ObjectShape,
    ObjectState, OrientedBox,
};

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
        confidence: Some(0.875),
        color: Some([1, 2, 3]),
        shape: Some(shape),
        best_view: Some(view),
    };
    let unknown = Object {
        id: 8,
        label: Some("cup".to_owned()),
        label_score: None,
        label_alternatives: Vec::new(),
        state: Some(ObjectState::Forgotten),
        frames: 0,
        first_frame: None,
        last_frame: None,
        confidence: None,
        color: None,
        shape: None,
        best_view: None,
    };
    let mut list = ObjectList::new(&ObjectLog::default(), None);
    list.frames = 5;
    list.objects = vec![known, unknown];
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
    let empty = ObjectList { objects: Vec::new(), ..list };
    assert_eq!(serde_json::from_str::<ObjectList>(&empty.to_json().unwrap()).unwrap(), empty);
    assert_eq!((empty.format.as_str(), empty.version), (ObjectList::FORMAT, ObjectList::VERSION));
    assert_eq!(empty.conventions, Conventions::default());
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
         1,1,1,0.25,0.25,0.25,0,0,0,1,0.75,17,2,4,{name},1,2,3,4,objects/7.jpg,5,,"
    );
    assert_eq!(lines[1], expected);
    assert_eq!(lines[2].split(',').count(), lines[0].split(',').count());
    assert!(lines[2].starts_with("8,cup,forgotten,0,,,"), "{}", lines[2]);
}

//! Shapes of objects compared with the synthetic room's geometry. The rules were chosen on the rooms of seeds 100 to
//! 109 and 200 to 229; `cargo run -p splatseg-objects --example box_errors` measures them on others.

use crate::seen_room::{BoxErrors, Cuboid, oriented, room, seen_room};
use glam::{DVec3, EulerRot, Mat3, Quat};
use splatseg_dataset::SyntheticSettings;
use splatseg_geometry::{Pose, SegmentMap};
use splatseg_objects::{ObjectList, ObjectLog, ObjectState, object_shapes};
use splatseg_tracking::FrameOutput;

#[test]
fn boxes_that_were_seen_from_two_sides_are_where_they_stand() {
    let mut count = 0;
    for seed in 1..=3 {
        let seen = seen_room(room(seed), Pose::IDENTITY);
        let shapes = object_shapes(&seen.memory.map());
        for thing in seen.boxes() {
            let shape = &shapes[&thing.id];
            let BoxErrors { off, iou, aligned_iou } = seen.box_errors(thing, shape);
            let ratio = shape.area_m2 / seen.faces[&thing.id].area(thing.size);
            println!("seed {seed}: {thing:?} {shape:?}: off {off:.3}, IoU {iou:.2} {aligned_iou:.2}, area {ratio:.2}");
            assert!(off <= 0.03 && iou >= 0.7 && aligned_iou >= 0.7, "seed {seed}, object {}", thing.id);
            assert!((0.4..1.1).contains(&ratio), "seed {seed}, object {}: area off by {ratio}", thing.id);
            count += 1;
        }
    }
    assert!(count >= 5, "only {count} boxes");
}

#[test]
fn boxes_turn_with_the_world() {
    // The same room, seen by a camera whose first pose is not upright.
    let rotation = Quat::from_euler(EulerRot::XYZ, 0.5, -0.8, 1.1);
    let place = Pose::from_quaternion(DVec3::new(4.0, -2.0, 1.0), rotation.as_dquat()).unwrap();
    let seen = seen_room(room(4), place);
    let shapes = object_shapes(&seen.memory.map());
    for thing in seen.boxes() {
        let axes = Mat3::from_quat(rotation) * Mat3::from_rotation_z(thing.turn);
        let truth = Cuboid(place.to_world(thing.center).as_vec3(), thing.size, axes);
        let iou = oriented(&shapes[&thing.id]).iou(&truth);
        assert!(iou >= 0.7, "object {}: IoU {iou:.2}", thing.id);
    }
    assert!(seen.boxes().count() > 0);
}

#[test]
fn the_list_has_what_the_log_and_the_memory_know() {
    let small = SyntheticSettings { frames: 4, width: 96, height: 72, objects: 8, ..SyntheticSettings::default() };
    let seen = seen_room(small, Pose::IDENTITY);
    let mut log = ObjectLog::default();
    seen.truths.iter().for_each(|truth| _ = log.record(&FrameOutput::from_segments(truth.clone())));
    let list = ObjectList::new(&log, Some(seen.memory.map()));
    assert_eq!(list, ObjectList::new(&log, Some(seen.memory.map())));
    assert_eq!(list.frames, 4);
    for (id, record) in log.records() {
        let object = list.get(*id).unwrap();
        let (first, last) = (object.first_frame.as_ref().unwrap(), object.last_frame.as_ref().unwrap());
        assert_eq!((first.number, last.number, object.frames), (record.first_frame, record.last_frame, record.frames));
        let expected = if record.frames > 1 { ObjectState::Remembered } else { ObjectState::Tentative };
        assert!(object.state == Some(expected) || object.shape.is_none(), "{object:?}");
        assert_eq!(object.color, object.shape.as_ref().map(|shape| shape.color));
    }
    // An assigned id without Gaussians.
    let mut memory = seen.memory;
    let carried = memory.map().carried_ids();
    let id = memory.new_segment().unwrap();
    assert!(!memory.map().carried_ids().contains(&id) && !carried.contains(&id));
    log.record(&FrameOutput::from_segments(SegmentMap::filled(2, 2, id)));
    let list = ObjectList::new(&log, Some(memory.map()));
    let object = list.get(id).unwrap();
    assert_eq!((object.state, &object.shape), (Some(ObjectState::Forgotten), &None));
}

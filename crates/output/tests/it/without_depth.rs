//! Outputs for a segment without depth and without any surface near it: a window at night, or the sky.

use glam::DVec3;
use splatseg_geometry::{Image, Pose, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::object_shapes;
use splatseg_output::map_data;
use splatseg_output::ros_messages::PointBytes;
use splatseg_ros::Time;
use splatseg_test_scenes::{camera, grey_frame};
use std::collections::BTreeSet;

/// A wall at 2 m on the left, id 1; nothing on the right, id 2, with a gap between them.
fn memory() -> SplatMemory {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    (0..2).for_each(|_| _ = memory.new_segment().unwrap());
    let depth = Image::from_fn(64, 48, |column, _| if column < 24 { 2.0 } else { 0.0 });
    let frame = grey_frame("0", camera(64, 48, 60.0), depth, Pose::IDENTITY);
    let predicted = SegmentMap::from_fn(64, 48, |column, _| match column {
        0..24 => 1,
        24..40 => 0,
        _ => 2,
    });
    for _ in 0..3 {
        let recall = memory.recall(&frame);
        memory.update(recall, &predicted, &BTreeSet::new()).unwrap();
    }
    memory
}

#[test]
fn it_is_remembered_but_has_no_shape_no_points_and_is_not_drawn() {
    let memory = memory();
    let ids = memory.map().segment_ids();
    let of_wall = ids.iter().filter(|id| **id == 1).count();
    assert!(of_wall > 10 && ids.len() - of_wall > 10, "{of_wall} of {}", ids.len());
    assert_eq!(object_shapes(&memory.map()).into_keys().collect::<Vec<_>>(), [1]);

    let points = PointBytes::in_world(&memory.map());
    let message = points.message(Time::from_nanoseconds(0)).unwrap();
    assert_eq!(message.width as usize, of_wall);

    let drawn = serde_json::to_value(map_data(&memory.map(), DVec3::ZERO, |_| true)).unwrap();
    assert_eq!((drawn["count"].as_u64(), drawn["total"].as_u64()), (Some(of_wall as u64), Some(of_wall as u64)));
    // The view is fitted to this box.
    let size = drawn["size"].as_array().unwrap();
    assert!(size.iter().all(|side| side.as_f64().unwrap() < 3.0), "{size:?}");
}

//! Real and rendered recordings next to the repository; skipped if missing.

use crate::support::shared_data;
use glam::Vec2;
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::CameraFrame;

#[test]
fn redkitchen_is_a_registered_recording() {
    let Some(path) = shared_data("redkitchen_is_a_registered_recording", "redkitchen") else { return };
    let scene = open_scene(path, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.name(), scene.frame_count(), scene.frame_name(15)), ("redkitchen", 100, "frame-000150".into()));
    let settings = DatasetSettings::default().with(|settings| {
        settings.stride = 33;
        settings.resize = "320x240".parse().ok();
        settings.crop_border = 5;
    });
    let frames: Vec<CameraFrame<'static>> =
        FrameStream::open(scene, &settings, GroundTruth::Skip).unwrap().map(|frame| frame.unwrap().frame).collect();
    assert_eq!(frames.len(), 4);
    for frame in &frames {
        assert_eq!((frame.width(), frame.height()), (310, 230));
        assert!((frame.intrinsics().fx - 262.906).abs() < 0.01);
        let measured = frame.depth().pixels().iter().filter(|z| **z > 0.3 && **z < 6.0).count();
        assert!(measured * 2 > 310 * 230, "{measured} pixels");
    }
}

#[test]
fn a_rendered_room_agrees_with_itself_in_world_coordinates() {
    let test = "a_rendered_room_agrees_with_itself_in_world_coordinates";
    let Some(path) = shared_data(test, "rooms/dev-a") else { return };
    let scene = open_scene(path, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.frame_name(10)), (80, "10".into()));
    let settings = DatasetSettings::default().with(|settings| settings.max_frames = Some(2));
    let frames: Vec<_> =
        FrameStream::open(scene, &settings, GroundTruth::Read).unwrap().map(|frame| frame.unwrap()).collect();
    let (here, there) = (&frames[0], &frames[1]);
    let [pose_here, pose_there] = [here, there].map(|streamed| streamed.world_from_camera.unwrap());
    let (ids_here, ids_there) = (here.ground_truth.as_ref().unwrap(), there.ground_truth.as_ref().unwrap());
    let (mut visible, mut same) = (0, 0);
    for row in 0..240 {
        for column in 0..320 {
            let z = here.frame.depth()[(column, row)];
            let point = here.frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), z);
            let world = pose_here.to_world(point);
            let point_there = pose_there.to_camera(world);
            let Some(pixel) = there.frame.intrinsics().project(point_there).map(Vec2::round) else { continue };
            if z > 0.0 && pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < 320.0 && pixel.y < 240.0 {
                let at = (pixel.x as usize, pixel.y as usize);
                if (there.frame.depth()[at] - point_there.z).abs() < 0.04 {
                    visible += 1;
                    same += usize::from(ids_there[at] == ids_here[(column, row)]);
                }
            }
        }
    }
    assert!(visible > 15_000 && same * 100 > visible * 95, "{same} of {visible}");
}

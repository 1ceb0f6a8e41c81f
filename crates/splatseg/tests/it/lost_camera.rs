//! The lens is covered for a while: the map does not change, and objects keep their ids.

use splatseg::dataset::{Scene, SyntheticScene};
use splatseg::odometry::PoseState;
use splatseg::{CameraFrame, Image, Pipeline, SegmentMap, Settings};
use splatseg_test_scenes::room;

/// Frame `index` of the scene without its pose, black and without depth from frame 6 to 10.
fn frame(scene: &SyntheticScene, index: usize) -> CameraFrame<'static> {
    let frame = scene.read_frame(index).unwrap().into_camera_frame();
    if !(6..11).contains(&index) {
        return frame;
    }
    let (width, height) = (frame.width(), frame.height());
    let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, 0.0));
    CameraFrame::new(frame.name(), color, depth, *frame.intrinsics()).unwrap()
}

/// Share of the pixels with the same id.
fn same(one: &SegmentMap, other: &SegmentMap) -> f64 {
    let equal = one.pixels().iter().zip(other.pixels()).filter(|(one, other)| one == other).count();
    equal as f64 / one.pixels().len() as f64
}

#[test]
fn while_the_lens_is_covered_the_map_rests_and_ids_stay() {
    let scene = room("synthetic:frames=16,width=160,height=120,speed=0.01");
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    let mut before = None;
    for index in 0..scene.frame_count() {
        let gaussians = pipeline.memory().unwrap().gaussian_count();
        let result = pipeline.step_unposed(frame(&scene, index)).unwrap();
        if (6..11).contains(&index) {
            assert_eq!(result.pose.state, PoseState::Lost, "frame {index}");
            assert_eq!(pipeline.memory().unwrap().gaussian_count(), gaussians, "frame {index}");
        } else {
            assert_eq!(result.pose.state, PoseState::Tracked, "frame {index}");
        }
        if index == 5 {
            before = Some(result.output.segments);
        } else if index > 11 {
            let share = same(before.as_ref().unwrap(), &result.output.segments);
            assert!(share > 0.9, "frame {index}: {share} of the pixels have the id from before");
        }
    }
}

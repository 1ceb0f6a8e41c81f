//! Moving things in the synthetic room: colour, depth and ids change together, and nothing else changes.

use glam::{Vec2, Vec3};
use splatseg_dataset::{Motion, Mover, Scene, SyntheticScene, SyntheticSettings};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use splatseg_test_scenes::{room, truth};
use std::collections::BTreeSet;

const STILL: &str = "synthetic:frames=40,seed=1,width=160,height=120,moving=3,camera=static";

fn read(scene: &SyntheticScene, index: usize) -> (RgbdFrame<'static>, SegmentMap) {
    (scene.read_frame(index).unwrap(), truth(scene, index))
}

fn pixels_of(ids: &SegmentMap, id: u32) -> BTreeSet<(usize, usize)> {
    let (width, height) = ids.size();
    let all = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    all.filter(|at| ids[*at] == id).collect()
}

/// Returns the pixels where colour, depth or id differ between two frames.
fn changed(
    first: &(RgbdFrame<'static>, SegmentMap),
    second: &(RgbdFrame<'static>, SegmentMap),
) -> BTreeSet<(usize, usize)> {
    let (width, height) = first.1.size();
    let all = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    all.filter(|at| {
        first.1[*at] != second.1[*at]
            || first.0.depth()[*at] != second.0.depth()[*at]
            || first.0.color()[*at] != second.0.color()[*at]
    })
    .collect()
}

fn only<Found>(movers: &[Mover], pick: impl Fn(Motion) -> Option<Found>) -> (u32, Found) {
    movers.iter().find_map(|mover| Some((mover.id, pick(mover.motion)?))).unwrap()
}

#[test]
fn kinds_take_turns_and_fewer_movers_are_the_first_of_more() {
    for seed in 0..6 {
        let movers = |count: usize| {
            let settings = SyntheticSettings { seed, moving: count, ..SyntheticSettings::default() };
            SyntheticScene::new(settings).unwrap().movers().to_vec()
        };
        let seven = movers(7);
        let kinds: String = seven
            .iter()
            .map(|mover| match mover.motion {
                Motion::Slide { .. } => 's',
                Motion::Vanish { .. } => 'v',
                Motion::Appear { .. } => 'a',
            })
            .collect();
        assert_eq!(kinds, "svasvas", "seed {seed}");
        assert_eq!(movers(2), seven[..2]);
        assert_eq!(movers(3), seven[..3]);
        let ids: BTreeSet<u32> = seven.iter().map(|mover| mover.id).collect();
        assert!(ids.len() == 7 && ids.iter().all(|id| (7..27).contains(id)), "{ids:?}");
        for mover in seven {
            match mover.motion {
                Motion::Slide { step, steps } => {
                    assert!((0.01..0.05).contains(&step.length()) && step.z == 0.0 && (3..=20).contains(&steps));
                }
                Motion::Vanish { frame } | Motion::Appear { frame } => assert!((20..=30).contains(&frame), "{frame}"),
            }
        }
    }
}

#[test]
fn a_pushed_thing_moves_and_the_rest_of_the_image_stays() {
    let scene = room("synthetic:frames=40,seed=1,width=160,height=120,moving=1,camera=static");
    let (id, ()) = only(scene.movers(), |motion| matches!(motion, Motion::Slide { .. }).then_some(()));
    let mut before = read(&scene, 0);
    for index in 1..12 {
        let now = read(&scene, index);
        let (was, is) = (pixels_of(&before.1, id), pixels_of(&now.1, id));
        assert!(was != is, "frame {index}: the mask moves");
        assert!(was.intersection(&is).count() * 2 > is.len(), "frame {index}: the masks overlap");
        let touched: BTreeSet<_> = was.union(&is).copied().collect();
        assert!(changed(&before, &now).is_subset(&touched), "frame {index}: something else changed");
        before = now;
    }
    assert_eq!(scene.read_frame(0).unwrap().world_from_camera(), before.0.world_from_camera());
}

#[test]
fn things_take_their_depth_ids_and_texture_along() {
    // Their patterns are strong enough for the test to fail if one stayed behind.
    for choice in ["seed=0", "seed=5,camera=static", "seed=10,camera=static"] {
        let text = format!("synthetic:frames=40,width=160,height=120,moving=3,{choice}");
        let scene = room(&text);
        let (id, motion) = only(scene.movers(), |motion| matches!(motion, Motion::Slide { .. }).then_some(motion));
        let first = (0..40).find(|index| pixels_of(&read(&scene, *index).1, id).len() > 150).unwrap();
        let (here, there) = (read(&scene, first), read(&scene, first + 2));
        let offset_at = |index: usize| motion.offset_at(index).unwrap();
        let moved: Vec3 = offset_at(first + 2) - offset_at(first);
        let (mut visible, mut same) = (0, 0);
        for (column, row) in pixels_of(&here.1, id) {
            let z = here.0.depth()[(column, row)];
            let point = here.0.intrinsics().unproject(Vec2::new(column as f32, row as f32), z);
            let point =
                there.0.world_from_camera().to_camera(here.0.world_from_camera().to_world(point) + moved.as_dvec3());
            let pixel = there.0.intrinsics().project(point).unwrap().round();
            if pixel.x < 0.0 || pixel.y < 0.0 || pixel.x > 159.0 || pixel.y > 119.0 {
                continue;
            }
            let at = (pixel.x as usize, pixel.y as usize);
            visible += 1;
            let color = here.0.color()[(column, row)];
            let same_color = there.0.color()[at].iter().zip(color).all(|(there, here)| there.abs_diff(here) < 20);
            same += usize::from(there.1[at] == id && (there.0.depth()[at] - point.z).abs() < 0.02 && same_color);
        }
        assert!(visible > 100 && same * 100 > visible * 85, "{text}: {same} of {visible}");
    }
}

#[test]
fn a_vanished_thing_reveals_its_background() {
    let scene = room(STILL);
    let (id, gone) = only(scene.movers(), |motion| match motion {
        Motion::Vanish { frame } => Some(frame),
        _ => None,
    });
    let has = |index: usize| !pixels_of(&read(&scene, index).1, id).is_empty();
    assert!((0..gone).all(has) && !(gone..40).any(has));
    let (before, after) = (read(&scene, gone - 1), read(&scene, gone));
    let slider = scene.movers()[0].id;
    let moved = [&before.1, &after.1].map(|ids| &pixels_of(ids, id) | &pixels_of(ids, slider));
    assert!(changed(&before, &after).is_subset(&(&moved[0] | &moved[1])), "something else changed");
    for at in pixels_of(&before.1, id) {
        if after.1[at] != slider {
            assert!(after.0.depth()[at] > before.0.depth()[at], "{at:?}");
        }
    }
}

#[test]
fn an_appearing_thing_hides_its_background() {
    let scene = room(STILL);
    let (id, come) = only(scene.movers(), |motion| match motion {
        Motion::Appear { frame } => Some(frame),
        _ => None,
    });
    let has = |index: usize| !pixels_of(&read(&scene, index).1, id).is_empty();
    assert!(!(0..come).any(has) && (come..40).all(has));
    let (before, after) = (read(&scene, come - 1), read(&scene, come));
    let slider = scene.movers()[0].id;
    let moved = [&before.1, &after.1].map(|ids| &pixels_of(ids, id) | &pixels_of(ids, slider));
    assert!(changed(&before, &after).is_subset(&(&moved[0] | &moved[1])), "something else changed");
    for at in pixels_of(&after.1, id) {
        if before.1[at] != slider {
            assert!(after.0.depth()[at] < before.0.depth()[at], "{at:?}");
        }
    }
}

#[test]
fn frames_with_movers_are_read_in_any_order() {
    let text = "synthetic:frames=40,seed=4,width=80,height=60,noise=kinect,moving=4";
    let forwards = room(text);
    let frames: Vec<_> = [3, 18, 25].map(|index| read(&forwards, index)).into();
    let backwards = room(text);
    for (index, frame) in [25, 18, 3].into_iter().zip(frames.into_iter().rev()) {
        assert_eq!(read(&backwards, index), frame, "frame {index}");
    }
}

#[test]
fn more_movers_than_movable_things_are_refused() {
    let asked = |text: &str| SyntheticScene::new(text.parse().unwrap()).map(|scene| scene.movers().len());
    // One of the 20 things has something on top.
    assert_eq!(asked("synthetic:moving=19").unwrap(), 19);
    let error = asked("synthetic:moving=20").unwrap_err().to_string();
    assert!(error.contains("moving: found \"20\", expected at most 19"), "{error}");
    assert_eq!(asked("synthetic:frames=1,objects=3,moving=3").unwrap(), 3);
}

#[test]
fn things_slow_down_with_the_camera() {
    let [fast, slow] = ["frames=60", "frames=1500,speed=0.04"]
        .map(|text| room(&format!("synthetic:{text},seed=4,width=64,height=48,moving=3")));
    let slide = |scene: &SyntheticScene| {
        only(scene.movers(), |motion| match motion {
            Motion::Slide { step, steps } => Some((step, steps)),
            _ => None,
        })
    };
    let ((fast_id, (fast_step, fast_steps)), (slow_id, (slow_step, slow_steps))) = (slide(&fast), slide(&slow));
    assert_eq!((fast_id, 25 * fast_steps), (slow_id, slow_steps));
    assert!((fast_step - 25.0 * slow_step).length() < 1e-6);
    let offset = |scene: &SyntheticScene, frame| scene.movers()[0].motion.offset_at(frame).unwrap();
    for frame in 0..60 {
        assert!((offset(&fast, frame) - offset(&slow, 25 * frame)).length() < 1e-4, "{frame}");
    }
    // Things still come and go after a third to half of the video.
    for mover in slow.movers() {
        if let Motion::Vanish { frame } | Motion::Appear { frame } = mover.motion {
            assert!((500..=750).contains(&frame), "{frame}");
        }
    }
    // 30 Hz, less than a round of the camera.
    assert_eq!(room("synthetic:frames=600,speed=0.04,moving=2").movers().len(), 2);
}

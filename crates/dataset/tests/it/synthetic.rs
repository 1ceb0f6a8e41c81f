//! Consistency of the synthetic room.

use glam::Vec2;
use rayon::ThreadPoolBuilder;
use splatseg_dataset::Scene;
use splatseg_test_scenes::{room, truth};
use std::collections::BTreeSet;

#[test]
fn neighbouring_frames_agree_on_places_and_ids() {
    let scene = room("synthetic:frames=40,seed=2,width=160,height=120");
    for first in [0, 13, 30] {
        let (here, there) = (scene.read_frame(first).unwrap(), scene.read_frame(first + 1).unwrap());
        let (ids_here, ids_there) = (truth(&scene, first), truth(&scene, first + 1));
        let (mut visible, mut same_id) = (0, 0);
        for row in 0..120 {
            for column in 0..160 {
                let z = here.depth()[(column, row)];
                let point = here.intrinsics().unproject(Vec2::new(column as f32, row as f32), z);
                let point_there = there.world_from_camera().to_camera(here.world_from_camera().to_world(point));
                let Some(pixel) = there.intrinsics().project(point_there).map(Vec2::round) else { continue };
                if pixel.x < 0.0 || pixel.y < 0.0 || pixel.x > 159.0 || pixel.y > 119.0 {
                    continue;
                }
                let at = (pixel.x as usize, pixel.y as usize);
                if (there.depth()[at] - point_there.z).abs() < 0.03 {
                    visible += 1;
                    same_id += usize::from(ids_there[at] == ids_here[(column, row)]);
                }
            }
        }
        assert!(visible > 160 * 120 * 6 / 10, "frame {first}: only {visible} pixels are seen in the next frame");
        assert!(same_id * 1000 > visible * 980, "frame {first}: {same_id} of {visible}");
    }
}

#[test]
fn frames_do_not_depend_on_the_number_of_threads_or_on_order() {
    let render = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let scene = room("synthetic:frames=9,seed=4,width=80,height=60,noise=kinect");
        pool.install(|| {
            (scene.read_frame(8).unwrap(), scene.read_frame(2).unwrap(), scene.read_ground_truth(8).unwrap())
        })
    };
    let once = render(1);
    assert_eq!(once, render(3));
    assert_ne!(once.0.depth(), once.1.depth());
}

#[test]
fn things_leave_and_come_back() {
    let scene = room("synthetic:frames=97,width=64,height=48");
    let seen: Vec<BTreeSet<u32>> =
        (0..97).map(|frame| scene.read_ground_truth(frame).unwrap().unwrap().areas().into_keys().collect()).collect();
    let all: BTreeSet<u32> = seen.iter().flatten().copied().collect();
    assert!(all.len() >= 22, "most of the 26 instances are seen: {all:?}");
    assert!(!all.contains(&0), "every pixel belongs to something");
    let returning = all
        .iter()
        .filter(|id| {
            let visible: Vec<bool> = seen.iter().map(|ids| ids.contains(*id)).collect();
            let first = visible.iter().position(|v| *v).unwrap();
            let gone = visible[first..].iter().position(|v| !*v);
            gone.is_some_and(|gone| visible[first + gone..].contains(&true))
        })
        .count();
    assert!(returning >= 10, "{returning} come back");
}

#[test]
fn kinect_noise_is_a_kinects() {
    let exact = room("synthetic:frames=3,seed=6").read_frame(1).unwrap();
    let noisy = room("synthetic:frames=3,seed=6,noise=kinect").read_frame(1).unwrap();
    let measured: Vec<(f32, f32)> = exact
        .depth()
        .pixels()
        .iter()
        .zip(noisy.depth().pixels())
        .filter(|(_, noisy)| **noisy > 0.0)
        .map(|(exact, noisy)| (*exact, *noisy))
        .collect();
    let share = measured.len() as f32 / exact.depth().pixels().len() as f32;
    assert!((0.7..0.995).contains(&share), "{share} of the pixels are measured");
    // Errors in units of the documented standard deviation.
    let squares = measured.iter().map(|(z, seen)| ((seen - z) / (0.0012 + 0.0019 * (z - 0.4).powi(2))).powi(2));
    let deviation = (squares.sum::<f32>() / measured.len() as f32).sqrt();
    assert!((0.95..1.05).contains(&deviation), "{deviation}");
    assert_eq!(exact.world_from_camera(), noisy.world_from_camera());
}

#[test]
fn seeds_make_rooms() {
    let first = room("synthetic:seed=1,width=64,height=48").read_frame(0).unwrap();
    assert_eq!(first, room("synthetic:seed=1,width=64,height=48").read_frame(0).unwrap());
    assert_ne!(first, room("synthetic:seed=2,width=64,height=48").read_frame(0).unwrap());
}

#[test]
fn a_static_camera_sees_the_first_frame_for_the_whole_video() {
    let (still, walking) = (room("synthetic:frames=9,camera=static"), room("synthetic:frames=9"));
    let first = walking.read_frame(0).unwrap();
    let last = still.read_frame(8).unwrap();
    assert_eq!((first.color(), first.depth()), (last.color(), last.depth()));
    assert_eq!(first.world_from_camera(), last.world_from_camera());
    assert_ne!(first.world_from_camera(), walking.read_frame(8).unwrap().world_from_camera());
}

/// Frame, pixel, id, depth and colour, recorded before moving things were added.
type Seen = (usize, (usize, usize), u32, f32, [u8; 3]);

#[test]
fn rooms_in_which_nothing_moves_stay_as_they_were() {
    let expected: [Seen; 8] = [
        (0, (5, 5), 5, 4.1753974, [86, 56, 98]),
        (0, (32, 40), 1, 2.6582143, [78, 110, 130]),
        (0, (40, 30), 5, 3.8103998, [124, 121, 163]),
        (0, (50, 20), 5, 3.4429955, [92, 60, 105]),
        (31, (20, 24), 1, 3.3206618, [63, 87, 104]),
        (31, (32, 40), 15, 1.365843, [206, 170, 170]),
        (31, (50, 20), 12, 2.9397671, [87, 110, 91]),
        (31, (60, 44), 1, 1.9610363, [66, 102, 117]),
    ];
    for text in ["synthetic:frames=60,seed=3,width=64,height=48", "synthetic:seed=3,width=64,height=48,moving=0"] {
        let scene = room(text);
        assert_eq!(scene.name(), "synthetic:frames=60,seed=3,width=64,height=48,objects=20,noise=none");
        assert!(scene.movers().is_empty());
        for (index, at, id, depth, color) in expected {
            let frame = scene.read_frame(index).unwrap();
            assert_eq!(scene.read_ground_truth(index).unwrap().unwrap()[at], id, "frame {index}, {at:?}");
            // Sines differ in the last digit between platforms.
            assert!((frame.depth()[at] - depth).abs() < 1e-3, "frame {index}, {at:?}");
            assert!(frame.color()[at].iter().zip(color).all(|(found, value)| found.abs_diff(value) <= 1));
        }
    }
}

#[test]
fn a_slow_camera_passes_the_same_views_with_more_frames() {
    let fast = room("synthetic:frames=9,seed=3,width=64,height=48,objects=8");
    let slow = room("synthetic:frames=200,seed=3,width=64,height=48,objects=8,speed=0.04");
    for index in [0, 1, 7] {
        let (fast, slow) = (fast.read_frame(index).unwrap(), slow.read_frame(25 * index).unwrap());
        assert_eq!(fast.world_from_camera(), slow.world_from_camera());
        assert_eq!((fast.color(), fast.depth()), (slow.color(), slow.depth()));
    }
    for index in 0..60 {
        let [here, there] = [index, index + 1].map(|index| *slow.read_frame(index).unwrap().world_from_camera());
        let step = here.inverse() * there;
        assert!((0.004..0.008).contains(&step.translation().length()), "{index}: {}", step.translation().length());
        let turn = glam::DQuat::from_mat3(&step.rotation()).to_axis_angle().1.to_degrees();
        assert!((0.02..0.7).contains(&turn), "{index}: {turn}");
    }
}

#[test]
fn the_default_speed_changes_no_byte() {
    let text = "synthetic:frames=60,seed=3,width=64,height=48,objects=8,moving=3";
    let (default, one) = (room(text), room(&format!("{text},speed=1")));
    assert_eq!((default.name(), default.movers()), (one.name(), one.movers()));
    assert_eq!(default.read_frame(59).unwrap(), one.read_frame(59).unwrap());
}

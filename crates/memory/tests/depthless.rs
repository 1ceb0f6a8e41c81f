//! Segments without depth, in a room made by hand: a wall, a floor, and black regions on them.

use glam::{DVec3, EulerRot, Mat4, Quat, Vec2, Vec3};
use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{ABSTAIN, MemoryKind, MemorySettings, SplatMemory};

const CAMERA: Intrinsics = Intrinsics { fx: 260.0, fy: 260.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
/// What is seen at a pixel of the room.
const WALL: SegmentId = 1;
const FLOOR: SegmentId = 2;
const SCREEN: SegmentId = 3;
const MAT: SegmentId = 4;

/// The wall is at z = 3 and the floor at y = 1; the screen hangs on the wall, the mat lies on the floor.
fn hit(origin: Vec3, ray: Vec3) -> (SegmentId, Vec3) {
    let (to_wall, to_floor) = ((3.0 - origin.z) / ray.z, (1.0 - origin.y) / ray.y);
    if to_floor > 0.0 && to_floor < to_wall {
        let point = origin + ray * to_floor;
        let is_mat = (-0.6..0.4).contains(&point.x) && (2.0..2.6).contains(&point.z);
        return (if is_mat { MAT } else { FLOOR }, point);
    }
    let point = origin + ray * to_wall;
    let is_screen = (-0.7..0.7).contains(&point.x) && (-0.8..0.1).contains(&point.y);
    (if is_screen { SCREEN } else { WALL }, point)
}

/// The room from `pose`: depth but for screen and mat, and what is seen.
fn view(pose: &Pose) -> (RgbdFrame<'static>, SegmentMap) {
    let local = pose.relative_to(DVec3::ZERO);
    let ray = |column: usize, row: usize| CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0);
    let hits = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| {
        hit(local.translation(), local.rotation() * ray(column, row))
    });
    let truth = hits.map(|(id, _)| *id);
    let depth = hits.map(|(id, point)| if *id >= SCREEN { 0.0 } else { local.to_camera(*point).z });
    (frame(depth, *pose), truth)
}

fn frame(depth: Image<f32>, pose: Pose) -> RgbdFrame<'static> {
    let color = Image::filled(depth.width(), depth.height(), [90; 3]);
    RgbdFrame::new("0", color, depth, CAMERA, pose).unwrap()
}

fn pose(position: Vec3, yaw: f32, pitch: f32) -> Pose {
    let rotation = Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0);
    Pose::from_matrix(Mat4::from_rotation_translation(rotation, position).as_dmat4()).unwrap()
}

fn memory(settings: MemorySettings, ids: usize) -> SplatMemory {
    let mut memory = SplatMemory::new(settings, 0, &mut |_| {}).unwrap();
    assert!((0..ids).all(|_| memory.new_segment().is_ok()));
    memory
}

/// Feeds the room to a new memory and returns, for every frame but the first, how well it expects `id` (IoU).
fn agreements(poses: impl Iterator<Item = Pose>, id: SegmentId, settings: MemorySettings) -> Vec<f64> {
    let mut memory = memory(settings, 4);
    let all = poses.map(|pose| {
        let (frame, truth) = view(&pose);
        let recall = memory.recall(&frame);
        let found = recall.expected().segments.mask_of(id).iou(&truth.mask_of(id));
        memory.update(recall, &truth).unwrap();
        found
    });
    let mut all: Vec<f64> = all.collect();
    assert_eq!(all.remove(0), 0.0, "nothing is expected of an empty memory");
    all
}

fn worst(agreements: &[f64]) -> f64 {
    agreements.iter().copied().fold(1.0, f64::min)
}

/// A walk of 30 frames: sideways, forward and up, turning and nodding.
fn walk() -> impl Iterator<Item = Pose> {
    (0..30).map(|number| {
        let time = number as f32;
        let position = Vec3::new(-0.4 + 0.03 * time, 0.1 * (0.2 * time).sin(), 0.015 * time);
        pose(position, 0.15 - 0.01 * time, -0.12 + 0.05 * (0.3 * time).sin())
    })
}

#[test]
fn a_screen_is_expected_where_it_is() {
    let still = agreements((0..30).map(|_| Pose::IDENTITY), SCREEN, MemorySettings::default());
    assert!(worst(&still) > 0.9, "{still:?}");
    let moving = agreements(walk(), SCREEN, MemorySettings::default());
    assert!(worst(&moving) > 0.8, "{moving:?}");
}

#[test]
fn a_mat_is_expected_on_the_floor_and_not_parallel_to_the_image() {
    let moving = agreements(walk(), MAT, MemorySettings::default());
    assert!(worst(&moving) > 0.8, "{moving:?}");
}

#[test]
fn long_steps_are_predicted_too() {
    let steps = [(0.0, 0.0, 0.0), (0.5, 0.3, -0.15), (-0.4, 0.6, 0.1), (0.2, -0.3, 0.0)];
    let poses = || steps.into_iter().map(|(x, z, yaw)| pose(Vec3::new(x, 0.0, z), yaw, -0.15));
    for id in [SCREEN, MAT] {
        let found = agreements(poses(), id, MemorySettings::default());
        assert!(worst(&found) > 0.8, "{id}: {found:?}");
    }
}

#[test]
fn a_screen_keeps_its_id_when_new_ids_are_given_to_what_is_not_expected() {
    let mut memory = memory(MemorySettings::default(), 2);
    for pose in walk() {
        let (frame, truth) = view(&pose);
        let recall = memory.recall(&frame);
        let expected = &recall.expected().segments;
        let mut name = |id: SegmentId| {
            let mask = truth.mask_of(id);
            let known =
                (3..=memory.segment_count() as SegmentId).find(|known| expected.mask_of(*known).iou(&mask) > 0.5);
            known.unwrap_or_else(|| memory.new_segment().unwrap())
        };
        let names = [0, WALL, FLOOR, name(SCREEN), name(MAT)];
        memory.update(recall, &truth.map(|id| names[*id as usize])).unwrap();
    }
    assert_eq!(memory.segment_count(), 4);
}

#[test]
fn it_is_still_known_when_the_camera_comes_back() {
    // Out of view for ten frames, and at the image's border before and after.
    let there = (0..20).map(|number| 0.08 * number as f32);
    let poses = there.clone().chain(there.rev()).map(|yaw| pose(Vec3::ZERO, yaw, 0.0));
    let found = agreements(poses, SCREEN, MemorySettings::default());
    assert!(found[30..].iter().all(|iou| *iou > 0.8), "{found:?}");
}

#[test]
fn without_any_depth_the_rotation_alone_links() {
    let is_inside = |direction: Vec3| direction.x.abs() < 0.3 && direction.y.abs() < 0.2;
    let mut memory = memory(MemorySettings::default(), 2);
    for number in 0..30 {
        let pose = pose(Vec3::ZERO, 0.01 * number as f32, 0.1 * (0.3 * number as f32).sin());
        let seen = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| {
            let direction = pose.rotation().as_mat3() * CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0);
            if is_inside(direction / direction.z) { 1 } else { 2 }
        });
        let frame = frame(Image::filled(CAMERA.width, CAMERA.height, 0.0), pose);
        let recall = memory.recall(&frame);
        if number > 0 {
            for id in [1, 2] {
                let found = recall.expected().segments.mask_of(id).iou(&seen.mask_of(id));
                assert!(found > 0.8, "frame {number}, id {id}: {found}");
            }
        }
        let update = memory.update(recall, &seen).unwrap();
        assert_eq!((update.grown, update.forgotten), (0, vec![]));
    }
}

#[test]
fn it_is_not_expected_where_there_is_depth() {
    let mut memory = memory(MemorySettings::default(), 4);
    let (frame_before, truth) = view(&Pose::IDENTITY);
    for _ in 0..3 {
        let recall = memory.recall(&frame_before);
        memory.update(recall, &truth).unwrap();
    }
    // Someone stands before the left part of the screen.
    let is_hidden = |column: usize| (110..150).contains(&column);
    let depth = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| {
        if is_hidden(column) { 1.0 } else { frame_before.depth()[(column, row)] }
    });
    let frame = frame(depth, Pose::IDENTITY);
    let recall = memory.recall(&frame);
    let belief = recall.expected();
    let screen = Mask::from_fn(CAMERA.width, CAMERA.height, |column, row| {
        (105..215).contains(&column) && (56..120).contains(&row)
    });
    for index in screen.pixel_indices() {
        let at = (index % CAMERA.width, index / CAMERA.width);
        assert_eq!(truth[at], SCREEN);
        let expected = if is_hidden(at.0) { (0, 0.0) } else { (SCREEN, 0.7) };
        assert_eq!((belief.segments[at], belief.confidence[at]), expected, "{at:?}");
    }
}

#[test]
fn the_map_is_not_overruled() {
    let off = MemorySettings::default().with(|settings| settings.depthless = false);
    let (mut with, mut without) = (memory(MemorySettings::default(), 4), memory(off.clone(), 4));
    for pose in walk() {
        let (frame, truth) = view(&pose);
        let (one, other) = (with.recall(&frame), without.recall(&frame));
        let (one_belief, other_belief) = (one.expected(), other.expected());
        for index in 0..truth.pixels().len() {
            let (more, map) = (one_belief.segments.pixels()[index], other_belief.segments.pixels()[index]);
            let is_added = map == 0 && frame.depth().pixels()[index] == 0.0;
            assert!(more == map || is_added);
        }
        assert_eq!(with.fuse(&one, &truth).unwrap(), without.fuse(&other, &truth).unwrap());
        with.update(one, &truth).unwrap();
        without.update(other, &truth).unwrap();
    }
    assert_eq!((with.balls(), with.segment_ids()), (without.balls(), without.segment_ids()));
    assert!(worst(&agreements(walk(), SCREEN, off)) < 0.2);
    let paper = MemorySettings::default().with(|settings| {
        settings.kind = MemoryKind::Features;
        settings.num_codes = 8;
        settings.feature_dim = 4;
    });
    assert!(worst(&agreements(walk().take(3), SCREEN, paper)) < 0.2);
}

#[test]
fn what_is_gone_is_forgotten() {
    let mut memory = memory(MemorySettings::default(), 4);
    let (frame_before, truth) = view(&Pose::IDENTITY);
    for _ in 0..3 {
        let recall = memory.recall(&frame_before);
        memory.update(recall, &truth).unwrap();
    }
    // The screen is taken off the wall; the mat is missed by the segmenter, which says nothing.
    let depth = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| match truth[(column, row)] {
        SCREEN => 3.0,
        _ => frame_before.depth()[(column, row)],
    });
    let after = frame(depth, Pose::IDENTITY);
    let seen = truth.map(|id| match *id {
        SCREEN => WALL,
        MAT => 0,
        id => id,
    });
    let mut forgotten = Vec::new();
    for _ in 0..64 {
        let recall = memory.recall(&after);
        forgotten.extend(memory.update(recall, &seen).unwrap().forgotten);
    }
    assert_eq!(forgotten, [SCREEN]);
    let recall = memory.recall(&after);
    assert!(recall.expected().segments.mask_of(MAT).iou(&truth.mask_of(MAT)) > 0.8);
}

#[test]
fn another_id_in_its_place_takes_over() {
    let mut memory = memory(MemorySettings::default(), 5);
    let (frame, truth) = view(&Pose::IDENTITY);
    let other = truth.map(|id| if *id == SCREEN { 5 } else { *id });
    for seen in [&truth, &truth, &other] {
        let recall = memory.recall(&frame);
        memory.update(recall, seen).unwrap();
    }
    let recall = memory.recall(&frame);
    let expected = recall.expected().segments.areas();
    assert!(expected[&5] > 4000 && expected.get(&SCREEN).copied().unwrap_or(0) < 800, "{expected:?}");
}

#[test]
fn no_more_than_a_fixed_number_is_remembered() {
    // 300 tiles of 16x16 pixels, all without depth.
    let seen =
        SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| (row / 16 * 20 + column / 16) as SegmentId + 1);
    let frame = frame(Image::filled(CAMERA.width, CAMERA.height, 0.0), Pose::IDENTITY);
    let mut memory = memory(MemorySettings::default(), 300);
    for _ in 0..3 {
        let recall = memory.recall(&frame);
        memory.update(recall, &seen).unwrap();
    }
    let recall = memory.recall(&frame);
    let expected = recall.expected().segments.areas();
    assert_eq!(expected.keys().copied().collect::<Vec<_>>(), (1..=256).collect::<Vec<_>>());
    assert!(expected.values().all(|area| *area == 256));
}

/// Numbers without a pattern, the same in every run.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end
    }

    fn signed(&mut self, most: f32) -> f32 {
        (self.below(2001) as f32 / 1000.0 - 1.0) * most
    }
}

#[test]
fn any_input_gives_the_same_for_any_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut numbers = Numbers(7);
            let mut memory = memory(MemorySettings::default(), 12);
            let mut beliefs = Vec::new();
            for _ in 0..40 {
                let position = Vec3::new(numbers.signed(3.0), numbers.signed(1.0), numbers.signed(4.0));
                let pose = pose(position, numbers.signed(3.0), numbers.signed(1.5));
                let side = 1 + numbers.below(30) as usize;
                let depth = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| {
                    let tile = column / side + row / side;
                    if tile.is_multiple_of(3) || numbers.below(9) == 0 {
                        0.0
                    } else {
                        0.2 + numbers.below(1000) as f32 * 0.01
                    }
                });
                let ids: Vec<SegmentId> = (0..50).map(|_| numbers.below(14) as SegmentId).collect();
                let seen = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| {
                    match ids[(column / side + 7 * (row / side)) % 50] {
                        13 => ABSTAIN,
                        id => id,
                    }
                });
                let frame = frame(depth, pose);
                let recall = memory.recall(&frame);
                beliefs.push(recall.expected().clone());
                memory.update(recall, &seen).unwrap();
            }
            beliefs
        })
    };
    assert!(run(1) == run(3));
}

#[test]
fn cameras_may_differ_in_size() {
    let mut memory = memory(MemorySettings::default(), 1);
    let mut look = |width: usize, height: usize| {
        let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, 0.0));
        let frame = RgbdFrame::new("0", color, depth, CAMERA.resized(width, height), Pose::IDENTITY).unwrap();
        let seen = SegmentMap::from_fn(width, height, |column, _| u32::from(2 * column < width));
        let recall = memory.recall(&frame);
        let found = recall.expected().segments.mask_of(1).iou(&seen.mask_of(1));
        memory.update(recall, &seen).unwrap();
        found
    };
    assert_eq!(look(160, 120), 0.0);
    assert!([look(80, 60), look(200, 150), look(160, 120)].into_iter().all(|iou| iou > 0.9));
    look(1, 1);
}

//! Segments without depth in a simple room: a wall, a floor, and black regions on them.

use glam::{DVec3, EulerRot, Mat4, Quat, Vec2, Vec3};
use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, SegmentId, SegmentMap, SurfaceKind};
use splatseg_memory::{MemorySettings, SplatFile, SplatMemory};
use splatseg_test_scenes::grey_frame;
use std::collections::BTreeSet;

const CAMERA: Intrinsics = Intrinsics { fx: 260.0, fy: 260.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
/// Ids of the room's surfaces.
const WALL: SegmentId = 1;
const FLOOR: SegmentId = 2;
const SCREEN: SegmentId = 3;
const MAT: SegmentId = 4;

/// Returns the id and the point that a ray hits. The wall is at z = 3 and the floor at y = 1; the screen hangs on the
/// wall, the mat lies on the floor.
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

/// Renders the room from `pose`: a frame with depth except on screen and mat, and the true ids.
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
    grey_frame("0", CAMERA, depth, pose)
}

fn pose(position: Vec3, yaw: f32, pitch: f32) -> Pose {
    let rotation = Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0);
    Pose::from_matrix(Mat4::from_rotation_translation(rotation, position).as_dmat4()).unwrap()
}

fn memory(ids: usize) -> SplatMemory {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    assert!((0..ids).all(|_| memory.new_segment().is_ok()));
    memory
}

/// Shows the room to a new memory. Returns the IoU of the expected and the true mask of `id` for every frame except the
/// first.
fn agreements(poses: impl Iterator<Item = Pose>, id: SegmentId) -> Vec<f64> {
    let mut memory = memory(4);
    let all = poses.map(|pose| {
        let (frame, truth) = view(&pose);
        let recall = memory.recall(&frame);
        let found = recall.expected().segments.mask_of(id).iou(&truth.mask_of(id));
        memory.update(recall, &truth, &BTreeSet::new()).unwrap();
        found
    });
    let mut all: Vec<f64> = all.collect();
    assert_eq!(all.remove(0), 0.0, "an empty memory expects nothing");
    all
}

/// Facts about the Gaussians of an id.
fn kinds(memory: &SplatMemory, id: SegmentId) -> Vec<SurfaceKind> {
    let known = memory.map().segment_ids().into_iter().zip(memory.map().surfaces);
    known.filter(|(shown, _)| *shown == id).map(|(_, surface)| *surface).collect()
}

fn learn(memory: &mut SplatMemory, frame: &RgbdFrame<'_>, predicted: &SegmentMap) {
    let recall = memory.recall(frame);
    memory.update(recall, predicted, &BTreeSet::new()).unwrap();
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
    let still = agreements((0..30).map(|_| Pose::IDENTITY), SCREEN);
    assert!(worst(&still) > 0.9, "{still:?}");
    let moving = agreements(walk(), SCREEN);
    assert!(worst(&moving) > 0.8, "{moving:?}");
}

#[test]
fn a_mat_is_expected_on_the_floor_and_not_parallel_to_the_image() {
    let moving = agreements(walk(), MAT);
    assert!(worst(&moving) > 0.8, "{moving:?}");
}

#[test]
fn long_steps_are_predicted_too() {
    let steps = [(0.0, 0.0, 0.0), (0.5, 0.3, -0.15), (-0.4, 0.6, 0.1), (0.2, -0.3, 0.0)];
    let poses = || steps.into_iter().map(|(x, z, yaw)| pose(Vec3::new(x, 0.0, z), yaw, -0.15));
    for id in [SCREEN, MAT] {
        let found = agreements(poses(), id);
        assert!(worst(&found) > 0.8, "{id}: {found:?}");
    }
}

#[test]
fn a_screen_keeps_its_id_when_unexpected_masks_get_new_ids() {
    let mut memory = memory(2);
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
        memory.update(recall, &truth.map(|id| names[*id as usize]), &BTreeSet::new()).unwrap();
    }
    assert_eq!(memory.segment_count(), 4);
}

#[test]
fn a_screen_is_still_expected_when_the_camera_comes_back() {
    // The screen is out of view for ten frames, and at the image's border before and after.
    let there = (0..20).map(|number| 0.08 * number as f32);
    let poses = there.clone().chain(there.rev()).map(|yaw| pose(Vec3::ZERO, yaw, 0.0));
    let found = agreements(poses, SCREEN);
    assert!(found[30..].iter().all(|iou| *iou > 0.8), "{found:?}");
}

#[test]
fn without_any_depth_the_rotation_alone_links_frames() {
    let is_inside = |direction: Vec3| direction.x.abs() < 0.3 && direction.y.abs() < 0.2;
    let mut memory = memory(2);
    for number in 0..30 {
        let pose = pose(Vec3::ZERO, 0.01 * number as f32, 0.1 * (0.3 * number as f32).sin());
        let predicted = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| {
            let direction = pose.rotation().as_mat3() * CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0);
            if is_inside(direction / direction.z) { 1 } else { 2 }
        });
        let frame = frame(Image::filled(CAMERA.width, CAMERA.height, 0.0), pose);
        let recall = memory.recall(&frame);
        if number > 0 {
            for id in [1, 2] {
                let found = recall.expected().segments.mask_of(id).iou(&predicted.mask_of(id));
                assert!(found > 0.8, "frame {number}, id {id}: {found}");
            }
        }
        let update = memory.update(recall, &predicted, &BTreeSet::new()).unwrap();
        assert!(update.forgotten.is_empty());
    }
}

#[test]
fn a_screen_is_not_expected_where_there_is_depth() {
    let mut memory = memory(4);
    let (frame_before, truth) = view(&Pose::IDENTITY);
    for _ in 0..3 {
        let recall = memory.recall(&frame_before);
        memory.update(recall, &truth, &BTreeSet::new()).unwrap();
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
        let expected = if is_hidden(at.0) { 0 } else { SCREEN };
        assert_eq!(belief.segments[at], expected, "{at:?}");
    }
}

#[test]
fn a_removed_screen_is_forgotten() {
    let mut memory = memory(4);
    let (frame_before, truth) = view(&Pose::IDENTITY);
    for _ in 0..3 {
        let recall = memory.recall(&frame_before);
        memory.update(recall, &truth, &BTreeSet::new()).unwrap();
    }
    // The screen is taken off the wall. The segmenter misses the mat, which must not be forgotten.
    let depth = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| match truth[(column, row)] {
        SCREEN => 3.0,
        _ => frame_before.depth()[(column, row)],
    });
    let after = frame(depth, Pose::IDENTITY);
    let predicted = truth.map(|id| match *id {
        SCREEN => WALL,
        MAT => 0,
        id => id,
    });
    let mut forgotten = Vec::new();
    for _ in 0..20 {
        let recall = memory.recall(&after);
        forgotten.extend(memory.update(recall, &predicted, &BTreeSet::new()).unwrap().forgotten);
    }
    assert_eq!(forgotten, [SCREEN]);
    let recall = memory.recall(&after);
    assert!(recall.expected().segments.mask_of(MAT).iou(&truth.mask_of(MAT)) > 0.8);
}

#[test]
fn another_id_in_the_place_of_a_screen_takes_over() {
    let mut memory = memory(5);
    let (frame, truth) = view(&Pose::IDENTITY);
    let other = truth.map(|id| if *id == SCREEN { 5 } else { *id });
    for predicted in [&truth, &truth, &other, &other, &other] {
        let recall = memory.recall(&frame);
        memory.update(recall, predicted, &BTreeSet::new()).unwrap();
    }
    let recall = memory.recall(&frame);
    let expected = recall.expected().segments.areas();
    assert!(
        expected.get(&5).copied().unwrap_or(0) > 4000 && expected.get(&SCREEN).copied().unwrap_or(0) < 800,
        "{expected:?}"
    );
}

/// Pseudorandom numbers, the same in every run.
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
fn results_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut numbers = Numbers(7);
            let mut memory = memory(12);
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
                let ids: Vec<SegmentId> = (0..50).map(|_| numbers.below(13) as SegmentId).collect();
                let predicted = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| {
                    ids[(column / side + 7 * (row / side)) % 50]
                });
                let frame = frame(depth, pose);
                let recall = memory.recall(&frame);
                beliefs.push(recall.expected().clone());
                memory.update(recall, &predicted, &BTreeSet::new()).unwrap();
            }
            beliefs
        })
    };
    assert!(run(1) == run(3));
}

#[test]
fn cameras_may_differ_in_size() {
    let mut memory = memory(1);
    let mut look = |width: usize, height: usize| {
        let depth = Image::filled(width, height, 0.0);
        let frame = grey_frame("0", CAMERA.resized(width, height), depth, Pose::IDENTITY);
        let predicted = SegmentMap::from_fn(width, height, |column, _| u32::from(2 * column < width));
        let recall = memory.recall(&frame);
        let found = recall.expected().segments.mask_of(1).iou(&predicted.mask_of(1));
        memory.update(recall, &predicted, &BTreeSet::new()).unwrap();
        found
    };
    assert_eq!(look(160, 120), 0.0);
    assert!([look(80, 60), look(200, 150), look(160, 120)].into_iter().all(|iou| iou > 0.9));
    look(1, 1);
}

#[test]
fn gaussians_know_whether_depth_was_measured_where_they_lie() {
    use SurfaceKind::{Continued, Observed};
    let (frame_before, truth) = view(&Pose::IDENTITY);
    let mut memory = memory(4);
    for _ in 0..3 {
        learn(&mut memory, &frame_before, &truth);
    }
    for id in [WALL, FLOOR] {
        assert!(kinds(&memory, id).iter().all(|kind| *kind == Observed), "{id}");
    }
    for id in [SCREEN, MAT] {
        let of_id = kinds(&memory, id);
        assert!(of_id.len() > 20 && of_id.iter().filter(|kind| **kind == Continued).count() * 2 > of_id.len());
    }
    // A later frame has depth on the screen, where it was assumed to be.
    let depth = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| match truth[(column, row)] {
        SCREEN => 3.0,
        _ => frame_before.depth()[(column, row)],
    });
    learn(&mut memory, &frame(depth, Pose::IDENTITY), &truth);
    assert!(kinds(&memory, SCREEN).iter().all(|kind| *kind == Observed));
    assert!(kinds(&memory, MAT).contains(&Continued));
}

#[test]
fn what_continues_nothing_measured_has_no_place() {
    let left = |column: usize| column < 160;
    let mut memory = memory(2);
    let blind = frame(Image::filled(CAMERA.width, CAMERA.height, 0.0), Pose::IDENTITY);
    let only_left = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, _| u32::from(left(column)));
    learn(&mut memory, &blind, &only_left);
    assert!(!kinds(&memory, 1).is_empty() && kinds(&memory, 1).iter().all(|kind| !kind.has_place()));
    // The right half lies beside it, so it continues the plane of the left one: but that was not measured.
    let both = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, _| if left(column) { 1 } else { 2 });
    learn(&mut memory, &blind, &both);
    assert!(!kinds(&memory, 2).is_empty() && kinds(&memory, 2).iter().all(|kind| !kind.has_place()));
}

#[test]
fn what_is_known_about_places_survives_saving_removal_and_jumps() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.ply");
    let (first, truth) = view(&Pose::IDENTITY);
    let mut memory = memory(5);
    // A window above the wall: no depth, and none around it.
    let window = |column: usize, row: usize| (20..60).contains(&column) && row < 100;
    let gap = |column: usize, row: usize| (0..80).contains(&column) && row < 120;
    let depth =
        Image::from_fn(
            CAMERA.width,
            CAMERA.height,
            |column, row| {
                if gap(column, row) { 0.0 } else { first.depth()[(column, row)] }
            },
        );
    let predicted = SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| match gap(column, row) {
        true => {
            if window(column, row) {
                5
            } else {
                0
            }
        }
        false => truth[(column, row)],
    });
    for _ in 0..2 {
        learn(&mut memory, &frame(depth.clone(), Pose::IDENTITY), &predicted);
    }
    assert!(!kinds(&memory, 5).is_empty() && kinds(&memory, 5).iter().all(|kind| *kind == SurfaceKind::Assumed));
    memory.save(&path).unwrap();
    assert_eq!(SplatFile::load(&path).unwrap().surfaces().unwrap(), memory.map().surfaces);
    let mut loaded = SplatMemory::load(&path, MemorySettings::default()).unwrap();
    assert_eq!(loaded.map().surfaces, memory.map().surfaces);

    // The poses jump by a metre. Then the wall stands farther back: its Gaussians are removed.
    let jumped = Pose::from_translation(DVec3::new(1.0, 0.0, 0.0));
    for memory in [&mut memory, &mut loaded] {
        learn(memory, &frame(depth.clone(), jumped), &predicted);
        let farther = depth.map(|depth| if *depth > 0.0 { depth + 1.0 } else { 0.0 });
        for _ in 0..12 {
            learn(memory, &frame(farther.clone(), jumped), &predicted);
        }
        assert_eq!(memory.map().surfaces.len(), memory.gaussian_count());
        let far = memory.map().means.iter().zip(memory.map().surfaces).filter(|(mean, _)| mean.z > 40.0);
        assert!(far.clone().count() > 0 && far.clone().all(|(_, surface)| *surface == SurfaceKind::Assumed));
    }
    assert_eq!(loaded.map().surfaces, memory.map().surfaces);

    // A damaged list is refused.
    let mut file = SplatFile::load(&path).unwrap();
    let runs: Vec<u64> = file.saved_state.get("memory.surfaces", &[2]).unwrap();
    file.saved_state.put("memory.surfaces", &[2], [0, 1].into_iter().chain(runs));
    assert!(file.surfaces().unwrap_err().to_string().contains("surfaces of"));
    file.save(&path).unwrap();
    let refused = SplatMemory::load(&path, MemorySettings::default()).unwrap_err().to_string();
    assert!(refused.contains("map.ply") && refused.contains("surfaces of"), "{refused}");
}

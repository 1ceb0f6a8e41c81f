//! Objects decided from the affinities of all frames, where the votes of the last frames say something else.

use glam::DVec3;
use splatseg_geometry::{
    Affinities, AffinityPlane, FrameAnchor, Intrinsics, MapCorrection, Pose, RgbdFrame, SegmentId, SegmentMap,
    Segmentation,
};
use splatseg_memory::{MemoryError, MemorySettings, SplatMemory};
use splatseg_test_scenes::wall;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

const SIZE: (usize, usize) = (64, 48);
const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width: SIZE.0, height: SIZE.1 };

/// Columns and rows of the grid of affinities.
const GRID: (usize, usize) = (32, 24);

/// Columns of the frame that show the left half of the wall, seen from `pose`.
fn middle(pose: &Pose) -> f64 {
    31.5 - pose.translation().x * 60.0 / 2.0
}

fn halves(left: SegmentId, right: SegmentId, pose: &Pose) -> SegmentMap {
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| if (column as f64) < middle(pose) { left } else { right })
}

/// Output of a segmenter that separates the two halves: stripes that do not cross the middle, and affinities.
fn found(pose: &Pose, log_odds: f32) -> Segmentation {
    let is_left = |column: usize| ((2 * column) as f64) < middle(pose);
    let plane = |(right, down): (i32, i32)| {
        let log_odds = |place: usize| {
            let (one, other) = (place % GRID.0, (place % GRID.0) as i32 + right);
            let is_same = is_left(one) == is_left(other.max(0) as usize);
            Affinities::quantised(if is_same { log_odds } else { -log_odds })
        };
        AffinityPlane { right, down, log_odds: (0..GRID.0 * GRID.1).map(log_odds).collect() }
    };
    let places = |count: usize| (0..count as u32).map(|place| 2 * place).collect();
    let affinities = Affinities {
        columns: places(GRID.0),
        rows: places(GRID.1),
        planes: [(1, 0), (0, 1), (9, 0), (-9, 9)].map(plane).into(),
    };
    let region = |column: usize| 1 + column as u32 / 8 + if (column as f64) < middle(pose) { 0 } else { 20 };
    let regions = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| region(column));
    Segmentation { masks: Vec::new(), regions: Some(regions), affinities: Some(affinities) }
}

fn memory() -> SplatMemory {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    (1..=3).for_each(|id| assert_eq!(memory.new_segment().unwrap(), id));
    memory
}

fn frame(pose: Pose) -> RgbdFrame<'static> {
    wall("0", CAMERA, 2.0, pose)
}

/// Learns a frame `times` times, in which the halves of the wall have these ids.
fn see(memory: &mut SplatMemory, pose: Pose, ids: (SegmentId, SegmentId), log_odds: f32, times: usize) {
    for _ in 0..times {
        let frame = frame(pose);
        let recall = memory.recall(&frame);
        let (predicted, found) = (halves(ids.0, ids.1, &pose), found(&pose, log_odds));
        memory.update_with_affinities(recall, &predicted, &BTreeSet::new(), &found).unwrap();
    }
}

/// The ids that most pixels of the left and the right quarter of the wall show.
fn shown(memory: &SplatMemory) -> (SegmentId, SegmentId) {
    let segments = memory.look_again(&frame(Pose::IDENTITY), &SegmentMap::filled(SIZE.0, SIZE.1, 0)).segments;
    let most = |columns: std::ops::Range<usize>| {
        let mut areas: BTreeMap<SegmentId, usize> = BTreeMap::new();
        for (column, row) in columns.flat_map(|column| (0..SIZE.1).map(move |row| (column, row))) {
            *areas.entry(segments[(column, row)]).or_default() += 1;
        }
        areas.into_iter().max_by_key(|(_, area)| *area).map_or(0, |(id, _)| id)
    };
    (most(8..24), most(40..56))
}

#[test]
fn a_few_wrong_frames_change_nothing_for_good() {
    let mut memory = memory();
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 12);
    // Wrong, and unsure.
    see(&mut memory, Pose::IDENTITY, (1, 1), -0.25, 6);
    assert_eq!(shown(&memory), (1, 1), "votes fade");
    assert!(memory.settle());
    assert_eq!(shown(&memory), (1, 2));
    assert!(memory.settle(), "again");
    assert_eq!(shown(&memory), (1, 2));
    assert_eq!(memory.segment_count(), 3);
}

#[test]
fn one_object_under_two_ids_becomes_one_and_two_under_one_become_two() {
    let mut memory = memory();
    // Where a segment ends, Gaussians are small.
    see(&mut memory, Pose::IDENTITY, (3, 1), 6.0, 1);
    see(&mut memory, Pose::IDENTITY, (3, 3), 6.0, 8);
    assert_eq!(shown(&memory), (3, 3));
    memory.settle();
    assert_eq!(shown(&memory), (3, 3), "the evidence of nine frames counts less than four votes");
    see(&mut memory, Pose::IDENTITY, (3, 3), 6.0, 30);
    memory.settle();
    assert_eq!(shown(&memory), (3, 1), "the left half has more of 3");

    let mut memory = self::memory();
    let right = Pose::from_translation(DVec3::new(0.6, 0.0, 0.0));
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 6);
    see(&mut memory, right, (1, 3), 4.0, 3);
    memory.settle();
    assert_eq!(shown(&memory), (1, 2), "3 was given to less of it");
}

#[test]
fn what_is_decided_between_frames_is_shown_and_changes_no_votes() {
    let mut memory = memory();
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 12);
    see(&mut memory, Pose::IDENTITY, (1, 1), -0.25, 6);
    let expected = |memory: &SplatMemory| memory.recall(&frame(Pose::IDENTITY)).expected().clone();
    let before = expected(&memory);
    memory.decide_objects(18);
    assert_eq!(shown(&memory), (1, 2));
    assert!(memory.map().segment_ids().contains(&2), "the map shows it, too");
    assert_eq!(expected(&memory), before);
    memory.keep_verdicts();
    assert_eq!(shown(&memory), (1, 2));
    assert_ne!(expected(&memory), before);
}

#[test]
fn everything_that_the_map_tells_follows_what_is_decided_between_frames() {
    let mut memory = memory();
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 60);
    // Votes are of the last frames: 2 is only in the evidence.
    see(&mut memory, Pose::IDENTITY, (1, 3), 4.0, 20);
    assert!(!memory.map().carried_ids().contains(&2));
    memory.decide_objects(80);
    let told = |memory: &SplatMemory| {
        let map = memory.map();
        let confidences = map.segments.segment_confidences().unwrap();
        (map.segment_ids(), map.segment_shares(), map.segment_votes(), confidences, map.carried_ids())
    };
    let decided = told(&memory);
    let shown: BTreeSet<SegmentId> = decided.0.iter().copied().filter(|id| *id != 0).collect();
    assert_eq!(shown, BTreeSet::from([1, 2]));
    assert!(shown.is_subset(&decided.4) && shown.iter().all(|id| memory.map().is_carried(*id)), "{:?}", decided.4);

    // A file has what the map shows, and the memory goes on as if it had not been written.
    let file = tempfile::NamedTempFile::new().unwrap();
    memory.save(file.path()).unwrap();
    assert_eq!(told(&memory), decided);
    let loaded = SplatMemory::load(file.path(), MemorySettings::default()).unwrap();
    assert_eq!(loaded.map().segment_ids(), decided.0);
    assert!(loaded.map().is_carried(2));
    memory.keep_verdicts();
    assert_eq!(told(&memory).0, decided.0);
    assert_eq!(told(&memory).1, decided.1, "the same votes count");
}

#[test]
fn a_map_that_has_lost_most_gaussians_is_saved_and_loaded() {
    let mut memory = memory();
    let pose = |step: u32| Pose::from_translation(DVec3::new(2.0 * f64::from(step), 0.0, 0.0));
    (0..6).for_each(|step| see(&mut memory, pose(step), (1, 2), 4.0, 1));
    let file = tempfile::NamedTempFile::new().unwrap();
    memory.save(file.path()).unwrap();
    // Of a smaller map, what was seen last stays: patches with large numbers.
    let small = MemorySettings::default().with(|settings| settings.max_gaussians = 60);
    let mut memory = SplatMemory::load(file.path(), small.clone()).unwrap();
    see(&mut memory, pose(5), (1, 2), 4.0, 1);
    assert!(memory.gaussian_count() <= 60);
    memory.save(file.path()).unwrap();
    let loaded = SplatMemory::load(file.path(), small).unwrap();
    assert_eq!(loaded.map().segment_ids(), memory.map().segment_ids());
}

#[test]
fn objects_keep_the_ids_that_were_decided() {
    let mut memory = memory();
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 12);
    memory.decide_objects(12);
    see(&mut memory, Pose::IDENTITY, (1, 3), 4.0, 20);
    memory.decide_objects(20);
    assert_eq!(shown(&memory), (1, 2), "3 is what most frames gave it by now");
    memory.settle();
    assert_eq!(shown(&memory), (1, 3));
}

#[test]
fn without_affinities_nothing_is_decided() {
    let mut memory = memory();
    let frame = frame(Pose::IDENTITY);
    for _ in 0..3 {
        memory.update(memory.recall(&frame), &halves(1, 2, &Pose::IDENTITY), &BTreeSet::new()).unwrap();
    }
    assert!(!memory.settle());
    assert_eq!(shown(&memory), (1, 2));
    // Gaussians of those frames keep their ids when later frames have affinities.
    see(&mut memory, Pose::from_translation(DVec3::new(1.0, 0.0, 0.0)), (1, 3), 4.0, 1);
    assert!(memory.settle());
    assert_eq!(shown(&memory), (1, 2));
}

#[test]
fn evidence_is_saved_with_the_map() {
    let mut memory = memory();
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 12);
    see(&mut memory, Pose::IDENTITY, (1, 1), -0.25, 6);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("memory.ply");
    memory.save(&path).unwrap();
    let mut loaded = SplatMemory::load(&path, MemorySettings::default()).unwrap();
    for memory in [&mut memory, &mut loaded] {
        see(memory, Pose::IDENTITY, (1, 1), -0.25, 1);
        memory.settle();
        assert_eq!(shown(memory), (1, 2));
    }
    let again = folder.path().join("again.ply");
    memory.save(&again).unwrap();
    loaded.save(&path).unwrap();
    assert!(std::fs::read(path).unwrap() == std::fs::read(again).unwrap());
}

#[test]
fn evidence_follows_a_loop() {
    let anchor = |keyframe| FrameAnchor {
        keyframe,
        world_from_keyframe: Pose::IDENTITY,
        is_tracked: true,
        uncertain: Arc::new(if keyframe == 0 { Default::default() } else { [0].into_iter().collect() }),
    };
    let drift = Pose::from_translation(DVec3::new(0.0, 0.0, 0.25));
    let mut memory = memory();
    memory.set_anchor(&anchor(0));
    see(&mut memory, Pose::IDENTITY, (1, 2), 4.0, 6);
    memory.set_anchor(&anchor(20));
    see(&mut memory, drift, (3, 3), 4.0, 6);
    memory.correct(&MapCorrection { new_from_old: [(20, drift.inverse())].into(), joined: vec![(0, 20)] });
    memory.settle();
    let (left, right) = shown(&memory);
    assert_ne!(left, right, "both passes saw two things");
}

#[test]
fn affinities_of_another_frame_are_an_error() {
    let mut memory = memory();
    let frame = frame(Pose::IDENTITY);
    let mut found = found(&Pose::IDENTITY, 1.0);
    found.affinities.as_mut().unwrap().planes[0].log_odds.pop();
    let predicted = halves(1, 2, &Pose::IDENTITY);
    let result = memory.update_with_affinities(memory.recall(&frame), &predicted, &BTreeSet::new(), &found);
    assert!(matches!(result, Err(MemoryError::Affinities { regions: SIZE, expected: SIZE })), "{result:?}");
    assert_eq!(memory.gaussian_count(), 0, "nothing is learnt");
}

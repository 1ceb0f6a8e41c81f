//! A map whose camera has drifted, before and after its poses are corrected.

use glam::DVec3;
use splatseg_files::StateBlock;
use splatseg_geometry::{
    FrameAnchor, Intrinsics, KeyframeId, MapCorrection, Pose, RemappedId, RgbdFrame, SegmentId, SegmentMap,
};
use splatseg_memory::{Attached, MemorySettings, SplatMemory};
use splatseg_test_scenes::wall;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

const SIZE: (usize, usize) = (64, 48);
const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width: SIZE.0, height: SIZE.1 };

/// The keyframe of the second time, and one after it.
const AGAIN: KeyframeId = 20;

/// A wall, two metres in front of the camera.
fn frame(pose: Pose) -> RgbdFrame<'static> {
    wall("0", CAMERA, 2.0, pose)
}

fn drift() -> Pose {
    Pose::from_translation(DVec3::new(0.02, 0.0, 0.25))
}

fn anchor(keyframe: KeyframeId, uncertain: &[KeyframeId]) -> FrameAnchor {
    let uncertain = Arc::new(uncertain.iter().copied().collect());
    FrameAnchor { keyframe, world_from_keyframe: Pose::IDENTITY, is_tracked: true, uncertain }
}

/// Ids in vertical stripes.
fn stripes(ids: &[SegmentId]) -> SegmentMap {
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| ids[column * ids.len() / SIZE.0])
}

/// Gives out the ids from 1 to `count`.
fn new_ids(memory: &mut SplatMemory, count: SegmentId) {
    (1..=count).for_each(|id| assert_eq!(memory.new_segment().unwrap(), id));
}

/// Learns a frame several times, as [`frame`].
fn see(memory: &mut SplatMemory, pose: Pose, anchor: &FrameAnchor, predicted: &SegmentMap) {
    for _ in 0..5 {
        memory.set_anchor(anchor);
        let frame = frame(pose);
        let recall = memory.recall(&frame);
        memory.update(recall, predicted, &BTreeSet::new()).unwrap();
        memory.record_shown(predicted);
    }
}

/// A wall of three things, seen twice: the second time from a drifted pose, under other ids.
fn seen_twice() -> SplatMemory {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    new_ids(&mut memory, 6);
    see(&mut memory, Pose::IDENTITY, &anchor(0, &[]), &stripes(&[1, 2, 3]));
    see(&mut memory, drift(), &anchor(AGAIN, &[0]), &stripes(&[4, 5, 6]));
    memory
}

fn correction() -> MapCorrection {
    MapCorrection { new_from_old: BTreeMap::from([(AGAIN, drift().inverse())]), joined: vec![(0, AGAIN)] }
}

fn pairs(remapped: &[RemappedId]) -> Vec<(SegmentId, SegmentId)> {
    let mut pairs: Vec<_> = remapped.iter().map(|ids| (ids.from, ids.into)).collect();
    pairs.sort_unstable();
    pairs
}

#[test]
fn a_surface_that_is_there_twice_becomes_one_and_its_ids_are_merged() {
    let mut once = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    new_ids(&mut once, 3);
    see(&mut once, Pose::IDENTITY, &anchor(0, &[]), &stripes(&[1, 2, 3]));
    let mut memory = seen_twice();
    let (single, doubled) = (once.gaussian_count(), memory.gaussian_count());
    assert!(doubled > single * 3 / 2, "the old surface has survived: {doubled} {single}");
    let remapped = memory.correct(&correction());
    assert_eq!(pairs(&remapped), [(4, 1), (5, 2), (6, 3)]);
    assert!(memory.gaussian_count() < single * 5 / 4, "{} {single}", memory.gaussian_count());
    assert_eq!(memory.remapped_ids(), &BTreeMap::from([(4, 1), (5, 2), (6, 3)]));
    let ids: BTreeSet<SegmentId> = memory.map().segment_ids().into_iter().collect();
    assert_eq!(ids, BTreeSet::from([1, 2, 3]));
    assert!(memory.map().means.iter().all(|mean| (mean.z - 2.0).abs() < 0.01));
    // The next frame expects the older ids.
    memory.set_anchor(&anchor(AGAIN, &[]));
    let next = frame(Pose::IDENTITY);
    let recall = memory.recall(&next);
    assert_eq!(recall.expected().segments[(10, 20)], 1);
    let update = memory.update(recall, &stripes(&[1, 2, 3]), &BTreeSet::new()).unwrap();
    assert_eq!(update.forgotten, [4, 5, 6]);
}

#[test]
fn ids_that_were_shown_side_by_side_are_never_merged() {
    let mut memory = seen_twice();
    memory.record_shown(&stripes(&[2, 5]));
    assert_eq!(pairs(&memory.correct(&correction())), [(4, 1), (6, 3)]);
}

#[test]
fn thousands_of_ids_in_view_give_a_small_map_that_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut memory) = (folder.path().join("map.ply"), seen_twice());
    memory.save(&path).unwrap();
    let before = std::fs::metadata(&path).unwrap().len();
    for first in [4, 10_000, 20_000, 30_000, 40_000] {
        memory.record_shown(&SegmentMap::from_fn(80, 60, |column, row| first + (column + 80 * row) as SegmentId));
    }
    memory.save(&path).unwrap();
    let added = std::fs::metadata(&path).unwrap().len() - before;
    assert!(added < 200_000, "{added} bytes for 24,000 ids");
    // Those of a crowded frame are not merged, whatever they were shown beside.
    let mut loaded = SplatMemory::load(&path, MemorySettings::default()).unwrap();
    loaded.set_anchor(&anchor(AGAIN, &[0]));
    assert!(loaded.correct(&correction()).is_empty() && memory.correct(&correction()).is_empty());
}

#[test]
fn a_part_of_the_map_moves_to_the_rest_and_its_ids_are_merged() {
    // The part begins right after the last keyframe of the rest, far beside it, and turned.
    const NEXT: KeyframeId = 1;
    let turn = glam::DQuat::from_rotation_y(2.0);
    let part = Pose::from_quaternion(DVec3::new(50.0, 0.0, 3.0), turn).unwrap();
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    new_ids(&mut memory, 6);
    see(&mut memory, Pose::IDENTITY, &anchor(0, &[]), &stripes(&[1, 2, 3]));
    let single = memory.gaussian_count();
    see(&mut memory, part, &anchor(NEXT, &[0]), &stripes(&[4, 5, 6]));
    let correction = MapCorrection { new_from_old: BTreeMap::from([(NEXT, part.inverse())]), joined: vec![(0, NEXT)] };
    assert_eq!(pairs(&memory.correct(&correction)), [(4, 1), (5, 2), (6, 3)]);
    let means = memory.map().means.iter().map(|mean| memory.map().origin + mean.as_dvec3());
    assert!(means.clone().all(|mean| (mean.z - 2.0).abs() < 0.01 && mean.x.abs() < 1.5), "all of it is one wall");
    assert!(memory.gaussian_count() < single * 5 / 4, "{} {single}", memory.gaussian_count());
}

#[test]
fn neighbours_are_not_merged_although_the_correction_is_off() {
    // Six things of 35 cm beside each other; what remains of the drift is 4 cm along the wall.
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    new_ids(&mut memory, 12);
    see(&mut memory, Pose::IDENTITY, &anchor(0, &[]), &stripes(&[1, 2, 3, 4, 5, 6]));
    see(&mut memory, drift(), &anchor(AGAIN, &[0]), &stripes(&[7, 8, 9, 10, 11, 12]));
    let off = Pose::from_translation(DVec3::new(0.04, 0.0, 0.0)) * drift().inverse();
    let correction = MapCorrection { new_from_old: BTreeMap::from([(AGAIN, off)]), joined: vec![(0, AGAIN)] };
    for (from, into) in pairs(&memory.correct(&correction)) {
        assert_eq!(from, into + 6);
    }
}

#[test]
fn a_correction_that_moves_nothing_changes_nothing() {
    let mut memory = seen_twice();
    let (means, ids) = (memory.map().means.to_vec(), memory.map().segment_ids());
    let remapped = memory.correct(&MapCorrection { joined: vec![(0, AGAIN)], ..MapCorrection::default() });
    assert!(remapped.is_empty() && memory.map().means == means && memory.map().segment_ids() == ids);
}

#[test]
fn surfaces_are_gone_only_if_the_pose_is_certain() {
    let counts = [&[0][..], &[][..]].map(|uncertain| {
        let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
        new_ids(&mut memory, 2);
        see(&mut memory, Pose::IDENTITY, &anchor(0, &[]), &stripes(&[1]));
        let before = memory.gaussian_count();
        see(&mut memory, drift(), &anchor(AGAIN, uncertain), &stripes(&[2]));
        let ids = memory.map().segment_ids();
        (before, ids.iter().filter(|id| **id == 1).count())
    });
    assert_eq!(counts[0].0, counts[0].1, "all are kept");
    // Those at the edge are out of view.
    assert!(2 * counts[1].1 < counts[1].0, "{counts:?}");
}

#[test]
fn a_saved_memory_is_corrected_in_the_same_way_and_keeps_its_keyframes() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut memory) = (folder.path().join("map.ply"), seen_twice());
    let bytes = |name: &str| {
        let mut block = StateBlock::default();
        block.put(name, &[], [1u8, 2]);
        block.to_bytes().unwrap()
    };
    let (keyframes, names, history) = (bytes("id"), bytes("label"), bytes("seen"));
    let attached = Attached { keyframes: Some(&keyframes), names: Some(&names), history: Some(&history) };
    memory.save_with(&path, attached).unwrap();
    let mut loaded = SplatMemory::load(&path, MemorySettings::default()).unwrap();
    assert_eq!(loaded.take_keyframes().unwrap(), keyframes);
    assert_eq!(loaded.take_keyframes(), None);
    assert_eq!((loaded.take_names().unwrap(), loaded.take_names()), (names, None));
    assert_eq!((loaded.take_history().unwrap(), loaded.take_history()), (history, None));
    let other = Attached { keyframes: Some(b"{}"), names: None, history: None };
    let error = memory.save_with(&path, other).unwrap_err().to_string();
    assert!(error.contains("no saved state, or a damaged one"), "{error}");
    loaded.set_anchor(&anchor(AGAIN, &[0]));
    assert_eq!(loaded.correct(&correction()), memory.correct(&correction()));
    assert_eq!((loaded.map().means, loaded.map().radii), (memory.map().means, memory.map().radii));
    assert_eq!(loaded.map().segment_ids(), memory.map().segment_ids());
    loaded.save(&path).unwrap();
    let again = SplatMemory::load(&path, MemorySettings::default()).unwrap();
    assert_eq!(again.remapped_ids(), memory.remapped_ids());
}

#[test]
fn ids_of_frames_without_a_pose_turn_out_to_be_those_of_the_map() {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    new_ids(&mut memory, 6);
    see(&mut memory, Pose::IDENTITY, &anchor(0, &[]), &stripes(&[1, 2, 3]));
    memory.start_session();
    assert!(memory.latest_ids().is_none(), "the latest frame was taken at another time");
    let without_pose = stripes(&[4, 5, 6]);
    memory.record_without_pose(&without_pose).unwrap();
    memory.record_shown(&without_pose);
    assert_eq!(memory.latest_ids(), Some(&without_pose));

    // Found again: two things are those of the map, the third is another one.
    let frame = frame(Pose::IDENTITY);
    let remapped = memory.remap_recognised(&stripes(&[1, 2, 6]));
    assert_eq!(pairs(&remapped), [(4, 1), (5, 2)]);
    let recall = memory.recall(&frame);
    memory.update(recall, &stripes(&[1, 2, 6]), &BTreeSet::new()).unwrap();
    assert_eq!(memory.remapped_ids().len(), 2);
    assert!(memory.remap_recognised(&stripes(&[1, 2, 6])).is_empty());
}

#[test]
fn two_things_in_one_frame_stay_two_though_one_mask_showed_both_before() {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    new_ids(&mut memory, 4);
    let without_pose = stripes(&[1, 2, 2]);
    memory.record_without_pose(&without_pose).unwrap();
    memory.record_shown(&without_pose);
    let remapped = memory.remap_recognised(&stripes(&[3, 4, 2]));
    assert_eq!(pairs(&remapped), [(1, 3)], "the frame shows 2 beside 4");
}

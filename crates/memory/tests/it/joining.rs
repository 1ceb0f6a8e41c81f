//! Two maps of one wall that become one.

use glam::DVec3;
use splatseg_geometry::{FrameAnchor, Intrinsics, Pose, RemappedId, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{MemoryError, MemoryKind, MemorySettings, SplatMemory};
use splatseg_test_scenes::wall;
use std::collections::BTreeSet;

const SIZE: (usize, usize) = (64, 48);
const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width: SIZE.0, height: SIZE.1 };

/// A wall that is `distance` in front of the camera.
fn frame(distance: f32, x: f64) -> RgbdFrame<'static> {
    wall("0", CAMERA, distance, Pose::from_translation(DVec3::new(x, 0.0, 0.0)))
}

/// Ids in vertical stripes.
fn stripes(ids: &[SegmentId]) -> SegmentMap {
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| ids[column * ids.len() / SIZE.0])
}

/// A map of a wall whose stripes have these ids, seen from a place at `x`.
fn map(distance: f32, x: f64, ids: &[SegmentId]) -> SplatMemory {
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    let highest = ids.iter().copied().max().unwrap_or(0);
    (1..=highest).for_each(|id| assert_eq!(memory.new_segment().unwrap(), id));
    for _ in 0..5 {
        memory.set_anchor(&FrameAnchor::default());
        let frame = frame(distance, x);
        let recall = memory.recall(&frame);
        memory.update(recall, &stripes(ids), &BTreeSet::new()).unwrap();
        memory.record_shown(&stripes(ids));
    }
    memory
}

fn shown(memory: &SplatMemory) -> BTreeSet<SegmentId> {
    memory.map().segment_ids().into_iter().collect()
}

#[test]
fn the_same_wall_is_there_once_with_the_ids_of_the_earlier_map() {
    let mut earlier = map(2.0, 0.0, &[1, 2, 3]);
    let count = earlier.gaussian_count();
    // Other ids, and an error of a centimetre.
    let ids = earlier.join(map(2.01, 0.0, &[2, 3, 1]), 10, &[]).unwrap();
    assert!(earlier.gaussian_count() < count * 11 / 10, "{} {count}", earlier.gaussian_count());
    assert_eq!([1, 2, 3].map(|id| ids.of_later(id)), [Some(3), Some(1), Some(2)]);
    assert_eq!((ids.of_earlier(2), ids.of_later(9)), (2, None));
    assert_eq!(shown(&earlier), BTreeSet::from([1, 2, 3]));
    assert!(earlier.remapped_ids().is_empty(), "no frame has shown another id");
    assert!([1, 2, 3].into_iter().all(|id| !earlier.map().is_tentative(id)));
}

#[test]
fn what_only_the_later_map_has_is_added_under_new_ids() {
    let mut earlier = map(2.0, 0.0, &[1, 2, 3]);
    let (count, later) = (earlier.gaussian_count(), map(2.0, 0.7, &[1, 2, 3]));
    // The wall is 2.1 m wide, so the later map's first two thirds are there already.
    let ids = earlier.join(later, 10, &[]).unwrap();
    let of_later = [1, 2, 3].map(|id| ids.of_later(id).unwrap());
    assert_eq!(of_later[..2], [2, 3]);
    assert!(of_later[2] > 3 && shown(&earlier) == BTreeSet::from([1, 2, 3, of_later[2]]), "{of_later:?}");
    let ratio = earlier.gaussian_count() as f32 / count as f32;
    assert!((1.25..1.45).contains(&ratio), "{ratio}");
    let anchors = earlier.map().means.iter().zip(earlier.map().segment_ids()).filter(|(_, id)| *id == of_later[2]);
    assert!(anchors.count() > 100);
}

#[test]
fn walls_at_different_places_share_no_id_unless_they_are_known_to_be_the_same() {
    let mut earlier = map(2.0, 0.0, &[1, 2, 3]);
    let count = earlier.gaussian_count();
    let ids = earlier.join(map(1.0, 0.0, &[1, 2, 3]), 10, &[RemappedId { from: 1, into: 2 }]).unwrap();
    assert!(earlier.gaussian_count() > count * 5 / 4);
    assert_eq!(ids.of_later(1), Some(2), "it has moved");
    assert!([2, 3].into_iter().all(|id| ids.of_later(id) > Some(3)), "{ids:?}");
}

#[test]
fn a_joined_map_is_saved_loaded_and_continued() {
    let folder = tempfile::tempdir().unwrap();
    let mut earlier = map(2.0, 0.0, &[1, 2, 3]);
    earlier.join(map(2.0, 0.7, &[1, 2, 3]), 10, &[]).unwrap();
    let path = folder.path().join("map.ply");
    earlier.save(&path).unwrap();
    let mut loaded = SplatMemory::load(&path, MemorySettings::default()).unwrap();
    assert_eq!(shown(&loaded), shown(&earlier));
    let next = frame(2.0, 0.0);
    let recall = loaded.recall(&next);
    assert_eq!([10, 30, 50].map(|column| recall.expected().segments[(column, 20)]), [1, 2, 3]);
    let new = loaded.new_segment().unwrap();
    assert!(!shown(&earlier).contains(&new));
    // The same bytes, whatever happens in the order of hash maps.
    let again = folder.path().join("again.ply");
    let mut earlier = map(2.0, 0.0, &[1, 2, 3]);
    earlier.join(map(2.0, 0.7, &[1, 2, 3]), 10, &[]).unwrap();
    earlier.save(&again).unwrap();
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&again).unwrap());
}

#[test]
fn features_are_refused() {
    let mut settings = MemorySettings::default();
    (settings.kind, settings.feature_dim, settings.num_codes) = (MemoryKind::Features, 8, 64);
    let features = || SplatMemory::new(settings.clone(), 0, &mut |_| {}).unwrap();
    let mut votes = map(2.0, 0.0, &[1]);
    let count = votes.gaussian_count();
    assert!(matches!(votes.join(features(), 1, &[]), Err(MemoryError::CannotJoin)));
    assert!(matches!(features().join(map(2.0, 0.0, &[1]), 1, &[]), Err(MemoryError::CannotJoin)));
    assert!(votes.gaussian_count() == count && votes.can_join() && !features().can_join());
}

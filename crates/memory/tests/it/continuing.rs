//! A memory that is saved and continued behaves like one that never stopped.

use glam::{Mat4, Vec3};
use proptest::prelude::*;
use splatseg_files::StateBlock;
use splatseg_geometry::{Image, Pose, RgbdFrame, SegmentMap};
use splatseg_memory::{GrowthRule, LearningStats, LoadMemoryError, MemoryKind, MemorySettings, SplatFile, SplatMemory};
use splatseg_test_scenes::camera;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
/// Number of frames before the memory is saved, and of all frames.
const SAVED_AFTER: usize = 6;
const FRAMES: usize = 20;
/// From this frame on the box is gone. The memory is saved while it is being removed.
const BOX_GONE: usize = 4;
/// From this frame on there is one more segment.
const NEW_SEGMENT: usize = 9;

fn settings(kind: MemoryKind, growth: GrowthRule) -> MemorySettings {
    // Few codes, so that the loaded codebook has to be extended.
    MemorySettings::default().with(|settings| {
        settings.kind = kind;
        settings.growth = growth;
        settings.feature_dim = 4;
        settings.num_codes = 3;
        settings.num_steps = 3;
    })
}

/// A frame of a wall of two segments with a box in front, and its predictions, which some frames lack.
fn frame(number: usize) -> (RgbdFrame<'static>, SegmentMap) {
    let is_box = |column: usize, row: usize| {
        number < BOX_GONE && (20 - number..40 - number).contains(&column) && (10..30).contains(&row)
    };
    let depth = Image::from_fn(WIDTH, HEIGHT, |column, row| if is_box(column, row) { 1.5 } else { 3.0 });
    let color = Image::from_fn(WIDTH, HEIGHT, |column, row| [column as u8 * 3, row as u8 * 5, number as u8]);
    let intrinsics = camera(WIDTH, HEIGHT, 60.0);
    let pose = Pose::from_matrix((Mat4::from_translation(Vec3::X * 0.025 * number as f32)).as_dmat4()).unwrap();
    let predicted = SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| match () {
        () if number % 5 == 3 => 0,
        () if is_box(column, row) => 3,
        () if number >= NEW_SEGMENT && row >= 36 => 4,
        () if column + number / 2 < 30 => 1,
        () => 2,
    });
    (RgbdFrame::new(number.to_string(), color, depth, intrinsics, pose).unwrap(), predicted)
}

/// The result of a frame: expected and shown segments, and changes of the memory.
#[derive(Debug, PartialEq)]
struct Outcome {
    expected: SegmentMap,
    shown: SegmentMap,
    grown: usize,
    removed: usize,
    forgotten: Vec<u32>,
    learning: LearningStats,
}

fn take_in(memory: &mut SplatMemory, frames: std::ops::Range<usize>) -> Vec<Outcome> {
    let outcome = |number| {
        let (frame, predicted) = frame(number);
        let needed = if number >= NEW_SEGMENT { 4 } else { 3 };
        for id in memory.segment_count()..needed {
            assert_eq!(memory.new_segment().unwrap() as usize, id + 1);
        }
        let recall = memory.recall(&frame);
        let (expected, shown) = (recall.expected().segments.clone(), memory.fuse(&recall, &predicted).unwrap());
        let update = memory.update(recall, &predicted, &BTreeSet::new()).unwrap();
        let (grown, removed) = (update.grown, update.removed);
        Outcome { expected, shown, grown, removed, forgotten: update.forgotten, learning: update.learning }
    };
    frames.map(outcome).collect()
}

fn continues(kind: MemoryKind, growth: GrowthRule, folder: &Path) -> Vec<Outcome> {
    let settings = settings(kind, growth);
    let mut memory = SplatMemory::new(settings.clone(), 7, &mut |_| {}).unwrap();
    take_in(&mut memory, 0..SAVED_AFTER);
    let path = folder.join("memory.ply");
    memory.save(&path).unwrap();
    let mut loaded = SplatMemory::load(&path, settings).unwrap();
    assert_eq!(loaded.segment_count(), 3);
    assert_eq!(loaded.map().segment_ids(), memory.map().segment_ids());
    let (found, expected) = (loaded.map(), memory.map());
    assert_eq!((found.means, found.radii, found.colors), (expected.means, expected.radii, expected.colors));
    loaded.save(&path).unwrap();

    let outcomes = take_in(&mut memory, SAVED_AFTER..FRAMES);
    assert_eq!(take_in(&mut loaded, SAVED_AFTER..FRAMES), outcomes);
    let (one, other) = (folder.join("one.ply"), folder.join("other.ply"));
    memory.save(&one).unwrap();
    loaded.save(&other).unwrap();
    assert!(fs::read(one).unwrap() == fs::read(other).unwrap(), "the memories are equal");
    outcomes
}

#[test]
fn a_continued_memory_behaves_like_one_that_never_stopped() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, growth) in [
        (MemoryKind::Evidence, GrowthRule::Auto),
        (MemoryKind::Features, GrowthRule::Auto),
        (MemoryKind::Features, GrowthRule::Missing),
    ] {
        let outcomes = continues(kind, growth, folder.path());
        assert!(outcomes[0].expected.areas().contains_key(&1), "a loaded memory expects the wall");
        assert!(outcomes.iter().any(|outcome| outcome.shown.areas().contains_key(&4)));
        if kind == MemoryKind::Evidence {
            assert!(outcomes.iter().any(|outcome| outcome.removed > 0), "the box is removed after loading");
            assert!(outcomes.iter().any(|outcome| outcome.forgotten == [3]));
        }
    }
}

/// A wall with a hole in its depth, segment 2.
fn frame_with_a_screen() -> (RgbdFrame<'static>, SegmentMap) {
    let (frame, _) = frame(0);
    let is_screen = |column: usize, row: usize| (20..44).contains(&column) && (12..36).contains(&row);
    let depth = Image::from_fn(WIDTH, HEIGHT, |column, row| if is_screen(column, row) { 0.0 } else { 3.0 });
    let color = frame.color().clone().into_owned();
    let predicted = SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| if is_screen(column, row) { 2 } else { 1 });
    let pose = *frame.world_from_camera();
    (RgbdFrame::new("screen".to_owned(), color, depth, *frame.intrinsics(), pose).unwrap(), predicted)
}

#[test]
fn state_besides_the_gaussians_is_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("memory.ply");
    let settings = settings(MemoryKind::Evidence, GrowthRule::Auto);
    let mut memory = SplatMemory::new(settings.clone(), 7, &mut |_| {}).unwrap();
    (0..3).for_each(|_| assert!(memory.new_segment().is_ok()));
    let (frame, predicted) = frame_with_a_screen();
    let take_in = |memory: &mut SplatMemory| {
        let recall = memory.recall(&frame);
        let expected = recall.expected().segments.clone();
        memory.update(recall, &predicted, &BTreeSet::new()).unwrap();
        expected
    };
    (0..4).for_each(|_| drop(take_in(&mut memory)));
    memory.save(&path).unwrap();

    let mut loaded = SplatMemory::load(&path, settings.clone()).unwrap();
    let expected = take_in(&mut loaded);
    assert_eq!(expected[(30, 20)], 2, "the screen");
    assert_eq!(take_in(&mut memory), expected);
    let again = folder.path().join("again.ply");
    loaded.save(&again).unwrap();
    memory.save(&path).unwrap();
    assert!(fs::read(&path).unwrap() == fs::read(&again).unwrap());

    // Invalid values are refused even with a correct checksum.
    let whole = SplatFile::load(&path).unwrap();
    let camera: serde_json::Value = whole.saved_state.get_json("recent.previous.camera.json").unwrap().unwrap();
    let changes: [&dyn Fn(&mut StateBlock); 4] = [
        &|state| {
            let mut camera = camera.clone();
            camera["intrinsics"]["fx"] = (-60.0).into();
            state.put_json("recent.previous.camera.json", &camera);
        },
        &|state| state.put("recent.previous.ids", &[2], [7u32, 1]),
        &|state| state.put("memory.released_ids", &[2], [1u32, 1]),
        &|state| state.put_number("memory.given_ids", 3u8),
    ];
    for (index, change) in changes.into_iter().enumerate() {
        let mut damaged = whole.clone();
        change(&mut damaged.saved_state);
        assert_ne!(damaged, whole, "change {index}");
        damaged.save(&path).unwrap();
        let error = SplatMemory::load(&path, settings.clone()).unwrap_err();
        assert!(matches!(&error, LoadMemoryError::SavedState { .. }), "change {index}: {error}");
        assert!(error.to_string().lines().count() == 1 && error.to_string().contains("memory.ply"), "{error}");
    }
}

/// A saved memory with recent frames, and where its state begins.
static SAVED: LazyLock<(Vec<u8>, usize)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("memory.ply");
    let mut memory = SplatMemory::new(settings(MemoryKind::Evidence, GrowthRule::Auto), 7, &mut |_| {}).unwrap();
    take_in(&mut memory, 0..SAVED_AFTER);
    memory.save(&path).unwrap();
    let state = SplatFile::load(&path).unwrap().saved_state.to_bytes().unwrap();
    let bytes = fs::read(&path).unwrap();
    let start = bytes.len() - 4 - state.len();
    assert_eq!(bytes[start..bytes.len() - 4], state);
    (bytes, start)
});

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn an_altered_state_with_a_correct_checksum_never_panics(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        in_header in any::<bool>(),
    ) {
        let (mut bytes, start) = SAVED.clone();
        let end = bytes.len() - 4;
        let length = if in_header { (end - start).min(2500) } else { end - start };
        for (place, value) in changes {
            bytes[start + place.index(length)] = value;
        }
        let checksum = crc32fast::hash(&bytes[..end]);
        bytes[end..].copy_from_slice(&checksum.to_le_bytes());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("memory.ply");
        fs::write(&path, &bytes).unwrap();
        match SplatMemory::load(&path, settings(MemoryKind::Evidence, GrowthRule::Auto)) {
            Ok(memory) => memory.save(&path).unwrap(),
            Err(error) => {
                let text = error.to_string();
                prop_assert!(text.contains("memory.ply") && text.lines().count() == 1, "{}", text);
            }
        }
    }
}

#[test]
fn a_memory_that_differs_from_the_settings_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("memory.ply");
    let of = |kind| settings(kind, GrowthRule::Auto);
    let save = |kind| SplatMemory::new(of(kind), 0, &mut |_| {}).unwrap().save(&path).unwrap();
    let refusal = |settings| SplatMemory::load(&path, settings).unwrap_err();

    save(MemoryKind::Evidence);
    let error = refusal(of(MemoryKind::Features));
    assert!(matches!(error, LoadMemoryError::Kind { expected: "features", .. }), "{error}");
    assert!(error.to_string().contains("memory.ply") && error.to_string().contains("memory.kind"), "{error}");

    save(MemoryKind::Features);
    assert!(matches!(refusal(of(MemoryKind::Evidence)), LoadMemoryError::Kind { expected: "evidence", .. }));
    let other = of(MemoryKind::Features).with(|settings| settings.feature_dim = 5);
    assert!(matches!(refusal(other), LoadMemoryError::FeatureDim { found: 4, expected: 5, .. }));
    let impossible = of(MemoryKind::Features).with(|settings| settings.feature_dim = 0);
    assert!(matches!(refusal(impossible), LoadMemoryError::Settings(_)));
    fs::write(&path, "ply\n").unwrap();
    assert!(matches!(refusal(of(MemoryKind::Evidence)), LoadMemoryError::File(_)));
}

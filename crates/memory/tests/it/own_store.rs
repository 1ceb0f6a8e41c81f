//! A kind of memory defined outside the crate: it remembers the last id that each Gaussian was predicted as.

use glam::{Mat4, Vec3};
use splatseg_files::StateBlock;
use splatseg_geometry::{Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{
    LearningStats, LoadMemoryError, MemoryError, MemoryKind, MemoryKindDefinition, MemoryRules, MemorySettings,
    NewGaussian, Recall, RegisterKindError, SavedMemorySettings, SegmentStore, SplatContent, SplatContentView,
    SplatFile, SplatFileError, SplatMemory, StoreTile, TileSurface, Votes, register_memory_kind,
};
use splatseg_render::{Splats, TileWeights};
use splatseg_test_scenes::{camera, wall};
use std::borrow::Cow;
use std::collections::BTreeSet;

/// Last id of each Gaussian, as its only vote. New ids beyond `max_ids` are refused.
#[derive(Debug)]
struct LastSeen {
    votes: Vec<Votes>,
    max_ids: SegmentId,
    form: Form,
}

/// The saved content.
#[derive(Debug)]
enum Form {
    Nothing,
    Votes,
    Arrays,
}

impl LastSeen {
    fn new(max_ids: SegmentId) -> Self {
        Self { votes: Vec::new(), max_ids, form: Form::Nothing }
    }
}

static LAST_SEEN: MemoryKindDefinition = MemoryKindDefinition {
    name: "last-seen",
    rules: |_| MemoryRules::default(),
    create: |_, _| Ok(Box::new(LastSeen { form: Form::Votes, ..LastSeen::new(SegmentId::MAX) })),
    restore: |settings, saved| match saved.content {
        SplatContent::Evidence { votes } => {
            Ok(Box::new(LastSeen { votes, form: Form::Votes, ..LastSeen::new(SegmentId::MAX) }))
        }
        _ => Err(saved.unexpected(settings)),
    },
};

/// The same, saved in a form of its own.
static LAST_SEEN_ARRAYS: MemoryKindDefinition = MemoryKindDefinition {
    name: "last-seen-arrays",
    rules: |_| MemoryRules::default(),
    create: |_, _| Ok(Box::new(LastSeen { form: Form::Arrays, ..LastSeen::new(SegmentId::MAX) })),
    restore: |settings, saved| {
        let SplatContent::Arrays { arrays } = &saved.content else { return Err(saved.unexpected(settings)) };
        let damaged = |found| LoadMemoryError::SavedState { path: saved.path.display().to_string(), found };
        let ids: Vec<SegmentId> = arrays.get("last_ids", &[]).map_err(|error| damaged(error.to_string()))?;
        if ids.len() != saved.gaussians {
            return Err(damaged(format!("last_ids: found {} numbers, expected {}", ids.len(), saved.gaussians)));
        }
        let votes = ids.into_iter().map(|id| Votes::one(id, 1.0)).collect();
        Ok(Box::new(LastSeen { votes, form: Form::Arrays, ..LastSeen::new(SegmentId::MAX) }))
    },
};

/// Returns the Gaussian with the largest weight at each pixel of a tile.
fn winners(tile: &TileWeights) -> Vec<Option<(u32, f32)>> {
    let mut winners: Vec<Option<(u32, f32)>> = vec![None; TileWeights::PIXELS];
    for (column, gaussian) in tile.gaussians().iter().enumerate() {
        for (pixel, weight) in tile.column(column) {
            let winner = &mut winners[usize::from(pixel)];
            if winner.is_none_or(|(_, largest)| weight > largest) {
                *winner = Some((*gaussian, weight));
            }
        }
    }
    winners
}

impl SegmentStore for LastSeen {
    fn read_tile(&self, tile: &TileWeights, _: &TileSurface) -> StoreTile {
        let winners = winners(tile);
        StoreTile {
            segments: winners
                .iter()
                .map(|winner| winner.map_or(0, |(gaussian, _)| self.votes[gaussian as usize].winner()))
                .collect(),
            confidence: winners.iter().map(|winner| winner.map_or(0.0, |(_, weight)| weight)).collect(),
            ..StoreTile::default()
        }
    }

    fn fuse(&self, recall: &Recall<'_>, predicted: &SegmentMap) -> SegmentMap {
        let expected = &recall.expected().segments;
        SegmentMap::from_fn(predicted.width(), predicted.height(), |column, row| match predicted[(column, row)] {
            0 => expected[(column, row)],
            id => id,
        })
    }

    fn grow(&mut self, added: &[NewGaussian], _: &Recall<'_>, predicted: &SegmentMap, _: &BTreeSet<SegmentId>) {
        self.votes.extend(added.iter().map(|gaussian| Votes::one(predicted.pixels()[gaussian.pixel], 1.0)));
    }

    fn learn(
        &mut self,
        recall: &Recall<'_>,
        _: &dyn Splats,
        predicted: &SegmentMap,
        _: &BTreeSet<SegmentId>,
    ) -> LearningStats {
        for tile in recall.view().weights().tiles() {
            let (left, top) = tile.origin();
            for (pixel, winner) in winners(tile).into_iter().enumerate() {
                if let Some((gaussian, _)) = winner {
                    let id = predicted[(left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE)];
                    if id != 0 {
                        self.votes[gaussian as usize] = Votes::one(id, 1.0);
                    }
                }
            }
        }
        LearningStats::default()
    }

    fn retain(&mut self, keep: &[bool]) {
        let mut keep = keep.iter();
        self.votes.retain(|_| *keep.next().unwrap());
    }

    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError> {
        if id <= self.max_ids {
            return Ok(());
        }
        Err(MemoryError::Other { name: "last-seen".to_owned(), source: format!("{id} is one id too many").into() })
    }

    fn segment_ids(&self) -> Vec<SegmentId> {
        self.votes.iter().map(Votes::winner).collect()
    }

    fn numbers_per_gaussian(&self) -> usize {
        1
    }

    fn content(&self) -> Option<SplatContentView<'_>> {
        match self.form {
            Form::Nothing => None,
            Form::Votes => Some(SplatContentView::Evidence { votes: Cow::Borrowed(&self.votes) }),
            Form::Arrays => {
                let mut arrays = StateBlock::default();
                arrays.put("last_ids", &[], self.segment_ids());
                Some(SplatContentView::Arrays { arrays: Cow::Owned(arrays) })
            }
        }
    }
}

const SIZE: (usize, usize) = (64, 48);

/// A wall 2 m ahead, seen by a camera that stands `x` metres to the right of the origin.
fn frame(x: f32) -> RgbdFrame<'static> {
    let pose = Pose::from_matrix(Mat4::from_translation(Vec3::new(x, 0.0, 0.0)).as_dmat4()).unwrap();
    wall("wall", camera(SIZE.0, SIZE.1, 40.0), 2.0, pose)
}

fn halves(left: SegmentId, right: SegmentId) -> SegmentMap {
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| if column < 32 { left } else { right })
}

#[test]
fn it_remembers_in_its_own_way_and_moves_with_the_camera() {
    let store = Box::new(LastSeen::new(2));
    let mut memory = SplatMemory::with_store(MemorySettings::default(), store).unwrap();
    assert_eq!((memory.new_segment().unwrap(), memory.new_segment().unwrap()), (1, 2));
    let first = frame(0.0);
    memory.update(memory.recall(&first), &halves(1, 2), &BTreeSet::new()).unwrap();
    // 0.4 m to the right, things 2 m away move 8 pixels to the left.
    let second = frame(0.4);
    let recall = memory.recall(&second);
    let expected = &recall.expected().segments;
    assert_eq!((expected[(20, 24)], expected[(28, 24)]), (1, 2));
    assert_eq!(memory.fuse(&recall, &halves(0, 0)).unwrap()[(28, 24)], 2, "without predictions the memory is shown");
    assert_eq!(memory.map().parameter_count(), memory.gaussian_count() * 8);
    assert_eq!(memory.map().segment_shares(), vec![1.0; memory.gaussian_count()], "it keeps no second opinion");
}

#[test]
fn its_own_errors_are_returned_and_saving_it_is_an_error() {
    let store = Box::new(LastSeen::new(0));
    let mut memory = SplatMemory::with_store(MemorySettings::default(), store).unwrap();
    assert_eq!(memory.new_segment().unwrap_err().to_string(), "last-seen: 1 is one id too many");
    let path = std::env::temp_dir().join("splatseg-own-store.ply");
    assert!(matches!(memory.save(&path), Err(SplatFileError::NoFormat { .. })));
    assert!(!path.exists());
}

/// The ids that the memory shows in a frame.
fn shown(memory: &SplatMemory, frame: &RgbdFrame) -> SegmentMap {
    memory.fuse(&memory.recall(frame), &halves(0, 0)).unwrap()
}

#[test]
fn a_registered_kind_is_chosen_by_its_name_saved_and_loaded() {
    let kind = register_memory_kind(&LAST_SEEN).unwrap();
    assert_eq!(register_memory_kind(&LAST_SEEN), Err(RegisterKindError::Taken("last-seen")));
    for name in ["evidence", "features"] {
        let named = Box::leak(Box::new(MemoryKindDefinition { name, ..LAST_SEEN }));
        assert_eq!(register_memory_kind(named), Err(RegisterKindError::Taken(name)));
    }
    let unwritable = Box::leak(Box::new(MemoryKindDefinition { name: "Last seen", ..LAST_SEEN }));
    assert_eq!(register_memory_kind(unwritable), Err(RegisterKindError::Name("Last seen")));
    assert_eq!(MemoryKind::names(), ["evidence", "features", "last-seen"]);

    let settings: MemorySettings = toml::from_str("kind = 'last-seen'").unwrap();
    assert_eq!(settings.kind, kind);
    assert!(toml::to_string(&settings).unwrap().contains("kind = \"last-seen\""));
    let error = toml::from_str::<MemorySettings>("kind = 'first-seen'").unwrap_err();
    assert!(error.to_string().contains("`last-seen`"), "{error}");

    let mut memory = SplatMemory::new(settings.clone(), 0, &mut |_| {}).unwrap();
    assert_eq!((memory.new_segment().unwrap(), memory.new_segment().unwrap()), (1, 2));
    let frame = frame(0.0);
    memory.update(memory.recall(&frame), &halves(1, 2), &BTreeSet::new()).unwrap();
    let (folder, features) =
        (tempfile::tempdir().unwrap(), settings.clone().with(|memory| memory.kind = MemoryKind::Features));
    let path = folder.path().join("map.ply");
    memory.save(&path).unwrap();
    let mut loaded = SplatMemory::load(&path, settings).unwrap();
    assert_eq!(shown(&loaded, &frame), shown(&memory, &frame));
    assert_eq!(loaded.new_segment().unwrap(), 3);
    assert!(matches!(SplatMemory::load(&path, features), Err(LoadMemoryError::Kind { expected: "features", .. })));
    // Its votes mean something else than those of the built-in kind, and the file says whose they are.
    let error = SplatMemory::load(&path, MemorySettings::default()).unwrap_err().to_string();
    assert!(error.ends_with("the memory has the kind \"last-seen\", but memory.kind is \"evidence\""), "{error}");
    assert_eq!(SavedMemorySettings::read(&path).unwrap().kind, kind);
    let unknown = folder.path().join("unknown.ply");
    let file = SplatFile { registered_kind: Some("first-seen".to_owned()), ..SplatFile::load(&path).unwrap() };
    file.save(&unknown).unwrap();
    let error = SavedMemorySettings::read(&unknown).unwrap_err().to_string();
    let expected = "was saved with memory.kind = \"first-seen\", which this program does not have: it has evidence, \
                    features, last-seen";
    assert!(error.ends_with(expected), "{error}");
    let file = SplatFile { registered_kind: Some("First seen".to_owned()), ..file };
    assert!(matches!(file.save(&unknown), Err(SplatFileError::Header { .. })));
    a_form_of_its_own_is_saved_and_loaded();
}

/// Part of the test before: kinds are registered for the whole program.
fn a_form_of_its_own_is_saved_and_loaded() {
    register_memory_kind(&LAST_SEEN_ARRAYS).unwrap();
    let settings: MemorySettings = toml::from_str("kind = 'last-seen-arrays'").unwrap();
    let mut memory = SplatMemory::new(settings.clone(), 0, &mut |_| {}).unwrap();
    assert_eq!((memory.new_segment().unwrap(), memory.new_segment().unwrap()), (1, 2));
    let frame = frame(0.0);
    memory.update(memory.recall(&frame), &halves(1, 2), &BTreeSet::new()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let [path, again, damaged] = ["map.ply", "again.ply", "damaged.ply"].map(|name| folder.path().join(name));
    memory.save(&path).unwrap();
    let loaded = SplatMemory::load(&path, settings.clone()).unwrap();
    assert_eq!(shown(&loaded, &frame), shown(&memory, &frame));
    loaded.save(&again).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(std::fs::read(&again).unwrap(), bytes);
    assert_eq!(SavedMemorySettings::read(&path).unwrap().kind, settings.kind);
    let error = SplatMemory::load(&path, MemorySettings::default()).unwrap_err().to_string();
    assert!(error.contains("last-seen-arrays") && error.contains("evidence"), "{error}");

    // Viewers and exports need none of it.
    let file = SplatFile::load(&path).unwrap();
    assert!(file.gaussians().all(|gaussian| gaussian.confidence == 1.0) && file.content.name() == "arrays");
    let SplatContent::Arrays { mut arrays } = file.content.clone() else { panic!("no arrays") };
    arrays.put("last_ids", &[], [1_u32]);
    SplatFile { content: SplatContent::Arrays { arrays }, ..file.clone() }.save(&damaged).unwrap();
    let error = SplatMemory::load(&damaged, settings).unwrap_err().to_string();
    assert!(error.contains("last_ids: found 1 numbers"), "{error}");
    // Arrays without the name of their kind are refused.
    let unnamed = SplatFile { registered_kind: None, ..file };
    assert!(matches!(unnamed.save(&damaged), Err(SplatFileError::Header { .. })));
    let text = b"comment kind last-seen-arrays\n";
    let start = bytes.windows(text.len()).position(|part| part == text).unwrap();
    std::fs::write(&damaged, [&bytes[..start], &bytes[start + text.len()..]].concat()).unwrap();
    assert!(matches!(SavedMemorySettings::read(&damaged), Err(SplatFileError::Header { .. })));
}

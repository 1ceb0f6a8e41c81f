//! A memory whose map is kept on a device that fails.

use splatseg_geometry::{Image, Intrinsics, LocalPose, Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{
    FrameTrust, MapBackend, MapContent, MapDevice, MapUpdate, MemoryError, MemoryKind, MemorySettings, Recall,
    RememberedSegments, SplatFileError, SplatMap, SplatMemory, VisibleGaussian,
};
use splatseg_render::{Balls, Camera};
use std::sync::Arc;

/// A device that takes maps over and fails at everything else.
#[derive(Debug)]
struct Broken;

/// A map on it.
#[derive(Debug, Default)]
struct BrokenMap(Balls);

fn failure<T>() -> Result<T, MemoryError> {
    Err(MemoryError::Device(Arc::new(std::io::Error::other("out of order"))))
}

impl MapDevice for Broken {
    fn take_over(
        &self,
        _: &MemorySettings,
        map: SplatMap,
        remembered: RememberedSegments,
    ) -> Result<Box<dyn MapBackend>, MemoryError> {
        match remembered {
            RememberedSegments::Votes(votes) => assert_eq!(map.balls.len(), votes.len()),
            RememberedSegments::Features { features, codes } => {
                assert_eq!(map.balls.len() * codes.codebook().feature_dim(), features.len());
            }
        }
        Ok(Box::new(BrokenMap(map.balls)))
    }
}

impl MapBackend for BrokenMap {
    fn recall<'f>(&self, _: &'f RgbdFrame<'_>, _: &Camera, _: FrameTrust) -> Result<Recall<'f>, MemoryError> {
        failure()
    }

    fn transform(&mut self, _: &LocalPose, _: &mut Recall<'_>) -> Result<(), MemoryError> {
        failure()
    }

    fn fuse(&self, _: &Recall<'_>, _: &SegmentMap) -> Result<SegmentMap, MemoryError> {
        failure()
    }

    fn visible_gaussians(&self, _: &Recall<'_>) -> Result<Vec<VisibleGaussian>, MemoryError> {
        failure()
    }

    fn favour(&mut self, _: &[u32], _: SegmentId) -> Result<(), MemoryError> {
        failure()
    }

    fn update(
        &mut self,
        _: &mut Recall<'_>,
        _: &SegmentMap,
        _: u32,
        _: &mut dyn Iterator<Item = SegmentId>,
    ) -> Result<MapUpdate, MemoryError> {
        failure()
    }

    fn new_segment(&mut self, _: SegmentId) -> Result<(), MemoryError> {
        failure()
    }

    fn gaussian_count(&self) -> usize {
        self.0.len()
    }

    fn balls(&self) -> &Balls {
        &self.0
    }

    fn colors(&self) -> &[[u8; 3]] {
        &[]
    }

    fn numbers_per_gaussian(&self) -> usize {
        8
    }

    fn segment_ids(&self) -> Result<Vec<SegmentId>, MemoryError> {
        failure()
    }

    fn segment_shares(&self) -> Result<Option<Vec<f32>>, MemoryError> {
        failure()
    }

    fn content(&self) -> Result<MapContent<'_>, MemoryError> {
        failure()
    }
}

fn wall() -> RgbdFrame<'static> {
    let camera = Intrinsics { fx: 30.0, fy: 30.0, cx: 15.5, cy: 11.5, width: 32, height: 24 };
    RgbdFrame::new("0", Image::filled(32, 24, [9; 3]), Image::filled(32, 24, 2.0), camera, Pose::IDENTITY).unwrap()
}

fn memory(kind: MemoryKind) -> SplatMemory {
    let settings = MemorySettings::default().with(|settings| {
        (settings.kind, settings.num_codes, settings.feature_dim) = (kind, 16, 8);
    });
    SplatMemory::new(settings, 0, &mut |_| {}).unwrap()
}

#[test]
fn a_device_that_fails_is_reported_with_the_next_result() {
    let frame = wall();
    let nothing = SegmentMap::filled(32, 24, 0);
    let mut memory = memory(MemoryKind::Evidence);
    memory.update(memory.recall(&frame), &nothing).unwrap();
    let count = memory.gaussian_count();
    let mut memory = memory.on_device(&Broken).unwrap();
    assert!(memory.gaussian_count() == count && count > 0);
    let recall = memory.recall(&frame);
    assert!(recall.expected().segments == nothing && recall.silhouette().pixels().iter().all(|value| *value == 0.0));
    let expected = "the map's device: out of order";
    assert_eq!(memory.fuse(&recall, &nothing).unwrap_err().to_string(), expected);
    assert_eq!(memory.note_explained(&recall, &nothing, &|_, _| false).unwrap_err().to_string(), expected);
    assert_eq!(memory.update(recall, &nothing).unwrap_err().to_string(), expected);
    assert_eq!(memory.new_segment().unwrap_err().to_string(), expected);
}

#[test]
fn what_cannot_be_read_is_not_saved_and_shows_nothing() {
    let frame = wall();
    let mut memory = memory(MemoryKind::Evidence);
    memory.update(memory.recall(&frame), &SegmentMap::filled(32, 24, 0)).unwrap();
    let memory = memory.on_device(&Broken).unwrap();
    let path = tempfile::tempdir().unwrap().path().join("map.ply");
    assert!(matches!(memory.save(&path).unwrap_err(), SplatFileError::Device { .. }));
    assert!(!path.exists());
    assert!(memory.exported_gaussians().is_none() && memory.carried_ids().is_empty());
    assert!(memory.segment_ids() == vec![0; memory.gaussian_count()]);
    assert!(memory.segment_shares() == vec![1.0; memory.gaussian_count()]);
}

#[test]
fn features_move_as_votes_do() {
    let frame = wall();
    let mut memory = memory(MemoryKind::Features);
    memory.update(memory.recall(&frame), &SegmentMap::filled(32, 24, 0)).unwrap();
    let count = memory.gaussian_count();
    assert!(count > 0);
    assert_eq!(memory.on_device(&Broken).unwrap().gaussian_count(), count);
}

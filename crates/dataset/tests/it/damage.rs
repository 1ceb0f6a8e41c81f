//! Whatever the files contain, reading them ends with a frame or an error.

use crate::support::*;
use proptest::prelude::*;
use splatseg_dataset::{DatasetSettings, ScannetScene, Scene, SevenScenesScene, read_segments_png};
use std::fs;

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, ..ProptestConfig::default() })]

    #[test]
    fn damaged_frames_never_panic(
        part in prop::sample::select(vec!["color.jpg", "depth.png", "pose.txt"]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in any::<prop::sample::Index>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        write_sevenscenes(folder.path(), 1);
        let path = folder.path().join(format!("frame-000000.{part}"));
        fs::write(&path, damaged(fs::read(&path).unwrap(), &changes, &keep)).unwrap();
        let scene = SevenScenesScene::open(folder.path(), &DatasetSettings::default()).unwrap();
        if let Err(error) = scene.read_frame(0) {
            prop_assert!(error.to_string().contains("frame-000000"), "{}", error);
        }
    }

    #[test]
    fn damaged_labels_and_intrinsics_never_panic(
        part in prop::sample::select(vec!["instance-filt/0.png", "intrinsic/intrinsic_color.txt", "depth/0.png"]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in any::<prop::sample::Index>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        write_scannet(folder.path(), 1, &ScannetSizes { color: (32, 24), depth: (16, 12), labels: (32, 24) });
        let path = folder.path().join(part);
        fs::write(&path, damaged(fs::read(&path).unwrap(), &changes, &keep)).unwrap();
        if let Ok(scene) = ScannetScene::open(folder.path(), &DatasetSettings::default()) {
            let _ = scene.read_frame(0);
            let _ = scene.read_ground_truth(0);
        }
        let _ = read_segments_png(&path);
    }
}

//! A map of version 4 of the format, whose state is text, written by commit 5218204:
//! `splatseg run synthetic:frames=10,width=48,height=36,speed=0.1,noise=kinect --set poses=track --save-memory ….ply`.

use splatseg_files::StateBlock;
use splatseg_memory::{Attached, MemorySettings, SplatFile, SplatMemory};
use splatseg_odometry::{PoseMode, PoseSource, Relocaliser, StateScope, TrackedPoses, keyframe_views};
use std::path::{Path, PathBuf};

fn old_map() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/map_of_version_4.ply")
}

fn load(path: &Path) -> (SplatMemory, Vec<u8>) {
    let mut memory = SplatMemory::load(path, MemorySettings::default()).unwrap();
    let keyframes = memory.take_keyframes().unwrap();
    (memory, keyframes)
}

/// The keyframes as a run with the map saves them.
fn saved_again(keyframes: &[u8]) -> Vec<u8> {
    let mut poses = TrackedPoses::new(PoseMode::Track);
    poses.restore(StateScope::Map, keyframes).unwrap();
    poses.save(StateScope::Map).unwrap()
}

#[test]
fn an_old_map_is_loaded_and_saved_in_the_present_form_with_the_same_content() {
    let (memory, keyframes) = load(&old_map());
    assert_eq!((memory.segment_count(), memory.gaussian_count()), (7, 682));
    assert_eq!(memory.map().carried_ids().into_iter().collect::<Vec<_>>(), [1, 2, 3, 4, 5, 7]);
    let views = keyframe_views(&keyframes, None).unwrap();
    assert_eq!(views.iter().map(|view| view.id).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(views[1].world_from_camera.translation().y, 0.09647531140919997);
    assert_eq!((views[0].intrinsics.fx, views[0].depth.size()), (43.199997, (48, 36)));
    assert!(views.iter().all(|view| view.color().is_none()), "old keyframes have no colour");
    assert_eq!(Relocaliser::new(&keyframes).unwrap().keyframe_count(), 2);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.ply");
    let again = saved_again(&keyframes);
    memory.save_with(&path, Attached { keyframes: Some(&again), names: None, history: None }).unwrap();
    let text = std::fs::read(&path).unwrap();
    assert!(text.starts_with(b"ply\nformat binary_little_endian 1.0\ncomment splatseg memory 5 kind evidence"));
    let (_, loaded) = load(&path);
    assert_eq!(saved_again(&loaded), again, "the same keyframes");

    let files = [old_map(), path].map(|path| {
        let mut file = SplatFile::load(path).unwrap();
        let _ = file.saved_state.take_block("keyframes");
        file
    });
    assert_eq!(files[0], files[1], "the same Gaussians, ids and other state");
    let state = &files[0].saved_state;
    assert_eq!(state.get_tuples("memory.anchors"), Ok(vec![[0u64, 635], [1, 47]]));
    assert_eq!(state.get_tuples::<u32, 2>("memory.co_visible").unwrap()[..5], [[1, 2], [1, 3], [1, 4], [1, 5], [2, 3]]);
    let keyframes = StateBlock::from_bytes(&again).unwrap();
    assert_eq!(keyframes.get("feature_offsets", &[]), Ok(vec![0u32, 11, 23]));
    assert_eq!(keyframes.get_tuples("edges"), Ok(vec![[0u32, 1]]));
    assert_eq!(keyframes.get::<f64>("edge_pose", &[4, 4]).unwrap()[3], 0.09647531185729691);
}

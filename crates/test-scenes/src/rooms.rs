//! The synthetic room.

use splatseg_dataset::{Scene, SyntheticScene};
use splatseg_geometry::{RgbdFrame, SegmentMap};

/// A synthetic scene, as on the command line: `synthetic:frames=9,width=64,height=48,seed=2`.
pub fn room(text: &str) -> SyntheticScene {
    SyntheticScene::new(text.parse().unwrap()).unwrap()
}

/// The true ids of a frame, `[height, width]`.
pub fn truth(scene: &dyn Scene, index: usize) -> SegmentMap {
    scene.read_ground_truth(index).unwrap().unwrap()
}

/// All frames of a synthetic scene, with their true ids.
pub fn recording(text: &str) -> Vec<(RgbdFrame<'static>, SegmentMap)> {
    let scene = room(text);
    (0..scene.frame_count()).map(|index| (scene.read_frame(index).unwrap(), truth(&scene, index))).collect()
}

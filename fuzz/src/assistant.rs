//! An assistant with a map of the synthetic room.

use splatseg::settings::SettingsLayers;
use splatseg::{Pipeline, dataset};
use splatseg_dataset::{FrameStream, GroundTruth};
use splatseg_mcp::{Assistant, AssistantOptions};

/// Makes the map and opens it. Nothing may be written.
pub fn assistant() -> Assistant {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let map = folder.path().join("room.ply");
    let settings = SettingsLayers::default().resolve().expect("settings");
    let scene = dataset::open_scene("synthetic:frames=4,width=64,height=48", &settings.dataset).expect("a scene");
    let mut pipeline = Pipeline::builder(&settings).build().expect("a pipeline");
    for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Skip).expect("frames")) {
        processed.expect("a frame").result.expect("a result");
    }
    pipeline.save_memory(&map).expect("a map");
    // The map stays in memory when its file is gone.
    Assistant::open(AssistantOptions { map, ..AssistantOptions::default() }).expect("an assistant")
}

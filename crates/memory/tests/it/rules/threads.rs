//! Results do not depend on the number of threads.

use super::run::{Run, kinds};
use super::scene::{Scene, pose};
use splatseg_geometry::SegmentMap;
use splatseg_memory::MemorySettings;
use std::fs;

/// Runs ten frames on a number of threads. Returns the saved memory and the shown segments.
fn outcome(settings: &MemorySettings, threads: usize) -> (Vec<u8>, Vec<SegmentMap>) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut run = Run::new(settings.clone());
        let shown = (0..10).map(|frame| {
            // A box is carried away halfway.
            let scene = if frame < 5 { Scene::boxes() } else { Scene::boxes().without(4) };
            run.show(&scene.seen_from(pose([0.05 * frame as f32, 0.0, 0.0], frame as f32))).fused
        });
        let shown = shown.collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("memory.ply");
        run.memory.save(&path).unwrap();
        (fs::read(path).unwrap(), shown)
    })
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    for settings in kinds() {
        let (bytes, shown) = outcome(&settings, 1);
        for threads in [2, 4] {
            let (other_bytes, other_shown) = outcome(&settings, threads);
            assert!(other_shown == shown, "{:?}: segments shown with {threads} threads", settings.kind);
            assert!(other_bytes == bytes, "{:?}: memory with {threads} threads", settings.kind);
        }
    }
}

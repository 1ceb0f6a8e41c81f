//! Frames per second of FastSAM-Splat without its segmenter, stage by stage, with both kinds of memory, on redkitchen at
//! 310×230 (320×240 less a 5-pixel border); features have D = 28 and 20 steps. Without `../shared` it measures the
//! synthetic room instead.
//!
//! `cargo bench -p splatseg --bench fastsam_splat`

use criterion::{Criterion, criterion_group, criterion_main};
use splatseg::dataset::{DatasetSettings, FrameStream, GroundTruth, ImageSize, Scene, open_scene};
use splatseg::memory::{MemoryKind, MemorySettings};
use splatseg::tracking::StageTimes;
use splatseg::{
    FastSamSplat, FastSamSplatSettings, GraphSegmenter, GraphSettings, Method, RgbdFrame, ScoredMask, Segmenter,
};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn scene(settings: &DatasetSettings) -> Arc<dyn Scene> {
    let redkitchen = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/redkitchen");
    if redkitchen.exists() {
        return open_scene(redkitchen, settings).expect("redkitchen can be read");
    }
    println!("../shared is not here: measuring the synthetic room");
    open_scene("synthetic:frames=100,noise=kinect", settings).expect("the synthetic room needs no file")
}

/// Every frame with the masks that the segmenter finds in it.
fn segmented_frames() -> Vec<(RgbdFrame<'static>, Vec<ScoredMask>)> {
    let resize = Some(ImageSize { width: 320, height: 240 });
    let settings = DatasetSettings { resize, crop_border: 5, ..DatasetSettings::default() };
    let mut segmenter = GraphSegmenter::new(GraphSettings::default()).expect("defaults are in range");
    FrameStream::open(scene(&settings), &settings, GroundTruth::Skip)
        .expect("the scene has frames")
        .map(|frame| {
            let frame = frame.expect("every frame is good").frame;
            let masks = segmenter.segment(&frame).expect("every frame can be segmented");
            (frame, masks)
        })
        .collect()
}

/// Tracks the whole video; summed stage times and the slowest frame.
fn track(frames: &[(RgbdFrame<'static>, Vec<ScoredMask>)], kind: MemoryKind) -> (StageTimes, Duration) {
    let segmenter = GraphSegmenter::new(GraphSettings::default()).expect("defaults are in range");
    let memory = MemorySettings { kind, ..MemorySettings::default() };
    let settings = FastSamSplatSettings { memory, ..FastSamSplatSettings::default() };
    let mut method = FastSamSplat::new(Box::new(segmenter), settings, &mut |_| {}).expect("defaults are in range");
    let (mut times, mut slowest) = (StageTimes::default(), Duration::ZERO);
    for (frame, masks) in frames {
        let output = method.track(frame, masks).expect("masks are of the frame's size");
        times += output.times;
        slowest = slowest.max(output.times.without_segmenter());
    }
    (times, slowest)
}

fn print_stages(frames: &[(RgbdFrame<'static>, Vec<ScoredMask>)], kind: MemoryKind) {
    let (times, slowest) = track(frames, kind);
    let count = frames.len() as f64;
    for (stage, time) in &times.stages()[1..] {
        println!("{stage:16} {:7.2} ms per frame", time.as_secs_f64() * 1e3 / count);
    }
    println!(
        "{}: {:.2} frames per second without the segmenter, slowest frame {:.0} ms",
        kind.name(),
        count / times.without_segmenter().as_secs_f64(),
        slowest.as_secs_f64() * 1e3
    );
}

fn whole_video(criterion: &mut Criterion) {
    let frames = segmented_frames();
    let kinds = [MemoryKind::Evidence, MemoryKind::Features];
    kinds.into_iter().for_each(|kind| print_stages(&frames, kind));
    let mut group = criterion.benchmark_group("fastsam_splat");
    group.sample_size(10);
    for kind in kinds {
        group.bench_function(format!("whole_video/{}", kind.name()), |bencher| {
            bencher.iter_custom(|rounds| (0..rounds).map(|_| track(&frames, kind).0.without_segmenter()).sum());
        });
    }
    group.finish();
}

criterion_group!(benches, whole_video);
criterion_main!(benches);

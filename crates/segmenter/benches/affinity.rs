//! The stages of the affinity segmenter on a frame of 320×240, each including the stages before it.
//!
//! `cargo bench -p splatseg-segmenter --bench affinity`; `RAYON_NUM_THREADS` sets the number of threads.

use criterion::{Criterion, criterion_group, criterion_main};
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::CameraFrame;
use splatseg_segmenter::{AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeights, Segmenter};
use splatseg_test_scenes::{demo_clip, shared};

/// A frame of a real kitchen, or the first of the demo where that is missing. Real depth makes twice as many regions.
fn frame() -> CameraFrame<'static> {
    let folder = shared("data/redkitchen_dense", "a real frame").unwrap_or_else(demo_clip);
    let mut settings = DatasetSettings::default();
    settings.resize = "320x240".parse().ok();
    let scene = open_scene(folder, &settings).expect("a scene");
    let mut frames = FrameStream::open(scene, &settings, GroundTruth::Skip).expect("a scene");
    frames.next().expect("a frame").expect("a frame").frame
}

fn stages(criterion: &mut Criterion) {
    let frame = frame();
    let network = AffinityNetwork::load(&AffinityWeights::BuiltIn).expect("built-in weights");
    let mut segmenter = AffinitySegmenter::new(network, AffinitySettings::default()).expect("settings");
    let mut group = criterion.benchmark_group("affinity");
    group.sample_size(30);
    group.bench_function("inputs", |bencher| bencher.iter(|| segmenter.inputs(&frame).channels()));
    group.bench_function("inputs, network", |bencher| {
        bencher.iter(|| segmenter.log_odds(&frame).expect("the CPU").channels())
    });
    group.bench_function("inputs, network, merging", |bencher| {
        bencher.iter(|| segmenter.merge_tree(&frame).expect("the CPU"))
    });
    group.bench_function("all", |bencher| bencher.iter(|| segmenter.segment(&frame)));
    group.finish();
}

criterion_group!(benches, stages);
criterion_main!(benches);

//! The stages of the affinity segmenter on a frame of 320×240, each including the stages before it.
//!
//! `cargo bench -p splatseg-segmenter --bench affinity`; `RAYON_NUM_THREADS` sets the number of threads.

use criterion::{Criterion, criterion_group, criterion_main};
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::CameraFrame;
use splatseg_segmenter::{AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeights, Segmenter};
use splatseg_test_scenes::demo_clip;

/// The first frame of the demo.
fn frame() -> CameraFrame<'static> {
    let settings = DatasetSettings::default();
    let scene = open_scene(demo_clip(), &settings).expect("the demo");
    let mut frames = FrameStream::open(scene, &settings, GroundTruth::Skip).expect("the demo");
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

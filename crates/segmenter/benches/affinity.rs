//! The stages of the affinity segmenter on a frame of 320×240, each with those before it.
//!
//! `cargo bench -p splatseg-segmenter --bench affinity`; `RAYON_NUM_THREADS` sets the number of threads.

use criterion::{Criterion, criterion_group, criterion_main};
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame};
use splatseg_segmenter::{AffinityNetwork, AffinitySegmenter, AffinitySettings, Segmenter};

/// Boxes of different depths before a slanted wall, with noise and holes.
fn frame() -> RgbdFrame<'static> {
    let (width, height) = (320, 240);
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    let block = |column: usize, row: usize| (column / 50 * 7 + row / 45 * 5) % 11;
    let depth = Image::from_fn(width, height, |column, row| {
        let depth = 1.5 + 0.15 * block(column, row) as f32 + 0.002 * column as f32;
        if noise() > 0.95 { 0.0 } else { depth + 0.003 * depth * depth * noise() }
    });
    let color = Image::from_fn(width, height, |column, row| {
        let shade = 20.0 * block(column, row) as f32 + 20.0 + 8.0 * noise();
        [shade as u8, (255.0 - shade) as u8, 120]
    });
    let camera = Intrinsics { fx: 288.0, fy: 288.0, cx: 159.5, cy: 119.5, width, height };
    RgbdFrame::new("0", color, depth, camera, Pose::IDENTITY).expect("a frame")
}

fn stages(criterion: &mut Criterion) {
    let frame = frame();
    let network = AffinityNetwork::built_in().expect("built-in weights");
    let mut segmenter = AffinitySegmenter::new(network, AffinitySettings::default()).expect("settings");
    let mut group = criterion.benchmark_group("affinity");
    group.sample_size(30);
    group.bench_function("inputs", |bencher| bencher.iter(|| segmenter.inputs(&frame).channels()));
    group.bench_function("inputs, network", |bencher| bencher.iter(|| segmenter.log_odds(&frame).channels()));
    group.bench_function("inputs, network, merging", |bencher| bencher.iter(|| segmenter.merge_tree(&frame)));
    group.bench_function("all", |bencher| bencher.iter(|| segmenter.segment(&frame)));
    group.finish();
}

criterion_group!(benches, stages);
criterion_main!(benches);

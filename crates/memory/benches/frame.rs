//! The memory's part of one frame of 320 × 240 pixels: what it expects to see, and what it learns.
//!
//! `cargo bench -p splatseg-memory --bench frame`

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use splatseg_geometry::SegmentMap;
use splatseg_memory::{MemoryKind, MemorySettings, SplatMemory};
use std::cell::RefCell;
use std::collections::BTreeSet;

const SCENE: &str = "synthetic:frames=40,width=320,height=240,noise=kinect";

fn frames(criterion: &mut Criterion) {
    let recording = splatseg_test_scenes::recording(SCENE);
    for kind in [MemoryKind::Evidence, MemoryKind::Features] {
        let settings = MemorySettings::default().with(|memory| memory.kind = kind);
        let mut memory = SplatMemory::new(settings, 0, &mut |_| {}).expect("the settings are in range");
        let highest = recording.iter().flat_map(|(_, ids)| ids.pixels()).max().copied().unwrap_or(0);
        (0..highest).for_each(|_| drop(memory.new_segment()));
        let learn = |memory: &mut SplatMemory, recall, ids: &SegmentMap| {
            memory.update(recall, ids, &BTreeSet::new()).expect("the ids exist")
        };
        for (frame, ids) in &recording {
            let recall = memory.recall(frame);
            learn(&mut memory, recall, ids);
        }
        let (frame, ids) = recording.last().expect("the scene has frames");
        let memory = RefCell::new(memory);
        let recall = || memory.borrow().recall(frame);
        let view = recall();
        println!(
            "{}: {} Gaussians, {} blend weights",
            kind.name(),
            memory.borrow().gaussian_count(),
            view.view().weights().non_zeros()
        );
        let mut group = criterion.benchmark_group(format!("frame_{}", kind.name()));
        group.sample_size(20);
        group.bench_function("recall", |bencher| bencher.iter(recall));
        group.bench_function("fuse", |bencher| bencher.iter(|| memory.borrow().fuse(&view, ids)));
        group.bench_function("second_opinion", |bencher| bencher.iter(|| memory.borrow().second_opinion(&view)));
        group.bench_function("learn", |bencher| {
            bencher.iter_batched(
                recall,
                |recall| learn(&mut memory.borrow_mut(), recall, ids),
                BatchSize::PerIteration,
            );
        });
        group.finish();
    }
}

criterion_group!(benches, frames);
criterion_main!(benches);

//! The correction of a map of 100,000 Gaussians and 300 keyframes when a loop is closed, which must not hold up a frame:
//! Gaussians move, a quarter of them become one with others, and ids are merged.
//!
//! `cargo bench -p splatseg-memory --bench correction`

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use splatseg_files::StateBlock;
use splatseg_geometry::{MapCorrection, Pose};
use splatseg_memory::{MemorySettings, SplatContent, SplatFile, SplatMap, SplatMemory, Votes};
use splatseg_render::Balls;

/// Number of keyframes of the map, and how many of them show its places for the first time.
const KEYFRAMES: usize = 300;
const FIRST_ROUND: usize = 225;

/// A wall of 100,000 Gaussians, two centimetres apart, along a path of 300 keyframes. The last quarter shows the beginning
/// again, ten centimetres off.
fn drifted_map() -> SplatFile {
    const COUNT: usize = 100_000;
    let keyframe = |index: usize| index * KEYFRAMES / COUNT;
    let place = |index: usize| {
        let round = index % (FIRST_ROUND * COUNT / KEYFRAMES);
        let off = if round == index { 0.0 } else { 0.1 };
        Vec3::new((round / 18) as f32 * 0.02, (round % 18) as f32 * 0.02, 2.0 + off)
    };
    let id = |index: usize| 1 + (keyframe(index) / 5) as u32;
    let segment_ids: Vec<u32> = (0..COUNT).map(id).collect();
    let first = |keyframe: usize| (keyframe * COUNT).div_ceil(KEYFRAMES);
    let runs = (0..KEYFRAMES).flat_map(|number| [number, first(number + 1) - first(number)]);
    let mut saved_state = StateBlock::default();
    saved_state.put("memory.anchors", &[2], runs.map(|number| number as u64));
    let count = 1 + KEYFRAMES / 5;
    SplatFile {
        origin: DVec3::ZERO,
        registered_kind: None,
        map: SplatMap {
            balls: Balls { means: (0..COUNT).map(place).collect(), radii: vec![0.012; COUNT] },
            colors: vec![[128; 3]; COUNT],
            last_seen: vec![7; COUNT],
            seen_through: vec![0; COUNT],
            anchors: vec![],
            surfaces: vec![],
        },
        content: SplatContent::Evidence { votes: segment_ids.iter().map(|id| Votes::one(*id, 4.0)).collect() },
        segment_ids,
        ids: (1..=count as u32).collect(),
        sightings: vec![9; count],
        carried: vec![true; count],
        frames: 300,
        saved_state,
    }
}

fn correcting(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("memory.ply");
    drifted_map().save(&path).expect("the file can be written");
    let back =
        |keyframe: usize| Pose::from_translation(DVec3::Z * (-0.1 * (keyframe as f64 / FIRST_ROUND as f64).min(1.0)));
    let correction = MapCorrection {
        new_from_old: (0..KEYFRAMES).map(|keyframe| (keyframe as u32, back(keyframe))).collect(),
        joined: vec![(0, FIRST_ROUND as u32)],
    };
    let load = || SplatMemory::load(&path, MemorySettings::default()).expect("the file can be read");
    let correct = |mut memory: SplatMemory| (memory.correct(&correction).len(), memory);
    let (merged, memory) = correct(load());
    println!("{merged} ids merged, {} Gaussians remain", memory.gaussian_count());
    let mut group = criterion.benchmark_group("100000_gaussians");
    group.sample_size(20);
    group.bench_function("correct", |bencher| bencher.iter_batched(load, correct, BatchSize::PerIteration));
    group.finish();
}

criterion_group!(benches, correcting);
criterion_main!(benches);

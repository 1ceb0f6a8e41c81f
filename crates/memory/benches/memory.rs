//! Operations that a user waits for: generating codebooks, decoding, saving and loading a memory of a million
//! Gaussians.
//!
//! `cargo bench -p splatseg-memory`

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use splatseg_files::StateBlock;
use splatseg_memory::{Codebook, CodebookSettings, SplatContent, SplatFile, SplatMap, Votes};
use splatseg_render::Balls;
use std::hint::black_box;

fn codebook(num_codes: usize, feature_dim: usize) -> Codebook {
    let settings = CodebookSettings { num_codes, feature_dim, seed: 0 };
    Codebook::generate(&settings, &mut |_| {}).expect("the settings are in range")
}

fn making_codebooks(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("codebook");
    group.sample_size(10);
    for num_codes in [128, 512, 2048] {
        for feature_dim in [4, 7, 14, 28] {
            let distance = codebook(num_codes, feature_dim).min_distance();
            println!("N {num_codes}, D {feature_dim}: smallest distance {distance:.4}");
            group.bench_function(format!("N{num_codes}_D{feature_dim}"), |bencher| {
                bencher.iter(|| codebook(num_codes, feature_dim));
            });
        }
    }
    group.finish();
}

fn decoding(criterion: &mut Criterion) {
    let codebook = codebook(512, 28);
    let feature = codebook.vector(300).to_vec();
    let mut group = criterion.benchmark_group("decode_512x28");
    for (name, hint) in [("search", None), ("hint", Some(300))] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| codebook.decode_with_hint(black_box(&feature), hint, 512, 0.5));
        });
    }
    group.finish();
}

fn files(criterion: &mut Criterion) {
    const COUNT: usize = 1_000_000;
    let means = (0..COUNT).map(|index| Vec3::splat(index as f32 * 1e-5)).collect();
    let map = SplatMap {
        balls: Balls { means, radii: vec![0.01; COUNT] },
        colors: vec![[128; 3]; COUNT],
        last_seen: vec![7; COUNT],
        seen_through: vec![0; COUNT],
        anchors: vec![],
        surfaces: vec![],
    };
    let evidence = SplatContent::Evidence { votes: vec![Votes::one(1, 4.0); COUNT] };
    let features = SplatContent::Features { features: vec![0.25; COUNT * 28], codebook: codebook(512, 28) };
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("memory.ply");
    let mut group = criterion.benchmark_group("million_gaussians");
    group.sample_size(10);
    for content in [evidence, features] {
        let kind = content.name();
        let (map, segment_ids) = (map.clone(), vec![1; COUNT]);
        let file = SplatFile {
            origin: DVec3::ZERO,
            map,
            content,
            registered_kind: None,
            segment_ids,
            ids: (1..=40).collect(),
            sightings: vec![9; 40],
            carried: vec![true; 40],
            frames: 300,
            saved_state: StateBlock::default(),
        };
        group.bench_function(format!("save_{kind}"), |bencher| {
            bencher.iter(|| file.save(&path).expect("the file can be written"));
        });
        group.bench_function(format!("load_{kind}"), |bencher| {
            bencher.iter(|| SplatFile::load(&path).expect("the file can be read"));
        });
    }
    group.finish();
}

criterion_group!(benches, making_codebooks, decoding, files);
criterion_main!(benches);

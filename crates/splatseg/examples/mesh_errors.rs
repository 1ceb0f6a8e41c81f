//! Compares meshes with the exact surfaces of synthetic rooms, for the numbers in docs/EXPORT.md:
//!
//! `cargo run --release -p splatseg --example mesh_errors -- track synthetic:frames=48,noise=kinect,seed=1 …`
//!
//! The first word says where poses are from: `given` or `track`. `--map MAP.ply` before a scene uses a map that was saved
//! before instead of making one, `--voxel 0.02` sets the size of voxels.

#[path = "../tests/it/mesh_accuracy/mod.rs"]
mod mesh_accuracy;

use mesh_accuracy::{Errors, errors, mapped};
use splatseg::dataset::{SyntheticScene, SyntheticSettings};
use splatseg::mesh::{MeshSettings, reconstruct};
use splatseg::odometry::keyframe_views;
use splatseg::pipeline::NamedMap;
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let poses = words.next().ok_or("expected: mesh_errors given|track SCENE …")?;
    let (mut settings, mut map) = (MeshSettings::default(), None);
    let mut all: Vec<Errors> = Vec::new();
    while let Some(word) = words.next() {
        match word.as_str() {
            "--voxel" => settings.voxel = Some(words.next().ok_or("--voxel: expected metres")?.parse()?),
            "--map" => map = Some(words.next().ok_or("--map: expected a file")?),
            scene => {
                let text = scene.to_owned();
                let scene = SyntheticScene::new(scene.parse::<SyntheticSettings>()?)?;
                let folder = tempfile::tempdir()?;
                let path = folder.path().join("map.ply");
                let file = map.take().map_or_else(|| mapped(&scene, &poses, &path), |map| Ok(map.into()))?;
                let start = Instant::now();
                let map = NamedMap::load(file)?;
                let keyframes = keyframe_views(map.keyframes.as_deref().ok_or("the map has no keyframes")?, None)?;
                let mesh = reconstruct(&map.memory.map(), &keyframes, &settings)?;
                let seconds = start.elapsed().as_secs_f64();
                let found = errors(&mesh, &keyframes, &scene)?;
                println!("{text}: {found}, {} keyframes, {seconds:.2} s", keyframes.len());
                all.push(found);
            }
        }
    }
    let mean = |value: fn(&Errors) -> f64| all.iter().map(value).sum::<f64>() / all.len().max(1) as f64;
    println!("mean: accuracy {:.2} %, completeness {:.2} %", mean(|all| all.accuracy), mean(|all| all.completeness));
    Ok(())
}

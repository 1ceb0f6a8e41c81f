//! Meshes of maps: how well they agree with the exact surfaces, and what is not in them.

use crate::mesh_accuracy::{errors, mapped};
use glam::Vec3;
use splatseg::dataset::{Motion, Mover, Noise, SyntheticScene, SyntheticSettings};
use splatseg::mesh::{MeshSettings, TriangleMesh, reconstruct};
use splatseg::odometry::{KeyframeView, keyframe_views};
use splatseg::pipeline::NamedMap;

struct Meshed {
    mesh: TriangleMesh,
    keyframes: Vec<KeyframeView>,
    /// Centres of the map's Gaussians.
    gaussians: Vec<Vec3>,
}

fn meshed(scene: &SyntheticScene, poses: &str, voxel: f32) -> Meshed {
    let folder = tempfile::tempdir().unwrap();
    let map = NamedMap::load(mapped(scene, poses, &folder.path().join("map.ply")).unwrap()).unwrap();
    let keyframes = keyframe_views(map.keyframes.as_deref().unwrap(), None).unwrap();
    let mesh = reconstruct(&map.memory.map(), &keyframes, &MeshSettings { voxel: Some(voxel) }).unwrap();
    let gaussians = map.memory.map().means.to_vec();
    Meshed { mesh, keyframes, gaussians }
}

#[test]
fn a_mesh_of_a_tracked_kinect_agrees_with_the_room() {
    let settings = "synthetic:frames=64,speed=0.25,noise=kinect,seed=3".parse().unwrap();
    let scene = SyntheticScene::new(settings).unwrap();
    let Meshed { mesh, keyframes, .. } = meshed(&scene, "track", 0.02);
    let found = errors(&mesh, &keyframes, &scene).unwrap();
    assert!(found.accuracy > 90.0 && found.completeness > 85.0, "{found}");
}

#[test]
fn what_has_gone_is_not_in_the_mesh() {
    let settings = SyntheticSettings { moving: 8, frames: 48, noise: Noise::Kinect, ..SyntheticSettings::default() };
    let scene = SyntheticScene::new(settings).unwrap();
    let Meshed { mesh, gaussians, .. } = meshed(&scene, "given", 0.02);
    let is_gone = |mover: &Mover| matches!(mover.motion, Motion::Vanish { .. });
    let mut looked_for = 0;
    for thing in scene.things() {
        // Its upper part, away from what it stands on.
        let is_inside = |place: &&Vec3| {
            let beside = **place - thing.center;
            let is_above = beside.z > 0.0 && beside.z <= 0.5 * thing.size.z + 0.02;
            is_above && beside.truncate().length() < 0.5 * thing.size.truncate().min_element()
        };
        let count = |places: &[Vec3]| places.iter().filter(is_inside).count();
        match scene.movers().iter().find(|mover| mover.id == thing.id) {
            // The map keeps what the camera did not look at again.
            Some(mover) if is_gone(mover) && count(&gaussians) < 3 => {
                // A few are beside Gaussians that the map still has.
                assert!(count(&mesh.positions) < 25, "object {} has gone", thing.id);
                looked_for += 1;
            }
            None if count(&gaussians) > 20 => {
                assert!(count(&mesh.positions) > 50, "object {} is still there", thing.id);
            }
            _ => {}
        }
    }
    assert!(looked_for > 0);
}

//! Relations of the objects of synthetic rooms, where what stands on what is known.

use crate::seen_room::seen_room;
use glam::{Mat3, Vec3};
use splatseg_dataset::{Noise, SyntheticScene, SyntheticSettings};
use splatseg_geometry::Pose;
use splatseg_objects::{Relation, RelationKind, relations};

/// Id of the floor.
const FLOOR: u32 = 1;

fn settings(seed: u64, noise: Noise) -> SyntheticSettings {
    SyntheticSettings { seed, noise, frames: 24, width: 160, height: 120, ..SyntheticSettings::default() }
}

/// True if a relation holds in the scene.
fn holds(scene: &SyntheticScene, relation: &Relation) -> bool {
    let things = scene.things();
    let thing = |id| things.iter().find(|thing| thing.id == id);
    let base = |id| scene.carrier(id).unwrap_or(FLOOR);
    let (Some(subject), other) = (thing(relation.subject), thing(relation.object)) else { return false };
    match (relation.relation, other) {
        (RelationKind::On, _) => base(subject.id) == relation.object,
        // Things touch no others but those that they stand on, so none contains or covers another.
        (RelationKind::In | RelationKind::Under, _) | (RelationKind::Beside, None) => false,
        (RelationKind::Beside, Some(other)) => {
            let apart = subject.center.truncate().distance(other.center.truncate());
            let reach = 0.5 * (subject.size.truncate().length() + other.size.truncate().length());
            base(subject.id) == base(other.id) && apart < reach + 0.22
        }
    }
}

#[test]
fn relations_of_rooms_are_right() {
    let (mut right, mut on_things, mut beside) = (0, 0, 0);
    for (seed, noise) in [(0, Noise::None), (1, Noise::Kinect), (2, Noise::Kinect), (3, Noise::Kinect)] {
        let scene = SyntheticScene::new(settings(seed, noise)).unwrap();
        let seen = seen_room(settings(seed, noise), Pose::IDENTITY);
        for relation in relations(&seen.memory.map(), Vec3::Z) {
            assert!(holds(&scene, &relation), "seed {seed}: {relation:?}");
            right += 1;
            on_things += usize::from(relation.relation == RelationKind::On && relation.object != FLOOR);
            beside += usize::from(relation.relation == RelationKind::Beside);
        }
    }
    println!("{right} right, {on_things} on another thing, {beside} beside");
    assert!(right > 20 && on_things > 0, "{right}, {on_things} on another thing");
}

#[test]
fn the_world_may_be_turned() {
    let turn = Mat3::from_rotation_x(2.0) * Mat3::from_rotation_z(0.7);
    let world = Pose::from_matrix(glam::DMat4::from_mat3(turn.as_dmat3())).unwrap();
    let found = |place: Pose, up: Vec3| relations(&seen_room(settings(1, Noise::None), place).memory.map(), up);
    let (upright, turned) = (found(Pose::IDENTITY, Vec3::Z), found(world, turn * Vec3::Z));
    let same = turned.iter().filter(|relation| upright.contains(relation)).count();
    // Points are rounded otherwise, which can decide what is just certain.
    assert!(!upright.is_empty() && 10 * same >= 8 * upright.len(), "{same} of {}", upright.len());
    assert!(found(Pose::IDENTITY, Vec3::NEG_Z).len() * 4 < upright.len(), "with the wrong up nothing is certain");
}

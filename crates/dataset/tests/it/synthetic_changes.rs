//! A room and a tour before and after a change: the same things are different in both, and they are clearly visible.

use splatseg_dataset::{ChangeKind, Scene, SyntheticScene, Thing, TrueChange};
use splatseg_test_scenes::room;
use std::collections::BTreeMap;

/// Returns the scene before and after.
fn visits(text: &str) -> [SyntheticScene; 2] {
    ["before", "after"].map(|visit| room(&format!("{text},visit={visit}")))
}

fn things(scene: &SyntheticScene) -> BTreeMap<u32, Thing> {
    scene.things().into_iter().map(|thing| (thing.id, thing)).collect()
}

fn count(changes: &[TrueChange], kind: ChangeKind) -> usize {
    changes.iter().filter(|change| change.kind == kind).count()
}

#[test]
fn the_changes_are_all_that_differs() {
    for text in ["synthetic:seed=1", "synthetic:seed=2", "synthetic:seed=3,tour=4", "synthetic:seed=4,tour=1"] {
        let [before, after] = visits(text);
        let changes = before.changes();
        assert_eq!(changes, after.changes());
        let kinds = [ChangeKind::Gone, ChangeKind::New, ChangeKind::Moved].map(|kind| count(changes, kind));
        assert_eq!(kinds, [3, 2, 2], "{text}");
        let (old, new) = (things(&before), things(&after));
        for change in changes {
            let [then, now] = [&old, &new].map(|things| things.get(&change.id));
            assert_eq!((then.map(|thing| thing.center), now.map(|thing| thing.center)), (change.before, change.after));
            assert_eq!(then.or(now).unwrap().size, change.size);
            assert_eq!(
                (change.kind == ChangeKind::New, change.kind == ChangeKind::Gone),
                (then.is_none(), now.is_none())
            );
            if let (Some(then), Some(now)) = (change.before, change.after) {
                assert!(then.distance(now) >= 1.0, "{text}: {then} {now}");
            }
        }
        let is_unchanged = |id: &u32| changes.iter().all(|change| change.id != *id);
        let ids = old.keys().chain(new.keys()).filter(|id| is_unchanged(id));
        assert!(ids.clone().count() > 20 && ids.clone().all(|id| old[id] == new[id]), "{text}");
    }
}

#[test]
fn a_twin_is_gone_and_another_moved() {
    for text in ["synthetic:seed=1", "synthetic:seed=6,tour=4"] {
        let [before, _] = visits(text);
        let twins = |kind| {
            let is_twin = |change: &&TrueChange| before.twins().iter().any(|group| group.contains(&change.id));
            before.changes().iter().filter(|change| change.kind == kind).filter(is_twin).count()
        };
        assert_eq!([ChangeKind::Gone, ChangeKind::Moved].map(twins), [1, 1], "{text}");
        for group in before.twins() {
            assert!(group.iter().filter(|id| before.changes().iter().any(|change| change.id == **id)).count() <= 1);
        }
    }
}

#[test]
fn changed_things_are_clearly_visible() {
    for (text, step) in [
        ("synthetic:frames=48,seed=1", 1),
        ("synthetic:frames=48,seed=2", 1),
        ("synthetic:frames=1800,seed=3,tour=4", 25),
    ] {
        let [before, after] = visits(text);
        for (scene, other) in [(&before, &after), (&after, &before)] {
            let frames: Vec<_> = (0..scene.frame_count())
                .step_by(step)
                .map(|index| scene.read_ground_truth(index).unwrap().unwrap().areas())
                .collect();
            let present = things(scene);
            for change in scene.changes().iter().filter(|change| present.contains_key(&change.id)) {
                let clear = frames.iter().filter(|areas| areas.get(&change.id) >= Some(&300)).count();
                assert!(clear >= 3, "{text}: {} is clear in {clear} frames", change.id);
            }
            assert_ne!(
                scene.read_frame(0).unwrap().world_from_camera(),
                other.read_frame(0).unwrap().world_from_camera()
            );
        }
    }
}

#[test]
fn changes_depend_on_the_seed_only() {
    let [room, _] = visits("synthetic:seed=1");
    let [video, _] = visits("synthetic:seed=1,frames=700,speed=0.05,noise=kinect");
    assert_eq!(room.changes(), video.changes());
    assert_ne!(room.changes(), visits("synthetic:seed=2")[0].changes());
    let plain = splatseg_test_scenes::room("synthetic:seed=1");
    assert!(plain.changes().is_empty());
}

#[test]
fn too_few_things_are_an_error() {
    let settings = "synthetic:objects=4,visit=after".parse().unwrap();
    let error = SyntheticScene::new(settings).unwrap_err().to_string();
    assert!(error.contains("visit: found \"after\", expected enough clearly visible things"), "{error}");
}

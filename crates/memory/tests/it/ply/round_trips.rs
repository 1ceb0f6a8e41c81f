//! Saved memories are loaded unchanged.

use super::sample::{KINDS, features, place, sample, saved, with_content};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use splatseg_files::StateBlock;
use splatseg_memory::{
    Codebook, CodebookSettings, MemoryKind, SavedMemorySettings, SplatContent, SplatFile, SplatMap, Votes,
};
use splatseg_render::Balls;
use std::fs;
use std::path::Path;

fn reloaded(file: &SplatFile) -> SplatFile {
    let place = place();
    file.save(&place.path).unwrap();
    SplatFile::load(&place.path).unwrap()
}

#[test]
fn saved_memories_are_loaded_unchanged() {
    for kind in KINDS {
        for count in [0, 1, 7, 3000] {
            let file = sample(kind, count);
            assert_eq!(reloaded(&file), file);
        }
    }
    for (count, feature_dim) in [(1, 1), (3000, 28)] {
        let file = with_content(features(count, feature_dim), count);
        assert_eq!(reloaded(&file), file);
    }
}

#[test]
fn a_loaded_codebook_grows_as_the_saved_one_would_have() {
    let grown = |content: SplatContent| {
        let SplatContent::Features { mut codebook, .. } = content else { panic!("no codebook") };
        codebook.extend(4, &mut |_| ()).unwrap();
        codebook
    };
    let file = with_content(features(2, 28), 2);
    assert_eq!(grown(reloaded(&file).content), grown(file.content));
}

#[test]
fn every_color_is_loaded_unchanged() {
    for kind in KINDS {
        let mut file = sample(kind, 256);
        file.map.colors = (0..=255).map(|value| [value, 255 - value, value]).collect();
        assert_eq!(reloaded(&file).map.colors, file.map.colors);
    }
}

#[test]
fn equal_memories_are_equal_files() {
    for kind in KINDS {
        assert_eq!(saved(&sample(kind, 50)), saved(&sample(kind, 50)));
    }
}

#[test]
fn paths_that_fail_are_named() {
    let place = place();
    let file = sample(KINDS[0], 1);
    let error = SplatFile::load(&place.path).unwrap_err().to_string();
    assert!(error.contains("memory.ply: cannot open"), "{error}");
    let missing = place.path.join("folder").join("a.ply");
    assert!(file.save(&missing).unwrap_err().to_string().contains("a.ply: cannot create"));
    let folder = place.path.parent().unwrap();
    assert!(file.save(folder).is_err());
    assert!(SplatFile::load(folder).is_err());
}

#[cfg(unix)]
#[test]
fn saved_files_have_the_permissions_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let place = place();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    sample(KINDS[0], 1).save(&place.path).unwrap();
    let other = place.path.with_extension("txt");
    fs::write(&other, "").unwrap();
    assert_eq!(mode(&place.path), mode(&other));
}

const MAX_ID: u32 = 4;

fn any_finite() -> impl Strategy<Value = f32> {
    any::<u32>().prop_map(f32::from_bits).prop_filter("finite", |value| value.is_finite())
}

fn any_positive() -> impl Strategy<Value = f32> {
    any_finite().prop_map(f32::abs).prop_filter("positive", |value| *value > 0.0)
}

fn any_votes() -> impl Strategy<Value = f32> {
    prop_oneof![Just(0.0), any_positive()]
}

prop_compose! {
    fn any_gaussian()(
        mean in [any_finite(), any_finite(), any_finite()],
        radius in any_positive(),
        color in any::<[u8; 3]>(),
        last_seen in 0..=9u32,
        seen_through in any::<u8>(),
        ids in [0..=MAX_ID, 0..=MAX_ID, 0..=MAX_ID, 0..=MAX_ID],
        votes in [any_votes(), any_votes(), any_votes(), any_votes()],
        feature in [any_finite(), any_finite()],
        segment_id in 0..=MAX_ID,
    ) -> (SplatMap, Votes, [f32; 2], u32) {
        let map = SplatMap {
            balls: Balls { means: vec![Vec3::from(mean)], radii: vec![radius] },
            colors: vec![color],
            last_seen: vec![last_seen],
            seen_through: vec![seen_through],
            anchors: vec![],
            surfaces: vec![],
        };
        (map, Votes::from_slots(std::array::from_fn(|slot| (ids[slot], votes[slot]))), feature, segment_id)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_memory_is_loaded_unchanged(
        gaussians in proptest::collection::vec(any_gaussian(), 0..6),
        sightings in any::<[u32; MAX_ID as usize]>(),
        carried in any::<[bool; MAX_ID as usize]>(),
        arrays in prop::collection::btree_map("[a-z_.]{1,12}", any::<Vec<u16>>(), 0..4),
        kind in prop::option::of("[a-z0-9_-]{1,12}"),
        origin in prop_oneof![Just([0.0; 3]), proptest::array::uniform3(-1e9f64..1e9)],
    ) {
        let origin = DVec3::from(origin);
        let mut saved_state = StateBlock::default();
        arrays.iter().for_each(|(name, values)| saved_state.put(name, &[], values.iter().copied()));
        let mut map = SplatMap::default();
        let (mut all_votes, mut all_features, mut segment_ids) = (vec![], vec![], vec![]);
        for (one, votes, feature, segment_id) in gaussians {
            map.balls.push(one.balls.means[0], one.balls.radii[0]);
            map.colors.extend(one.colors);
            map.last_seen.extend(one.last_seen);
            map.seen_through.extend(one.seen_through);
            all_votes.push(votes);
            all_features.extend(feature);
            segment_ids.push(segment_id);
        }
        let SplatContent::Features { codebook, .. } = features(0, 2) else { panic!("no codebook") };
        for content in [SplatContent::Evidence { votes: all_votes }, SplatContent::Features { features: all_features, codebook }] {
            let (map, segment_ids, saved_state) = (map.clone(), segment_ids.clone(), saved_state.clone());
            let (sightings, carried) = (sightings.to_vec(), carried.to_vec());
            let (registered_kind, ids) = (kind.clone(), (1..=MAX_ID).collect());
            let file = SplatFile { origin, map, content, registered_kind, segment_ids, ids, sightings, carried, frames: 9, saved_state };
            prop_assert_eq!(&reloaded(&file), &file);
            // −0 equals 0, but their bytes differ.
            prop_assert_eq!(saved(&reloaded(&file)), saved(&file));
        }
    }
}

#[test]
fn the_settings_of_a_file_are_read_without_its_gaussians() {
    let settings_of = |file: &SplatFile| {
        let place = place();
        file.save(&place.path).unwrap();
        SavedMemorySettings::read(&place.path).unwrap()
    };
    let evidence = settings_of(&sample(MemoryKind::Evidence, 5));
    assert_eq!((evidence.kind, evidence.codes), (MemoryKind::Evidence, None));
    for (blocks, count, feature_dim) in [(1, 0, 3), (2, 5, 3), (3, 70, 4)] {
        let settings = CodebookSettings { num_codes: 6, feature_dim, seed: 5 };
        let mut codebook = Codebook::generate(&settings, &mut |_| ()).unwrap();
        (1..blocks).for_each(|_| codebook.extend(6, &mut |_| ()).unwrap());
        let content = SplatContent::Features { features: vec![0.5; count * feature_dim], codebook };
        let found = settings_of(&with_content(content, count));
        let codes = found.codes.map(|codes| (codes.feature_dim, codes.num_codes));
        assert_eq!((found.kind, codes), (MemoryKind::Features, Some((feature_dim, 6))));
    }
}

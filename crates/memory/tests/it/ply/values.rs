//! Invalid values are neither loaded nor saved.

use super::sample::{COMMON_PROPERTIES, FEATURE_DIM, KINDS, place, sample, with_word};
use splatseg_geometry::SegmentId;
use splatseg_memory::{MemoryKind, SplatContent, SplatFile, SplatFileError, Votes};
use std::fs;

const FLOATS: usize = 18;
const RADIUS: usize = 17;
const SEEN_THROUGH: usize = 19;

fn message(kind: MemoryKind, column: usize, word: [u8; 4]) -> String {
    let error = with_word(kind, column, word).unwrap_err();
    assert!(matches!(&error, SplatFileError::Value { gaussian: 1, .. }), "{error}");
    error.to_string()
}

#[test]
fn invalid_values_are_errors_when_loaded() {
    for kind in KINDS {
        let own_floats = match kind {
            MemoryKind::Evidence => (0..4).map(|slot| COMMON_PROPERTIES + 2 * slot + 1).collect::<Vec<_>>(),
            _ => (COMMON_PROPERTIES..COMMON_PROPERTIES + FEATURE_DIM).collect(),
        };
        for column in (0..FLOATS).chain(own_floats) {
            for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                message(kind, column, value.to_le_bytes());
            }
        }
        for radius in [0.0f32, -0.1] {
            let message = message(kind, RADIUS, radius.to_le_bytes());
            assert!(message.contains("radius of Gaussian 1 is"), "{message}");
        }
        let through = message(kind, SEEN_THROUGH, 256i32.to_le_bytes());
        assert!(through.contains("seen_through of Gaussian 1 is 256, expected a number from 0 to 255"), "{through}");
        let segment_id = COMMON_PROPERTIES + if kind == MemoryKind::Evidence { 8 } else { FEATURE_DIM };
        for id in [5i32, -1, i32::MAX] {
            let message = message(kind, segment_id, id.to_le_bytes());
            assert!(
                message.contains("segment_id of Gaussian 1") && message.contains("0 or one of the 4 ids"),
                "{message}"
            );
        }
    }
    for id in [5i32, 65_536, 65_537, -1] {
        let message = message(MemoryKind::Evidence, COMMON_PROPERTIES + 4, id.to_le_bytes());
        assert!(message.contains("vote_id_2 of Gaussian 1") && message.contains("0 or one of the 4 ids"), "{message}");
    }
    let negative = message(MemoryKind::Evidence, COMMON_PROPERTIES + 5, (-0.5f32).to_le_bytes());
    assert!(negative.contains("votes_2 of Gaussian 1 is -0.5"), "{negative}");
}

#[test]
fn failed_saving_leaves_the_old_file() {
    for kind in KINDS {
        let refuses = |change: fn(&mut SplatFile), expected: &str| refuses(kind, change, expected);
        refuses(|file| file.map.colors.truncate(2), "colors has 2 entries, expected 3");
        refuses(|file| file.map.balls.radii.truncate(1), "radii has 1");
        refuses(|file| file.map.last_seen.push(0), "last_seen has 4");
        refuses(|file| file.map.seen_through.clear(), "seen_through has 0");
        let too_much = |file: &mut SplatFile| file.saved_state.put("memory.crowded", &[], vec![1u8; 1 << 28]);
        refuses(too_much, "bytes of state besides the Gaussians, expected at most 268435456");
        refuses(|file| file.origin.x = f64::MAX, "three numbers up to");
        refuses(|file| file.segment_ids.push(0), "segment_ids has 4");
        refuses(|file| file.carried.truncate(3), "carried has 3 entries, expected 4");
        refuses(|file| file.segment_ids[2] = 5, "segment_id of Gaussian 2 is 5");
        refuses(|file| file.map.last_seen[2] = 70_001, "last_seen of Gaussian 2 is 70001");
        refuses(|file| file.map.balls.radii[1] = 0.0, "radius of Gaussian 1 is 0");
        refuses(|file| file.map.balls.radii[1] = f32::NAN, "radius of Gaussian 1 is NaN");
        refuses(|file| file.map.balls.means[0].z = f32::NAN, "z of Gaussian 0 is NaN");
        refuses(|file| file.ids[1] = 1, "an id is 1, expected a number from 2");
        refuses(|file| file.sightings.truncate(3), "sightings has 3 entries, expected 4");
    }
    let refuses_features = |change, expected| refuses(MemoryKind::Features, change, expected);
    refuses_features(|file| features(file).truncate(2), "features has 2 entries, expected 9");
    refuses_features(|file| features(file)[5] = f32::NAN, "feature_2 of Gaussian 1");
    refuses_features(|file| give_ids(file, 10), "10 segments, expected at most 9");
    let refuses_votes = |change, expected| refuses(MemoryKind::Evidence, change, expected);
    refuses_votes(|file| votes(file).truncate(2), "votes has 2 entries, expected 3");
    refuses_votes(|file| votes(file)[1] = Votes::one(5, 1.0), "vote_id_0 of Gaussian 1 is 5");
    refuses_votes(|file| votes(file)[1] = Votes::one(1, f32::NAN), "votes_0 of Gaussian 1 is NaN");
    refuses_votes(|file| votes(file)[1] = Votes::one(1, -1.0), "votes_0 of Gaussian 1 is -1");
}

fn refuses(kind: MemoryKind, change: fn(&mut SplatFile), expected: &str) {
    let place = place();
    sample(kind, 2).save(&place.path).unwrap();
    let before = fs::read(&place.path).unwrap();
    let mut file = sample(kind, 3);
    change(&mut file);
    let error = file.save(&place.path).unwrap_err().to_string();
    assert!(error.contains(expected) && error.contains("memory.ply"), "{error}");
    assert_eq!(fs::read(&place.path).unwrap(), before);
    assert_eq!(fs::read_dir(place.path.parent().unwrap()).unwrap().count(), 1, "no temporary file stays");
}

fn give_ids(file: &mut SplatFile, count: usize) {
    file.ids = (1..=count as SegmentId).collect();
    file.sightings.resize(count, 0);
    file.carried.resize(count, false);
}

fn features(file: &mut SplatFile) -> &mut Vec<f32> {
    let SplatContent::Features { features, .. } = &mut file.content else { panic!("no features") };
    features
}

fn votes(file: &mut SplatFile) -> &mut Vec<Votes> {
    let SplatContent::Evidence { votes } = &mut file.content else { panic!("no votes") };
    votes
}

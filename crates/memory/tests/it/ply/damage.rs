//! Files that were cut off or altered, or that are not splatseg memories.

use super::sample::{FEATURE_DIM, KINDS, SEGMENTS, header_length, load, record_bytes, sample, saved, with_checksum};
use proptest::prelude::*;
use splatseg_memory::{MemoryKind, SplatFile, SplatFileError};
use std::sync::LazyLock;

#[test]
fn a_file_cut_off_anywhere_is_an_error() {
    for kind in KINDS {
        let bytes = saved(&sample(kind, 3));
        let header = header_length(&bytes);
        for length in 0..bytes.len() {
            match (length, load(&bytes[..length]).unwrap_err()) {
                (0..4, SplatFileError::NotPly { .. } | SplatFileError::CopiedAsText { .. }) => (),
                (4.., SplatFileError::Header { .. }) if length < header => (),
                (_, SplatFileError::Length { found, expected, .. }) if length >= header => {
                    assert_eq!((found, expected), (length as u64, bytes.len() as u64));
                }
                (_, error) => panic!("cut to {length} of {}: {error}", bytes.len()),
            }
        }
        let longer = [&bytes[..], b"\0"].concat();
        assert!(matches!(load(&longer), Err(SplatFileError::Length { .. })));
    }
}

#[test]
fn every_changed_bit_is_an_error() {
    for kind in KINDS {
        let bytes = saved(&sample(kind, 2));
        for position in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[position] ^= 1 << (position % 8);
            assert!(load(&changed).is_err(), "byte {position} of {}", bytes.len());
        }
        let mut changed = bytes.clone();
        changed[header_length(&bytes) + 1] ^= 1;
        assert!(matches!(load(&changed), Err(SplatFileError::Checksum { .. })));
        let not_a_number = header_length(&bytes)..header_length(&bytes) + 4;
        changed[not_a_number].fill(0xff);
        assert!(matches!(load(&changed), Err(SplatFileError::Checksum { .. })), "damage explains values best");
    }
}

#[test]
fn a_wrong_length_is_reported_with_the_expected_content() {
    let message = |kind| load(&[&saved(&sample(kind, 3))[..], b"1"].concat()).unwrap_err().to_string();
    let [evidence, features] = KINDS.map(message);
    assert!(evidence.contains("3 Gaussians with votes and 4 segments"), "{evidence}");
    assert!(features.contains("3 Gaussians and 9 codes of dimension 3, and 4 segments"), "{features}");
}

#[test]
fn a_header_without_an_end_is_reported_with_its_last_line() {
    let message = |text: &str| load(text.as_bytes()).unwrap_err().to_string();
    for text in ["ply\nformat any\nelement some\n", "ply\nformat any\nelement some\n\n"] {
        assert!(message(text).contains("element some"), "{}", message(text));
    }
}

/// Loads a sample with `from` in the header replaced and the checksum corrected.
fn with_header(kind: MemoryKind, from: &str, to: &str) -> Result<SplatFile, SplatFileError> {
    let bytes = saved(&sample(kind, 3));
    let (header, body) = bytes.split_at(header_length(&bytes));
    let header = String::from_utf8(header.to_vec()).unwrap();
    assert!(header.contains(from), "{from}");
    load(&with_checksum([header.replace(from, to).as_bytes(), body].concat()))
}

#[test]
fn other_files_are_named_for_what_they_are() {
    let message = |result: Result<SplatFile, SplatFileError>| result.unwrap_err().to_string();
    assert!(message(load(b"PNG and more")).contains("not a PLY"));
    assert!(message(load(b"")).contains("not a PLY"));
    let as_text =
        saved(&sample(MemoryKind::Evidence, 3)).split(|byte| *byte == b'\n').collect::<Vec<_>>().join(&b"\r\n"[..]);
    assert!(message(load(&as_text)).contains("the file was copied as text"));
    for kind in KINDS {
        let with_header = |from, to| with_header(kind, from, to);
        assert!(message(with_header("binary_little_endian", "binary_big_endian")).contains("binary_big_endian 1.0"));
        assert!(message(with_header("binary_little_endian", "ascii")).contains("\"ascii 1.0\""));
        assert!(message(with_header("comment splatseg", "comment other")).contains("not a splatseg memory"));
        assert!(message(with_header("memory 5", "memory 1")).contains("version \"1\""));
        assert!(message(with_header("memory 5", "memory 6")).contains("version \"6\" of the splatseg memory format"));
        assert!(message(with_header("memory 5", "memory 4")).contains("segments and short_term"));
        assert!(message(with_header(" kind ", " of ")).contains("expected version, kind"));
        assert!(message(with_header("segments 4", "segments four")).contains("segments four"));
        assert!(message(with_header("element vertex 3", "element vertex -3")).contains("element vertex"));
        assert!(message(with_header("property float nx\n", "")).contains("\"property float nx\""));
        assert!(message(with_header("float radius", "double radius")).contains("double radius"));
        assert!(message(with_header("property int segment_id", "element face 0")).contains("segment_id"));
        with_header("end_header", "comment of an editor\nend_header").unwrap();
    }
    assert!(message(with_header(MemoryKind::Features, "float feature_1", "double feature_1")).contains("feature_1"));
    assert!(message(with_header(MemoryKind::Evidence, "float votes_1", "uchar votes_1")).contains("votes_1"));
    let ascii = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n";
    assert!(message(load(ascii)).contains("\"ascii 1.0\""));
    let foreign = b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nend_header\n";
    assert!(message(load(foreign)).contains("not a splatseg memory"));
}

#[cfg(unix)]
#[test]
fn devices_and_fifos_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo.ply");
    assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    for (path, kind) in [(fifo.as_path(), "a FIFO"), (std::path::Path::new("/dev/zero"), "a device")] {
        let message = SplatFile::load(path).unwrap_err().to_string();
        assert!(message.contains(&format!("it is {kind}, expected a regular file")), "{message}");
    }
}

#[test]
fn a_memory_of_version_1_is_refused() {
    let old = b"ply\nformat binary_little_endian 1.0\ncomment splatseg memory 1 feature_dim 28 codes 512 used 40\n\
                element vertex 0\nproperty float x\nend_header\n";
    let error = load(old).unwrap_err();
    assert!(matches!(&error, SplatFileError::Version { found, .. } if found == "1"), "{error}");
}

#[test]
fn counts_that_lie_take_no_memory() {
    const HUGE: [&str; 3] = ["1000000000000", "9223372036854775807", "18446744073709551615"];
    for kind in KINDS {
        for lie in ["4", "2"].into_iter().chain(HUGE) {
            let result = with_header(kind, "element vertex 3", &format!("element vertex {lie}"));
            assert!(matches!(result, Err(SplatFileError::Length { .. })), "{lie}");
        }
        for lie in ["3", "5"] {
            let result = with_header(kind, "segments 4", &format!("segments {lie}"));
            assert!(matches!(result, Err(SplatFileError::Length { .. })), "{lie}");
        }
        for lie in ["16777216"].into_iter().chain(HUGE) {
            let result = with_header(kind, "segments 4", &format!("segments {lie}"));
            assert!(matches!(result, Err(SplatFileError::Segments { .. })), "{lie}");
        }
    }
    let features = |from: &str, to: &str| with_header(MemoryKind::Features, from, to);
    for lie in ["8", "10"].into_iter().chain(HUGE) {
        let result = features("codes 9", &format!("codes {lie}"));
        assert!(matches!(result, Err(SplatFileError::Length { .. })), "{lie}");
    }
    for lie in ["0", "2", "4"].into_iter().chain(HUGE) {
        let result = features("feature_dim 3", &format!("feature_dim {lie}"));
        assert!(matches!(result, Err(SplatFileError::Header { .. })), "{lie}");
    }
    assert!(matches!(features("codes 9", "codes 3"), Err(SplatFileError::Segments { found: 4, max: 3, .. })));
    let feature = "property float feature_2\n";
    assert!(features(feature, "").is_err());
    assert!(features(feature, &format!("{feature}property float feature_3\n")).is_err());
}

#[test]
fn fields_after_the_vertices_are_checked() {
    let with_field = |kind: MemoryKind, at: usize, value: &[u8]| {
        let mut bytes = saved(&sample(kind, 3));
        let block = header_length(&bytes) + 3 * record_bytes(kind);
        bytes[block + at..][..value.len()].copy_from_slice(value);
        load(&with_checksum(bytes))
    };
    for kind in KINDS {
        let fields: [(usize, &[u8]); 4] = [(0, b"s"), (8, &[1]), (12, &[2]), (16, &[5])];
        for (at, value) in fields {
            assert!(matches!(with_field(kind, at, value), Err(SplatFileError::Trailer { .. })), "at {at}");
        }
        let error = with_field(kind, 20, &7u32.to_le_bytes()).unwrap_err().to_string();
        assert!(error.contains("last_seen of Gaussian 0 is 70000, expected a number from 0 to 7"), "{error}");
        let codebook = if kind == MemoryKind::Features { 24 + 4 * 9 * FEATURE_DIM } else { 0 };
        let error = with_field(kind, 24 + codebook + 8 * SEGMENTS, &[2]).unwrap_err().to_string();
        assert!(error.contains("carried is 2, expected 0 or 1"), "{error}");
    }
    let features = |at, value: &[u8]| with_field(MemoryKind::Features, at, value);
    assert!(matches!(features(24, &[4]), Err(SplatFileError::Trailer { .. })));
    for codes in [0u64, 8, 10, 1 << 40, u64::MAX] {
        assert!(matches!(features(28, &codes.to_le_bytes()), Err(SplatFileError::Trailer { .. })), "{codes}");
    }
    assert!(matches!(features(48, &2f32.to_le_bytes()), Err(SplatFileError::Codebook { .. })));
    assert!(matches!(features(48, &f32::NAN.to_le_bytes()), Err(SplatFileError::Codebook { .. })));
}

static SAVED: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| KINDS.map(|kind| saved(&sample(kind, 3))));

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn altered_files_never_panic(
        kind in 0..2usize,
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in proptest::option::of(any::<prop::sample::Index>()),
        insert in proptest::option::of((any::<prop::sample::Index>(), proptest::collection::vec(any::<u8>(), 0..40))),
        repaired in any::<bool>(),
    ) {
        let mut bytes = SAVED[kind].clone();
        for (position, value) in edits {
            let position = position.index(bytes.len());
            bytes[position] = value;
        }
        if let Some((position, inserted)) = insert {
            let position = position.index(bytes.len());
            bytes.splice(position..position, inserted);
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        // With a correct checksum, the edits reach all later checks.
        if repaired && bytes.len() > 4 {
            bytes = with_checksum(bytes);
        }
        if let Ok(file) = load(&bytes) {
            prop_assert!(file.map.balls.means.iter().all(|mean| mean.is_finite()));
            prop_assert!(file.map.balls.radii.iter().all(|radius| *radius > 0.0));
            prop_assert!(file.segment_ids.iter().all(|&id| id as usize <= SEGMENTS));
            prop_assert_eq!(load(&saved(&file)).unwrap(), file);
        }
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(load(&bytes).is_err());
        prop_assert!(load(&[b"ply\n".to_vec(), bytes].concat()).is_err());
    }
}

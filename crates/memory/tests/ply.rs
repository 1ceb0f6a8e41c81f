//! Memories to files and back, and files that are none.

use glam::{Quat, Vec3};
use proptest::prelude::*;
use splatseg_memory::{Codebook, CodebookSettings, SplatFile, SplatFileError};
use splatseg_render::Gaussians;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

const FEATURE_DIM: usize = 3;
const RECORD_BYTES: usize = 4 * (17 + FEATURE_DIM + 1);

fn sample(count: usize, feature_dim: usize) -> SplatFile {
    let settings = CodebookSettings { num_codes: 6, feature_dim, seed: 5 };
    let mut codebook = Codebook::generate(&settings, &mut |_| ()).unwrap();
    codebook.extend(3, &mut |_| ()).unwrap();
    let mut gaussians = Gaussians::default();
    let (mut colors, mut features, mut segment_ids) = (Vec::new(), Vec::new(), Vec::new());
    for index in 0..count {
        let t = index as f32;
        let quat = Quat::from_xyzw(t.sin(), t.cos(), 0.5, -0.25);
        let scale = Vec3::new(0.01 + 0.003 * t, 1e-4 / (1.0 + t), 7.0);
        gaussians.push(Vec3::new(t * 0.1, -t, 1e-20 * t), quat, scale, [1.0, 0.0, 0.3, 0.999_999_94][index % 4]);
        colors.push([0.0, 1.0, (t * 0.37).fract()]);
        features.extend((0..feature_dim).map(|channel| (t + channel as f32).sin() * 1e-3));
        segment_ids.push(index as u32 % 10);
    }
    SplatFile { gaussians, colors, features, segment_ids, codebook, used_codes: 4 }
}

struct Place {
    _folder: TempDir,
    path: PathBuf,
}

fn place() -> Place {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("memory.ply");
    Place { path, _folder: folder }
}

/// The bytes that `file` is saved as.
fn saved(file: &SplatFile) -> Vec<u8> {
    let place = place();
    file.save(&place.path).unwrap();
    fs::read(&place.path).unwrap()
}

fn load(bytes: &[u8]) -> Result<SplatFile, SplatFileError> {
    let place = place();
    fs::write(&place.path, bytes).unwrap();
    let result = SplatFile::load(&place.path);
    if let Err(error) = &result {
        assert!(error.to_string().contains("memory.ply"), "{error}");
    }
    result
}

/// CRC-32 a bit at a time.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| step(crc)))
}

/// `bytes` with the checksum that they should have.
fn with_checksum(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.truncate(bytes.len() - 4);
    bytes.extend(crc32(&bytes).to_le_bytes());
    bytes
}

fn header_length(bytes: &[u8]) -> usize {
    bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11
}

fn close(left: f32, right: f32) -> bool {
    (left - right).abs() <= 1e-6
}

#[test]
fn what_is_saved_comes_back() {
    for (count, feature_dim) in [(0, 28), (1, 1), (7, 3), (3000, 28)] {
        let (place, file) = (place(), sample(count, feature_dim));
        file.save(&place.path).unwrap();
        let loaded = SplatFile::load(&place.path).unwrap();
        assert_eq!(loaded.gaussians.means, file.gaussians.means);
        assert_eq!(loaded.gaussians.quats, file.gaussians.quats);
        assert_eq!(loaded.features, file.features);
        assert_eq!(loaded.segment_ids, file.segment_ids);
        assert_eq!((&loaded.codebook, loaded.used_codes), (&file.codebook, 4));
        for (found, &saved) in loaded.gaussians.opacities.iter().zip(&file.gaussians.opacities) {
            assert!(close(*found, saved) && (saved != 1.0 || *found == 1.0) && (saved != 0.0 || *found == 0.0));
        }
        for (found, saved) in loaded.gaussians.scales.iter().zip(&file.gaussians.scales) {
            assert!(((*found - *saved) / *saved).abs().max_element() <= 1e-6, "{found} {saved}");
        }
        for (found, saved) in loaded.colors.iter().flatten().zip(file.colors.iter().flatten()) {
            assert!(close(*found, *saved) && (0.0..=1.0).contains(found));
        }
        let (mut loaded, mut file) = (loaded, file);
        loaded.codebook.extend(4, &mut |_| ()).unwrap();
        file.codebook.extend(4, &mut |_| ()).unwrap();
        assert_eq!(loaded.codebook, file.codebook, "a loaded codebook grows as the saved one would have");
    }
}

#[test]
fn equal_memories_are_equal_files() {
    assert_eq!(saved(&sample(50, 4)), saved(&sample(50, 4)));
}

/// Reads the header the way antimatter15/splat, gsplat.js and their kin do.
#[test]
fn viewers_find_their_properties() {
    let file = sample(4, FEATURE_DIM);
    let bytes = saved(&file);
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(10 * 1024)]).into_owned();
    let start = text.find("end_header\n").unwrap() + "end_header\n".len();
    let header: Vec<&str> = text[..start].lines().collect();
    assert_eq!(header[..2], ["ply", "format binary_little_endian 1.0"]);
    assert!(header.contains(&"element vertex 4"));
    assert_eq!(header.iter().filter(|line| line.starts_with("element")).count(), 1);
    assert!(header.contains(&"comment splatseg memory 1 feature_dim 3 codes 9 used 4"));
    assert!(header.iter().all(|line| !line.contains("packed_") && !line.contains("codebook_centers")));

    let properties: Vec<(&str, &str)> =
        header.iter().filter_map(|line| line.strip_prefix("property ")?.split_once(' ')).collect();
    let names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 \
                 feature_0 feature_1 feature_2 segment_id";
    assert_eq!(properties.iter().map(|(_, name)| *name).collect::<Vec<_>>(), names.split(' ').collect::<Vec<_>>());
    assert!(properties.iter().all(|(kind, name)| *kind == if *name == "segment_id" { "int" } else { "float" }));

    let word = |row: usize, name: &str| -> [u8; 4] {
        let column = properties.iter().position(|(_, found)| *found == name).unwrap();
        bytes[start + RECORD_BYTES * row + 4 * column..][..4].try_into().unwrap()
    };
    let value = |name: &str| f32::from_le_bytes(word(2, name));
    assert_eq!([value("x"), value("y"), value("nx")], [0.2, -2.0, 0.0]);
    assert!(close(0.5 + 0.282_094_8 * value("f_dc_1"), 1.0));
    assert!(close(1.0 / (1.0 + (-value("opacity")).exp()), 0.3));
    assert!(close(value("scale_0").exp(), 0.016) && close(value("scale_2").exp(), 7.0));
    assert_eq!([value("rot_0"), value("rot_1"), value("rot_3")], [-0.25, 2f32.sin(), 0.5]);
    assert_eq!(value("feature_1"), file.features[2 * FEATURE_DIM + 1]);
    assert_eq!(i32::from_le_bytes(word(2, "segment_id")), 2);
}

#[test]
fn the_block_behind_the_vertices_is_as_documented() {
    let file = sample(2, FEATURE_DIM);
    let bytes = saved(&file);
    let block = &bytes[header_length(&bytes) + 2 * RECORD_BYTES..];
    assert_eq!(block.len(), 44 + 9 * FEATURE_DIM * 4 + 4);
    assert_eq!(&block[..8], b"SPLATSEG");
    let number = |at: usize, width: usize| {
        block[at..at + width].iter().rev().fold(0u64, |sum, &byte| sum << 8 | u64::from(byte))
    };
    assert_eq!(
        [number(8, 4), number(12, 4), number(16, 8), number(24, 8), number(32, 8), number(40, 4)],
        [1, 3, 9, 4, 5, 2]
    );
    assert_eq!(block[44..48], file.codebook.vector(0)[0].to_le_bytes());
    assert_eq!(bytes[bytes.len() - 4..], crc32(&bytes[..bytes.len() - 4]).to_le_bytes());
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
}

#[test]
fn a_file_cut_off_anywhere_is_an_error() {
    let bytes = saved(&sample(3, FEATURE_DIM));
    let header = header_length(&bytes);
    for length in 0..bytes.len() {
        match (length, load(&bytes[..length]).unwrap_err()) {
            (0..4, SplatFileError::NotPly { .. }) => (),
            (4.., SplatFileError::Header { .. }) if length < header => (),
            (_, SplatFileError::Length { found, .. }) if length >= header => assert_eq!(found, length as u64),
            (_, error) => panic!("cut to {length} of {}: {error}", bytes.len()),
        }
    }
    let longer = [&bytes[..], b"\0"].concat();
    assert!(matches!(load(&longer), Err(SplatFileError::Length { .. })));
}

#[test]
fn every_changed_bit_is_an_error() {
    let bytes = saved(&sample(2, FEATURE_DIM));
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

/// `text` of the header replaced, the checksum made right.
fn with_header(from: &str, to: &str) -> Result<SplatFile, SplatFileError> {
    let bytes = saved(&sample(3, FEATURE_DIM));
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
    assert!(message(with_header("binary_little_endian", "binary_big_endian")).contains("binary_big_endian 1.0"));
    assert!(message(with_header("binary_little_endian", "ascii")).contains("\"ascii 1.0\""));
    assert!(message(with_header("comment splatseg", "comment other")).contains("not a splatseg memory"));
    assert!(message(with_header("memory 1", "memory 2")).contains("version \"2\""));
    assert!(message(with_header("element vertex 3", "element vertex -3")).contains("element vertex"));
    assert!(message(with_header("property float nx\n", "")).contains("\"property float nx\""));
    assert!(message(with_header("float feature_1", "double feature_1")).contains("feature_1"));
    assert!(message(with_header("property int segment_id", "element face 0")).contains("segment_id"));
    let ascii = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n";
    assert!(message(load(ascii)).contains("\"ascii 1.0\""));
    let foreign = b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nend_header\n";
    assert!(message(load(foreign)).contains("not a splatseg memory"));
    with_header("end_header", "comment of an editor\nend_header").unwrap();
}

#[test]
fn counts_that_lie_take_no_memory() {
    for lie in ["4", "2", "1000000000000", "18446744073709551615"] {
        let result = with_header("element vertex 3", &format!("element vertex {lie}"));
        assert!(matches!(result, Err(SplatFileError::Length { .. } | SplatFileError::Trailer { .. })), "{lie}");
    }
    let feature = "property float feature_2\n";
    assert!(with_header(feature, "").is_err());
    assert!(with_header(feature, &format!("{feature}property float feature_3\n")).is_err());

    let bytes = saved(&sample(3, FEATURE_DIM));
    let block = header_length(&bytes) + 3 * RECORD_BYTES;
    let with_field = |at: usize, value: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[block + at..][..value.len()].copy_from_slice(value);
        load(&with_checksum(bytes))
    };
    for codes in [0u64, 8, 10, 1 << 40, u64::MAX] {
        assert!(matches!(with_field(16, &codes.to_le_bytes()), Err(SplatFileError::Length { .. })), "{codes}");
    }
    assert!(matches!(with_field(0, b"s"), Err(SplatFileError::Trailer { .. })));
    assert!(matches!(with_field(8, &[2]), Err(SplatFileError::Trailer { .. })));
    assert!(matches!(with_field(12, &[4]), Err(SplatFileError::Trailer { .. })));
    assert!(matches!(with_field(24, &[10]), Err(SplatFileError::UsedCodes { found: 10, codes: 9, .. })));
    assert!(matches!(with_field(44, &2f32.to_le_bytes()), Err(SplatFileError::Codebook { .. })));
    assert!(matches!(with_field(44, &f32::NAN.to_le_bytes()), Err(SplatFileError::Codebook { .. })));
}

#[test]
fn values_no_gaussian_has_are_errors_when_loaded() {
    let bytes = saved(&sample(3, FEATURE_DIM));
    let with_word = |column: usize, word: [u8; 4]| {
        let mut bytes = bytes.clone();
        let at = header_length(&bytes) + RECORD_BYTES + 4 * column;
        bytes[at..at + 4].copy_from_slice(&word);
        load(&with_checksum(bytes))
    };
    for column in 0..17 + FEATURE_DIM {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let result = with_word(column, value.to_le_bytes());
            assert!(matches!(result, Err(SplatFileError::Value { gaussian: 1, .. })), "column {column}, {value}");
        }
    }
    for logarithm in [200.0f32, -200.0] {
        let error = with_word(11, logarithm.to_le_bytes()).unwrap_err().to_string();
        assert!(error.contains("scale_1 of Gaussian 1"), "{error}");
    }
    for id in [10i32, -1, i32::MAX] {
        let error = with_word(17 + FEATURE_DIM, id.to_le_bytes()).unwrap_err().to_string();
        assert!(error.contains("segment_id of Gaussian 1") && error.contains("from 0 to 9"), "{error}");
    }
}

#[test]
fn what_cannot_be_saved_leaves_the_old_file() {
    let place = place();
    sample(2, FEATURE_DIM).save(&place.path).unwrap();
    let before = fs::read(&place.path).unwrap();
    let refuses = |change: fn(&mut SplatFile), expected: &str| {
        let mut file = sample(3, FEATURE_DIM);
        change(&mut file);
        let error = file.save(&place.path).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("memory.ply"), "{error}");
        assert_eq!(fs::read(&place.path).unwrap(), before);
        assert_eq!(fs::read_dir(place.path.parent().unwrap()).unwrap().count(), 1, "no temporary file stays");
    };
    refuses(|file| file.colors.truncate(2), "colors has 2 entries, expected 3");
    refuses(|file| file.features.truncate(2), "features has 2 entries, expected 9");
    refuses(|file| file.segment_ids.push(0), "segment_ids has 4");
    refuses(|file| file.gaussians.scales.truncate(1), "scales has 1");
    refuses(|file| file.used_codes = 10, "used_codes is 10, expected at most the codebook's 9");
    refuses(|file| file.segment_ids[2] = 10, "segment_id of Gaussian 2 is 10");
    refuses(|file| file.gaussians.scales[1].y = 0.0, "scale_1 of Gaussian 1");
    refuses(|file| file.gaussians.opacities[1] = 1.1, "opacity of Gaussian 1");
    refuses(|file| file.gaussians.opacities[1] = f32::NAN, "opacity of Gaussian 1");
    refuses(|file| file.gaussians.means[0].z = f32::NAN, "z of Gaussian 0 is NaN");
    refuses(|file| file.gaussians.quats[0].w = f32::INFINITY, "rot_0 of Gaussian 0 is inf");
    refuses(|file| file.colors[0][2] = f32::NAN, "f_dc_2 of Gaussian 0");
    refuses(|file| file.features[5] = f32::NAN, "feature_2 of Gaussian 1");
}

#[test]
fn paths_that_fail_are_named() {
    let place = place();
    let error = SplatFile::load(&place.path).unwrap_err().to_string();
    assert!(error.contains("memory.ply: cannot open"), "{error}");
    let missing = place.path.join("folder").join("a.ply");
    assert!(sample(1, 2).save(&missing).unwrap_err().to_string().contains("a.ply: cannot create"));
    let folder = place.path.parent().unwrap();
    assert!(sample(1, 2).save(folder).is_err());
    assert!(SplatFile::load(folder).is_err());
}

#[cfg(unix)]
#[test]
fn saved_files_have_the_permissions_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let place = place();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    sample(1, 2).save(&place.path).unwrap();
    let other = place.path.with_extension("txt");
    fs::write(&other, "").unwrap();
    assert_eq!(mode(&place.path), mode(&other));
}

static SAVED: LazyLock<Vec<u8>> = LazyLock::new(|| saved(&sample(3, FEATURE_DIM)));

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn altered_files_never_panic(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in proptest::option::of(any::<prop::sample::Index>()),
        insert in proptest::option::of((any::<prop::sample::Index>(), proptest::collection::vec(any::<u8>(), 0..40))),
        repaired in any::<bool>(),
    ) {
        let mut bytes = SAVED.clone();
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
        // A right checksum lets the edits through to everything behind it.
        if repaired && bytes.len() > 4 {
            bytes = with_checksum(bytes);
        }
        if let Ok(file) = load(&bytes) {
            prop_assert!(file.gaussians.means.iter().all(|mean| mean.is_finite()));
            prop_assert!(file.segment_ids.iter().all(|&id| id <= 9));
            prop_assert!(load(&saved(&file)).is_ok());
        }
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(load(&bytes).is_err());
        prop_assert!(load(&[b"ply\n".to_vec(), bytes].concat()).is_err());
    }
}

//! Sample memories and the bytes of their files.

use glam::{DVec3, Vec3};
use splatseg_memory::{
    Codebook, CodebookSettings, MemoryKind, SplatContent, SplatFile, SplatFileError, SplatMap, Votes,
};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

pub const KINDS: [MemoryKind; 2] = [MemoryKind::Evidence, MemoryKind::Features];
pub const FEATURE_DIM: usize = 3;
pub const CODES: usize = 9;
/// Number of ids in a sample.
pub const SEGMENTS: usize = 4;
/// Number of frames learnt by a sample.
pub const FRAMES: u32 = 70_000;
/// Number of properties before votes or features.
pub const COMMON_PROPERTIES: usize = 20;

pub fn record_bytes(kind: MemoryKind) -> usize {
    let own = if kind == MemoryKind::Evidence { 8 } else { FEATURE_DIM };
    4 * (COMMON_PROPERTIES + own + 1)
}

pub fn sample(kind: MemoryKind, count: usize) -> SplatFile {
    let content = match kind {
        MemoryKind::Evidence => SplatContent::Evidence { votes: (0..count).map(votes).collect() },
        _ => features(count, FEATURE_DIM),
    };
    with_content(content, count)
}

fn votes(index: usize) -> Votes {
    let t = index as f32;
    let id = |slot| ((index + slot) % (SEGMENTS + 1)) as u32;
    // An empty slot between others, and an empty slot with an old id.
    Votes::from_slots([(id(0), 1e-3 + t.fract()), (0, 0.0), (id(2), 4.0 / (1.0 + t)), (id(3), 0.0)])
}

pub fn features(count: usize, feature_dim: usize) -> SplatContent {
    let settings = CodebookSettings { num_codes: 6, feature_dim, seed: 5 };
    let mut codebook = Codebook::generate(&settings, &mut |_| ()).unwrap();
    codebook.extend(CODES - 6, &mut |_| ()).unwrap();
    let value = |index| (index as f32).sin() * 1e-3;
    SplatContent::Features { features: (0..count * feature_dim).map(value).collect(), codebook }
}

pub fn with_content(content: SplatContent, count: usize) -> SplatFile {
    let mut map = SplatMap::default();
    for index in 0..count {
        let t = index as f32;
        map.balls.push(Vec3::new(t * 0.1, -t, 1e-20 * t), [0.01 + 0.003 * t, 7.0, 1e-4 / (1.0 + t)][index % 3]);
        map.colors.push([index as u8, (index / 2) as u8 ^ 0xff, 77]);
        map.last_seen.push(FRAMES - index as u32);
        map.seen_through.push([0, 2, 255][index % 3]);
    }
    SplatFile {
        origin: DVec3::ZERO,
        map,
        content,
        registered_kind: None,
        segment_ids: (0..count).map(|index| (index % (SEGMENTS + 1)) as u32).collect(),
        ids: (1..=SEGMENTS as u32).collect(),
        sightings: vec![3, 0, u32::MAX, 500],
        carried: vec![true, false, false, true],
        frames: FRAMES,
        saved_state: Default::default(),
    }
}

pub struct Place {
    _folder: TempDir,
    pub path: PathBuf,
}

pub fn place() -> Place {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("memory.ply");
    Place { path, _folder: folder }
}

/// Returns the bytes of the saved `file`.
pub fn saved(file: &SplatFile) -> Vec<u8> {
    let place = place();
    file.save(&place.path).unwrap();
    fs::read(&place.path).unwrap()
}

pub fn load(bytes: &[u8]) -> Result<SplatFile, SplatFileError> {
    let place = place();
    fs::write(&place.path, bytes).unwrap();
    let result = SplatFile::load(&place.path);
    if let Err(error) = &result {
        assert!(error.to_string().contains("memory.ply"), "{error}");
    }
    result
}

/// Computes CRC-32 bit by bit.
pub fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
    !bytes.iter().fold(u32::MAX, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| step(crc)))
}

/// Returns `bytes` with the correct checksum.
pub fn with_checksum(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.truncate(bytes.len() - 4);
    bytes.extend(crc32(&bytes).to_le_bytes());
    bytes
}

/// Loads a sample with one word of Gaussian 1 replaced and the checksum corrected.
pub fn with_word(kind: MemoryKind, column: usize, word: [u8; 4]) -> Result<SplatFile, SplatFileError> {
    let mut bytes = saved(&sample(kind, 3));
    let at = header_length(&bytes) + record_bytes(kind) + 4 * column;
    bytes[at..at + 4].copy_from_slice(&word);
    load(&with_checksum(bytes))
}

pub fn header_length(bytes: &[u8]) -> usize {
    bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11
}

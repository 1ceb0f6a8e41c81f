//! Peak memory of reading. The process's peak is measured, so this file has one test.
#![cfg(target_os = "linux")]

#[path = "it/support/mod.rs"]
mod support;

use flate2::{Compression, write::ZlibEncoder};
use splatseg_dataset::{
    DatasetError, DatasetSettings, FrameStream, GroundTruth, TumScene, open_scene, read_color_image,
};
use splatseg_files::MemoryLimit;
use splatseg_geometry::Intrinsics;
use std::fs;
use std::io::Write;
use std::path::Path;
use support::sens::{SensWriter, frame_bytes};

/// Returns the peak memory of this process so far, MB.
fn peak_mb() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() / 1000
}

/// Compresses `count` zeros with zlib, without having them all in memory.
fn zeros(count: usize) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    for _ in 0..count >> 12 {
        encoder.write_all(&[0; 1 << 12]).unwrap();
    }
    encoder.finish().unwrap()
}

fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [&kind[..], data].concat();
    [&(data.len() as u32).to_be_bytes()[..], &body, &crc32fast::hash(&body).to_be_bytes()].concat()
}

/// Returns a PNG of 64x48 pixels with a colour profile that unpacks to 400 MB.
fn write_profile_bomb(path: &Path) {
    support::write_color(path, 64, 48);
    let png = fs::read(path).unwrap();
    let profile = [&b"x\0\0"[..], &zeros(400 << 20)].concat();
    let after_header = 33;
    fs::write(path, [&png[..after_header], &chunk(b"iCCP", &profile), &png[after_header..]].concat()).unwrap();
}

/// Returns a recording whose depth has 4096x4096 pixels in few bytes.
fn write_large_recording(path: &Path) {
    let camera = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5, width: 64, height: 48 };
    let large = Intrinsics { fx: 3840.0, fy: 3840.0, cx: 2047.5, cy: 2047.5, width: 4096, height: 4096 };
    let writer = SensWriter { color_compression: 0, color_intrinsics: camera, ..SensWriter::new(large) };
    let mut bytes = writer.header(1);
    bytes.extend(frame_bytes(glam::Mat4::IDENTITY.to_cols_array(), &[7; 3 * 64 * 48], &zeros(2 * 4096 * 4096)));
    fs::write(path, bytes).unwrap();
}

#[test]
fn small_files_take_little_memory_and_no_more_than_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    let bomb = folder.path().join("bomb.png");
    write_profile_bomb(&bomb);
    let before = peak_mb();
    assert_eq!(read_color_image(&bomb).unwrap().size(), (64, 48), "the profile is not used");
    assert!(peak_mb() < before + 20, "{before} MB, then {} MB", peak_mb());

    MemoryLimit::Bytes(100_000_000).enforce();
    fs::write(folder.path().join("rgb.txt"), "1 a\n".repeat(300_000)).unwrap();
    let error = TumScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    let expected =
        "rgb.txt: lines: found 300000, expected at most 195312, as each takes up to 512 bytes and the memory";
    assert!(error.contains(expected), "{error}");

    let recording = folder.path().join("large.sens");
    write_large_recording(&recording);
    let settings = DatasetSettings::default();
    MemoryLimit::Bytes(200_000_000).enforce();
    let error = open_scene(&recording, &settings).unwrap_err();
    assert!(
        error.to_string().ends_with(
            "large.sens: the depth image of 4096x4096 pixels would take 268 MB of memory, but the limit is 200 MB: raise \
             --memory-limit, or store smaller images"
        ),
        "{error}"
    );
    MemoryLimit::Bytes(300_000_000).enforce();
    let scene = open_scene(&recording, &settings).unwrap();
    let refused = FrameStream::open(scene.clone(), &settings, GroundTruth::Skip).unwrap_err();
    assert!(matches!(refused, DatasetError::MemoryLimit { .. }), "{refused}");
    assert!(refused.to_string().contains("make frames smaller with --resize or dataset.max_pixels"), "{refused}");
    MemoryLimit::Bytes(1_000_000_000).enforce();
    let stream = FrameStream::open(scene, &settings, GroundTruth::Skip).unwrap();
    assert_eq!(stream.frame_size(), Some((1449, 1449)));
    assert!(peak_mb() < before + 268, "{before} MB, then {} MB", peak_mb());
}

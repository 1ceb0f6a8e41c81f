//! Recordings that rosbag2 has compressed: each message, or each file; and split ones. The same from a file and as a stream.

use crate::messages::messages;
use crate::support;
use crate::support::damaged;
use crate::support::mcap::{McapWriter, recording_of};
use crate::support::recording::recording;
use crate::support::two_ways::{Found, places_of_messages, read, read_path};
use proptest::prelude::*;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use splatseg_dataset::{DatasetSettings, RecordingScene, RecordingSummary, Scene, open_scene};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

fn plain() -> &'static [u8] {
    static PLAIN: OnceLock<Vec<u8>> = OnceLock::new();
    PLAIN.get_or_init(|| {
        let room: Vec<(RgbdFrame, SegmentMap)> = recording("synthetic:frames=4,width=32,height=24,seed=3");
        recording_of(&room.iter().map(|(frame, _)| frame).collect::<Vec<_>>())
    })
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    compress_to_vec(bytes, CompressionLevel::Fastest)
}

/// Compresses each message of a recording.
fn message_mode(bytes: &[u8]) -> Vec<u8> {
    rewritten(bytes, |_| true, packed)
}

fn rewritten(bytes: &[u8], is_kept: impl Fn(usize) -> bool, change: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let mut writer = McapWriter::new();
    for (_, message) in messages(bytes).iter().enumerate().filter(|(index, _)| is_kept(*index)) {
        let at = i64::try_from(message.at.as_nanos()).unwrap();
        writer.write_as(&message.topic, &message.type_name, &change(&message.data), at);
    }
    writer.finish()
}

fn none() -> DatasetSettings {
    DatasetSettings::default()
}

fn expected() -> Found {
    read(plain(), &none()).unwrap()
}

fn assert_same(found: &Found, expected: &Found) {
    assert_eq!(found.frames, expected.frames);
    assert_eq!((&found.sources, found.warnings.as_slice()), (&expected.sources, &[][..]));
}

/// Writes files into a folder.
fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

fn summary(path: &Path) -> RecordingSummary {
    RecordingSummary::read(path, &none()).unwrap()
}

fn refused(path: &Path) -> String {
    RecordingScene::open(path, &none()).unwrap_err().to_string().replace(&path.display().to_string(), "PATH")
}

#[test]
fn compressed_messages_are_read() {
    let bytes = message_mode(plain());
    assert_same(&read(&bytes, &none()).unwrap(), &expected());
    let of = |bytes: &[u8]| summary(folder(&[("bag_0.mcap", bytes), ("metadata.yaml", b"")]).path()).compression;
    assert_eq!((of(&bytes), of(plain())), (Some("zstd, each message"), None));
}

#[test]
fn a_damaged_compressed_message_costs_its_frame() {
    let mut bytes = support::mcap::without_checksums(message_mode(plain()));
    let place = places_of_messages(&bytes, "/camera/depth")[1].clone();
    // The kind of the first block, which no block has.
    bytes[place.start + 7..place.start + 20].fill(0xFF);
    let found = read(&bytes, &none()).unwrap();
    assert_eq!(found.frames.len(), 3);
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    assert!(
        warning.starts_with("a.mcap: 1 compressed message is damaged and left out: damaged zstd data: "),
        "{warning}"
    );
}

#[test]
fn a_message_that_claims_to_be_huge_is_left_out() {
    // Frames of the format with a size of eight bytes in the header, and the sizes of blocks that repeat a byte.
    let claims = |size: u64| [&[0x28, 0xB5, 0x2F, 0xFD, 0xE0][..], &size.to_le_bytes(), &[0x03, 0, 0, 0x07]].concat();
    for size in [1 << 40, u64::MAX, 300 << 20] {
        let bytes = rewritten(plain(), |_| true, |data| if data.len() > 700 { claims(size) } else { packed(data) });
        let error = read(&bytes, &none()).map(|_| ()).unwrap_err();
        assert!(error.contains("colour images") || error.contains("depth images"), "{error}");
        let told = summary(&folder(&[("a.mcap", &bytes)]).path().join("a.mcap")).damage;
        assert_eq!(told.len(), 1, "{told:?}");
    }
}

#[test]
fn compressed_files_are_read() {
    let file = packed(plain());
    for name in ["bag_0.mcap.zstd", "bag.mcap.zst", "BAG.MCAP.ZSTD", "bag.mcap"] {
        let folder = folder(&[(name, &file), ("metadata.yaml", b"")]);
        for path in [folder.path().to_owned(), folder.path().join(name)] {
            assert_same(&read_path(&path, &none()).unwrap(), &expected());
            assert_eq!(summary(&path).compression, Some("zstd, each file"));
            let scene = open_scene(&path, &none()).unwrap();
            assert_eq!(scene.name().to_lowercase().trim_end_matches("_0"), "bag");
        }
    }
    // Both modes, several frames of the format with one to skip, and the unpacked file beside it.
    assert_same(&read(&packed(&message_mode(plain())), &none()).unwrap(), &expected());
    let (start, end) = plain().split_at(1000);
    let several = [packed(start), vec![0x53, 0x2A, 0x4D, 0x18, 3, 0, 0, 0, 1, 2, 3], packed(end)].concat();
    assert_same(&read(&several, &none()).unwrap(), &expected());
    let both = folder(&[("bag_0.mcap.zstd", b"damaged"), ("bag_0.mcap", plain())]);
    assert_same(&read_path(both.path(), &none()).unwrap(), &expected());
}

#[test]
fn damaged_compressed_files_are_read_as_far_as_possible() {
    let parts: Vec<Vec<u8>> = plain().chunks(2000).map(packed).collect();
    let whole = parts.concat();
    let folder = folder(&[("a.mcap.zstd", &whole[..whole.len() / 2])]);
    let path = folder.path().join("a.mcap.zstd");
    let summary = summary(&path);
    let count = summary.scene.unwrap().count;
    assert!((1..4).contains(&count), "{count}");
    assert!(summary.damage[0].contains("a.mcap.zstd: damaged zstd data: "), "{:?}", summary.damage);
    assert!(summary.damage[1].contains("the recording was not finished"), "{:?}", summary.damage);
    // Another size in the header than that of the data: written by hand, with data that are stored as they are.
    let stored = |stated: u32| {
        let blocks = plain().chunks(100_000).collect::<Vec<_>>();
        let mut bytes = [&[0x28, 0xB5, 0x2F, 0xFD, 0xA0][..], &stated.to_le_bytes()].concat();
        for (index, block) in blocks.iter().enumerate() {
            let header = (block.len() as u32) << 3 | u32::from(index + 1 == blocks.len());
            bytes.extend(&header.to_le_bytes()[..3]);
            bytes.extend(*block);
        }
        bytes
    };
    assert_same(&read(&stored(plain().len() as u32), &none()).unwrap(), &expected());
    let found = read(&stored(plain().len() as u32 + 5), &none()).unwrap();
    assert_eq!(found.frames, expected().frames);
    assert!(found.warnings[0].contains("but its header says"), "{:?}", found.warnings);
}

#[test]
fn files_that_are_no_recording_are_refused() {
    for (bytes, text) in [
        (packed(b"hello world"), "PATH: first bytes: found \"hello wo\", expected"),
        (packed(b""), "PATH: zstd data: found nothing in them, expected a recording"),
        (vec![0x28, 0xB5, 0x2F, 0xFD], "PATH: zstd data: found damaged zstd data: "),
        ([&[0x28, 0xB5, 0x2F, 0xFD, 0xE0][..], &(1u64 << 50).to_le_bytes()].concat(), "PATH: zstd data: found "),
    ] {
        let folder = folder(&[("a.mcap.zstd", &bytes)]);
        let error = refused(&folder.path().join("a.mcap.zstd"));
        assert!(error.starts_with(text), "{error}");
    }
    let folder = folder(&[("bag_0.mcap.lz4", b"packed"), ("metadata.yaml", b"")]);
    let error = open_scene(folder.path(), &none()).unwrap_err().to_string();
    assert!(
        error.ends_with("bag_0.mcap.lz4: compression: found \"lz4\", expected zstd (.zstd or .zst), or a file that was unpacked to .mcap before"),
        "{error}"
    );
}

#[test]
fn split_recordings_are_read_as_one() {
    let count = messages(plain()).len();
    let part = |range: std::ops::Range<usize>| rewritten(plain(), |index| range.contains(&index), <[u8]>::to_vec);
    let parts = [part(0..count / 3), part(count / 3..count / 2), part(count / 2..count)];
    let metadata = ("metadata.yaml", &b""[..]);
    for is_packed in [false, true] {
        let files: Vec<(String, Vec<u8>)> = parts
            .iter()
            .zip([9, 10, 11])
            .map(|(part, number)| match is_packed {
                true => (format!("bag_{number}.mcap.zstd"), packed(part)),
                false => (format!("bag_{number}.mcap"), part.clone()),
            })
            .collect();
        let mut named: Vec<(&str, &[u8])> =
            files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
        named.push(metadata);
        let all = folder(&named);
        assert_same(&read_path(all.path(), &none()).unwrap(), &expected());
        assert_eq!(summary(all.path()).files, 3);
        // One is missing.
        named.remove(1);
        let found = read_path(folder(&named).path(), &none()).unwrap();
        assert!(found.frames.len() < 4);
        assert_eq!(found.warnings, ["a.mcap: the files with these numbers are missing: 10"]);
        // Without rosbag2's list, they may be anything.
        named.pop();
        let error = read_path(folder(&named).path(), &none()).map(|_| ()).unwrap_err();
        assert!(error.contains("holds several sequences"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn damaged_compressed_recordings_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        keep in any::<prop::sample::Index>(),
        is_file in any::<bool>(),
    ) {
        static WHOLE: OnceLock<[Vec<u8>; 2]> = OnceLock::new();
        let whole = WHOLE.get_or_init(|| {
            [support::mcap::without_checksums(message_mode(plain())), packed(plain())]
        });
        let bytes = damaged(whole[usize::from(is_file)].clone(), &changes, &keep);
        let folder = folder(&[("a.mcap", &bytes)]);
        match RecordingScene::open(&folder.path().join("a.mcap"), &none()) {
            Ok(scene) => (0..scene.frame_count()).for_each(|index| _ = scene.read_frame(index)),
            Err(error) => prop_assert!(error.to_string().contains("a.mcap") && !error.to_string().contains('\n'), "{}", error),
        }
    }
}

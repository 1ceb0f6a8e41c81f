//! Recordings of Azure Kinect that are damaged, cut off, or lack something.

use crate::support::damaged;
use crate::support::mkv::{HeadPlace, MkvWriter, SMALL_COLOR, bitmap_header, element, read, small, track, written};
use proptest::prelude::*;
use splatseg_dataset::{DatasetSettings, RecordingScene, Scene};

/// The tracks, the calibration and the tags of a recording made here, and its first blocks.
const HEAD_BYTES: usize = 2800;

#[test]
fn a_recording_that_was_cut_off_is_read_up_to_there() {
    let whole = small(4, 0).bytes();
    let mut last = 5;
    for end in (100..whole.len()).rev().step_by(41) {
        let (warnings, frames) = read(&whole[..end]);
        let count = frames.map_or(0, |frames| frames.len());
        assert!(count <= last, "{count} frames of {end} bytes");
        if count > 0 {
            let told =
                warnings.iter().any(|line| line.contains("was not finished, or is damaged: it is read up to byte"));
            assert!(told, "{end}: {warnings:?}");
        }
        last = count;
    }
    assert_eq!(last, 0);
}

#[test]
fn reading_goes_on_after_damage() {
    let whole = small(4, 0).bytes();
    let clusters: Vec<usize> =
        (0..whole.len() - 4).filter(|at| whole[*at..].starts_with(&[0x1F, 0x43, 0xB6, 0x75])).collect();
    assert_eq!(clusters.len(), 8);
    // The size of a block beyond its cluster, and the id of a cluster.
    for (at, value) in [(clusters[2] + 12 + 17 + 3, 200), (clusters[2], 0)] {
        let mut bytes = whole.clone();
        bytes[at] = value;
        let (warnings, frames) = read(&bytes);
        assert_eq!(frames.unwrap().len(), 3);
        assert!(warnings.iter().any(|line| line.contains("reading goes on with")), "{warnings:?}");
    }
}

#[test]
fn what_is_missing_is_told_in_one_line() {
    let error = |change: fn(&mut MkvWriter)| {
        let mut writer = small(2, 0);
        change(&mut writer);
        let error = read(&writer.bytes()).1.map(|frames| frames.len()).unwrap_err();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    assert_eq!(
        error(|writer| _ = writer.tracks.pop()),
        "a.mkv: tracks: found COLOR (jpeg), expected DEPTH with 16 bits (b16g): PASSIVE_IR and OFF are no modes with depth"
    );
    let text = error(|writer| {
        writer.tracks[0] = track(1, "COLOR", "V_MS/VFW/FOURCC", &bitmap_header(b"H264"), SMALL_COLOR);
    });
    assert_eq!(
        text,
        "a.mkv: tracks: found COLOR (V_MS/VFW/FOURCC H264), DEPTH (16UC1), expected COLOR as MJPG, NV12, YUY2 or BGRA"
    );
    assert!(
        error(|writer| writer.calibration = None)
            .starts_with("a.mkv: attachment calibration.json: found none, expected")
    );
    let text = error(|writer| writer.calibration = Some(b"{}".to_vec()));
    assert!(
        text.starts_with("a.mkv: attachment calibration.json: found one that cannot be used: missing field"),
        "{text}"
    );
    let (warnings, frames) = read(&MkvWriter { flags: 2, ..small(2, 0) }.bytes());
    assert!(frames.is_err() && warnings.is_empty(), "{warnings:?}");
}

#[test]
fn what_says_that_it_is_large_is_not_believed() {
    for size in [(1u64 << 40, 9 << 37), (u64::MAX, u64::MAX), (0, 0)] {
        let mut writer = small(1, 0);
        writer.tracks[1] = track(2, "DEPTH", "V_MS/VFW/FOURCC", &bitmap_header(b"b16g"), size);
        assert!(read(&writer.bytes()).1.is_ok_and(|frames| frames.is_empty()) || read(&writer.bytes()).1.is_err());
    }
    // A part of the head, and lists of parts that point to each other.
    let mut bytes = small(1, 0).bytes();
    let tags = bytes.windows(4).position(|id| id == [0x12, 0x54, 0xC3, 0x67]).unwrap();
    bytes[tags + 5] = 0x7F;
    assert!(read(&bytes).0.iter().any(|line| line.contains("damaged")));
    let list = element(
        0x114D_9B74,
        &element(0x4DBB, &[element(0x53AB, &[0x11, 0x4D, 0x9B, 0x74]), element(0x53AC, &[0])].concat()),
    );
    let bytes = [element(0x1A45_DFA3, &[]), element(0x1853_8067, &list.repeat(500))].concat();
    assert!(read(&bytes).1.is_err());
}

/// Number of damaged recordings: 400, or as many as the variable says.
fn cases() -> u32 {
    std::env::var("SPLATSEG_FUZZ_CASES").ok().and_then(|text| text.parse().ok()).unwrap_or(400)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    /// Damaged recordings are read or refused in one line that names them, without a panic.
    #[test]
    fn damaged_recordings_are_read_or_refused(
        kind in 0usize..4,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        // Most of the file is images: as often, only the rest is changed.
        head in any::<bool>(),
        keep in any::<prop::sample::Index>(),
    ) {
        let mut writer = small(2, 0);
        match kind {
            0 => {}
            1 => writer.head = HeadPlace::Last,
            2 => writer.is_streamed = true,
            _ => writer.is_grouped = true,
        }
        let mut bytes = writer.bytes();
        if head {
            let start = bytes.len().min(HEAD_BYTES);
            changes.iter().for_each(|(at, value)| bytes[at.index(start)] = *value);
        } else {
            bytes = damaged(bytes, &changes, &keep);
        }
        let (_folder, path) = written(&bytes);
        let place = path.display().to_string();
        let settings = DatasetSettings::default();
        let told = match RecordingScene::open(&path, &settings) {
            Ok(scene) => {
                let read = |index| scene.read_recorded(index).err();
                (0..scene.frame_count()).filter_map(read).map(|error| error.to_string()).collect()
            }
            Err(error) => vec![error.to_string()],
        };
        for line in told {
            prop_assert!(!line.contains('\n') && line.contains(&place), "{line}");
        }
    }
}

//! JPEG files have the pixels that libjpeg-turbo gives them, and damaged ones are told.
//!
//! `data/jpeg` is made by `tools/make_jpeg_test_data.py`: each JPEG lies beside the pixels that Pillow decodes.

mod support;

use proptest::prelude::*;
use splatseg_dataset::{DatasetError, read_color_image};
use splatseg_geometry::Image;
use std::fs;
use std::path::{Path, PathBuf};
use support::{damaged, shared_data};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/jpeg");

fn jpegs_in(folder: &Path) -> Vec<PathBuf> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = paths.filter(|path| path.extension().is_some_and(|ending| ending == "jpg")).collect();
    paths.sort();
    paths
}

fn read_bytes(bytes: &[u8]) -> Result<Image<[u8; 3]>, DatasetError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("read.jpg");
    fs::write(&path, bytes).unwrap();
    read_color_image(&path)
}

fn data(name: &str) -> Vec<u8> {
    fs::read(Path::new(DATA).join(name)).unwrap()
}

#[test]
fn pixels_are_those_of_libjpeg_turbo() {
    let paths = jpegs_in(Path::new(DATA));
    assert_eq!(paths.len(), 24);
    for path in paths {
        let expected = image::open(path.with_extension("png")).unwrap().into_rgb8();
        let found = read_color_image(&path).unwrap();
        let name = path.file_stem().unwrap().to_string_lossy();
        assert_eq!(found.size(), (expected.width() as usize, expected.height() as usize), "{name}");
        let differing = found.pixels().as_flattened().iter().zip(expected.as_raw()).filter(|(a, b)| a != b).count();
        assert_eq!(differing, 0, "samples of {name}");
    }
}

#[test]
fn other_kinds_are_left_to_another_decoder() {
    let cmyk = read_color_image(&Path::new(DATA).join("other/cmyk.jpg")).unwrap();
    assert_eq!(cmyk.size(), (16, 24));
    let error = read_color_image(&Path::new(DATA).join("other/arithmetic.jpg")).unwrap_err();
    assert!(matches!(error, DatasetError::Image { .. }), "{error}");
}

#[test]
fn real_recordings_are_read() {
    let test = "real_recordings_are_read";
    for (part, count, size) in
        [("redkitchen", 100, (640, 480)), ("rooms/dev-a/color", 80, (320, 240)), ("rooms/dev-b/color", 80, (320, 240))]
    {
        let Some(folder) = shared_data(test, part) else { return };
        let paths = jpegs_in(&folder);
        assert_eq!(paths.len(), count, "{part}");
        for path in paths {
            assert_eq!(read_color_image(&path).unwrap().size(), size, "{}", path.display());
        }
    }
}

#[test]
fn cut_off_files_are_told() {
    for name in ["420.jpg", "progressive.jpg"] {
        let whole = data(name);
        for keep in 3..whole.len() - 1 {
            let error = read_bytes(&whole[..keep]).unwrap_err();
            assert!(matches!(error, DatasetError::CutOff { .. }), "{name} {keep}: {error}");
        }
    }
}

/// The position of the last segment with this marker.
fn last(bytes: &[u8], marker: u8) -> usize {
    bytes.windows(2).rposition(|pair| pair == [0xFF, marker]).unwrap()
}

#[test]
fn missing_data_is_told() {
    for name in ["420.jpg", "progressive.jpg", "restarts.jpg"] {
        let mut bytes = data(name);
        let (scan, end) = (last(&bytes, 0xDA), last(&bytes, 0xD9));
        bytes.drain((scan + end) / 2..end);
        let error = read_bytes(&bytes).unwrap_err().to_string();
        assert!(error.contains("the colour image is damaged") && error.contains("it ends early"), "{error}");
    }
    // The first restart marker has another number.
    let mut bytes = data("restarts.jpg");
    let restart = bytes.windows(2).position(|pair| pair == [0xFF, 0xD0]).unwrap();
    bytes[restart + 1] = 0xD5;
    assert!(read_bytes(&bytes).unwrap_err().to_string().contains("a restart marker is missing"));
}

#[test]
fn missing_parts_are_told() {
    // Without the last of three scans.
    let mut bytes = data("separate_scans.jpg");
    let (scan, end) = (last(&bytes, 0xDA), last(&bytes, 0xD9));
    bytes.drain(scan..end);
    assert!(read_bytes(&bytes).unwrap_err().to_string().contains("no compressed data for a component"));
    // With a quantisation table under a number that no component names.
    let mut bytes = data("grey.jpg");
    let table = last(&bytes, 0xDB);
    bytes[table + 4] = 3;
    assert!(read_bytes(&bytes).unwrap_err().to_string().contains("quantisation table 0 is missing"));
}

#[test]
fn endless_scans_are_refused() {
    let mut bytes = data("progressive.jpg");
    // The scan of the lowest bits without frequency fits in again and again.
    let header = [0xFF, 0xDA, 0, 12, 3, 1, 0, 2, 0, 3, 0, 0, 0, 0x10];
    let scan = bytes.windows(header.len()).position(|window| window == header).unwrap();
    let data = scan + header.len();
    let end = data + bytes[data..].windows(2).position(|pair| pair[0] == 0xFF && pair[1] != 0).unwrap();
    let repeated = bytes[scan..end].repeat(200);
    bytes.splice(end..end, repeated);
    assert!(read_bytes(&bytes).unwrap_err().to_string().contains("too many scans"));
}

#[test]
fn sizes_beyond_reason_take_no_memory() {
    let mut bytes = data("420.jpg");
    let frame = last(&bytes, 0xC0);
    bytes[frame + 5..frame + 9].fill(0xFF);
    let error = read_bytes(&bytes).unwrap_err();
    assert!(matches!(error, DatasetError::ImplausibleSize { width: 65535, height: 65535, .. }), "{error}");
}

#[test]
fn bytes_that_belong_to_nothing_are_left_out() {
    let clean = data("420.jpg");
    let expected = read_bytes(&clean).unwrap();
    for (marker, extra) in [(0xD9, &[0x12, 0x34][..]), (0xDA, &[0xFF, 0xFF]), (0xC4, &[0xFF, 0xFE, 0, 4, 0xFF, 0xD8])] {
        let mut bytes = clean.clone();
        let at = last(&bytes, marker);
        bytes.splice(at..at, extra.iter().copied());
        assert_eq!(read_bytes(&bytes).unwrap().pixels(), expected.pixels());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(
        name in prop::sample::select(vec![
            "420.jpg", "mixed.jpg", "grey.jpg", "restarts.jpg", "separate_scans.jpg", "progressive.jpg",
            "progressive_unusual.jpg", "two_columns.jpg",
        ]),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        keep in any::<prop::sample::Index>(),
        with_end in any::<bool>(),
    ) {
        let mut bytes = damaged(data(name), &changes, &keep);
        if with_end {
            bytes.extend([0xFF, 0xD9]);
        }
        if let Err(error) = read_bytes(&bytes) {
            prop_assert!(error.to_string().contains("read.jpg"), "{}", error);
        }
    }
}

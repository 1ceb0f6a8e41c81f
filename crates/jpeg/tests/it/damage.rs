//! Damaged files give errors, never panics.

use proptest::prelude::*;
use proptest::sample::Index;
use splatseg_jpeg::{Jpeg, JpegError};
use std::fs;
use std::path::Path;

fn data(name: &str) -> Vec<u8> {
    fs::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data")).join(name)).unwrap()
}

fn decode(bytes: &[u8]) -> Result<Vec<[u8; 3]>, JpegError> {
    Jpeg::read_header(bytes)?.decode()
}

fn error_of(bytes: &[u8]) -> String {
    decode(bytes).unwrap_err().to_string()
}

#[test]
fn files_cut_off_anywhere_are_errors() {
    let whole = data("420.jpg");
    // The last bytes may be only padding.
    for keep in 0..last(&whole, 0xD9) - 4 {
        assert!(decode(&whole[..keep]).is_err(), "{keep} bytes");
    }
}

/// The position of the last segment with this marker.
fn last(bytes: &[u8], marker: u8) -> usize {
    bytes.windows(2).rposition(|pair| pair == [0xFF, marker]).unwrap()
}

#[test]
fn missing_data_is_an_error() {
    for name in ["420.jpg", "progressive.jpg", "restarts.jpg"] {
        let mut bytes = data(name);
        let (scan, end) = (last(&bytes, 0xDA), last(&bytes, 0xD9));
        bytes.drain((scan + end) / 2..end);
        let error = error_of(&bytes);
        assert!(error.contains("it ends early"), "{name}: {error}");
    }
    // The first restart marker has the wrong number.
    let mut bytes = data("restarts.jpg");
    let restart = bytes.windows(2).position(|pair| pair == [0xFF, 0xD0]).unwrap();
    bytes[restart + 1] = 0xD5;
    assert!(error_of(&bytes).contains("a restart marker is missing"));
}

#[test]
fn missing_parts_are_errors() {
    // Without the last of three scans.
    let mut bytes = data("separate_scans.jpg");
    let (scan, end) = (last(&bytes, 0xDA), last(&bytes, 0xD9));
    bytes.drain(scan..end);
    assert!(error_of(&bytes).contains("no compressed data for a component"));
    // With a quantisation table under an index that no component uses.
    let mut bytes = data("grey.jpg");
    let table = last(&bytes, 0xDB);
    bytes[table + 4] = 3;
    assert!(error_of(&bytes).contains("quantisation table 0 is missing"));
}

#[test]
fn endless_scans_are_refused() {
    let mut bytes = data("progressive.jpg");
    // The refinement scan of the lowest DC bits can be repeated.
    let header = [0xFF, 0xDA, 0, 12, 3, 1, 0, 2, 0, 3, 0, 0, 0, 0x10];
    let scan = bytes.windows(header.len()).position(|window| window == header).unwrap();
    let data = scan + header.len();
    let end = data + bytes[data..].windows(2).position(|pair| pair[0] == 0xFF && pair[1] != 0).unwrap();
    let repeated = bytes[scan..end].repeat(200);
    bytes.splice(end..end, repeated);
    assert!(error_of(&bytes).contains("too many scans"));
}

#[test]
fn a_header_with_an_absurd_size_is_read_without_memory_for_it() {
    let mut bytes = data("420.jpg");
    let frame = last(&bytes, 0xC0);
    bytes[frame + 5..frame + 9].fill(0xFF);
    assert_eq!(Jpeg::read_header(&bytes).unwrap().size(), (65535, 65535));
}

#[test]
fn stray_bytes_are_skipped() {
    let clean = data("420.jpg");
    let expected = decode(&clean).unwrap();
    for (marker, extra) in [(0xD9, &[0x12, 0x34][..]), (0xDA, &[0xFF, 0xFF]), (0xC4, &[0xFF, 0xFE, 0, 4, 0xFF, 0xD8])] {
        let mut bytes = clean.clone();
        let at = last(&bytes, marker);
        bytes.splice(at..at, extra.iter().copied());
        assert_eq!(decode(&bytes).unwrap(), expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, ..ProptestConfig::default() })]

    /// Changing bytes, inserting a copied part or truncating gives an image of the declared size or an error, not a
    /// panic.
    #[test]
    fn mutated_files_never_panic(
        name in prop::sample::select(vec![
            "420.jpg", "mixed.jpg", "grey.jpg", "restarts.jpg", "separate_scans.jpg", "progressive.jpg",
            "progressive_unusual.jpg", "two_columns.jpg", "410.jpg", "rgb.jpg",
        ]),
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 0..8),
        (from, to, len) in (any::<Index>(), any::<Index>(), 0usize..40),
        keep in any::<Index>(),
    ) {
        let mut bytes = data(name);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let from = from.index(bytes.len());
        let part = bytes[from..(from + len).min(bytes.len())].to_vec();
        let to = to.index(bytes.len());
        bytes.splice(to..to, part);
        bytes.truncate(keep.index(4 * bytes.len()));
        if let Ok(jpeg) = Jpeg::read_header(&bytes) {
            let (width, height) = jpeg.size();
            // A changed size may be huge, so it is checked first, as callers should.
            if u64::from(width) * u64::from(height) <= 1 << 20
                && let Ok(pixels) = jpeg.decode()
            {
                prop_assert_eq!(pixels.len(), width as usize * height as usize);
            }
        }
    }
}

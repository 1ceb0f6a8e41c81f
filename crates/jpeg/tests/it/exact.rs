//! Decoded pixels are identical to those of libjpeg-turbo.
//!
//! `tools/make_jpeg_test_data.py` makes `data`: each JPEG with the pixels decoded by Pillow.

use splatseg_jpeg::{Jpeg, JpegError};
use std::fs;
use std::path::{Path, PathBuf};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");

#[test]
fn pixels_are_those_of_libjpeg_turbo() {
    let entries = fs::read_dir(DATA).unwrap().map(|entry| entry.unwrap().path());
    let references: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|end| end == "png")).collect();
    assert_eq!(references.len(), 18);
    for reference in references {
        let expected = image::open(&reference).unwrap().into_rgb8();
        let bytes = fs::read(reference.with_extension("jpg")).unwrap();
        let jpeg = Jpeg::read_header(&bytes).unwrap();
        let name = reference.file_stem().unwrap().to_string_lossy();
        assert_eq!(jpeg.size(), expected.dimensions(), "{name}");
        let found = jpeg.decode().unwrap();
        let differing = found.as_flattened().iter().zip(expected.as_raw()).filter(|(a, b)| a != b).count();
        assert_eq!(differing, 0, "samples of {name}");
    }
}

#[test]
fn arithmetic_coding_is_unsupported() {
    let bytes = fs::read(Path::new(DATA).join("arithmetic.jpg")).unwrap();
    assert!(matches!(Jpeg::read_header(&bytes), Err(JpegError::Unsupported(_))));
}

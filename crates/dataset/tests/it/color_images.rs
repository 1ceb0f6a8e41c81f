//! Colour images, whole and damaged.

use crate::support::recording::jpeg_bytes;
use crate::support::shared_data;
use splatseg_dataset::{DatasetError, read_color_image};
use splatseg_geometry::Image;
use std::fs;
use std::path::{Path, PathBuf};

fn read_bytes(bytes: &[u8]) -> Result<Image<[u8; 3]>, DatasetError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("read.jpg");
    fs::write(&path, bytes).unwrap();
    read_color_image(&path)
}

fn jpeg() -> Vec<u8> {
    jpeg_bytes(&Image::from_fn(43, 29, |column, row| [5 * column as u8, 8 * row as u8, 90]))
}

#[test]
fn kinds_of_jpeg_that_the_exact_decoder_leaves_out_are_read_too() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/cmyk.jpg"));
    assert_eq!(read_color_image(path).unwrap().size(), (16, 24));
}

#[test]
fn cut_off_files_are_errors() {
    let whole = jpeg();
    for keep in 3..whole.len() - 1 {
        let error = read_bytes(&whole[..keep]).unwrap_err();
        assert!(matches!(error, DatasetError::CutOff { .. }), "{keep}: {error}");
    }
}

#[test]
fn missing_data_is_an_error_that_names_the_file() {
    let mut bytes = jpeg();
    let end = bytes.len() - 2;
    bytes.drain(end - 200..end);
    let error = read_bytes(&bytes).unwrap_err().to_string();
    assert!(error.contains("read.jpg: the colour image is damaged") && error.contains("it ends early"), "{error}");
}

#[test]
fn absurd_sizes_take_no_memory() {
    let mut bytes = jpeg();
    let frame = bytes.windows(2).position(|pair| pair == [0xFF, 0xC0]).unwrap();
    bytes[frame + 5..frame + 9].fill(0xFF);
    let error = read_bytes(&bytes).unwrap_err();
    assert!(matches!(error, DatasetError::ImplausibleSize { width: 65535, height: 65535, .. }), "{error}");
}

fn jpegs_in(folder: &Path) -> Vec<PathBuf> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.filter(|path| path.extension().is_some_and(|ending| ending == "jpg")).collect()
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

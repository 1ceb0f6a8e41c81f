//! Tests of the result images.

use splatseg_geometry::Image;
use splatseg_output::{OutputError, write_atomically, write_overlay_jpeg};
use splatseg_test_scenes::file_names;
use std::fs;

#[test]
fn failed_writes_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing/a.png");
    let error = write_atomically(&missing, b"new").unwrap_err().to_string();
    assert!(error.contains("missing/a.png: cannot be written"), "{error}");
    // A folder cannot be replaced by a file: the rename fails after everything is written.
    let taken = folder.path().join("taken");
    fs::create_dir_all(taken.join("full")).unwrap();
    assert!(write_atomically(&taken, b"new").is_err());
    assert_eq!(file_names(folder.path()), ["taken"]);
    let path = folder.path().join("a.txt");
    write_atomically(&path, b"old").unwrap();
    write_atomically(&path, b"new").unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"new");
    assert_eq!(file_names(folder.path()), ["a.txt", "taken"]);
}

#[cfg(target_os = "linux")]
#[test]
fn an_unwritable_folder_is_an_error_that_names_the_path() {
    let Err(error) = write_atomically(std::path::Path::new("/proc/splatseg.png"), b"new") else {
        panic!("/proc takes no files")
    };
    assert!(error.to_string().contains("/proc/splatseg.png"), "{error}");
}

#[test]
fn overlays_are_jpegs_of_the_frames_size() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("7.jpg");
    let color = Image::filled(160, 120, [100, 100, 100]);
    write_overlay_jpeg(&path, &color, &Image::from_fn(160, 120, |column, _| 1 + u32::from(column > 80))).unwrap();
    let drawn = image::open(&path).unwrap().into_rgb8();
    assert_eq!(drawn.dimensions(), (160, 120));
    assert!(matches!(
        write_overlay_jpeg(&path, &color, &Image::filled(3, 3, 0)),
        Err(OutputError::SizesDiffer { image: (160, 120), segments: (3, 3) })
    ));
}

//! Tests of id images.

use splatseg_annotations::{WriteIdsError, write_segments_png};
use splatseg_dataset::{DatasetError, read_segments_png};
use splatseg_geometry::{Image, SegmentId, SegmentMap};
use splatseg_test_scenes::file_names;
use std::fs;

/// The largest id of an RGB image.
const MAX_ID: SegmentId = 16_777_215;

#[test]
fn segments_survive_writing_and_reading() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("7.png");
    let map = SegmentMap::from_pixels(3, 2, vec![0, 1, 255, 256, 65_535, 3]).unwrap();
    write_segments_png(&path, &map).unwrap();
    assert_eq!(read_segments_png(&path).unwrap(), map);
    assert_eq!(image::open(&path).unwrap().color(), image::ColorType::L16);
    let map = SegmentMap::from_pixels(3, 2, vec![0, 1, 65_535, 65_536, 0x01_02_03, MAX_ID]).unwrap();
    write_segments_png(&path, &map).unwrap();
    assert_eq!(read_segments_png(&path).unwrap(), map);
    let rgb = image::open(&path).unwrap();
    assert_eq!(rgb.as_rgb8().unwrap().get_pixel(1, 1).0, [3, 2, 1], "R + 256 G + 65536 B");
    assert_eq!(file_names(folder.path()), ["7.png"]);
}

#[test]
fn ids_that_do_not_fit_and_empty_maps_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("7.png");
    let error = write_segments_png(&path, &Image::filled(2, 2, MAX_ID + 1)).unwrap_err();
    assert!(error.to_string().ends_with("7.png: segment id 16777216 does not fit an image (at most 16777215)"));
    assert!(matches!(write_segments_png(&path, &Image::filled(0, 0, 1)), Err(WriteIdsError::Encode { .. })));
    assert!(file_names(folder.path()).is_empty());
}

#[test]
fn other_images_are_not_segments() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("7.png");
    image::RgbaImage::new(4, 4).save(&path).unwrap();
    assert!(matches!(read_segments_png(&path), Err(DatasetError::PixelKind { .. })));
    assert!(matches!(read_segments_png(&folder.path().join("8.png")), Err(DatasetError::MissingFile { .. })));
    // One bit of grey would be widened to 0 and 255 by the decoder.
    let mut bytes = fs::read(&path).unwrap();
    (bytes[24], bytes[25]) = (1, 0);
    fs::write(&path, bytes).unwrap();
    assert!(read_segments_png(&path).unwrap_err().to_string().contains("1-bit grey"));
}

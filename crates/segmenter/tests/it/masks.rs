//! Replaying stored masks in every format, and the errors for damaged files.

use image::{ImageBuffer, Luma, Rgb, Rgba};
use proptest::prelude::*;
use splatseg_dataset::{Framing, ImageSize};
use splatseg_geometry::{Mask, Pose, RgbdFrame, RunLengths, ScoredMask, SegmentMap};
use splatseg_segmenter::{MaskFolder, Segmenter, SegmenterError};
use splatseg_test_scenes::{camera, wall};
use std::path::Path;
use tempfile::TempDir;

fn frame(name: &str, width: usize, height: usize) -> RgbdFrame<'static> {
    wall(name, camera(width, height, 10.0), 1.0, Pose::IDENTITY)
}

/// A folder with one file `7.<extension>`.
fn folder(extension: &str, content: &[u8]) -> TempDir {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join(format!("7.{extension}")), content).unwrap();
    folder
}

fn read(folder: &Path, framing: Framing, size: (usize, usize)) -> Result<Vec<ScoredMask>, SegmenterError> {
    MaskFolder::open(folder, framing).unwrap().segment(&frame("7", size.0, size.1)).map(|found| found.masks)
}

fn read_json(text: &str) -> Result<Vec<ScoredMask>, SegmenterError> {
    read(folder("json", text.as_bytes()).path(), Framing::default(), (4, 5))
}

/// Ids 0, 3 and 900 on 6×4 pixels.
fn id_folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let image = ImageBuffer::<Luma<u16>, _>::from_fn(6, 4, |column, row| {
        Luma([if column < 2 {
            900
        } else if row == 3 {
            3
        } else {
            0
        }])
    });
    image.save(folder.path().join("7.png")).unwrap();
    folder
}

#[test]
fn ids_become_masks() {
    let masks = read(id_folder().path(), Framing::default(), (6, 4)).unwrap();
    assert_eq!(masks.iter().map(|m| (m.mask.area(), m.score)).collect::<Vec<_>>(), [(4, 1.0), (8, 1.0)]);
    assert!(masks[1].mask.contains(1, 3) && masks[0].mask.contains(2, 3));
}

#[test]
fn eight_bit_ids_and_dotted_frame_names_are_read() {
    let folder = TempDir::new().unwrap();
    ImageBuffer::<Luma<u8>, _>::from_pixel(3, 2, Luma([255])).save(folder.path().join("a.b.color.png")).unwrap();
    let mut segmenter = MaskFolder::open(folder.path(), Framing::default()).unwrap();
    assert_eq!(segmenter.segment(&frame("a.b.color", 3, 2)).unwrap().masks[0].mask.area(), 6);
    assert_eq!(segmenter.name(), "masks");
}

#[test]
fn masks_are_resized_and_cropped_like_the_video() {
    let framing = Framing { resize: Some(ImageSize { width: 12, height: 8 }), crop_border: 2, ..Framing::default() };
    let masks = read(id_folder().path(), framing, (8, 4)).unwrap();
    let expected = Mask::from_fn(8, 4, |column, _| column < 2);
    assert_eq!(masks.len(), 1, "id 3 lies in the border that is cut off");
    assert_eq!(masks[0].mask, expected);
    // Masks already of the frame's size are used unchanged, regardless of the framing.
    assert_eq!(read(id_folder().path(), framing, (6, 4)).unwrap().len(), 2);
    let halved = Framing { resize: Some(ImageSize { width: 3, height: 2 }), crop_border: 0, ..Framing::default() };
    // Of two rows at the same distance the upper one is sampled, so id 3, only in the lowest row, is lost.
    let masks = read(id_folder().path(), halved, (3, 2)).unwrap();
    assert_eq!(masks.iter().map(|found| found.mask.clone()).collect::<Vec<_>>(), [Mask::from_fn(3, 2, |x, _| x == 0)]);
}

#[test]
fn masks_and_labels_take_the_same_pixels_at_half_size() {
    let folder = TempDir::new().unwrap();
    ImageBuffer::<Luma<u8>, _>::from_raw(4, 1, vec![1u8, 2, 3, 4]).unwrap().save(folder.path().join("7.png")).unwrap();
    let half = Framing { resize: Some(ImageSize { width: 2, height: 1 }), crop_border: 0, ..Framing::default() };
    let labels = half.apply_to_labels(SegmentMap::from_pixels(4, 1, vec![1, 2, 3, 4]).unwrap()).unwrap();
    let masks = read(folder.path(), half, (2, 1)).unwrap();
    let expected: Vec<Mask> = Mask::of_segments(&labels).into_iter().map(|(_, mask)| mask).collect();
    assert_eq!(masks.into_iter().map(|scored| scored.mask).collect::<Vec<_>>(), expected);
}

#[test]
fn masks_of_another_size_are_refused() {
    let framing = Framing { resize: None, crop_border: 1, ..Framing::default() };
    let error = read(id_folder().path(), framing, (5, 5)).unwrap_err().to_string();
    assert!(error.contains("7.png: masks of 6x4 pixels become 4x2"), "{error}");
    assert!(error.ends_with("expected 5x5 as in the frame"), "{error}");
    let cut_away = Framing { resize: None, crop_border: usize::MAX, ..Framing::default() };
    assert!(matches!(read(id_folder().path(), cut_away, (5, 5)), Err(SegmenterError::WrongSize { found: (0, 0), .. })));
}

#[test]
fn coco_masks_may_be_compressed_or_not_and_overlap() {
    let list = r#"[{"segmentation": {"size": [5, 4], "counts": "62304"}, "score": 0.25, "category_id": 1},
                   {"segmentation": {"size": [5, 4], "counts": [0, 20]}},
                   {"segmentation": {"size": [5, 4], "counts": [20]}, "score": 1}]"#;
    let inner = Mask::from_fn(4, 5, |column, row| (1..3).contains(&column) && (1..3).contains(&row));
    for text in [list.to_owned(), format!(r#"{{"info": {{}}, "annotations": {list}}}"#)] {
        let masks = read_json(&text).unwrap();
        assert_eq!(masks.len(), 2, "the empty mask is left out");
        assert_eq!(masks[0], ScoredMask { mask: inner.clone(), score: 0.25 });
        assert_eq!((masks[1].mask.area(), masks[1].score), (20, 1.0));
    }
    assert_eq!(read_json("[]").unwrap(), []);
}

#[test]
fn missing_frames_are_named_with_the_files_looked_for() {
    let folder = id_folder();
    let mut segmenter = MaskFolder::open(folder.path(), Framing::default()).unwrap();
    let error = segmenter.segment(&frame("8", 6, 4)).unwrap_err().to_string();
    let path = |name: &str| folder.path().join(name).display().to_string();
    assert!(error.contains("frame 8") && error.contains(&path("8.png")) && error.contains(&path("8.json")), "{error}");
}

#[test]
fn folders_without_masks_are_refused() {
    let empty = TempDir::new().unwrap();
    let open = |path: &Path| MaskFolder::open(path, Framing::default());
    assert!(matches!(open(empty.path()), Err(SegmenterError::NoMasks { .. })));
    assert!(matches!(open(&empty.path().join("none")), Err(SegmenterError::Read { .. })));
    let folder = id_folder();
    assert!(matches!(open(&folder.path().join("7.png")), Err(SegmenterError::NotAFolder { .. })));
    let huge =
        Framing { resize: Some(ImageSize { width: usize::MAX, height: 2 }), crop_border: 0, ..Framing::default() };
    assert!(matches!(MaskFolder::open(folder.path(), huge), Err(SegmenterError::Setting(_))));
}

#[test]
fn damaged_images_are_refused() {
    let whole = std::fs::read(id_folder().path().join("7.png")).unwrap();
    for length in [0, 10, 30, whole.len() / 2] {
        let error = read(folder("png", &whole[..length]).path(), Framing::default(), (6, 4)).unwrap_err();
        assert!(matches!(error, SegmenterError::IdImage(_)), "{error}");
    }
    let folder = TempDir::new().unwrap();
    ImageBuffer::<Rgba<u8>, _>::new(6, 4).save(folder.path().join("7.png")).unwrap();
    let error = read(folder.path(), Framing::default(), (6, 4)).unwrap_err().to_string();
    assert!(error.contains("7.png") && error.contains("8-bit RGBA") && error.contains("16-bit grey"), "{error}");
}

#[test]
fn ids_may_be_in_rgb_as_in_panoptic_images() {
    let folder = TempDir::new().unwrap();
    let image = ImageBuffer::from_fn(6, 4, |column, _| Rgb(if column < 2 { [1u8, 0, 2] } else { [0, 0, 0] }));
    image.save(folder.path().join("7.png")).unwrap();
    assert_eq!(read(folder.path(), Framing::default(), (6, 4)).unwrap().len(), 1);
}

#[test]
fn false_image_sizes_allocate_no_memory() {
    let mut png = std::fs::read(id_folder().path().join("7.png")).unwrap();
    // Width and height are in bytes 16 to 24 of the header, its checksum in bytes 29 to 33.
    png[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    let checksum = crc32fast::hash(&png[12..29]);
    png[29..33].copy_from_slice(&checksum.to_be_bytes());
    let error = read(folder("png", &png).path(), Framing::default(), (6, 4)).unwrap_err();
    assert!(matches!(error, SegmenterError::IdImage(_)), "{error}");
}

#[test]
fn errors_locate_damaged_annotations() {
    let rle = r#""segmentation": {"size": [5, 4], "counts": [20]}"#;
    let cases = [
        ("{", "7.json: file: found EOF"),
        ("3", "file: found 3, expected a list of annotations"),
        (r#"{"images": []}"#, "file: found an object, expected a list of annotations"),
        ("[3]", "annotation 0: found 3, expected an object"),
        (r#"{"annotations": 3}"#, "file: found invalid type: integer `3`, expected a list"),
        ("[{]", "7.json: file: found key must be a string"),
        (&format!(r"[{{{rle}}}, {{}}]"), "annotation 1, segmentation: found nothing"),
        (&format!(r#"[{{{rle}, "score": 1.5}}]"#), "annotation 0, score: found 1.5, expected a number from 0 to 1"),
        (
            r#"[{"segmentation": [[1, 2, 3, 4]]}]"#,
            "segmentation: found a list of 1 with a list of 4 in it, expected an RLE object",
        ),
        (r#"[{"segmentation": {"size": [5, -4], "counts": []}}]"#, "segmentation: found a list of 2"),
        (r#"[{"segmentation": {"size": [5, 4]}}]"#, "annotation 0, counts: found nothing"),
        (r#"[{"segmentation": {"size": [5, 4], "counts": [-1]}}]"#, "annotation 0, counts: found a list of 1 with -1"),
        (r#"[{"segmentation": {"size": [5, 4], "counts": "6~"}}]"#, "annotation 0, segmentation: the compressed RLE"),
        (r#"[{"segmentation": {"size": [5, 4], "counts": [7]}}]"#, "the RLE's runs add up to 7 pixels"),
        (r#"[{"segmentation": {"size": [0, 0], "counts": []}}]"#, "masks of 0x0 pixels"),
        (r#"[{"segmentation": {"size": [99999999, 99999999], "counts": [1]}}]"#, "expected 1 to 67108864 pixels"),
    ];
    for (text, expected) in cases {
        let error = read_json(text).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("7.json"), "{text}\n{error}");
    }
}

/// A JSON list of `count` masks of `side`² pixels, each a rectangle that takes about 50 bytes of JSON.
fn rectangles(count: usize, side: usize) -> String {
    let (outside, inside) = (side * side / 4, side * side / 2);
    let annotation = format!(
        r#"{{"segmentation":{{"size":[{side},{side}],"counts":[{outside},{inside},{}]}}}}"#,
        side * side - outside - inside
    );
    format!("[{}]", vec![annotation; count].join(","))
}

#[test]
fn thousands_of_huge_masks_take_no_more_memory_than_the_frame_allows() {
    let masks = folder("json", rectangles(3000, 8192).as_bytes());
    let error = read(masks.path(), Framing::default(), (64, 48)).unwrap_err();
    assert!(matches!(error, SegmenterError::WrongSize { stored: (8192, 8192), .. }), "{error}");
    let framing = Framing { resize: Some(ImageSize { width: 64, height: 64 }), crop_border: 8, ..Framing::default() };
    let found = read(masks.path(), framing, (48, 48)).unwrap();
    assert_eq!(found.len(), 3000);
    // The left and right quarters of the image are outside the mask.
    assert_eq!(found[2999].mask, Mask::from_fn(48, 48, |column, _| (8..40).contains(&column)));
    assert!(found.iter().map(|found| found.mask.memory_bytes()).sum::<usize>() < 3_000_000);
}

#[test]
fn the_first_mask_of_a_wrong_size_ends_the_file() {
    let right = r#"{"segmentation": {"size": [5, 4], "counts": [20]}}"#;
    let wrong = r#"{"segmentation": {"size": [6, 4], "counts": [0, 24]}}"#;
    let error = read_json(&format!("[{right}, {wrong}, this is not even JSON")).unwrap_err();
    assert!(matches!(error, SegmenterError::WrongSize { stored: (4, 6), .. }), "{error}");
}

#[test]
fn masks_of_one_frame_stay_within_the_memory_limit() {
    let file = folder("json", rectangles(200, 256).as_bytes());
    let segment = |limit: u64| {
        let mut masks = MaskFolder::open(file.path(), Framing::default()).unwrap().with_memory_limit(limit);
        masks.segment(&frame("7", 256, 256)).map(|found| found.masks)
    };
    assert_eq!(segment(10_000_000).unwrap().len(), 200);
    let error = segment(100_000).unwrap_err();
    assert!(matches!(error, SegmenterError::TooMuchMemory { limit: 100_000, .. }));
    let error = error.to_string();
    assert!(
        error.contains("7.json: the first ") && error.ends_with("expected at most 100 kB (memory_limit)"),
        "{error}"
    );
}

#[test]
fn more_masks_than_ids_are_refused() {
    let dot = r#"{"segmentation":{"size":[5,4],"counts":[3,1,16]}}"#;
    let list = |count: usize| format!("[{}]", vec![dot; count].join(","));
    assert_eq!(read_json(&list(65_535)).unwrap().len(), 65_535);
    let error = read_json(&list(65_536)).unwrap_err().to_string();
    assert!(error.contains("7.json contains more than 65535 masks"), "{error}");
}

#[test]
fn unrelated_json_takes_no_memory() {
    // As a tree of JSON values, each element would take 32 bytes for 3 bytes of text.
    let filler = format!("[{}]", vec!["[]"; 100_000].join(","));
    let text = format!(r#"{{"info": {filler}, "annotations": [{{"segmentation": {filler}}}]}}"#);
    let error = read_json(&text).unwrap_err().to_string();
    assert!(error.contains("annotation 0, segmentation: found a list of 100000 with a list of 0 in it"), "{error}");
}

#[cfg(unix)]
#[test]
fn devices_and_fifos_are_refused_at_once() {
    let folder = TempDir::new().unwrap();
    std::os::unix::fs::symlink("/dev/zero", folder.path().join("7.json")).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(folder.path().join("8.json")).status().unwrap().success());
    let mut segmenter = MaskFolder::open(folder.path(), Framing::default()).unwrap();
    for (name, kind) in [("7", "a device"), ("8", "a FIFO")] {
        let error = segmenter.segment(&frame(name, 4, 5)).unwrap_err().to_string();
        assert!(error.contains(&format!("{name}.json: it is {kind}, expected a regular file")), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn any_mask_survives_the_file(pixels in prop::collection::vec(any::<bool>(), 20..=20)) {
        let mask = Mask::from_fn(4, 5, |column, row| pixels[row * 4 + column]);
        let runs = RunLengths::encode(&mask);
        let compressed = serde_json::to_string(&runs.to_compressed()).unwrap();
        let text = format!(
            r#"[{{"segmentation": {{"size": [5, 4], "counts": {compressed}}}}},
                {{"segmentation": {{"size": [5, 4], "counts": {:?}}}}}]"#,
            runs.counts
        );
        let masks = read_json(&text).unwrap();
        prop_assert_eq!(masks.len(), if mask.is_empty() { 0 } else { 2 });
        prop_assert!(masks.iter().all(|found| found.mask == mask));
    }

    #[test]
    fn garbage_never_panics(text in r#"[\[\]{}":,0-9a-z\-]{0,60}"#, bytes in prop::collection::vec(any::<u8>(), 0..80)) {
        let _ = read_json(&text);
        let png = [b"\x89PNG\r\n\x1a\n".to_vec(), bytes].concat();
        let _ = read(folder("png", &png).path(), Framing::default(), (4, 5));
    }
}

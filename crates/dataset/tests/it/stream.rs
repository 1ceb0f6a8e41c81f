//! Streams: selection, framing, bad frames, read-ahead.

use crate::support::*;
use glam::Vec2;
use proptest::prelude::*;
use splatseg_dataset::{
    DatasetError, DatasetSettings, FrameSource, FrameStream, Framing, GroundTruth, ImageSize, MAX_FRAMES_IN_MEMORY,
    RecordedFrame, Scene, open_scene,
};
use splatseg_geometry::{CameraFrame, Image, Intrinsics, RunLengths, SegmentMap};
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

fn room(text: &str) -> Arc<dyn Scene> {
    Arc::new(splatseg_test_scenes::room(text))
}

fn indices(scene: &Arc<dyn Scene>, settings: &DatasetSettings) -> Vec<usize> {
    let stream = FrameStream::open(Arc::clone(scene), settings, GroundTruth::Skip).unwrap();
    stream.map(|frame| frame.unwrap().index).collect()
}

#[test]
fn frames_are_selected_in_order() {
    let scene = room("synthetic:frames=20,width=16,height=12,objects=2");
    let settings = DatasetSettings::default().with(|settings| {
        settings.start = 3;
        settings.stride = 4;
    });
    assert_eq!(indices(&scene, &settings), [3, 7, 11, 15, 19]);
    assert_eq!(indices(&scene, &settings.with(|settings| settings.max_frames = Some(2))), [3, 7]);
    assert_eq!(indices(&scene, &DatasetSettings::default().with(|settings| settings.start = 19)), [19]);
}

#[test]
fn impossible_settings_are_reported_on_opening() {
    let scene = room("synthetic:frames=5,width=32,height=24,objects=1");
    let refused = |settings: DatasetSettings| match FrameStream::open(Arc::clone(&scene), &settings, GroundTruth::Read)
    {
        Err(DatasetError::Setting(error)) => error.to_string(),
        other => panic!("{other:?}"),
    };
    let default = DatasetSettings::default;
    let cases = [
        (default().with(|settings| settings.stride = 0), "dataset.stride is 0, expected 1 to 1000000000"),
        (
            default().with(|settings| settings.resize = "0x0".parse().ok()),
            "dataset.resize is \"0x0\", expected WIDTHxHEIGHT, sides of 1 to 4096 pixels",
        ),
        (
            default().with(|settings| settings.crop_border = 12),
            "dataset.crop_border is 12, expected less than half of 32x24 pixels, the frame's size",
        ),
        (
            default().with(|settings| settings.start = 5),
            "dataset.start is 5, expected less than 5, the scene's number of frames",
        ),
    ];
    for (settings, message) in cases {
        assert_eq!(refused(settings), message);
    }
    let huge = refused(default().with(|settings| settings.crop_border = usize::MAX));
    assert!(huge.starts_with("dataset.crop_border is "), "{huge}");
}

#[test]
fn points_stay_where_they_are_after_resizing_and_cropping() {
    let scene = room("synthetic:frames=1,seed=5,objects=6");
    let original = scene.read_frame(0).unwrap();
    let labels = scene.read_ground_truth(0).unwrap().unwrap();
    let settings = DatasetSettings::default().with(|settings| {
        settings.resize = "200x150".parse().ok();
        settings.crop_border = 5;
    });
    let mut stream = FrameStream::open(scene, &settings, GroundTruth::Read).unwrap();
    assert_eq!((stream.len(), stream.frame_size()), (1, Some((190, 140))));
    let framed = stream.next().unwrap().unwrap();
    let framed_labels = framed.ground_truth.unwrap();
    assert_eq!(framed_labels.size(), (190, 140));
    let (mut same, mut checked) = (0, 0);
    for row in (3..140).step_by(7) {
        for column in (3..190).step_by(7) {
            let z = framed.frame.depth()[(column, row)];
            let point = framed.frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), z);
            let pixel = original.intrinsics().project(point).unwrap();
            let at = (pixel.x.round() as usize, pixel.y.round() as usize);
            let id = framed_labels[(column, row)];
            checked += 1;
            // At edges the nearest measurement may be from the other surface.
            if labels[at] == id {
                same += 1;
                assert!((pixel - Vec2::new(at.0 as f32, at.1 as f32)).length() < 0.8);
                let there = original.intrinsics().unproject(pixel, original.depth()[at]);
                assert!((there - point).length() < 0.1, "{column}, {row}: {there} {point}");
            }
        }
    }
    assert!(same * 100 > checked * 97, "{same} of {checked}");
}

#[test]
fn bad_frames_are_reported_and_skipped() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 6);
    fs::remove_file(folder.path().join("frame-000000.depth.png")).unwrap();
    truncate(&folder.path().join("frame-000020.color.jpg"));
    let other_size = folder.path().join("frame-000040");
    write_color(&other_size.with_extension("color.jpg"), 32, 24);
    write_png16(&other_size.with_extension("depth.png"), (32, 24), |_, _| 1000);
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    let stream = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    let results: Vec<_> = stream.collect();
    assert_eq!(results.iter().map(Result::is_ok).collect::<Vec<_>>(), [false, true, false, true, false, true]);
    let error = results[0].as_ref().unwrap_err();
    assert_eq!((error.index, error.name.as_str()), (0, "frame-000000"));
    assert!(error.to_string().starts_with("frame 0 (frame-000000) cannot be used: "), "{error}");
    let error = results[4].as_ref().unwrap_err();
    assert!(error.to_string().ends_with("the frame has 32x24 pixels, but the first frame has 64x48"), "{error}");
    assert_eq!(results[5].as_ref().unwrap().frame.name(), "frame-000050");
}

#[test]
fn a_scene_of_bad_frames_ends() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 3);
    for frame in 0..3 {
        fs::write(folder.path().join(format!("frame-{:06}.pose.txt", 10 * frame)), "").unwrap();
    }
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    let stream = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    assert_eq!(stream.frame_size(), None);
    assert!(stream.description().to_string().ends_with(": format 7scenes, 3 frames; none of them can be read"));
    assert_eq!(stream.filter(Result::is_err).count(), 3);
}

/// Scene that counts reads of frames, and fails as a format may.
#[derive(Debug)]
struct Watched {
    inner: Arc<dyn Scene>,
    read: AtomicUsize,
    panics_at: usize,
}

impl Scene for Watched {
    fn name(&self) -> &str {
        "watched"
    }
    fn frame_count(&self) -> usize {
        1000
    }
    fn frame_name(&self, index: usize) -> String {
        index.to_string()
    }
    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        self.read.fetch_add(1, Ordering::SeqCst);
        assert!(index != self.panics_at, "a defect");
        self.inner.read_recorded(0)
    }
    fn has_ground_truth(&self) -> bool {
        false
    }
    fn read_ground_truth(&self, _: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }
}

fn watched(panics_at: usize) -> Arc<Watched> {
    Arc::new(Watched {
        inner: room("synthetic:frames=1,width=16,height=12,objects=1"),
        read: AtomicUsize::new(0),
        panics_at,
    })
}

#[test]
fn few_frames_are_read_ahead_and_dropping_stops_the_reader() {
    let scene = watched(usize::MAX);
    let mut stream = FrameStream::open(scene.clone(), &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    for given in 1..20 {
        let held = stream.next().unwrap().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(5));
        // Frames returned earlier are dropped; the one held counts.
        assert!(scene.read.load(Ordering::SeqCst) - (given - 1) <= MAX_FRAMES_IN_MEMORY, "{}", held.index);
    }
    drop(stream);
    let read = scene.read.load(Ordering::SeqCst);
    assert_eq!(Arc::strong_count(&scene), 1, "the thread is gone");
    assert!(read < 30, "{read}");
}

#[test]
fn a_defect_in_a_reader_ends_the_stream_with_an_error() {
    let stream = FrameStream::open(watched(5), &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    let results: Vec<_> = stream.collect();
    assert_eq!(results.len(), 6);
    let error = results[5].as_ref().unwrap_err();
    assert!(error.index == 5 && error.to_string().contains("ended early"), "{error}");
}

#[test]
fn frames_with_more_pixels_than_are_of_use_are_reduced_like_resized_ones() {
    let scene = room("synthetic:frames=2,width=96,height=64,objects=3");
    let frames = |change: &dyn Fn(&mut DatasetSettings)| {
        let settings = DatasetSettings::default().with(change);
        let stream = FrameStream::open(Arc::clone(&scene), &settings, GroundTruth::Read).unwrap();
        let described = stream.description().to_string();
        (stream.map(Result::unwrap).collect::<Vec<_>>(), described)
    };
    // A quarter of 96x64 pixels.
    let (reduced, described) = frames(&|settings| settings.max_pixels = 1536);
    assert_eq!((reduced[0].frame.width(), reduced[0].frame.height()), (48, 32));
    assert!(described.contains("colour 96x64, used at 48x32; depth of the first frame "), "{described}");
    assert_eq!(reduced, frames(&|settings| settings.resize = "48x32".parse().ok()).0);
    let (exact, _) = frames(&|settings| settings.max_pixels = 96 * 64);
    assert_eq!(exact, frames(&|_| ()).0, "not more than the limit");
    let (larger, _) = frames(&|settings| {
        settings.max_pixels = 1536;
        settings.resize = "64x48".parse().ok();
    });
    assert_eq!(larger[0].frame.width(), 64, "a requested size is not limited");
    let full_hd = DatasetSettings::default().framing().check((1920, 1080)).unwrap();
    assert_eq!(full_hd, (1920, 1080));
}

#[test]
fn a_scene_without_any_possible_frame_is_reported_once() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 3);
    fs::write(folder.path().join("camera-intrinsics.txt"), "1e-30 0 31.5\n0 1e-30 23.5\n0 0 1\n").unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    let error = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Skip).unwrap_err().to_string();
    assert!(
        error.ends_with(
            "camera-intrinsics.txt: focal lengths: found 1e-30 and 1e-30 pixels, expected those of a camera of 64x48 \
             pixels, about 64"
        ),
        "{error}"
    );
}

#[test]
fn a_camera_off_the_earth_is_an_error_of_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 2);
    let far = pose_text(0).replace('2', "1e38");
    fs::write(folder.path().join("frame-000010.pose.txt"), far).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    let stream = FrameStream::open(scene, &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    let results: Vec<_> = stream.collect();
    assert!(results[0].is_ok());
    let error = results[1].as_ref().unwrap_err().to_string();
    assert!(
        error.contains("frame-000010.pose.txt: camera position: found (0e0, 1e38, 3e0), expected metres"),
        "{error}"
    );
}

#[test]
fn far_depth_is_removed_before_frames_are_resized() {
    let camera = Intrinsics { fx: 8.0, fy: 8.0, cx: 3.5, cy: 2.5, width: 8, height: 6 };
    let near = |column: usize, row: usize| 1.0 + (column / 2 + row / 2) as f32 * 0.1;
    let depth = Image::from_fn(8, 6, |column, row| if (column + row) % 2 == 0 { near(column, row) } else { 4.0 });
    let frame = CameraFrame::new("0", Image::filled(8, 6, [9; 3]), depth, camera).unwrap();
    let settings = DatasetSettings::default().with(|settings| {
        settings.max_depth_m = Some(4.0);
        settings.resize = "4x3".parse().ok();
    });
    let framed = settings.framing().apply(frame).unwrap();
    assert_eq!(*framed.depth(), Image::from_fn(4, 3, |column, row| near(2 * column, 2 * row)));
}

proptest! {
    #[test]
    fn masks_and_labels_take_the_same_pixels(
        (width, height) in (2usize..20, 2usize..20), (to_width, to_height) in (3usize..40, 3usize..40),
        crop_border in 0usize..2, salt in any::<u32>(),
    ) {
        let id = |column: usize, row: usize| (salt >> ((3 * column + 7 * row) % 31)) & 1;
        let labels = SegmentMap::from_fn(width, height, id);
        let framing = Framing { resize: Some(ImageSize { width: to_width, height: to_height }), crop_border, ..Framing::default() };
        let framed = framing.apply_to_labels(labels.clone()).unwrap();
        let mask = RunLengths::encode(&labels.mask_of(1));
        let (columns, rows) = framing.source_pixels((width, height)).unwrap();
        prop_assert_eq!(mask.decode_at(&columns, &rows).unwrap(), framed.mask_of(1));
    }
}

//! ScanNet's `.sens` recordings and zipped labels, whole and damaged.

use crate::support;
use crate::support::recording::*;
use crate::support::sens::{SensWriter, frame_bytes, zlib};
use crate::support::write_scannet;
use proptest::prelude::*;
use splatseg_dataset::{
    DatasetError, DatasetSettings, FrameStream, GroundTruth, LeftOut, Preset, Scene, SensScene, open_scene,
};
use splatseg_geometry::{Image, Intrinsics, RgbdFrame, SegmentMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

const ROOM: &str = "synthetic:frames=3,width=64,height=48,seed=5";
const EXACT: Tolerance = Tolerance { depth: 0.00051, color: 0.0 };
const JPEG: Tolerance = Tolerance { depth: 0.00051, color: 4.0 };

fn room() -> &'static [(RgbdFrame<'static>, SegmentMap)] {
    static ROOM_FRAMES: OnceLock<Vec<(RgbdFrame<'static>, SegmentMap)>> = OnceLock::new();
    ROOM_FRAMES.get_or_init(|| recording(ROOM))
}

fn frames() -> Vec<&'static RgbdFrame<'static>> {
    room().iter().map(|(frame, _)| frame).collect()
}

fn writer() -> SensWriter {
    SensWriter::new(*room()[0].0.intrinsics())
}

fn labels_zip(labels: &[SegmentMap]) -> Vec<u8> {
    let member = |(index, labels)| (format!("instance-filt/{index}.png"), png_label_bytes(labels));
    zip_bytes(&labels.iter().enumerate().map(member).collect::<Vec<_>>())
}

fn write_sens(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("scene0000_00.sens");
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn recordings_are_read_back_in_every_compression() {
    for (color_compression, depth_compression, tolerance) in [(0, 0, EXACT), (1, 1, EXACT), (2, 1, JPEG)] {
        let folder = tempfile::tempdir().unwrap();
        let writer = SensWriter { color_compression, depth_compression, ..writer() };
        let path = write_sens(folder.path(), &writer.recording(&frames()));
        for path in [path.as_path(), folder.path()] {
            let scene = open_scene(path, &DatasetSettings::default()).unwrap();
            assert_eq!((scene.name(), scene.frame_count()), ("scene0000_00", 3));
            for (index, written) in frames().into_iter().enumerate() {
                let read = scene.read_frame(index).unwrap();
                assert_eq!((read.name(), read.intrinsics()), (index.to_string().as_str(), written.intrinsics()));
                assert_same(&read, written, &tolerance);
            }
            assert!(!scene.has_ground_truth() && scene.read_ground_truth(0).unwrap().is_none());
            assert!(matches!(scene.read_frame(3), Err(DatasetError::NoSuchFrame { index: 3, count: 3, .. })));
            assert!(matches!(scene.read_ground_truth(3), Err(DatasetError::NoSuchFrame { .. })));
        }
    }
}

#[test]
fn labels_come_out_of_the_zip_file_or_its_unpacked_folder() {
    let folder = tempfile::tempdir().unwrap();
    write_sens(folder.path(), &writer().recording(&frames()));
    let labels: Vec<SegmentMap> = room().iter().map(|(_, labels)| labels.clone()).collect();
    fs::write(folder.path().join("scene0000_00_2d-instance-filt.zip"), labels_zip(&labels[..2])).unwrap();
    let settings = DatasetSettings::default().with(|settings| settings.stride = 2);
    let open = || open_scene(folder.path(), &settings).unwrap();
    let scene = open();
    assert!(scene.has_ground_truth());
    assert_eq!(scene.read_ground_truth(1).unwrap().as_ref(), Some(&labels[1]));
    assert_eq!(scene.read_ground_truth(2).unwrap(), None, "a frame that is not labelled");
    let streamed: Vec<_> =
        FrameStream::open(scene, &settings, GroundTruth::Read).unwrap().map(Result::unwrap).collect();
    assert_eq!(streamed.iter().map(|frame| frame.ground_truth.is_some()).collect::<Vec<_>>(), [true, false]);

    fs::remove_file(folder.path().join("scene0000_00_2d-instance-filt.zip")).unwrap();
    fs::create_dir(folder.path().join("instance-filt")).unwrap();
    fs::write(folder.path().join("instance-filt/2.png"), png_label_bytes(&labels[2])).unwrap();
    assert_eq!(open().read_ground_truth(2).unwrap().as_ref(), Some(&labels[2]));
}

#[test]
fn colour_and_labels_of_another_size_are_brought_to_the_depth_camera() {
    let folder = tempfile::tempdir().unwrap();
    let large = recording("synthetic:frames=1,width=128,height=96,seed=5");
    let (color, labels) = (large[0].0.color(), &large[0].1);
    let small = &room()[0].0;
    let writer = SensWriter { color_intrinsics: *large[0].0.intrinsics(), ..writer() };
    let mut bytes = writer.header(1);
    bytes.extend(writer.frame(
        small.world_from_camera().to_row_major().map(|number| number as f32),
        color,
        small.depth(),
    ));
    let path = write_sens(folder.path(), &bytes);
    fs::write(folder.path().join("scene0000_00_2d-instance-filt.zip"), labels_zip(std::slice::from_ref(labels)))
        .unwrap();
    let scene = SensScene::open(&path, &DatasetSettings::default()).unwrap();
    // Only one of them is low-pass filtered, so edges differ.
    assert_same(&scene.read_frame(0).unwrap(), small, &Tolerance { color: 12.0, ..JPEG });
    let read = scene.read_ground_truth(0).unwrap().unwrap();
    let same = read.pixels().iter().zip(room()[0].1.pixels()).filter(|(read, written)| read == written).count();
    assert!(same * 100 > read.pixels().len() * 95, "{same} of {}", read.pixels().len());
}

#[test]
fn the_benchmarks_preset_gives_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let many: Vec<&RgbdFrame> = std::iter::repeat_n(frames()[0], 41).collect();
    write_sens(folder.path(), &writer().recording(&many));
    let settings = Preset::ScannetMv.settings();
    let scene = open_scene(folder.path(), &settings).unwrap();
    let stream = FrameStream::open(scene, &settings, GroundTruth::Skip).unwrap();
    let frames: Vec<_> = stream.map(|frame| frame.unwrap()).collect();
    assert_eq!(frames.iter().map(|frame| frame.frame.name()).collect::<Vec<_>>(), ["0", "20", "40"]);
    assert!(frames.iter().all(|frame| (frame.frame.width(), frame.frame.height()) == (310, 230)));
}

#[test]
fn a_frame_in_which_tracking_was_lost_has_no_pose() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = writer().header(2);
    for pose in [[f32::NEG_INFINITY; 16], frames()[0].world_from_camera().to_row_major().map(|number| number as f32)] {
        bytes.extend(writer().frame(pose, frames()[0].color(), frames()[0].depth()));
    }
    let scene = SensScene::open(&write_sens(folder.path(), &bytes), &DatasetSettings::default()).unwrap();
    let lost = scene.read_recorded(0).unwrap();
    assert_eq!((lost.world_from_camera, lost.frame.timestamp()), (None, Some(Duration::from_micros(11))));
    assert_eq!(scene.read_frame(0).unwrap_err().to_string(), "scene0000_00: frame 0 has no pose");
    let what = "whose pose is NaN or infinite: tracking was lost".to_owned();
    assert_eq!((scene.has_poses(), scene.without_pose()), (true, &[LeftOut { count: 1, what }][..]));
    // The writer sets 11 microseconds.
    assert_eq!(scene.read_frame(1).unwrap().timestamp(), Some(Duration::from_micros(11)));
}

#[test]
fn times_may_start_at_zero() {
    let folder = tempfile::tempdir().unwrap();
    let start = writer().header(0).len();
    let frame = writer().recording(&frames()[..1]).len() - start - 8;
    for (times, expected) in [([0, 33_000], [Some(0), Some(33_000)]), ([0, 0], [None, None]), ([7, 0], [Some(7), None])]
    {
        // Frames of one size.
        let mut bytes = writer().recording(&[frames()[0]; 2]);
        for (index, time) in times.into_iter().enumerate() {
            let at = start + index * frame + 64;
            bytes[at..at + 8].copy_from_slice(&u64::to_le_bytes(time));
        }
        let scene = SensScene::open(&write_sens(folder.path(), &bytes), &DatasetSettings::default()).unwrap();
        let time = |index| scene.read_frame(index).unwrap().timestamp();
        assert_eq!([time(0), time(1)], expected.map(|time| time.map(Duration::from_micros)));
    }
}

#[test]
fn folders_with_several_recordings_or_none_are_distinguished() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["b.sens", "a.SENS"] {
        fs::write(folder.path().join(name), writer().recording(&frames())).unwrap();
    }
    let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err();
    assert!(error.to_string().ends_with("holds several sequences, pick one of a.SENS, b.sens"), "{error}");
    assert!(open_scene(folder.path().join("a.SENS"), &DatasetSettings::default()).is_ok());
    assert!(matches!(
        SensScene::open(&folder.path().join("c.sens"), &DatasetSettings::default()),
        Err(DatasetError::NotFound { .. })
    ));
    fs::write(folder.path().join("c.sens"), writer().header(0)).unwrap();
    assert!(matches!(
        SensScene::open(&folder.path().join("c.sens"), &DatasetSettings::default()),
        Err(DatasetError::NoFrames { .. })
    ));
}

fn opening_fails(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let error =
        SensScene::open(&write_sens(folder.path(), bytes), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.contains("scene0000_00.sens: "), "the file is named: {error}");
    error
}

#[test]
fn a_recording_that_is_cut_off_gives_the_frames_that_are_whole() {
    let one = writer().recording(&frames()[..1]).len() - 8;
    let whole = writer().recording(&frames()[..2]);
    let needed = whole.len() - 8; // The number of accelerometer measurements is not needed.
    for keep in (0..one).step_by(97).chain([one - 2]) {
        let error = opening_fails(&whole[..keep]);
        assert!(error.contains("cut off"), "{keep}: {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    for keep in (one..needed).step_by(97).chain([needed - 1]) {
        let scene = SensScene::open(&write_sens(folder.path(), &whole[..keep]), &DatasetSettings::default()).unwrap();
        assert_eq!((scene.frame_count(), scene.read_frame(0).is_ok()), (1, true));
        let what = "after frame 0, where the recording is cut off".to_owned();
        assert_eq!(scene.left_out(), [LeftOut { count: 1, what }]);
    }
    let scene = SensScene::open(&write_sens(folder.path(), &whole[..needed]), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.left_out().len()), (2, 0));
}

#[cfg(unix)]
#[test]
fn paths_that_are_not_utf8_are_read() {
    use std::os::unix::ffi::OsStringExt;
    let folder = tempfile::tempdir().unwrap();
    let name = |ending: &str| std::ffi::OsString::from_vec([b"sc\xFFne", ending.as_bytes()].concat());
    fs::write(folder.path().join(name(".sens")), writer().recording(&frames())).unwrap();
    let labels: Vec<SegmentMap> = room().iter().map(|(_, labels)| labels.clone()).collect();
    fs::write(folder.path().join(name("_2d-instance-filt.zip")), labels_zip(&labels)).unwrap();
    for path in [folder.path().to_owned(), folder.path().join(name(".sens"))] {
        let scene = open_scene(path, &DatasetSettings::default()).unwrap();
        assert!(scene.frame_count() == 3 && scene.has_ground_truth());
    }
}

#[test]
fn unsupported_headers_are_reported() {
    let write = |change: fn(&mut SensWriter)| {
        let mut writer = writer();
        change(&mut writer);
        let frame = frames()[0];
        let mut bytes = writer.header(1);
        bytes.extend(SensWriter::new(*frame.intrinsics()).frame([0.0; 16], frame.color(), frame.depth()));
        opening_fails(&bytes)
    };
    assert!(write(|writer| writer.version = 3).contains("version: found 3, expected 4"));
    assert!(write(|writer| writer.color_compression = -1).contains("colour compression: found -1"));
    assert!(
        write(|writer| writer.depth_compression = 2)
            .contains("depth compression: found 2, expected 0 (raw) or 1 (zlib)")
    );
    assert!(write(|writer| writer.depth_shift = 0.0).contains("depth shift: found 0"));
    assert!(write(|writer| writer.depth_shift = f32::NAN).contains("depth shift: found NaN"));
    assert!(write(|writer| writer.depth_intrinsics.width = 0).contains("depth size: found 0x48"));
    assert!(write(|writer| writer.color_intrinsics.width = 1 << 31).contains("colour size: found 2147483648x48"));
    assert!(write(|writer| writer.color_intrinsics.fx = -1.0).contains("focal lengths must be positive"));
    assert!(opening_fails(b"This is a text, and a rather long one at that.").contains("version: found 1936287828"));
}

#[test]
fn sizes_that_lie_take_no_memory() {
    // The number of frames and the length of the sensor's name.
    assert!(opening_fails(&writer().header(u64::MAX)).contains("frame 0 would end at"));
    let mut bytes = writer().recording(&frames());
    bytes[4..12].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(opening_fails(&bytes).contains("the sensor's name of 18446744073709551615 bytes"));
    // The sizes of a frame's data.
    let frame_start = writer().header(0).len();
    for (at, bytes_of) in [(80, "colour"), (88, "depth")] {
        for (size, message) in [(u64::MAX, "at most 268435456"), (200 << 20, "would end at byte")] {
            let mut bytes = writer().recording(&frames());
            bytes[frame_start + at..frame_start + at + 8].copy_from_slice(&u64::to_le_bytes(size));
            let error = opening_fails(&bytes);
            assert!(error.contains("frame 0") && error.contains(message), "{bytes_of}: {error}");
        }
    }
}

fn reading_fails(writer: &SensWriter, color: &[u8], depth: &[u8]) -> DatasetError {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = writer.header(1);
    bytes.extend(frame_bytes(glam::Mat4::IDENTITY.to_cols_array(), color, depth));
    let scene = SensScene::open(&write_sens(folder.path(), &bytes), &DatasetSettings::default()).unwrap();
    let error = scene.read_frame(0).unwrap_err();
    assert!(error.to_string().contains("scene0000_00.sens: frame 0: "), "{error}");
    error
}

#[test]
fn damaged_frames_are_reported() {
    let color = jpeg_bytes(frames()[0].color());
    let pixels = 64 * 48;
    let depth = zlib(&vec![1; 2 * pixels]);
    for (bytes, message) in [
        (zlib(&vec![1; 2 * pixels - 1]), "found 6143 bytes, expected 6144"),
        (zlib(&vec![1; 2 * pixels + 1]), "found more than 6144 bytes, expected 6144"),
        (zlib(&vec![0; 100 << 20]), "found more than 6144 bytes"), // A bomb is left after the first byte too many.
        (b"no zlib data here".to_vec(), "damaged zlib data"),
        (depth[..depth.len() / 2].to_vec(), "damaged zlib data"),
        (Vec::new(), "its 0 bytes can hold"),
    ] {
        let error = reading_fails(&writer(), &color, &bytes).to_string();
        assert!(error.contains("depth image") && error.contains(message), "{error}");
    }
    assert!(matches!(reading_fails(&writer(), &color[..color.len() / 2], &depth), DatasetError::CutOff { .. }));
    assert!(matches!(reading_fails(&writer(), b"no image", &depth), DatasetError::Image { .. }));
    let other = jpeg_bytes(&Image::filled(32, 24, [9; 3]));
    assert!(matches!(reading_fails(&writer(), &other, &depth), DatasetError::SizesDiffer { found: (32, 24), .. }));
    let raw = SensWriter { color_compression: 0, depth_compression: 0, ..writer() };
    let error = reading_fails(&raw, &[0; 10], &vec![0; 2 * pixels]).to_string();
    assert!(error.contains("colour image: found 10 bytes, expected 9216"), "{error}");
    // A huge stated depth image cannot fit in a few bytes.
    let huge = Intrinsics { width: 8192, height: 8192, ..*frames()[0].intrinsics() };
    let writer = SensWriter { depth_intrinsics: huge, ..writer() };
    assert!(matches!(reading_fails(&writer, &color, &depth), DatasetError::ImplausibleSize { width: 8192, .. }));
}

#[test]
fn damaged_zip_files_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sens(folder.path(), &writer().recording(&frames()));
    let zip = folder.path().join("scene0000_00_2d-instance-filt.zip");
    let labels: Vec<SegmentMap> = room().iter().map(|(_, labels)| labels.clone()).collect();
    let whole = labels_zip(&labels);
    for keep in (0..whole.len()).step_by(41) {
        fs::write(&zip, &whole[..keep]).unwrap();
        let error = SensScene::open(&path, &DatasetSettings::default()).unwrap_err();
        assert!(matches!(error, DatasetError::Archive { .. }), "{keep}: {error}");
    }
    // A decompression bomb, unpacked only up to the maximum image size.
    let bomb = zip_bytes(&[("instance-filt/0.png".to_owned(), vec![0; 64 << 20])]);
    fs::write(&zip, bomb).unwrap();
    let error = SensScene::open(&path, &DatasetSettings::default()).unwrap().read_ground_truth(0).unwrap_err();
    assert!(matches!(error, DatasetError::FileTooBig { limit: 33_554_432, .. }), "{error}");
    assert!(error.to_string().contains("filt.zip/instance-filt/0.png: "), "{error}");
    // A member with damaged data.
    let mut bytes = whole.clone();
    bytes[70] ^= 0xFF;
    fs::write(&zip, bytes).unwrap();
    let scene = SensScene::open(&path, &DatasetSettings::default()).unwrap();
    assert!(scene.read_ground_truth(0).is_err());
    assert!(scene.read_ground_truth(1).unwrap().is_some(), "the others can still be read");
    // A directory whose 64-bit counts claim more than there is.
    let mut bytes = whole[..whole.len() - 22].to_vec();
    bytes.extend(*b"PK\x06\x06");
    bytes.extend([0xFF; 52]);
    bytes.extend(*b"PK\x06\x07");
    bytes.extend([0; 16]);
    bytes.extend(&whole[whole.len() - 22..]);
    fs::write(&zip, bytes).unwrap();
    assert!(SensScene::open(&path, &DatasetSettings::default()).unwrap_err().to_string().contains("zip64"));
}

#[test]
fn exported_scenes_take_the_zip_file_too() {
    let folder = tempfile::tempdir().unwrap();
    let sizes = support::ScannetSizes { color: (64, 48), depth: (64, 48), labels: (64, 48) };
    write_scannet(folder.path(), 2, &sizes);
    fs::remove_dir_all(folder.path().join("instance-filt")).unwrap();
    let labels: Vec<SegmentMap> = room().iter().map(|(_, labels)| labels.clone()).collect();
    fs::write(folder.path().join("scene0707_00_2d-instance-filt.zip"), labels_zip(&labels[..1])).unwrap();
    let open = || open_scene(folder.path(), &DatasetSettings::default());
    let scene = open().unwrap();
    assert!(scene.has_ground_truth());
    assert_eq!(scene.read_ground_truth(0).unwrap().as_ref(), Some(&labels[0]));
    assert_eq!(scene.read_ground_truth(1).unwrap(), None);
    fs::write(folder.path().join("scene0708_00_2d-instance-filt.zip"), labels_zip(&labels[..1])).unwrap();
    let error = open().unwrap_err().to_string();
    assert!(error.contains("scene0707_00_2d-instance-filt.zip, scene0708_00"), "{error}");
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_sens(folder.path(), &writer().recording(&frames()));
    let labels: Vec<SegmentMap> = room().iter().map(|(_, labels)| labels.clone()).collect();
    fs::write(folder.path().join("scene0000_00_2d-instance-filt.zip"), labels_zip(&labels)).unwrap();
    support::assert_special_files_are_refused(folder.path(), &path);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn damaged_recordings_never_panic(
        raw in any::<bool>(),
        // Sizes and counts are in the header and at the frames' starts, so most changes go there.
        header_changes in prop::collection::vec((0usize..420, any::<u8>()), 0..4),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in any::<prop::sample::Index>(),
    ) {
        let (color_compression, depth_compression) = if raw { (0, 0) } else { (2, 1) };
        let mut bytes = SensWriter { color_compression, depth_compression, ..writer() }.recording(&frames()[..2]);
        for (at, value) in header_changes {
            bytes[at] = value;
        }
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        bytes.truncate(keep.index(3 * bytes.len()));
        let folder = tempfile::tempdir().unwrap();
        let path = write_sens(folder.path(), &bytes);
        fs::write(folder.path().join("scene0000_00_2d-instance-filt.zip"), labels_zip(&[room()[0].1.clone()])).unwrap();
        if let Ok(scene) = SensScene::open(&path, &DatasetSettings::default()) {
            for index in 0..scene.frame_count().min(3) {
                let _ = scene.read_frame(index);
                let _ = scene.read_ground_truth(index);
            }
        }
    }

    #[test]
    fn damaged_zip_directories_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        from_end in prop::collection::vec((0usize..300, any::<u8>()), 0..6),
    ) {
        let mut bytes = labels_zip(&[room()[0].1.clone(), room()[1].1.clone()]);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        for (at, value) in from_end {
            let at = bytes.len() - 1 - at;
            bytes[at] = value;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = write_sens(folder.path(), &writer().recording(&frames()[..1]));
        fs::write(folder.path().join("scene0000_00_2d-instance-filt.zip"), bytes).unwrap();
        if let Ok(scene) = SensScene::open(&path, &DatasetSettings::default()) {
            let _ = scene.read_ground_truth(0);
        }
    }
}

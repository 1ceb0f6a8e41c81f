//! MVPd videos in folders and archives, whole and damaged.

use crate::support;
use crate::support::mvpd::*;
use crate::support::recording::*;
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use serde_json::{Value, json};
use splatseg_dataset::{DatasetError, DatasetSettings, MvpdScene, MvpdVideos, Scene, open_scene};
use std::fs;
use std::path::Path;
use std::sync::{Arc, OnceLock};

const JPEG: Tolerance = Tolerance { depth: 0.00051, color: 4.0 };

fn open(path: impl AsRef<Path>) -> Result<Arc<dyn Scene>, DatasetError> {
    open_scene(path, &DatasetSettings::default())
}

fn assert_is_the_room(scene: &dyn Scene, name: &str) {
    assert_eq!((scene.name(), scene.frame_count(), scene.frame_name(1)), (name, 2, "0000000001".to_owned()));
    for (index, (written, labels)) in room().iter().enumerate() {
        let read = scene.read_frame(index).unwrap();
        assert_same(&read, written, &JPEG);
        assert!((read.intrinsics().fx - 46.560_29).abs() < 1e-4, "465.6029 for 640 pixels; these images have 64");
        assert_eq!(scene.read_ground_truth(index).unwrap().as_ref(), Some(labels));
    }
    assert!(scene.has_ground_truth());
    assert!(matches!(scene.read_frame(2), Err(DatasetError::NoSuchFrame { .. })));
}

#[test]
fn the_only_video_of_a_folder_needs_no_name() {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST], &panoptic(&[FIRST]));
    assert_is_the_room(open(folder.path()).unwrap().as_ref(), FIRST);
}

#[test]
fn one_of_several_videos_is_chosen_by_colon_or_by_folder() {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST, SECOND], &panoptic(&[FIRST, SECOND]));
    let root = folder.path().display();
    assert_is_the_room(open(format!("{root}:{SECOND}")).unwrap().as_ref(), SECOND);
    assert_is_the_room(open(format!("{root}/imagesRGB/{SECOND}/")).unwrap().as_ref(), SECOND);
    let error = open(folder.path()).unwrap_err().to_string();
    let message = format!(
        "{root}: holds several videos ({FIRST}, {SECOND}): choose one by adding its name to the path, e.g. {root}:{FIRST}"
    );
    assert_eq!(error, message);
    let error = open(format!("{root}:other")).unwrap_err().to_string();
    assert_eq!(error, format!("{root}: there is no video \"other\"; the first are {FIRST}, {SECOND}"));
    assert!(matches!(open(format!("{root}/nowhere:{FIRST}")), Err(DatasetError::NotFound { .. })));
    assert!(matches!(open(format!("{root}:")), Err(DatasetError::NotFound { .. })));
    let many: Vec<String> = (0..9).map(|index| format!("video-{index}")).collect();
    let names: Vec<&str> = many.iter().map(String::as_str).collect();
    fs::write(folder.path().join("panoptic_val.json"), panoptic(&names).to_string()).unwrap();
    assert!(
        open(folder.path()).unwrap_err().to_string().contains("(video-0, video-1, video-2, video-3, video-4, ...)")
    );
}

#[test]
fn archives_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("00800-TEEsavR23oF.tar.gz");
    for prefix in ["00800-TEEsavR23oF/", "./00800-TEEsavR23oF/", "./", ""] {
        for annotations_first in [true, false] {
            fs::write(&path, archive(&[FIRST], prefix, annotations_first)).unwrap();
            assert_is_the_room(open(&path).unwrap().as_ref(), FIRST);
        }
    }
    // Names longer than the 100 bytes of a plain header.
    fs::write(&path, archive(&[FIRST], &format!("{}/", "long".repeat(40)), true)).unwrap();
    assert_is_the_room(open(&path).unwrap().as_ref(), FIRST);
    fs::write(&path, archive(&[FIRST, SECOND], "00800/", false)).unwrap();
    assert_is_the_room(open(format!("{}:{SECOND}", path.display())).unwrap().as_ref(), SECOND);
    assert!(matches!(open(&path), Err(DatasetError::SeveralVideos { .. })));
    assert!(matches!(open(format!("{}:{SECOND}0", path.display())), Err(DatasetError::NoSuchVideo { .. })));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is unpacked beside the archive");
}

#[test]
fn all_videos_of_a_split_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(MvpdVideos::find(folder.path()).unwrap().videos, []);
    // The published folders are splits containing scene archives, until the authors' script unpacks them.
    let test = folder.path().join("test");
    fs::create_dir_all(folder.path().join("train")).unwrap();
    fs::create_dir_all(&test).unwrap();
    fs::write(test.join("00800-TEEsavR23oF.tar.gz"), archive(&[FIRST, SECOND], "00800-TEEsavR23oF/", false)).unwrap();
    fs::write(test.join("00801-other.tar.gz"), archive(&["other"], "00801-other/", true)).unwrap();
    let archives = MvpdVideos::find(folder.path()).unwrap();
    assert_eq!((archives.rejected, &archives.split), (None, &test));
    let names = |found: &MvpdVideos| found.videos.iter().map(|video| video.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&archives), [FIRST, SECOND, "other"]);
    for video in &archives.videos {
        let scene = open(&video.path).unwrap();
        assert_eq!((scene.name(), scene.frame_count()), (video.name.as_str(), video.frames));
    }
    // Unpacked, with the authors' list.
    for archive in ["00800-TEEsavR23oF.tar.gz", "00801-other.tar.gz"] {
        fs::remove_file(test.join(archive)).unwrap();
    }
    write_split(&test, &[FIRST, SECOND], &panoptic(&[FIRST, SECOND]));
    fs::write(test.join("empty_videos.json"), json!({"accepted": [SECOND], "rejected": [FIRST]}).to_string()).unwrap();
    let accepted = MvpdVideos::find(folder.path()).unwrap();
    assert_eq!((names(&accepted), accepted.rejected), (vec![SECOND.to_owned()], Some(1)));
    assert_eq!(MvpdVideos::find(&test).unwrap(), accepted);
    assert_is_the_room(open(&accepted.videos[0].path).unwrap().as_ref(), SECOND);

    for (name, text, expected) in [
        ("empty_videos.json", "{\"accepted\": 3}", "empty_videos.json"),
        ("panoptic_val.json", "{\"videos\": [{\"images\": []}]}", "neither `video_name` nor `video_id`"),
        ("panoptic_val.json", "{\"annotations\": []}", "a video in \"videos\""),
        ("panoptic_val.json", "{\"videos\": [", "panoptic_val.json"),
    ] {
        let path = test.join(name);
        let good = fs::read(&path).unwrap();
        fs::write(&path, text).unwrap();
        let error = MvpdVideos::find(&test).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}: {error}");
        fs::write(&path, good).unwrap();
    }
}

#[test]
fn blenders_camera_looks_along_its_negative_z() {
    let folder = tempfile::tempdir().unwrap();
    let mut content = panoptic(&[FIRST]);
    content["videos"][0]["images"][0]["camera_rotation"] = json!([2.0, 0.0, 0.0, 0.0]);
    content["videos"][0]["images"][0]["camera_position"] = json!([1.0, 2.0, 3.0]);
    // A quarter turn to the left about the vertical, y.
    content["videos"][0]["images"][1]["camera_rotation"] = json!([0.5f64.sqrt(), 0.0, 0.5f64.sqrt(), 0.0]);
    content["videos"][0]["images"][1]["camera_position"] = json!([0.0, 0.0, 0.0]);
    write_split(folder.path(), &[FIRST], &content);
    let scene = open(folder.path()).unwrap();
    let pose = |index: usize| *scene.read_frame(index).unwrap().world_from_camera();
    assert_eq!(pose(0).to_world(Vec3::new(0.0, 0.0, 5.0)), DVec3::new(1.0, 2.0, -2.0), "5 m ahead");
    assert_eq!(pose(0).to_world(Vec3::new(0.0, 1.0, 0.0)), DVec3::new(1.0, 1.0, 3.0), "1 m down");
    assert!((pose(1).to_world(Vec3::Z) - DVec3::NEG_X).length() < 1e-12, "left of -z is -x");
}

#[test]
fn the_format_pages_keys_and_the_minimised_annotations_are_read_too() {
    let folder = tempfile::tempdir().unwrap();
    let mut content = panoptic(&[FIRST]);
    for list in ["videos", "annotations"] {
        content[list][0]["video_id"] = content[list][0]["video_name"].take();
    }
    write_split(folder.path(), &[FIRST], &content);
    assert_is_the_room(open(folder.path()).unwrap().as_ref(), FIRST);

    let mut content = panoptic(&[FIRST]);
    for image in content["videos"][0]["images"].as_array_mut().unwrap() {
        for key in ["id", "width", "height", "scene_id", "depth_file_name"] {
            image.as_object_mut().unwrap().remove(key);
        }
    }
    for annotation in content["annotations"][0]["annotations"].as_array_mut().unwrap() {
        annotation.as_object_mut().unwrap().remove("segments_info");
    }
    write_split(folder.path(), &[FIRST], &content);
    let scene = open(folder.path()).unwrap();
    assert_same(&scene.read_frame(0).unwrap(), &room()[0].0, &JPEG);
    let stored = room()[0].1.map(|id| id + PANOPTIC_OFFSET);
    assert_eq!(scene.read_ground_truth(0).unwrap(), Some(stored), "the ids of the mask");
}

#[test]
fn crowds_are_not_instances_and_ids_without_a_segment_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let mut content = panoptic(&[FIRST]);
    let info = |content: &mut Value| content["annotations"][0]["annotations"][0]["segments_info"][0].take();
    let mut crowd = info(&mut content.clone());
    let id = crowd["instance_id"].as_u64().unwrap() as u32;
    crowd["iscrowd"] = json!(1);
    content["annotations"][0]["annotations"][0]["segments_info"][0] = crowd;
    write_split(folder.path(), &[FIRST], &content);
    let expected = room()[0].1.map(|label| if *label == id { 0 } else { *label });
    assert_eq!(open(folder.path()).unwrap().read_ground_truth(0).unwrap(), Some(expected));
    content["annotations"][0]["annotations"][0]["segments_info"].as_array_mut().unwrap().remove(0);
    write_split(folder.path(), &[FIRST], &content);
    let error = open(folder.path()).unwrap().read_ground_truth(0).unwrap_err().to_string();
    assert!(error.contains("0000000000.png: id: found") && error.contains("segments_info"), "{error}");
}

#[test]
fn videos_without_labels_have_no_ground_truth() {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST], &panoptic(&[FIRST]));
    fs::remove_dir_all(folder.path().join("panomasksRGB")).unwrap();
    let scene = open(folder.path()).unwrap();
    assert!(!scene.has_ground_truth() && scene.read_ground_truth(0).unwrap().is_none());
    let mut content = panoptic(&[FIRST]);
    content["annotations"] = json!([]);
    write_split(folder.path(), &[FIRST], &content);
    assert!(!open(folder.path()).unwrap().has_ground_truth());
}

fn opening_fails(content: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST], &json!({}));
    fs::write(folder.path().join("panoptic_val.json"), content).unwrap();
    let error = open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("panoptic_val.json: "), "the file is named: {error}");
    error
}

#[test]
fn damaged_annotations_are_reported() {
    let whole = panoptic(&[FIRST]).to_string();
    for keep in (0..whole.len()).step_by(37) {
        assert!(opening_fails(&whole[..keep]).contains("EOF"), "{keep}");
    }
    assert!(opening_fails("[]").contains("expected an object with \"videos\""));
    assert!(opening_fails("{}").contains("no frames"));
    assert!(opening_fails("{\"videos\": [{\"images\": []}]}").contains("neither `video_name` nor `video_id`"));
    assert!(opening_fails(&"[".repeat(100_000)).contains("invalid type"));
    assert!(opening_fails(&format!("{{\"other\": {}", "[".repeat(100_000))).contains("EOF"));
    let change = |path: &str, value: Value| {
        let mut content = panoptic(&[FIRST]);
        *content.pointer_mut(path).unwrap() = value;
        opening_fails(&content.to_string())
    };
    assert!(change("/videos/0/images", json!([])).contains("no frames"));
    assert!(change("/videos/0/images/0/camera_rotation", json!([1, 0, 0])).contains("invalid length 3"));
    assert!(change("/annotations/0/annotations/0/segments_info/0/id", json!(-1)).contains("-1"));
    for (path, name) in [
        ("/videos/0/video_name", ".."),
        ("/videos/0/images/1/file_name", "../0.jpg"),
        ("/videos/0/images/1/depth_file_name", "/etc/passwd"),
        ("/annotations/0/annotations/1/file_name", "a\\b.png"),
        ("/videos/0/images/1/file_name", ""),
    ] {
        assert!(change(path, json!(name)).contains("expected a name without folders"), "{name}");
    }
    assert!(change("/videos/0/images/1/file_name", json!("0000000000.jpg")).contains("expected each image once"));
    let error = {
        let folder = tempfile::tempdir().unwrap();
        let mut content = panoptic(&[FIRST]);
        content["videos"][0]["images"][0]["camera_rotation"] = json!([0, 0, 0, 0]);
        write_split(folder.path(), &[FIRST], &content);
        open(folder.path()).unwrap().read_frame(0).unwrap_err().to_string()
    };
    assert!(error.contains("the pose's quaternion has length zero"), "{error}");
}

#[test]
fn two_files_of_annotations_are_one_too_many() {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST], &panoptic(&[FIRST]));
    fs::write(folder.path().join("panoptic.json"), "{}").unwrap();
    let error = open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("found panoptic.json, panoptic_val.json"), "{error}");
}

#[test]
fn damaged_archives_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.tar.gz");
    let whole = archive(&[FIRST], "scene/", true);
    for keep in (0..whole.len() - 200).step_by(211) {
        fs::write(&path, &whole[..keep]).unwrap();
        let error = open(&path).and_then(|scene| scene.read_ground_truth(1)).unwrap_err();
        assert!(error.to_string().contains("scene.tar.gz"), "{keep}: {error}");
    }
    fs::write(&path, tar_gz_bytes(&[("scene/notes.txt".to_owned(), b"hello".to_vec())])).unwrap();
    let error = open(&path).unwrap_err().to_string();
    assert!(error.ends_with("scene.tar.gz/panoptic.json: the file of annotations is missing"), "{error}");
    // An image missing from the archive is an error of its frame.
    let mut members = files(&[FIRST]);
    members.retain(|(name, _)| !name.starts_with("imagesDEPTH") || name.ends_with("1.png"));
    members.push(("panoptic.json".to_owned(), panoptic(&[FIRST]).to_string().into_bytes()));
    fs::write(&path, tar_gz_bytes(&members)).unwrap();
    let scene = open(&path).unwrap();
    assert!(matches!(scene.read_frame(0), Err(DatasetError::MissingFile { .. })));
    assert!(scene.read_frame(1).is_ok());
}

#[test]
fn bombs_are_not_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.tar.gz");
    let zeros = vec![0; 96 << 20];
    let spaces = vec![b' '; 96 << 20];
    let names = ["scene/other.bin", "scene/panoptic.json", &format!("scene/imagesRGB/{FIRST}/0000000000.jpg")];
    for (name, content) in names.into_iter().zip([&zeros, &spaces, &zeros]) {
        let mut members = vec![(name.to_owned(), content.clone())];
        members.push(("scene/panoptic.json".to_owned(), panoptic(&[FIRST]).to_string().into_bytes()));
        fs::write(&path, tar_gz_bytes(&members)).unwrap();
        let error = open(&path).unwrap_err().to_string();
        assert!(error.contains("it unpacks to more than 64 times its size"), "{name}: {error}");
    }
}

/// Returns a tar archive of one member whose header states another size or kind than it has.
fn lying_member(size: u64, kind: tar::EntryType) -> Vec<u8> {
    let mut header = tar::Header::new_gnu();
    header.set_path("scene/panoptic.json").unwrap();
    header.set_size(size);
    header.set_entry_type(kind);
    header.set_cksum();
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut encoder, header.as_bytes()).unwrap();
    std::io::Write::write_all(&mut encoder, &[b'x'; 2048]).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn members_that_lie_about_their_size_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.tar.gz");
    for size in [4096, 1 << 33, u64::MAX / 2] {
        for kind in [tar::EntryType::Regular, tar::EntryType::GNULongName, tar::EntryType::XHeader] {
            fs::write(&path, lying_member(size, kind)).unwrap();
            assert!(open(&path).unwrap_err().to_string().contains("scene.tar.gz"), "{size}");
        }
    }
}

#[test]
fn a_video_without_any_depth_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST], &panoptic(&[FIRST]));
    fs::remove_dir_all(folder.path().join("imagesDEPTH")).unwrap();
    let error = open(folder.path()).unwrap_err().to_string();
    let expected = format!("imagesDEPTH/{FIRST}: no frames: looked for the depth images that the annotations name");
    assert!(error.ends_with(&expected), "{error}");
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    write_split(folder.path(), &[FIRST], &panoptic(&[FIRST]));
    support::assert_special_files_are_refused(folder.path(), folder.path());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("00800-TEEsavR23oF.tar.gz");
    fs::write(&path, archive(&[FIRST], "", true)).unwrap();
    support::assert_special_files_are_refused(folder.path(), &path);
}

#[cfg(unix)]
#[test]
fn paths_that_are_not_utf8_are_read() {
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(std::ffi::OsString::from_vec(b"sc\xFFne.tar.gz".to_vec()));
    fs::write(&path, archive(&[FIRST, SECOND], "", true)).unwrap();
    let chosen = [path.as_os_str().as_bytes(), b":", SECOND.as_bytes()].concat();
    assert_is_the_room(open(Path::new(std::ffi::OsStr::from_bytes(&chosen))).unwrap().as_ref(), SECOND);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn damaged_archives_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        static MEMBERS: OnceLock<Vec<u8>> = OnceLock::new();
        // Damage the tar inside rather than the compressed data, whose checks would detect it first.
        let tar = MEMBERS.get_or_init(|| {
            let bytes = archive(&[FIRST], "scene/", true);
            let mut tar = Vec::new();
            std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(bytes.as_slice()), &mut tar).unwrap();
            tar
        });
        let mut bytes = tar.clone();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut encoder, &bytes).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.tar.gz");
        fs::write(&path, encoder.finish().unwrap()).unwrap();
        if let Ok(scene) = MvpdScene::open(&path, &DatasetSettings::default()) {
            let _ = scene.read_frame(0);
            let _ = scene.read_ground_truth(1);
        }
    }
}

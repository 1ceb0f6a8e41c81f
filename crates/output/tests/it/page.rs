//! Contents of the page's files, for any names of frames.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use splatseg_geometry::{FrameAnchor, Image, Intrinsics, Pose};
use splatseg_objects::{ObjectList, ObjectLog, RemapLog};
use splatseg_odometry::PoseState;
use splatseg_output::{FrameRecord, OutputError, Page, ResultFolder, RunEnd, RunOutput, segment_color};
use splatseg_test_scenes::wall;
use splatseg_tracking::FrameOutput;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

const CAMERA: Intrinsics = Intrinsics { fx: 3.0, fy: 3.0, cx: 1.5, cy: 1.0, width: 4, height: 3 };

/// Results in memory: texts, and pictures.
#[derive(Default)]
struct Files(BTreeMap<String, String>, BTreeMap<String, Vec<u8>>);

impl ResultFolder for Files {
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError> {
        if file.ends_with(".jpg") {
            self.1.insert(file.to_owned(), bytes.to_vec());
        } else {
            self.0.insert(file.to_owned(), String::from_utf8(bytes.to_vec()).unwrap());
        }
        Ok(())
    }

    fn remove(&mut self, file: &str) -> Result<(), OutputError> {
        self.0.remove(file);
        Ok(())
    }

    fn path_of(&self, file: &str) -> PathBuf {
        PathBuf::from(file)
    }
}

/// The page of a camera that moves along x. Object 7 is seen in every frame, object 9 in every third.
fn page(frames: usize, scene: &str, name: impl Fn(usize) -> String) -> Files {
    let (mut files, mut page, mut log) = (Files::default(), Page::new(), ObjectLog::default());
    for number in 0..frames {
        let segments = Image::from_fn(4, 3, |column, _| if column == 0 && number % 3 == 0 { 9 } else { 7 });
        let camera = Intrinsics { fx: if number < 2 { 3.0 } else { 4.0 }, ..CAMERA };
        let pose = Pose::from_translation(DVec3::new(number as f64, 0.5, 0.0));
        // The third frame has no timestamp.
        let stamp = (number != 2).then(|| Duration::from_millis(100 * number as u64));
        let frame = wall("0", camera, 1.0, pose).with_timestamp(stamp);
        let objects = log.record(&FrameOutput::from_segments(segments.clone()));
        let record = FrameRecord {
            number,
            index: number,
            pose_state: PoseState::Given,
            file_name: name(number),
            frame,
            segments,
            regions: None,
            objects,
            anchor: FrameAnchor::default(),
            remapped: Vec::new(),
        };
        page.add_frame(&record, &mut files).unwrap();
    }
    let objects = ObjectList::new(&log, None);
    let remaps = RemapLog::default();
    let end = RunEnd {
        scene,
        objects: &objects,
        map: None,
        plan: None,
        pose_corrections: &[],
        remaps: &remaps,
        changes: None,
    };
    page.finish(&end, &mut files).unwrap();
    files
}

/// Parses the page's data.
fn run(files: &Files) -> Value {
    let script = &files.0["viewer/run.js"];
    serde_json::from_str(script.strip_prefix("var splatsegRun=").unwrap().strip_suffix(";\n").unwrap()).unwrap()
}

#[test]
fn frames_are_in_files_of_64() {
    let files = page(130, "room", |number| number.to_string());
    let names: Vec<&String> = files.0.keys().collect();
    let viewer = ["frames-000.js", "frames-001.js", "frames-002.js", "run.js", "viewer.js"];
    let expected: Vec<String> =
        ["index.html".to_owned()].into_iter().chain(viewer.map(|name| format!("viewer/{name}"))).collect();
    assert_eq!(names, expected.iter().collect::<Vec<_>>());
    assert_eq!(files.1.len(), 130);
    let picture = image::load_from_memory(&files.1["pictures/129.jpg"]).unwrap();
    assert_eq!((picture.width(), picture.height()), (4, 3));
    for (chunk, count) in [(0, 64), (1, 64), (2, 2)] {
        let script = &files.0[&format!("viewer/frames-{chunk:03}.js")];
        let start = format!("splatsegFrames({chunk},");
        let frames: Value =
            serde_json::from_str(script.strip_prefix(&start).unwrap().strip_suffix(");\n").unwrap()).unwrap();
        assert_eq!(frames.as_array().unwrap().len(), count);
        // No pixel as above, one of id 9, none as above, three of id 7, the other two rows as above.
        let ids = STANDARD.encode([0, 1, 9, 0, 3, 7, 8]);
        assert_eq!(frames[(3 - chunk * 64 % 3) % 3], json!([4, 3, ids]));
    }
}

#[test]
fn the_data_say_where_objects_and_cameras_were() {
    let run = run(&page(5, "room", |number| format!("frame {number}")));
    assert_eq!((&run["scene"], &run["frames"][4], &run["map"]), (&json!("room"), &json!("frame 4"), &Value::Null));
    assert_eq!(run["stamps"], json!([0.0, 0.1, null, 0.3, 0.4]));
    let cameras: Vec<(&Value, &Value)> =
        run["cameras"].as_array().unwrap().iter().map(|camera| (&camera["from"], &camera["fx"])).collect();
    assert_eq!(cameras, [(&json!(0), &json!(3.0)), (&json!(2), &json!(4.0))]);
    let poses = STANDARD.decode(run["poses"].as_str().unwrap()).unwrap();
    let poses: Vec<f32> = poses.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    assert_eq!(poses[7..14], [1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(run["up"], json!([0.0, -1.0, 0.0]));
    let objects = run["objects"].as_array().unwrap();
    assert_eq!(objects.len(), 2);
    assert_eq!((&objects[0]["id"], &objects[0]["color"]), (&json!(7), &json!(segment_color(7))));
    assert_eq!(
        (&objects[0]["area"], &objects[0]["best"], &objects[0]["seen"]),
        (&json!(12), &json!(1), &json!([[0, 4]]))
    );
    assert_eq!((&objects[1]["frames"], &objects[1]["seen"]), (&json!(2), &json!([[0, 0], [3, 3]])));
}

#[test]
fn names_are_data_and_the_page_is_always_the_same() {
    let harmful = "</script><img src=x onerror=alert(1)>\"\\\u{2028}";
    let files = page(2, harmful, |number| format!("{harmful}{number}"));
    assert_eq!(files.0["index.html"], page(1, "room", |number| number.to_string()).0["index.html"]);
    let run = run(&files);
    assert_eq!((&run["scene"], &run["frames"][1]), (&json!(harmful), &json!(format!("{harmful}1"))));
    for reference in ["http:", "https:", "@import", "url(", "{{"] {
        assert!(!files.0["index.html"].contains(reference), "{reference}");
    }
    // The licence of three.js goes with its code.
    assert!(files.0["viewer/viewer.js"].contains("Permission is hereby granted, free of charge"));
}

#[test]
fn the_script_is_as_new_as_its_sources() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("viewer");
    let entries = fs::read_dir(folder.join("src")).unwrap();
    let mut sources: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    sources.sort();
    sources.push(folder.join("package-lock.json"));
    let mut hash = Sha256::new();
    sources.iter().for_each(|source| hash.update(fs::read(source).unwrap()));
    let hash: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    let script = fs::read_to_string(folder.join("viewer.min.js")).unwrap();
    assert!(script.contains(&format!("package-lock.json: {hash}\n")), "run tools/build_viewer.sh");
}

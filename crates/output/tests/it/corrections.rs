//! Files of a run in which a loop closure moved earlier poses and showed that two ids are one object.

use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use splatseg_annotations::write_segments_png;
use splatseg_geometry::{FrameAnchor, Image, Intrinsics, Pose, RemappedId, RgbdFrame, SegmentMap};
use splatseg_objects::{ObjectList, ObjectLog, RemapLog};
use splatseg_odometry::PoseState;
use splatseg_output::{
    CocoFile, FrameRecord, McapFile, ObjectsFile, OutputError, Page, PosesFile, ResultFolder, RunEnd, RunOutput,
    UpdatedFrame, write_overlay_jpeg,
};
use splatseg_tracking::FrameOutput;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const CAMERA: Intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx: 11.5, cy: 7.5, width: 24, height: 16 };
/// The frame before which id 5 turns out to be id 3.
const FOUND: usize = 4;
const FRAMES: usize = 6;

/// Results in a folder.
struct Folder(PathBuf);

impl ResultFolder for Folder {
    fn write(&mut self, file: &str, bytes: &[u8]) -> Result<(), OutputError> {
        fs::create_dir_all(self.path_of(file).parent().unwrap()).unwrap();
        fs::write(self.path_of(file), bytes).unwrap();
        Ok(())
    }

    fn remove(&mut self, file: &str) -> Result<(), OutputError> {
        let _ = fs::remove_file(self.path_of(file));
        Ok(())
    }

    fn path_of(&self, file: &str) -> PathBuf {
        self.0.join(file)
    }
}

/// Ids of a frame: until [`FOUND`], 3 at the left and its other part, 5, at the right; later only the right part, as 3.
/// Frame 0 shows nothing but 5.
fn segments(number: usize) -> SegmentMap {
    Image::from_fn(24, 16, |column, row| match (column, row) {
        (2..12, 3..13) if number > 0 && number < FOUND => 3,
        (12..20, 3..13) if number < FOUND => 5,
        (12..20, 3..13) => 3,
        _ => 0,
    })
}

/// The same with final ids.
fn final_segments(number: usize) -> SegmentMap {
    Image::from_fn(24, 16, |column, row| if segments(number)[(column, row)] > 0 { 3 } else { 0 })
}

fn pose(number: usize) -> Pose {
    Pose::from_translation(DVec3::new(0.1 * number as f64, 0.0, 0.0))
}

/// Every frame of the run, with its objects.
fn records() -> (Vec<FrameRecord>, ObjectLog) {
    let mut log = ObjectLog::default();
    let records = (0..FRAMES).map(|number| {
        let remapped = if number == FOUND { vec![RemappedId { from: 5, into: 3 }] } else { Vec::new() };
        log.remap(&remapped);
        let segments = segments(number);
        let color = Image::from_fn(24, 16, |column, row| [10 * column as u8, 10 * row as u8, 40]);
        let frame =
            RgbdFrame::new(number.to_string(), color, Image::filled(24, 16, 1.0), CAMERA, pose(number)).unwrap();
        FrameRecord {
            number,
            index: number,
            file_name: number.to_string(),
            pose_state: PoseState::Tracked,
            frame,
            objects: log.record(&FrameOutput::from_segments(segments.clone())),
            segments,
            regions: None,
            anchor: FrameAnchor { keyframe: (number / 3) as u32, ..FrameAnchor::default() },
            remapped,
        }
    });
    (records.collect(), log)
}

fn outputs(folder: &Path) -> Vec<Box<dyn RunOutput>> {
    let (coco, mcap) = (folder.join("masks.json"), folder.join("run.mcap"));
    vec![
        Box::new(ObjectsFile::default()),
        Box::new(PosesFile::default()),
        Box::new(CocoFile::new(coco)),
        Box::new(McapFile::new(mcap)),
        Box::new(Page::new()),
    ]
}

/// Writes the run to a folder; new outputs continue from saved ones after each frame of `stops`.
fn write_run(path: &Path, stops: &[usize], corrections: &[Option<Pose>]) {
    let mut folder = Folder(path.to_owned());
    let (records, log) = records();
    let mut written = outputs(path);
    let mut lines: Vec<Vec<String>> = vec![Vec::new(); written.len()];
    fs::create_dir_all(path.join("segments")).unwrap();
    fs::create_dir_all(path.join("overlay")).unwrap();
    for (number, record) in records.iter().enumerate() {
        // Images as they are at the end of the run.
        let ids = final_segments(number);
        write_segments_png(&path.join(format!("segments/{number}.png")), &ids).unwrap();
        write_overlay_jpeg(&path.join(format!("overlay/{number}.jpg")), record.frame.color(), &ids).unwrap();
        for (output, lines) in written.iter_mut().zip(&mut lines) {
            output.add_frame(record, &mut folder).unwrap();
            lines.push(String::from_utf8(output.frame_state(record).unwrap()).unwrap());
        }
        if stops.contains(&number) {
            let mut resumed = outputs(path);
            for ((new, old), lines) in resumed.iter_mut().zip(&mut written).zip(&lines) {
                new.restore(lines, &old.save(&mut folder).unwrap()).unwrap();
            }
            written = resumed;
        }
    }
    let mut remaps = RemapLog::default();
    remaps.add(FOUND, &[RemappedId { from: 5, into: 3 }]);
    let remapped = BTreeSet::from([3]);
    for (number, record) in records.iter().enumerate().take(FOUND) {
        let color = record.frame.color();
        let frame =
            UpdatedFrame { position: number, number, color, segments: &final_segments(number), remapped: &remapped };
        written.iter_mut().for_each(|output| output.update_frame(&frame, &mut folder).unwrap());
    }
    let objects = ObjectList::new(&log, None);
    let end = RunEnd {
        scene: "room",
        objects: &objects,
        map: None,
        plan: None,
        pose_corrections: corrections,
        remaps: &remaps,
        changes: None,
    };
    written.iter_mut().for_each(|output| output.finish(&end, &mut folder).unwrap());
}

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn one_object_is_left_in_every_file() {
    let folder = tempfile::tempdir().unwrap();
    write_run(folder.path(), &[], &[]);
    let list = read_json(&folder.path().join("objects.json"));
    let objects = list["objects"].as_array().unwrap();
    assert_eq!((objects.len(), &objects[0]["id"], &objects[0]["first_frame"]["number"]), (1, &json!(3), &json!(0)));
    let view = &objects[0]["best_view"];
    // The best view of 3 is a frame with both parts: its box and its crop are those of the whole object.
    assert_eq!(view["frame"]["number"], 1);
    assert_eq!(view["bounding_box"], json!({"x": 2, "y": 3, "width": 18, "height": 10}));
    assert_eq!((&view["area_px"], &view["crop"]), (&json!(180), &json!("objects/3.jpg")));
    let crops: Vec<_> =
        fs::read_dir(folder.path().join("objects")).unwrap().map(|file| file.unwrap().file_name()).collect();
    assert_eq!(crops, ["3.jpg"]);
    let masks = read_json(&folder.path().join("masks.json"));
    let masks = masks["annotations"].as_array().unwrap();
    assert_eq!(masks.len(), FRAMES);
    assert!(masks.iter().all(|mask| mask["track_id"] == 3 && mask["score"] == 1.0), "{masks:?}");
    let run = fs::read_to_string(folder.path().join("viewer/run.js")).unwrap();
    let run: Value =
        serde_json::from_str(run.strip_prefix("var splatsegRun=").unwrap().trim_end_matches(";\n")).unwrap();
    assert_eq!(run["remapped"], json!([[FOUND, 5, 3]]));
    assert_eq!(run["objects"].as_array().unwrap().len(), 1);
    assert_eq!((&run["objects"][0]["seen"], &run["objects"][0]["frames"]), (&json!([[0, 5]]), &json!(6)));
    assert_eq!((&run["objects"][0]["area"], &run["objects"][0]["best"]), (&json!(180), &json!(1)));
}

#[test]
fn poses_are_corrected_only_where_their_keyframe_moved() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, moved] = ["plain", "moved"].map(|name| folder.path().join(name));
    write_run(&plain, &[], &[]);
    let turn = DQuat::from_rotation_z(0.5);
    let motion = Pose::from_quaternion(DVec3::new(0.0, 2.0, 0.0), turn).unwrap();
    write_run(&moved, &[], &[None, None, None, Some(motion), Some(motion)]);
    let lines = |folder: &Path| fs::read_to_string(folder.join("poses.txt")).unwrap();
    let (plain, moved) = (lines(&plain), lines(&moved));
    let changed: Vec<bool> = plain.lines().zip(moved.lines()).skip(1).map(|(plain, moved)| plain != moved).collect();
    assert_eq!(changed, [false, false, false, true, true, false]);
    let numbers: Vec<f64> = moved.lines().nth(5).unwrap().split(' ').map(|number| number.parse().unwrap()).collect();
    let expected = turn * DVec3::new(0.4, 0.0, 0.0) + DVec3::new(0.0, 2.0, 0.0);
    assert!((DVec3::from_slice(&numbers[1..4]) - expected).length() < 1e-6, "{moved}");
    assert!((numbers[6] - 0.25_f64.sin()).abs() < 1e-6, "{moved}");
}

#[test]
fn resumed_outputs_write_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let motion = Some(Pose::from_translation(DVec3::new(0.5, 0.0, 0.0)));
    let [whole, resumed] = ["whole", "resumed"].map(|name| folder.path().join(name));
    write_run(&whole, &[], &[motion, motion]);
    write_run(&resumed, &[0, FOUND - 1, FOUND], &[motion, motion]);
    let files =
        ["objects.json", "objects.csv", "objects/3.jpg", "poses.txt", "masks.json", "run.mcap", "viewer/run.js"];
    for file in files.into_iter().chain(["viewer/frames-000.js", "index.html"]) {
        assert!(fs::read(whole.join(file)).unwrap() == fs::read(resumed.join(file)).unwrap(), "{file} differs");
    }
    assert!(!resumed.join("objects/5.jpg").exists());
}

//! Free space and rooms of a run: in the recording, in `objects.json`, and as exported from the saved map.

use crate::support::{Ended, finish, read_json, splatseg};
use splatseg_dataset::SyntheticScene;
use splatseg_objects::{FrameStamp, ObjectList};
use splatseg_places::{GridShape, PlanFile};
use splatseg_ros::{OccupancyGrid, from_cdr};
use splatseg_test_scenes::{PlanErrors, room, true_cells, without_chunks};
use std::fs;
use std::path::Path;

const SCENE: &str = "synthetic:frames=48,width=96,height=72,objects=8,seed=5";

fn run(folder: &Path, scene: &str, more: &[&str]) {
    let mut command = splatseg();
    command.current_dir(folder).args(["run", scene, "--out", "out", "--no-page"]);
    let ended = finish(command.args(["--threads", "2", "--save-memory", "map.ply"]).args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
}

fn export(folder: &Path, more: &[&str]) -> Ended {
    let arguments = ["export", "map.ply", "--as", "occupancy", "--out", "home"];
    finish(splatseg().current_dir(folder).args(arguments).args(more))
}

/// Exports the plan, also over itself.
fn exported(folder: &Path) {
    let ended = export(folder, &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ended = export(folder, &[]);
    assert!(ended.code == 2 && ended.err.contains("home.pgm: exists: give --overwrite"), "{}", ended.err);
    let ended = export(folder, &["--overwrite"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
}

/// The only message of a topic.
fn message(file: &Path, topic: &str) -> Vec<u8> {
    let bytes = without_chunks(&fs::read(file).unwrap());
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let found: Vec<_> = messages.filter(|message| message.channel.topic == topic).collect();
    assert_eq!(found.len(), 1, "{topic}");
    found[0].data.to_vec()
}

/// The cells of a `map_server` image as in a message, read by the rules of Nav2 for the exported thresholds.
fn cells_of_pgm(bytes: &[u8], shape: &GridShape) -> Vec<i8> {
    let header = format!("P5\n{} {}\n255\n", shape.width, shape.height);
    let pixels = bytes.strip_prefix(header.as_bytes()).expect("the header");
    assert_eq!(pixels.len(), shape.width * shape.height);
    let cell = |pixel: &u8| match f64::from(255 - pixel) / 255.0 {
        occupied if occupied > 0.65 => 100,
        occupied if occupied < 0.196 => 0,
        _ => -1,
    };
    pixels.chunks(shape.width).rev().flatten().map(cell).collect()
}

#[test]
fn the_recording_of_a_run_has_the_exported_grid_and_its_list_the_rooms() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(folder, SCENE, &["--segmenter", "oracle", "--save-mcap", "run.mcap"]);
    exported(folder);
    let plan: PlanFile = serde_json::from_value(read_json(&folder.join("home.json"))).unwrap();
    let grid: OccupancyGrid = from_cdr(&message(&folder.join("run.mcap"), "/splatseg/map")).unwrap();
    assert_eq!(grid.data, cells_of_pgm(&fs::read(folder.join("home.pgm")).unwrap(), &plan.grid));
    let (info, shape) = (&grid.info, &plan.grid);
    assert_eq!((info.width as usize, info.height as usize), (shape.width, shape.height));
    assert_eq!((info.resolution, info.origin.orientation.w), (0.05, 1.0));
    assert_eq!([info.origin.position.x, info.origin.position.y], shape.origin.to_array());
    assert_eq!((grid.header.frame_id.as_str(), info.origin.position.z), ("world", plan.frame.floor_height));

    // Against the exact geometry of the scene.
    let scene: SyntheticScene = room(SCENE);
    let truth = true_cells(&scene, (&scene, 1), shape.origin, (shape.width, shape.height), shape.resolution);
    let errors = PlanErrors::new(grid.data.iter().map(|cell| *cell == 0), &truth);
    assert!(errors.iou() > 0.8 && errors.inside * 50 <= errors.both, "{} {errors:?}", errors.iou());

    let list: ObjectList = serde_json::from_value(read_json(&folder.join("out/objects.json"))).unwrap();
    let areas =
        |rooms: Vec<(u32, f64)>| rooms.into_iter().map(|(id, area)| (id, (area * 1e4).round())).collect::<Vec<_>>();
    let listed = areas(list.rooms.iter().map(|room| (room.id, room.area_m2)).collect());
    assert_eq!(listed, areas(plan.rooms.iter().map(|room| (room.id, room.area_m2)).collect()));
    assert!(!listed.is_empty());
    for object in &list.objects {
        let planned = plan.objects.iter().find(|planned| planned.id == object.id);
        assert_eq!(object.room, planned.and_then(|planned| planned.room), "object {}", object.id);
        let is_in = |room: &u32| list.rooms.iter().any(|one| one.id == *room && one.objects.contains(&object.id));
        assert!(object.room.as_ref().is_none_or(is_in));
    }
    assert!(list.objects.iter().filter(|object| object.room.is_some()).count() >= 5);
    let inspected = finish(splatseg().current_dir(folder).args(["inspect", "map.ply", "--json"]));
    let inspected: serde_json::Value = serde_json::from_str(&inspected.out).unwrap();
    let rooms: Vec<Option<u64>> =
        inspected["objects"].as_array().unwrap().iter().map(|object| object["room"].as_u64()).collect();
    assert_eq!(rooms, list.objects.iter().map(|object| object.room.map(u64::from)).collect::<Vec<_>>());
    let csv = fs::read_to_string(folder.join("out/objects.csv")).unwrap();
    let rooms: Vec<&str> = csv.lines().map(|line| line.rsplit(',').nth(2).unwrap()).collect();
    assert_eq!(rooms[0], "room");
    let expected: Vec<String> =
        list.objects.iter().map(|object| object.room.map_or_else(String::new, |room| room.to_string())).collect();
    assert_eq!(rooms[1..], expected);
}

#[test]
fn times_of_sightings_are_those_of_the_frames_and_last_over_runs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A recording has the times of its frames, 1/30 s apart from 0.
    let scene = "synthetic:frames=12,width=64,height=48,objects=6";
    let convert = finish(splatseg().current_dir(folder).args(["convert", scene, "scene.mcap"]));
    assert_eq!(convert.code, 0, "{}", convert.err);
    let objects = || -> ObjectList { serde_json::from_value(read_json(&folder.join("out/objects.json"))).unwrap() };
    run(folder, "scene.mcap", &["--max-frames", "6"]);
    let first = objects();
    for object in &first.objects {
        let time = |frame: &Option<FrameStamp>| frame.as_ref().unwrap().time_s;
        assert_eq!((object.first_seen_s, object.last_seen_s), (time(&object.first_frame), time(&object.last_frame)));
        assert!(object.first_seen_s.is_some());
    }
    run(folder, "scene.mcap", &["--start", "6", "--load-memory", "map.ply", "--overwrite"]);
    let mut again = 0;
    for object in objects().objects {
        let Some(before) = first.get(object.id) else { continue };
        // The times of both runs together; one that was not seen again keeps its own.
        assert_eq!(object.first_seen_s, before.first_seen_s, "object {}", object.id);
        match object.last_frame.and_then(|frame| frame.time_s) {
            Some(last) => assert_eq!(object.last_seen_s, Some(last)),
            None => assert_eq!(object.last_seen_s, before.last_seen_s),
        }
        again += usize::from(object.last_seen_s > before.last_seen_s);
    }
    assert!(again >= 3, "{again} objects were seen again");
}

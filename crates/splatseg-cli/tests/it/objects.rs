//! The list of objects and the COCO file of a run.

use crate::support::{Ended, ROOM, file_names, finish, read_json, splatseg};
use serde_json::Value;
use splatseg_dataset::read_segments_png;
use splatseg_geometry::{RunLengths, SegmentId};
use splatseg_objects::{ObjectList, ObjectState};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Runs with true masks and further options.
fn run(scene: &str, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["run", scene, "--segmenter", "oracle", "--out"]).arg(out).args(more))
}

/// Counts the frames that show each id, from the id images of a run.
fn frames_by_id(out: &Path) -> BTreeMap<SegmentId, usize> {
    let mut frames = BTreeMap::new();
    for name in file_names(&out.join("segments")) {
        let map = read_segments_png(&out.join("segments").join(name)).unwrap();
        map.areas().into_keys().for_each(|id| *frames.entry(id).or_default() += 1);
    }
    frames
}

fn list(out: &Path) -> ObjectList {
    serde_json::from_str(&fs::read_to_string(out.join("objects.json")).unwrap()).unwrap()
}

#[test]
fn a_run_lists_every_object_with_a_crop() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let ended = run(ROOM, &out, &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.out.contains("objects.json"), "{}", ended.out);
    let list = list(&out);
    assert_eq!((list.frames, list.scene.as_deref()), (18, Some(ROOM)));
    let found: BTreeMap<SegmentId, usize> = list.all().map(|object| (object.id, object.frames)).collect();
    assert_eq!(found, frames_by_id(&out));
    for object in list.all() {
        let view = object.best_view.as_ref().unwrap();
        let file = view.frame.file.as_ref().unwrap();
        let map = read_segments_png(&out.join(format!("segments/{file}.png"))).unwrap();
        assert_eq!(map.areas()[&object.id], view.area_px, "object {}", object.id);
        let crop = image::open(out.join(view.crop.as_ref().unwrap())).unwrap();
        assert!(crop.width() <= 64 && crop.height() <= 48);
        assert!(object.first_frame.as_ref().unwrap().number <= object.last_frame.as_ref().unwrap().number);
        assert!(object.confidence.is_some_and(|confidence| confidence > 0.0 && confidence <= 1.0));
        assert_eq!(object.shape.is_none(), object.state == Some(ObjectState::Forgotten), "object {}", object.id);
    }
    assert_eq!(file_names(&out.join("objects")).len(), list.all().count());
    let csv = fs::read_to_string(out.join("objects.csv")).unwrap();
    let columns: BTreeSet<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert_eq!((csv.lines().count(), columns.len()), (list.objects.len() + 1, 1));

    // Another run's list and crops replace them all.
    assert_eq!(run("synthetic:frames=1,width=64,height=48,objects=0", &out, &["--overwrite"]).code, 0);
    assert_eq!(file_names(&out.join("objects")).len(), frames_by_id(&out).len());
}

/// The number of objects is the same wherever one is given, and objects of one frame are not among them.
#[test]
fn there_is_one_number_of_objects() {
    let folder = tempfile::tempdir().unwrap();
    let (out, map) = (folder.path().join("out"), folder.path().join("map.ply"));
    let scene = "synthetic:frames=30,width=128,height=96,objects=8,noise=kinect,seed=4";
    let ended = finish(splatseg().args(["run", scene, "--out"]).arg(&out).arg("--save-memory").arg(&map));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let list = list(&out);
    let (counts, count) = (list.counts(), list.objects.len());
    assert!(ended.out.contains(&format!("30 frames, {counts}, ")), "{counts}: {}", ended.out);
    let summary = read_json(&out.join("summary.json"));
    for (key, expected) in
        [("objects", counts.objects), ("tentative_objects", counts.tentative), ("forgotten_objects", counts.forgotten)]
    {
        assert_eq!(summary[key], expected, "{key}");
    }
    let printed = |arguments: &[&str]| {
        let ended = finish(splatseg().args(arguments));
        assert_eq!(ended.code, 0, "{}", ended.err);
        serde_json::from_str::<Value>(&ended.out).unwrap()
    };
    let map = map.to_str().unwrap();
    assert_eq!(printed(&["inspect", map, "--json"])["counts"]["objects"], count);
    let found = printed(&["find", map, "largest", "--json", "--top", "1000"]);
    let ids = |list: &Value| -> BTreeSet<u64> {
        list.as_array().unwrap().iter().map(|object| object["id"].as_u64().unwrap()).collect()
    };
    let counted: BTreeSet<u64> = list.objects.iter().map(|object| u64::from(object.id)).collect();
    assert!(ids(&found).is_subset(&counted), "{found}");
    assert_eq!(ids(&printed(&["inspect", map, "--json"])["objects"]), counted);

    let shown = frames_by_id(&out);
    for object in &list.objects {
        assert!(shown.get(&object.id).is_some_and(|frames| *frames > 1), "object {}", object.id);
    }
    assert!(list.objects.is_sorted_by_key(|object| std::cmp::Reverse(object.frames)), "the longest seen first");
    for object in list.not_counted.iter().filter(|object| object.state == Some(ObjectState::Tentative)) {
        assert!(shown.get(&object.id).is_none_or(|frames| *frames < 2), "object {}", object.id);
    }
    let mut boxes = list.all().filter_map(|object| Some(object.shape.as_ref()?.oriented_box.size));
    assert!(boxes.all(|size| size.min_element() > 0.0), "no box is empty");
}

#[test]
fn without_a_memory_objects_have_no_shape() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    assert_eq!(run(ROOM, &out, &["--method", "fastsam"]).code, 0);
    let list = list(&out);
    assert!(!list.objects.is_empty());
    for object in &list.objects {
        assert!(object.shape.is_none() && object.state.is_none() && object.color.is_some());
        assert!(object.best_view.as_ref().is_some_and(|view| view.crop.is_some()));
    }
}

#[test]
fn a_coco_file_has_the_masks_of_the_images_and_the_same_score() {
    let folder = tempfile::tempdir().unwrap();
    let (out, coco) = (folder.path().join("out"), folder.path().join("new/masks.json"));
    let ended = run(ROOM, &out, &["--save-coco", coco.to_str().unwrap()]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let document = read_json(&coco);
    let images = document["images"].as_array().unwrap();
    assert_eq!(images.len(), 18);
    let annotations = document["annotations"].as_array().unwrap();
    let ids: BTreeSet<u64> = annotations.iter().map(|annotation| annotation["id"].as_u64().unwrap()).collect();
    assert_eq!(ids.len(), annotations.len());
    for image in images {
        let name = image["file_name"].as_str().unwrap().replace(".jpg", ".png");
        let map = read_segments_png(&out.join("segments").join(name)).unwrap();
        let of_image: Vec<&Value> =
            annotations.iter().filter(|annotation| annotation["image_id"] == image["id"]).collect();
        assert_eq!(of_image.len(), map.areas().len());
        for annotation in of_image {
            let counts = annotation["segmentation"]["counts"].as_str().unwrap();
            let mask = RunLengths::from_compressed(map.width(), map.height(), counts).unwrap().decode().unwrap();
            assert_eq!(mask, map.mask_of(annotation["track_id"].as_u64().unwrap() as SegmentId));
            assert_eq!(annotation["area"], mask.area());
        }
    }
    let score = |predictions: &Path| {
        let scores = predictions.with_extension("scores.json");
        let mut eval = splatseg();
        eval.args(["eval", "--gt", ROOM, "--pred"])
            .arg(predictions)
            .args(["--protocol", "strict", "--json"])
            .arg(&scores);
        let ended = finish(&mut eval);
        assert_eq!(ended.code, 0, "{}", ended.err);
        let found = read_json(&scores);
        (found["vsq"].clone(), found["stq"].clone())
    };
    assert_eq!(score(&coco), score(&out));
}

#[test]
fn a_coco_file_replaces_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (out, coco) = (folder.path().join("out"), folder.path().join("masks.json"));
    let place = coco.to_str().unwrap();
    let short = "synthetic:frames=1,width=64,height=48,objects=2";
    let refused = |more: &[&str], message: &str| {
        let ended = run(short, &out, more);
        assert_eq!(ended.code, 2, "{}", ended.err);
        assert!(ended.err.contains(message), "{}", ended.err);
    };
    fs::write(&coco, "{}").unwrap();
    refused(&["--save-coco", place], "masks.json: exists: give --overwrite to replace it");
    refused(&["--save-coco", place, "--overwrite"], "exists and is not a COCO file by splatseg");
    assert_eq!(fs::read_to_string(&coco).unwrap(), "{}");
    let result = out.join("objects.json");
    refused(&["--save-coco", result.to_str().unwrap()], "is reserved for other results");
    for around in [&out, out.parent().unwrap()] {
        refused(&["--save-memory", around.to_str().unwrap()], "is the folder of --out, or one around it");
    }
    let twice = folder.path().join("both");
    let twice = twice.to_str().unwrap();
    refused(&["--save-coco", twice, "--save-memory", twice], "is the file of --save-memory");
    assert!(!out.exists());
    fs::remove_file(&coco).unwrap();
    assert_eq!(run(short, &out, &["--save-coco", place]).code, 0);
    assert_eq!(run(short, &out, &["--save-coco", place, "--overwrite"]).code, 0);
    assert_eq!(read_json(&coco)["images"].as_array().unwrap().len(), 1);
}

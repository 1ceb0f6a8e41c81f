//! Files in COCO's panoptic format, and their images.

use crate::predicted_video::{PredictedVideo, expected, frames_and_ids, write_columns};
use serde_json::{Value, json};

/// A frame whose image has segments of these ids and tracks.
fn frame(file: &str, segments: &[(u32, Option<u32>)]) -> Value {
    let infos: Vec<Value> = segments.iter().map(|(id, track)| json!({"id": id, "track_id": track})).collect();
    json!({"file_name": file, "segments_info": infos})
}

/// The images of frames 0 and 1 in two folders, each with one segment.
fn two_folders(video: &PredictedVideo) -> Value {
    let list = [("a/000.png", 3), ("a/001.png", 3), ("b/000.png", 5), ("b/001.png", 5)];
    for (file, id) in list {
        write_columns(&video.path(file), [id, 0, 0, 0]);
    }
    Value::from(list.map(|(file, id)| frame(file, &[(id, None)])).to_vec())
}

#[test]
fn track_0_is_a_track() {
    let video = PredictedVideo::new(2);
    write_columns(&video.path("0.png"), [10, 20, 30, 0]);
    write_columns(&video.path("1.png"), [40, 50, 50, 0]);
    let mut document = json!({"annotations": [
        frame("0.png", &[(10, Some(0)), (20, Some(1)), (30, Some(2))]),
        frame("1.png", &[(40, Some(0)), (50, Some(3))]),
    ]});
    let found = frames_and_ids(&video.open_json(&document, None).unwrap());
    assert_eq!(found, expected(&[("000", &[1, 2, 4]), ("001", &[3, 4])]));
    // Pixels of the id 0 have no segment, in a list or not.
    document["annotations"][1] = frame("1.png", &[(40, Some(0)), (50, Some(3)), (0, Some(0))]);
    let found = frames_and_ids(&video.open_json(&document, None).unwrap());
    assert_eq!(found, expected(&[("000", &[1, 2, 4]), ("001", &[3, 4])]));
    // A segment that is left out has no id.
    document["annotations"][1]["segments_info"][0]["score"] = json!(-1.0);
    let found = frames_and_ids(&video.open_json(&document, None).unwrap());
    assert_eq!(found, expected(&[("000", &[1, 2, 4]), ("001", &[3])]));
}

#[test]
fn videos_of_a_flat_list_are_told_apart_by_folder() {
    let video = PredictedVideo::new(2);
    let mut document = json!({"annotations": two_folders(&video)});
    let error = video.open_json(&document, None).unwrap_err();
    assert_eq!(error, "has several videos (a, b): choose one with --video");
    for (name, id) in [("a", 3), ("b", 5)] {
        let found = frames_and_ids(&video.open_json(&document, Some(name)).unwrap());
        assert_eq!(found, expected(&[("000", &[id]), ("001", &[id])]), "{name}");
    }
    let error = video.open_json(&document, Some("c")).unwrap_err();
    assert_eq!(error, "has no video c; its first folders are a, b");

    document = json!({"annotations": [frame("000.png", &[(3, None)]), frame("001.png", &[(3, None)])]});
    for file in ["000.png", "001.png", "pan_pred/c/000.png", "pan_pred/c/001.png"] {
        write_columns(&video.path(file), [3, 0, 0, 0]);
    }
    let error = video.open_json(&document, Some("d")).unwrap_err();
    assert!(error.starts_with("has no videos to choose from: "), "{error}");
    let lost = json!({"annotations": [frame("002.png", &[(3, None)])]});
    let error = video.open_json(&lost, Some("d")).unwrap_err();
    assert!(error.starts_with("image 002.png: not found beside the file, nor in pred/"), "{error}");
    // The images are in the folder of the video, which the file does not name.
    let found = video.open_json(&document, Some("c")).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&[("000", &[3]), ("001", &[3])]));
}

#[test]
fn a_frame_that_is_listed_twice_is_refused() {
    let video = PredictedVideo::new(2);
    for file in ["1.png", "001.png"] {
        write_columns(&video.path(file), [3, 0, 0, 0]);
    }
    let document = json!({"annotations": [frame("1.png", &[(3, None)]), frame("001.png", &[(3, None)])]});
    let error = video.open_json(&document, None).unwrap_err();
    let choose = "if they are of several videos, choose one with --video";
    assert_eq!(error, format!("frame 001 is listed twice, as 1.png and 001.png: {choose}"));
}

#[test]
fn no_image_may_be_outside_of_the_folder() {
    let video = PredictedVideo::new(2);
    write_columns(&video.path("in/000.png"), [3, 0, 0, 0]);
    write_columns(&video.path("001.png"), [3, 0, 0, 0]);
    let absolute = video.path("001.png");
    for outside in ["../001.png", absolute.to_str().unwrap()] {
        let document = json!({"annotations": [frame("in/000.png", &[(3, None)]), frame(outside, &[(3, None)])]});
        let error = video.open_json(&document, None).unwrap_err();
        assert_eq!(error, format!("image {outside}: leads out of the folder of the predictions"));
    }
}

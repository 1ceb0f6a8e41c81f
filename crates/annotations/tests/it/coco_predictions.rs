//! JSON files of masks: which video they are of, and which of their ids follow objects over time.

use crate::predicted_video::{PredictedVideo, SIZE, expected, frames_and_ids};
use serde_json::{Value, json};
use splatseg_annotations::PredictionChoice;

/// A mask of all pixels.
fn rle() -> Value {
    json!({"size": [SIZE.1, SIZE.0], "counts": [0, SIZE.0 * SIZE.1]})
}

/// An annotation with further keys.
fn mask(keys: &Value) -> Value {
    let mut mask = keys.clone();
    mask["segmentation"] = rle();
    mask
}

fn masks(list: &[Value]) -> Vec<Value> {
    list.iter().map(mask).collect()
}

/// Video a has three of six frames, and the last without a mask; video b has all.
fn two_videos() -> Value {
    let image = |video: usize, frame: usize| {
        let folder = ["", "a", "b"][video];
        json!({"id": 10 * video + frame, "video_id": video, "file_name": format!("{folder}/{frame:03}.jpg")})
    };
    let images: Vec<Value> = (0..3).map(|frame| image(1, frame)).chain((0..6).map(|frame| image(2, frame))).collect();
    let annotations = masks(&[
        json!({"image_id": 10, "track_id": 3}),
        json!({"image_id": 11, "track_id": 3}),
        json!({"image_id": 25, "track_id": 8}),
    ]);
    json!({"videos": [{"id": 1, "name": "a"}, {"id": 2, "name": "b"}], "images": images, "annotations": annotations})
}

const OF_A: [(&str, &[u32]); 3] = [("000", &[3]), ("001", &[3]), ("002", &[])];

#[test]
fn images_of_other_videos_are_no_frames_of_the_chosen_one() {
    let video = PredictedVideo::new(6);
    let mut document = two_videos();
    for name in ["a", "1"] {
        let found = video.open_json(&document, Some(name)).unwrap();
        assert_eq!(frames_and_ids(&found), expected(&OF_A), "{name}");
        assert!(!found.has("003"));
    }
    let of_b = video.open_json(&document, Some("b")).unwrap();
    assert_eq!(frames_and_ids(&of_b).last().unwrap(), &("005".to_owned(), vec![8]));
    let error = video.open_json(&document, None).unwrap_err();
    assert_eq!(error, "has several videos (1, 2): choose one with --video");
    let error = video.open_json(&document, Some("c")).unwrap_err();
    assert_eq!(error, "has no video c; its first videos are 1, 2");

    // Only annotations state their video: images are of that of their annotations.
    for image in document["images"].as_array_mut().unwrap() {
        image.as_object_mut().unwrap().remove("video_id");
    }
    for (annotation, video) in [(0, 1), (1, 1), (2, 2)] {
        document["annotations"][annotation]["video_id"] = json!(video);
    }
    let found = video.open_json(&document, Some("a")).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&OF_A[..2]));
    // An annotation that nothing gives a video is not left out in silence.
    document["annotations"][0].as_object_mut().unwrap().remove("video_id");
    let error = video.open_json(&document, Some("b")).unwrap_err();
    assert_eq!(error, "annotation 0: expected the key video_id, as the file has several videos");
}

#[test]
fn an_image_of_another_video_is_not_taken_for_a_frame_number() {
    let video = PredictedVideo::new(30);
    let mut document = two_videos();
    document["annotations"][2]["video_id"] = json!(1);
    let error = video.open_json(&document, Some("1")).unwrap_err();
    assert_eq!(error, "annotation 2: image_id 25 is of another video");
    // Image ids that begin anew in each video.
    document["images"][3]["id"] = json!(10);
    let error = video.open_json(&document, Some("1")).unwrap_err();
    assert_eq!(error, "annotation 0: image_id 10 is of the images a/000.jpg and b/000.jpg, expected the key video_id");
    document["annotations"][0]["video_id"] = json!(1);
    document["annotations"][2]["video_id"] = json!(2);
    let found = video.open_json(&document, Some("1")).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&OF_A));
}

#[test]
fn without_video_ids_folders_with_the_same_frames_are_videos() {
    let video = PredictedVideo::new(6);
    let mut document = two_videos();
    for image in document["images"].as_array_mut().unwrap() {
        image.as_object_mut().unwrap().remove("video_id");
    }
    let error = video.open_json(&document, None).unwrap_err();
    assert_eq!(error, "has several videos (a, b): choose one with --video");
    let found = video.open_json(&document, Some("a")).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&OF_A));
    let error = video.open_json(&document, Some("c")).unwrap_err();
    assert_eq!(error, "has no video c; its first folders are a, b");

    // By default the folder of the scene.
    let named: Vec<Value> = [("x/kitchen/0", 2), ("x/kitchen/1", 2), ("y/other/0", 5)]
        .iter()
        .map(|(path, id)| mask(&json!({"file_name": format!("{path}.jpg"), "track_id": id})))
        .collect();
    let found = video.open_json(&Value::from(named), None).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&[("000", &[2]), ("001", &[2])]));
    // Folders of different frames are one video.
    let parts =
        masks(&[json!({"file_name": "a/0.jpg", "track_id": 2}), json!({"file_name": "b/1.jpg", "track_id": 2})]);
    let found = video.open_json(&Value::from(parts), None).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&[("000", &[2]), ("001", &[2])]));
}

#[test]
fn a_frame_that_is_listed_twice_is_refused() {
    let video = PredictedVideo::new(6);
    let images = |names: [&str; 2]| json!([{"id": 1, "file_name": names[0]}, {"id": 2, "file_name": names[1]}]);
    let mut document = json!({"images": images(["1.jpg", "001.jpg"]), "annotations": []});
    let error = video.open_json(&document, None).unwrap_err();
    let choose = "if they are of several videos, choose one with --video";
    assert_eq!(error, format!("frame 001 is listed twice, as 1.jpg and 001.jpg: {choose}"));
    document["images"] = images(["1.jpg", "2.jpg"]);
    video.open_json(&document, None).unwrap();
    let error = video.open_json(&document, Some("a")).unwrap_err();
    assert!(error.starts_with("has no videos to choose from: "), "{error}");
}

#[test]
fn ids_of_objects_go_before_ids_of_masks() {
    let video = PredictedVideo::new(6);
    // As CocoVID has them.
    let mut list = masks(&[
        json!({"id": 1, "instance_id": 7, "file_name": "0.jpg"}),
        json!({"id": 2, "instance_id": 7, "file_name": "1.jpg"}),
    ]);
    let found = video.open_json(&Value::from(list.clone()), None).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&[("000", &[7]), ("001", &[7])]));
    list[1]["track_id"] = json!(9);
    let found = video.open_json(&Value::from(list.clone()), None).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&[("000", &[7]), ("001", &[9])]));
    list[0]["instance_id"] = json!(0);
    let error = video.open_json(&Value::from(list), None).unwrap_err();
    assert!(error.starts_with("annotation 0: instance_id: found 0, expected an integer from 1"), "{error}");
}

#[test]
fn ids_that_are_unique_to_masks_are_refused() {
    let video = PredictedVideo::new(6);
    let ids = |ids: [usize; 3]| {
        let frames = ["0.jpg", "0.jpg", "1.jpg"];
        let list = ids.iter().zip(frames).map(|(id, frame)| mask(&json!({"id": id, "file_name": frame})));
        Value::from(list.collect::<Vec<_>>())
    };
    let error = video.open_json(&ids([1, 2, 3]), None).unwrap_err();
    let expected_keys = "expected the key track_id or instance_id, or --no-ids";
    assert_eq!(
        error,
        format!("no id of a mask occurs in two frames, so ids do not follow objects over time: {expected_keys}")
    );
    let per_frame = PredictionChoice { scene: "kitchen", per_frame_ids: true, ..Default::default() };
    let found = video.open("pred.json", &per_frame).unwrap();
    assert_eq!(frames_and_ids(&found), expected(&[("000", &[1, 2]), ("001", &[3])]));
    // One object in both frames, or one frame.
    video.open_json(&ids([1, 2, 1]), None).unwrap();
    let one_frame = masks(&[json!({"id": 1, "file_name": "0.jpg"}), json!({"id": 2, "file_name": "0.jpg"})]);
    video.open_json(&Value::from(one_frame), None).unwrap();
    // The ids of tracks are of objects.
    let track = |frame: usize| {
        let masks: Vec<Value> = (0..6).map(|index| if index == frame { rle() } else { Value::Null }).collect();
        json!({"id": frame + 1, "segmentations": masks})
    };
    video.open_json(&json!([track(0), track(1)]), None).unwrap();
}

//! An MVPd video of the synthetic room, as a folder or an archive.

use super::recording::{jpeg_bytes, png_depth_bytes, png_panoptic_bytes, recording, tar_gz_bytes};
use glam::{DMat3, DQuat};
use serde_json::{Value, json};
use splatseg_geometry::{Pose, RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

pub const FIRST: &str = "00800-TEEsavR23oF.0000000000.0000000100";
pub const SECOND: &str = "00800-TEEsavR23oF.0000000001.0000000100";
/// Offset added to instance ids in mask images, because panoptic ids have three bytes.
pub const PANOPTIC_OFFSET: u32 = 70_000;

pub fn room() -> &'static [(RgbdFrame<'static>, SegmentMap)] {
    static ROOM: OnceLock<Vec<(RgbdFrame<'static>, SegmentMap)>> = OnceLock::new();
    ROOM.get_or_init(|| recording("synthetic:frames=2,width=64,height=48,seed=3"))
}

/// Returns the position and quaternion (w, x, y, z) of a camera with Blender's axes.
pub fn blender_pose(pose: &Pose) -> ([f64; 3], [f64; 4]) {
    let axes = pose.rotation();
    let blender = DMat3::from_cols(axes.x_axis, -axes.y_axis, -axes.z_axis);
    let [x, y, z, w] = DQuat::from_mat3(&blender).to_array();
    (pose.translation().to_array(), [w, x, y, z])
}

pub fn images() -> Vec<Value> {
    let image = |(index, (frame, _)): (usize, &(RgbdFrame<'static>, SegmentMap))| {
        let (position, rotation) = blender_pose(frame.world_from_camera());
        json!({
            "id": index, "width": 64, "height": 48, "file_name": format!("{index:010}.jpg"),
            "depth_file_name": format!("{index:010}.png"), "scene_id": "00800-TEEsavR23oF",
            "camera_position": position, "camera_rotation": rotation,
        })
    };
    room().iter().enumerate().map(image).collect()
}

pub fn frame_annotations() -> Vec<Value> {
    let annotation = |(index, (_, labels)): (usize, &(RgbdFrame<'static>, SegmentMap))| {
        let info = |(id, area): (u32, usize)| {
            json!({"id": id + PANOPTIC_OFFSET, "category_id": 3, "instance_id": id, "area": area,
                   "bbox": [0, 0, 64, 48], "iscrowd": 0})
        };
        let infos: Vec<Value> = labels.areas().into_iter().map(info).collect();
        json!({"image_id": index, "file_name": format!("{index:010}.png"), "segments_info": infos})
    };
    room().iter().enumerate().map(annotation).collect()
}

/// Returns annotations as written by the authors' script: `video_id` is a number.
pub fn panoptic(videos: &[&str]) -> Value {
    let list = |content: &dyn Fn() -> (&'static str, Vec<Value>)| -> Vec<Value> {
        let entry = |(index, name): (usize, &&str)| {
            let (key, content) = content();
            json!({"video_id": index, key: content, "video_name": name})
        };
        videos.iter().enumerate().map(entry).collect()
    };
    json!({
        "videos": list(&|| ("images", images())),
        "annotations": list(&|| ("annotations", frame_annotations())),
        "categories": [{"id": 3, "name": "chair", "isthing": 1}],
        "instances": [],
    })
}

/// Returns the files of videos, with names relative to the split's folder.
pub fn files(videos: &[&str]) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for video in videos {
        for (index, (frame, labels)) in room().iter().enumerate() {
            files.push((format!("imagesRGB/{video}/{index:010}.jpg"), jpeg_bytes(frame.color())));
            files.push((format!("imagesDEPTH/{video}/{index:010}.png"), png_depth_bytes(frame.depth(), 1000.0)));
            let stored = labels.map(|id| id + PANOPTIC_OFFSET);
            files.push((format!("panomasksRGB/{video}/{index:010}.png"), png_panoptic_bytes(&stored)));
        }
    }
    files
}

pub fn write_split(folder: &Path, videos: &[&str], panoptic: &Value) {
    for (name, bytes) in files(videos) {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    fs::write(folder.join("panoptic_val.json"), panoptic.to_string()).unwrap();
}

/// Returns a scene's archive with the annotations at the start, as ordered by `tar`, or at the end.
pub fn archive(videos: &[&str], prefix: &str, annotations_first: bool) -> Vec<u8> {
    let mut members: Vec<_> =
        files(videos).into_iter().map(|(name, bytes)| (format!("{prefix}{name}"), bytes)).collect();
    let annotations = (format!("{prefix}panoptic.json"), panoptic(videos).to_string().into_bytes());
    members.insert(if annotations_first { 0 } else { members.len() }, annotations);
    tar_gz_bytes(&members)
}

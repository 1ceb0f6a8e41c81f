//! A small valid scene of every format, of the synthetic room.

use crate::support::mcap::{recording_of, without_checksums};
use crate::support::recording::{
    jpeg_bytes, png_color_bytes, png_depth_bytes, png_label_bytes, png_panoptic_bytes, recording, tar_gz_bytes,
};
use crate::support::sens::SensWriter;
use crate::support::{pose_text, write_color, write_png16};
use serde_json::json;
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=2,width=24,height=16,seed=3";

fn room() -> Vec<(RgbdFrame<'static>, SegmentMap)> {
    recording(ROOM)
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder of the template");
    fs::write(path, bytes).expect("a file of the template");
}

fn matrix(frame: &RgbdFrame) -> String {
    let rows = frame.world_from_camera().to_row_major();
    rows.chunks(4).map(|row| row.iter().map(f64::to_string).collect::<Vec<_>>().join(" ") + "\n").collect()
}

/// 7-Scenes: one frame with JPEG colour, one with PNG.
pub fn sevenscenes(folder: &Path) {
    fs::create_dir_all(folder).expect("a folder of the template");
    write(folder, "camera-intrinsics.txt", "20 0 12\n0 20 8\n0 0 1\n");
    for (index, (frame, _)) in room().iter().enumerate() {
        let part = |ending: &str| format!("frame-{index:06}.{ending}");
        match index {
            0 => write(folder, &part("color.jpg"), jpeg_bytes(frame.color())),
            _ => write(folder, &part("color.png"), png_color_bytes(frame.color())),
        }
        write(folder, &part("depth.png"), png_depth_bytes(frame.depth(), 1000.0));
        write(folder, &part("pose.txt"), matrix(frame));
    }
}

/// ScanNet as exported, with labels.
pub fn scannet(folder: &Path) {
    let camera = "24 0 12 0\n0 24 8 0\n0 0 1 0\n0 0 0 1\n";
    write(folder, "intrinsic/intrinsic_color.txt", camera);
    write(folder, "intrinsic/intrinsic_depth.txt", camera);
    for part in ["color", "depth", "instance-filt"] {
        fs::create_dir_all(folder.join(part)).expect("a folder of the template");
    }
    for index in 0..2 {
        write_color(&folder.join(format!("color/{index}.jpg")), 24, 16);
        write_png16(&folder.join(format!("depth/{index}.png")), (24, 16), |_, _| 2000);
        write_png16(&folder.join(format!("instance-filt/{index}.png")), (24, 16), |x, _| 1 + u16::from(x > 9));
        write(folder, &format!("pose/{index}.txt"), pose_text(index));
    }
}

/// ScanNet's `.sens`, compressed and raw.
pub fn sens(folder: &Path) {
    let room = room();
    let frames: Vec<&RgbdFrame> = room.iter().map(|(frame, _)| frame).collect();
    let packed = SensWriter::new(*frames[0].intrinsics());
    write(folder, "a/packed.sens", packed.recording(&frames));
    let raw = SensWriter { color_compression: 0, depth_compression: 0, ..packed.clone() };
    write(folder, "b/raw.sens", raw.recording(&frames));
    let png = SensWriter { color_compression: 1, ..packed };
    write(folder, "c/png.sens", png.recording(&frames));
}

/// TUM RGB-D.
pub fn tum(folder: &Path) {
    let (mut color, mut depth, mut poses) = (String::new(), String::new(), "# ground truth\n".to_owned());
    for (index, (frame, _)) in room().iter().enumerate() {
        let (color_name, depth_name) = (format!("rgb/{index}.5.png"), format!("depth/{index}.501.png"));
        write(folder, &color_name, png_color_bytes(frame.color()));
        write(folder, &depth_name, png_depth_bytes(frame.depth(), 5000.0));
        color += &format!("{index}.5 {color_name}\n");
        depth += &format!("{index}.501 {depth_name}\n");
        poses += &format!("{index}.502 1 2 3 0 0 0 1\n");
    }
    write(folder, "rgb.txt", color);
    write(folder, "depth.txt", depth);
    write(folder, "groundtruth.txt", poses);
}

/// Replica in the layout of NICE-SLAM.
pub fn replica(folder: &Path) {
    let mut trajectory = String::new();
    for (index, (frame, _)) in room().iter().enumerate() {
        trajectory += &(matrix(frame).trim_end().replace('\n', " ") + "\n");
        write(folder, &format!("results/frame{index:06}.jpg"), jpeg_bytes(frame.color()));
        write(folder, &format!("results/depth{index:06}.png"), png_depth_bytes(frame.depth(), 6553.5));
    }
    write(folder, "traj.txt", trajectory);
    let camera = json!({"camera": {"w": 24, "h": 16, "fx": 20.0, "fy": 20.0, "cx": 12.0, "cy": 8.0, "scale": 6553.5}});
    write(folder, "cam_params.json", camera.to_string());
}

/// Plain folders: one with a lens and poses by time, one with matrices.
pub fn folder(folder: &Path) {
    let camera = json!({
        "width": 24, "height": 16, "fx": 20.0, "fy": 20.0, "cx": 12.0, "cy": 8.0, "depth_scale": 1000.0,
    });
    let mut with_lens = camera.clone();
    with_lens["distortion_model"] = json!("rational_polynomial");
    with_lens["distortion_coefficients"] = json!([0.1, -0.2, 0.001, 0.002, 0.05, 0.1, -0.1, 0.02]);
    let (mut tum, mut matrices) = ("# time tx ty tz qx qy qz qw\n".to_owned(), String::new());
    for (index, (frame, _)) in room().iter().enumerate() {
        write(folder, &format!("tum/color/{index}.5.jpg"), jpeg_bytes(frame.color()));
        write(folder, &format!("tum/depth/{index}.5.png"), png_depth_bytes(frame.depth(), 1000.0));
        tum += &format!("{index}.502 1 2 3 0 0 0 1\n");
        write(folder, &format!("matrices/color/{index}.png"), png_color_bytes(frame.color()));
        write(folder, &format!("matrices/depth/{index}.png"), png_depth_bytes(frame.depth(), 1000.0));
        matrices += &matrix(frame);
    }
    write(folder, "tum/camera.json", with_lens.to_string());
    write(folder, "tum/poses.txt", tum);
    write(folder, "matrices/camera.json", camera.to_string());
    write(folder, "matrices/poses.txt", matrices);
}

/// MVPd: a split's folder in `split`, a scene's archive beside it.
pub fn mvpd(folder: &Path) {
    let (mut images, mut annotations, mut files) = (Vec::new(), Vec::new(), Vec::new());
    for (index, (frame, labels)) in room().iter().enumerate() {
        images.push(json!({
            "id": index, "width": 24, "height": 16, "file_name": format!("{index:010}.jpg"),
            "depth_file_name": format!("{index:010}.png"), "scene_id": "room",
            "camera_position": [1.0, 2.0, 3.0], "camera_rotation": [1.0, 0.0, 0.0, 0.0],
        }));
        let infos = labels.areas().into_iter().map(|(id, area)| {
            json!({"id": id, "category_id": 3, "instance_id": id, "area": area, "bbox": [0, 0, 24, 16], "iscrowd": 0})
        });
        let infos: Vec<_> = infos.collect();
        annotations.push(json!({"image_id": index, "file_name": format!("{index:010}.png"), "segments_info": infos}));
        files.push((format!("imagesRGB/video/{index:010}.jpg"), jpeg_bytes(frame.color())));
        files.push((format!("imagesDEPTH/video/{index:010}.png"), png_depth_bytes(frame.depth(), 1000.0)));
        files.push((format!("panomasksRGB/video/{index:010}.png"), png_panoptic_bytes(labels)));
    }
    let panoptic = json!({
        "videos": [{"video_id": 0, "images": images, "video_name": "video"}],
        "annotations": [{"video_id": 0, "annotations": annotations, "video_name": "video"}],
        "categories": [{"id": 3, "name": "chair", "isthing": 1}], "instances": [],
    });
    for (name, bytes) in &files {
        write(folder, &format!("split/{name}"), bytes);
    }
    write(folder, "split/panoptic_val.json", panoptic.to_string());
    files.insert(0, ("panoptic.json".to_owned(), panoptic.to_string().into_bytes()));
    write(folder, "room.tar.gz", tar_gz_bytes(&files));
}

/// A recording of ROS 2 messages. It has no CRCs, or every change would only be a wrong one.
pub fn mcap(folder: &Path) {
    let room = room();
    let frames: Vec<&RgbdFrame> = room.iter().map(|(frame, _)| frame).collect();
    fs::create_dir_all(folder).expect("a folder of the template");
    write(folder, "a.mcap", without_checksums(recording_of(&frames)));
}

/// Recordings in SQLite, of two versions of RealSense's SDK.
pub fn db3(folder: &Path) {
    write(folder, "raw/a.db3", include_bytes!("../../crates/dataset/tests/data/recordings/realsense_2.58.db3"));
    write(folder, "png/a.db3", include_bytes!("../../crates/dataset/tests/data/recordings/realsense_2.59.db3"));
}

/// Bags of ROS 1.
pub fn bag(folder: &Path) {
    write(folder, "lz4/a.bag", include_bytes!("../../crates/dataset/tests/data/recordings/room_lz4.bag"));
    write(folder, "bz2/a.bag", include_bytes!("../../crates/dataset/tests/data/recordings/room_bz2.bag"));
    write(folder, "realsense/a.bag", include_bytes!("../../crates/dataset/tests/data/recordings/realsense_2.56.bag"));
}

/// Images alone: labels in 8 and 16 bits, colour.
pub fn images(folder: &Path) {
    let (frame, labels) = &room()[0];
    write(folder, "labels.png", png_label_bytes(labels));
    write(folder, "panoptic.png", png_panoptic_bytes(labels));
    write(folder, "depth.png", png_depth_bytes(frame.depth(), 1000.0));
    write(folder, "color.png", png_color_bytes(frame.color()));
    write(folder, "color.jpg", jpeg_bytes(frame.color()));
}

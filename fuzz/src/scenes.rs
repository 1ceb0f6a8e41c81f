//! A small valid scene of every format, of the synthetic room.

use crate::support::bag::{Chunks, small as small_bag};
use crate::support::mcap::{recording_of, without_checksums};
use crate::support::mkv::{HeadPlace, MkvWriter, small};
use crate::support::orbbec::OrbbecWriter;
use crate::support::recording::{
    jpeg_bytes, png_color_bytes, png_depth_bytes, png_label_bytes, png_panoptic_bytes, recording, tar_gz_bytes,
    zip_bytes,
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

/// Bags of ROS 1, small: with each kind of chunks, of RealSense's SDK, and of Orbbec's.
pub fn bag(folder: &Path) {
    for (name, chunks) in [("plain", Chunks::Plain), ("lz4", Chunks::Lz4), ("bz2", Chunks::Bz2)] {
        write(folder, &format!("{name}/a.bag"), small_bag(chunks));
    }
    write(folder, "realsense/a.bag", include_bytes!("../../crates/dataset/tests/data/recordings/realsense_2.56.bag"));
    for (name, is_new) in [("orbbec", true), ("orbbec_old", false)] {
        write(folder, &format!("{name}/a.bag"), OrbbecWriter { is_new, ..OrbbecWriter::default() }.bytes());
    }
}

/// The scenes of [`bag`].
pub const BAGS: [&str; 6] = ["plain", "lz4", "bz2", "realsense", "orbbec", "orbbec_old"];

/// Recordings of an Azure Kinect, in two of the ways in which Matroska is written.
pub fn mkv(folder: &Path) {
    let closed = small(2, 0);
    write(folder, "closed/a.mkv", closed.bytes());
    let streamed = MkvWriter { head: HeadPlace::Last, is_streamed: true, is_grouped: true, ..closed };
    write(folder, "streamed/a.mkv", streamed.bytes());
}

/// Plain folders with depth in every kind of file that is read.
pub fn depth_files(folder: &Path) {
    // Fuzz targets and an example of `crates/dataset` have this file.
    let data_of = |root: &Path| root.join("crates/dataset/tests/data/depth_files");
    let mut data = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(data_of);
    let data = data.find(|data| data.is_dir()).expect("the repository");
    for name in DEPTH_FILES {
        let (stem, ending) = name.split_once('.').expect("an extension");
        fs::create_dir_all(folder.join(stem).join("color")).expect("a folder of the template");
        write_color(&folder.join(stem).join("color/0.png"), 11, 19);
        let bytes = fs::read(data.join(name)).expect("a depth file of the tests");
        write(folder, &format!("{stem}/depth/0.{ending}"), bytes);
        let camera = json!({
            "width": 11, "height": 19, "fx": 20.0, "fy": 20.0, "cx": 5.0, "cy": 9.0, "depth_scale": 1.0,
        });
        write(folder, &format!("{stem}/camera.json"), camera.to_string());
    }
}

/// The files of [`depth_files`]; each is in a folder of its name without the extension.
pub const DEPTH_FILES: [&str; 8] = [
    "doubles_tiles.tiff",
    "integers_opencv.tiff",
    "integers_deflate.tiff",
    "floats.npy",
    "floats_opencv.pfm",
    "halves_rle.exr",
    "floats_zip.exr",
    "layers_zip.exr",
];

/// Scenes of [`phones`].
pub const PHONES: [&str; 6] = ["room.r3d", "r3d", "polycam", "stray", "arkitscenes", "nerfstudio"];

/// Recordings of phones and nerfstudio's list, of the first frame.
pub fn phones(folder: &Path) {
    let frame = &room()[0].0;
    let (jpeg, depth) = (jpeg_bytes(frame.color()), png_depth_bytes(frame.depth(), 1000.0));
    let levels = vec![1; frame.depth().pixels().len()];
    let confidence = image::GrayImage::from_raw(24, 16, levels.clone()).expect("24x16 pixels");
    let grey = |name: &str| confidence.save(folder.join(name)).expect("a file of the template");
    let mut packed = [Vec::new(), Vec::new()];
    let metres: Vec<u8> = frame.depth().pixels().iter().flat_map(|depth| depth.to_le_bytes()).collect();
    lzfse_rust::encode_bytes(&metres, &mut packed[0]).expect("LZFSE");
    lzfse_rust::encode_bytes(&levels, &mut packed[1]).expect("LZFSE");
    let metadata = json!({
        "w": 24, "h": 16, "dw": 24, "dh": 16, "fps": 30, "K": [20, 0, 0, 0, 20, 0, 12, 8, 1],
        "poses": [[0, 0, 0, 1, 1, 2, 3]], "frameTimestamps": [0.0], "perFrameIntrinsicCoeffs": [[20, 20, 12, 8]],
    });
    let [packed_depth, packed_levels] = packed;
    let members = [
        ("metadata", metadata.to_string().into_bytes()),
        ("rgbd/0.jpg", jpeg.clone()),
        ("rgbd/0.depth", packed_depth),
        ("rgbd/0.conf", packed_levels),
    ]
    .map(|(name, bytes)| (name.to_owned(), bytes));
    write(folder, "room.r3d", zip_bytes(&members));
    members.iter().for_each(|(name, bytes)| write(folder, &format!("r3d/{name}"), bytes));

    let mut camera = json!({"fx": 20.0, "fy": 20.0, "cx": 12.0, "cy": 8.0, "width": 24, "height": 16});
    for (index, number) in [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3].into_iter().enumerate() {
        camera[format!("t_{}{}", index / 4, index % 4)] = json!(number);
    }
    write(folder, "polycam/keyframes/images/262195552056.jpg", &jpeg);
    write(folder, "polycam/keyframes/depth/262195552056.png", &depth);
    write(folder, "polycam/keyframes/cameras/262195552056.json", camera.to_string());
    write(folder, "polycam/keyframes/confidence/262195552056.png", "");
    grey("polycam/keyframes/confidence/262195552056.png");

    write(folder, "stray/rgb/000000.jpg", &jpeg);
    write(folder, "stray/depth/000000.png", &depth);
    write(folder, "stray/camera_matrix.csv", "20, 0, 12\n0, 20, 8\n0, 0, 1\n");
    let columns = "timestamp, frame, x, y, z, qx, qy, qz, qw, fx, fy, cx, cy";
    write(folder, "stray/odometry.csv", format!("{columns}\n9.5, 000000, 1, 2, 3, 0, 0, 0, 1, 20, 20, 12, 8\n"));
    write(folder, "stray/confidence/000000.png", "");
    grey("stray/confidence/000000.png");

    write(folder, "arkitscenes/lowres_wide/4_10.5.png", png_color_bytes(frame.color()));
    write(folder, "arkitscenes/lowres_depth/4_10.5.png", &depth);
    write(folder, "arkitscenes/lowres_wide_intrinsics/4_10.5.pincam", "24 16 20 20 12 8");
    write(folder, "arkitscenes/lowres_wide.traj", "10.5 0.1 0.2 0.3 1 2 3\n");

    let transforms = json!({
        "fl_x": 20.0, "fl_y": 20.0, "cx": 12.0, "cy": 8.0, "w": 24, "h": 16, "k1": 0.1, "p1": 0.001,
        "frames": [{
            "file_path": "0.jpg", "depth_file_path": "0.png",
            "transform_matrix": [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]],
        }],
    });
    write(folder, "nerfstudio/transforms.json", transforms.to_string());
    write(folder, "nerfstudio/0.jpg", &jpeg);
    write(folder, "nerfstudio/0.png", &depth);
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

//! Small stand-ins for the paper's data sets, in their published layouts, made from any scenes with ground truth.
//!
//! The tests of the paper's tables use this file too.

use glam::{DMat3, DQuat, Vec2};
use image::{ImageBuffer, Luma, RgbImage};
use serde_json::{Value, json};
use splatseg_dataset::Scene;
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::error::Error;
use std::fmt::Display;
use std::fs;
use std::path::Path;
use std::slice::from_ref;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Spacing of the mesh's vertices in the labelled frames, pixels.
const MESH_STEP: usize = 4;
/// The focal length of MVPd's camera, in image widths; the data set specifies no other.
const MVPD_FOCAL_LENGTH: f32 = 465.6029 / 640.0;
/// Label of all instances. ScanNet's instance files contain `label * 1000 + instance`.
const LABEL: u32 = 3;

/// Writes into a folder: `ScanNet/` (exported scenes in `scans/`, meshes, `scannetv2_val.txt`), `instances/` (the true
/// instance of each vertex), `MVPd/test/` (an unpacked split) and `MVPd-archives/test/` (a `.tar.gz` for each scene).
///
/// # Errors
/// If a scene has no ground truth, or something cannot be read or written.
pub fn write_standins(scenes: &[&dyn Scene], frames: usize, out: &Path) -> Outcome<()> {
    let (mut videos, mut annotations) = (Vec::new(), Vec::new());
    let split = out.join("MVPd/test");
    for scene in scenes {
        let indices = 0..scene.frame_count().min(frames);
        let labelled = indices.map(|index| labelled_frame(*scene, index)).collect::<Outcome<Vec<_>>>()?;
        write_scannet(scene.name(), &labelled, out)?;
        let name = format!("00800-{}.0000000000.0000000100", scene.name());
        let [video, annotation] = write_video(&name, &labelled, &split)?;
        let archived = out.join("MVPd-archives/unpacked").join(scene.name());
        write_video(&name, &labelled, &archived)?;
        write_json(&archived.join("panoptic.json"), &document(from_ref(&video), from_ref(&annotation)))?;
        let archive = out.join("MVPd-archives/test").join(format!("00800-{}.tar.gz", scene.name()));
        pack(&archived, scene.name(), &archive)?;
        videos.push(video);
        annotations.push(annotation);
    }
    fs::remove_dir_all(out.join("MVPd-archives/unpacked"))?;
    write_json(&split.join("panoptic_test.json"), &document(&videos, &annotations))?;
    let names: Vec<&Value> = videos.iter().map(|video| &video["video_name"]).collect();
    write_json(&split.join("empty_videos.json"), &json!({"accepted": names, "rejected": []}))?;
    let list: String = scenes.iter().map(|scene| format!("{}\n", scene.name())).collect();
    Ok(fs::write(out.join("ScanNet/scannetv2_val.txt"), list)?)
}

fn labelled_frame(scene: &dyn Scene, index: usize) -> Outcome<(RgbdFrame<'static>, SegmentMap)> {
    let labels = scene.read_ground_truth(index)?.ok_or_else(|| format!("{}: no ground truth", scene.name()))?;
    Ok((scene.read_frame(index)?, labels))
}

/// An exported scene with its mesh, and the instances of the mesh's vertices.
fn write_scannet(name: &str, frames: &[(RgbdFrame<'_>, SegmentMap)], out: &Path) -> Outcome<()> {
    let folder = out.join("ScanNet/scans").join(name);
    for part in ["color", "depth", "pose", "intrinsic", "instance-filt"] {
        fs::create_dir_all(folder.join(part))?;
    }
    let (mut vertices, mut instances) = (Vec::new(), String::new());
    for (index, (frame, labels)) in frames.iter().enumerate() {
        color_image(frame, 0).save(folder.join(format!("color/{index}.jpg")))?;
        depth_image(frame, 0).save(folder.join(format!("depth/{index}.png")))?;
        let value = |column: u32, row: u32| Luma([labels[(column as usize, row as usize)] as u16]);
        let image = ImageBuffer::<Luma<u16>, _>::from_fn(labels.width() as u32, labels.height() as u32, value);
        image.save(folder.join(format!("instance-filt/{index}.png")))?;
        fs::write(folder.join(format!("pose/{index}.txt")), matrix(frame.world_from_camera().to_row_major()))?;
        for row in (0..frame.height()).step_by(MESH_STEP) {
            for column in (0..frame.width()).step_by(MESH_STEP) {
                let (depth, id) = (frame.depth()[(column, row)], labels[(column, row)]);
                if depth > 0.0 {
                    let point = frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                    vertices.push(frame.world_from_camera().to_world(point).as_vec3().to_array());
                    instances += &format!("{}\n", if id == 0 { 0 } else { LABEL * 1000 + id });
                }
            }
        }
    }
    let (first, _) = frames.first().ok_or("a scene has no frames")?;
    let camera = first.intrinsics();
    let intrinsics =
        [camera.fx, 0.0, camera.cx, 0.0, 0.0, camera.fy, camera.cy, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    for camera in ["color", "depth"] {
        fs::write(folder.join(format!("intrinsic/intrinsic_{camera}.txt")), matrix(intrinsics))?;
    }
    fs::write(folder.join(format!("{name}_vh_clean_2.ply")), ply(&vertices))?;
    fs::create_dir_all(out.join("instances"))?;
    Ok(fs::write(out.join("instances").join(format!("{name}.txt")), instances)?)
}

fn matrix(entries: [impl Display; 16]) -> String {
    entries.chunks(4).map(|row| format!("{} {} {} {}\n", row[0], row[1], row[2], row[3])).collect()
}

fn ply(vertices: &[[f32; 3]]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         end_header\n",
        vertices.len()
    )
    .into_bytes();
    bytes.extend(vertices.iter().flatten().flat_map(|number| number.to_le_bytes()));
    bytes
}

/// Writes the images of a video of MVPd; returns its entries in `videos` and `annotations`. The loader derives the
/// camera from the size of the images, so they get a black margin that makes it equal to the scene's.
fn write_video(name: &str, frames: &[(RgbdFrame<'_>, SegmentMap)], split: &Path) -> Outcome<[Value; 2]> {
    let (mut images, mut annotations) = (Vec::new(), Vec::new());
    let folders = ["imagesRGB", "imagesDEPTH", "panomasksRGB"].map(|part| split.join(part).join(name));
    folders.iter().try_for_each(fs::create_dir_all)?;
    for (index, (frame, labels)) in frames.iter().enumerate() {
        let margin = margin(frame);
        let (color, mask) = (color_image(frame, margin), panoptic_image(labels, margin));
        let [color_file, file] = ["jpg", "png"].map(|ending| format!("{index:010}.{ending}"));
        color.save(folders[0].join(&color_file))?;
        depth_image(frame, margin).save(folders[1].join(&file))?;
        mask.save(folders[2].join(&file))?;
        let pose = frame.world_from_camera();
        let axes = pose.rotation();
        // Blender's cameras look along -z, with y up.
        let [x, y, z, w] = DQuat::from_mat3(&DMat3::from_cols(axes.x_axis, -axes.y_axis, -axes.z_axis)).to_array();
        images.push(json!({
            "id": index, "width": color.width(), "height": color.height(), "file_name": color_file,
            "depth_file_name": file, "camera_position": pose.translation().to_array(), "camera_rotation": [w, x, y, z],
        }));
        let info = |(id, area): (u32, usize)| json!({"id": id, "category_id": 1, "instance_id": id, "area": area, "bbox": [0, 0, 1, 1], "iscrowd": 0});
        let infos: Vec<Value> = labels.areas().into_iter().map(info).collect();
        annotations.push(json!({"image_id": index, "file_name": file, "segments_info": infos}));
    }
    Ok([
        json!({"video_id": 0, "video_name": name, "images": images}),
        json!({"video_id": 0, "video_name": name, "annotations": annotations}),
    ])
}

/// Margin on the left and right, pixels, that makes the image as wide as an image of MVPd's camera with the frame's
/// focal length. The margin above and below is three quarters of it.
fn margin(frame: &RgbdFrame<'_>) -> usize {
    let width = frame.intrinsics().fx / MVPD_FOCAL_LENGTH;
    ((width - frame.width() as f32) / 2.0).round().max(0.0) as usize
}

/// Adds a margin to an image of `size`; returns the new width, height and pixels, which are `empty` in the margin.
fn framed<T: Copy>(
    size: (usize, usize),
    margin: usize,
    empty: T,
    value: impl Fn(usize, usize) -> T,
) -> (u32, u32, Vec<T>) {
    let vertical = margin * 3 / 4;
    let (width, height) = (size.0 + 2 * margin, size.1 + 2 * vertical);
    let at = |place: usize| {
        let inside = (place % width).checked_sub(margin).zip((place / width).checked_sub(vertical));
        let inside = inside.filter(|(column, row)| *column < size.0 && *row < size.1);
        inside.map_or(empty, |(column, row)| value(column, row))
    };
    (width as u32, height as u32, (0..width * height).map(at).collect())
}

fn color_image(frame: &RgbdFrame<'_>, margin: usize) -> RgbImage {
    let size = (frame.width(), frame.height());
    let (width, height, pixels) = framed(size, margin, [0; 3], |column, row| frame.color()[(column, row)]);
    RgbImage::from_fn(width, height, |x, y| image::Rgb(pixels[(y * width + x) as usize]))
}

fn depth_image(frame: &RgbdFrame<'_>, margin: usize) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    let millimetres = |column: usize, row: usize| (1000.0 * frame.depth()[(column, row)]).round() as u16;
    let (width, height, pixels) = framed((frame.width(), frame.height()), margin, 0, millimetres);
    ImageBuffer::from_fn(width, height, |x, y| Luma([pixels[(y * width + x) as usize]]))
}

/// Ids as R + 256 G + 65536 B.
fn panoptic_image(labels: &SegmentMap, margin: usize) -> RgbImage {
    let (width, height, pixels) = framed(labels.size(), margin, 0, |column, row| labels[(column, row)]);
    RgbImage::from_fn(width, height, |x, y| {
        let [red, green, blue, _] = pixels[(y * width + x) as usize].to_le_bytes();
        image::Rgb([red, green, blue])
    })
}

fn document(videos: &[Value], annotations: &[Value]) -> Value {
    json!({"videos": videos, "annotations": annotations, "categories": [], "instances": []})
}

fn write_json(path: &Path, value: &Value) -> Outcome<()> {
    Ok(fs::write(path, value.to_string())?)
}

/// Packs a folder into a `.tar.gz` under a name.
fn pack(folder: &Path, name: &str, archive: &Path) -> Outcome<()> {
    fs::create_dir_all(archive.parent().ok_or("an archive without folder")?)?;
    let encoder = flate2::write::GzEncoder::new(fs::File::create(archive)?, flate2::Compression::fast());
    let mut builder = tar::Builder::new(encoder);
    builder.append_dir_all(name, folder)?;
    builder.into_inner()?.finish()?;
    Ok(())
}

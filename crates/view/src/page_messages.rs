//! The messages that the page reads in `live.js` of the viewer.
//!
//! Text messages are JSON objects with a `kind`. A frame is binary: the length of its JSON (32 bits, little-endian), the
//! JSON, a JPEG file, and the ids. The page draws them over the picture.

use crate::camera_path::CameraPath;
use crate::hub::{ListedObjects, PlacedFrame, Shared};
use crate::{ViewFrame, ViewObject};
use glam::{DQuat, DVec3, Vec3};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageError, RgbImage, imageops};
use serde_json::{Value, json};
use splatseg_geometry::{Image, ImageSizeError, Pose, SegmentMap};
use splatseg_output::{MapData, PlanData, encode_ids, segment_color};
use splatseg_places::FloorPlan;
use thiserror::Error;
use tungstenite::Message;

/// Maximum width of a picture, pixels.
const MAX_WIDTH: usize = 640;
const JPEG_QUALITY: u8 = 80;

/// A frame cannot be shown.
#[derive(Debug, Error)]
pub(crate) enum EncodeError {
    #[error(transparent)]
    Jpeg(#[from] ImageError),
    #[error(transparent)]
    Size(#[from] ImageSizeError),
    #[error("the colour image is too large")]
    TooLarge,
}

fn text(value: &Value) -> Message {
    Message::text(value.to_string())
}

/// Description of a server in the first message.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hello<'a> {
    pub(crate) scene: &'a str,
    /// Differs between servers.
    pub(crate) session: &'a str,
    /// Whether it answers questions of viewers.
    pub(crate) answers: bool,
}

impl<'a> Hello<'a> {
    pub(crate) fn of(shared: &'a Shared) -> Self {
        Self { scene: &shared.scene, session: &shared.session, answers: shared.answer.get().is_some() }
    }
}

/// The first message: `run` is the number of the server's run, `path` has the camera's places so far, relative to `origin`.
pub(crate) fn hello(
    Hello { scene, session, answers }: Hello<'_>,
    run: u64,
    origin: DVec3,
    path: &CameraPath,
) -> Message {
    text(&json!({
        "kind": "hello",
        "version": env!("CARGO_PKG_VERSION"),
        "scene": scene,
        "session": format!("{session}-{run}"),
        "answers": answers,
        "origin": origin,
        "path": path.encoded(origin),
        "frames": path.frames(),
    }))
}

/// Sent every second, so that the page notices a lost connection. `notes` are lines about the run.
pub(crate) fn status(frames_per_second: f32, viewers: usize, notes: &[String]) -> Message {
    text(&json!({ "kind": "status", "rate": frames_per_second, "viewers": viewers, "notes": notes }))
}

/// The list of objects.
pub(crate) fn objects(ListedObjects { objects, frames }: &ListedObjects) -> Message {
    let object = |object: &ViewObject| {
        json!({
            "id": object.id,
            "color": segment_color(object.id),
            "label": object.label,
            "box": object.oriented_box,
            "frames": object.frames,
            "state": object.state,
            "spans": object.seen,
        })
    };
    let objects: Vec<Value> = objects.iter().map(object).collect();
    text(&json!({ "kind": "objects", "frames": frames, "objects": objects }))
}

/// The map, relative to `origin`; `up` points up in world coordinates.
pub(crate) fn map(map: &MapData, up: Vec3, origin: DVec3) -> Message {
    text(&json!({ "kind": "map", "up": up, "origin": origin, "map": map }))
}

/// The plan of the map, for a page whose coordinates are relative to `origin`; `None` if it has none any more.
pub(crate) fn plan(plan: Option<&FloorPlan>, origin: DVec3) -> Message {
    text(&json!({ "kind": "plan", "plan": plan.map(|plan| PlanData::new(plan, origin)) }))
}

/// A frame with its result, at most [`MAX_WIDTH`] pixels wide. Poses are relative to `origin`.
pub(crate) fn frame(placed: &PlacedFrame, origin: DVec3, frames_per_second: f32) -> Result<Message, EncodeError> {
    let PlacedFrame { index, frame, world_from_camera } = placed;
    let (color, segments) = small(frame)?;
    let mut jpeg = Vec::new();
    let pixels: &[u8] = color.pixels().as_flattened();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode(
        pixels,
        color.width() as u32,
        color.height() as u32,
        ExtendedColorType::Rgb8,
    )?;
    let pose_state = match (world_from_camera, frame.status.is_pose_given) {
        (None, _) => "lost",
        (Some(_), true) => "given",
        (Some(_), false) => "tracked",
    };
    let header = json!({
        "kind": "frame",
        "index": index,
        "number": frame.number,
        "name": frame.name,
        "time": frame.timestamp.map(|time| time.as_secs_f64()),
        "origin": origin,
        "pose": world_from_camera.as_ref().map(|pose| pose_numbers(pose, origin)),
        "pose_state": pose_state,
        "camera": frame.intrinsics,
        "jpeg": jpeg.len(),
        "width": segments.width(),
        "height": segments.height(),
        "rate": frames_per_second,
        "dropped": frame.status.dropped,
        "delay": frame.status.delay.map(|delay| delay.as_secs_f64()),
        "detail": frame.status.detail,
        "lines": frame.status.lines,
    })
    .to_string();
    let length = u32::try_from(header.len()).map_err(|_| EncodeError::TooLarge)?;
    let bytes = [&length.to_le_bytes(), header.as_bytes(), &jpeg, &encode_ids(&segments)].concat();
    Ok(Message::binary(bytes))
}

/// Centre of the camera relative to `origin`, and rotation from camera to world as a quaternion x, y, z, w.
fn pose_numbers(pose: &Pose, origin: DVec3) -> [f64; 7] {
    let [x, y, z] = (pose.translation() - origin).to_array();
    let [a, b, c, d] = DQuat::from_mat3(&pose.rotation()).normalize().to_array();
    [x, y, z, a, b, c, d]
}

/// The images of a frame, reduced to at most [`MAX_WIDTH`] columns.
fn small(frame: &ViewFrame) -> Result<(Image<[u8; 3]>, SegmentMap), EncodeError> {
    let (width, height) = frame.color.size();
    if width <= MAX_WIDTH || frame.segments.size() != (width, height) {
        return Ok((frame.color.clone(), frame.segments.clone()));
    }
    let (columns, rows) = (MAX_WIDTH, (height * MAX_WIDTH).div_ceil(width));
    let size = |side: usize| u32::try_from(side).map_err(|_| EncodeError::TooLarge);
    let pixels = frame.color.pixels().as_flattened().to_vec();
    let large = RgbImage::from_raw(size(width)?, size(height)?, pixels).ok_or(EncodeError::TooLarge)?;
    let reduced = imageops::thumbnail(&large, size(columns)?, size(rows)?);
    let color = Image::from_pixels(columns, rows, reduced.pixels().map(|pixel| pixel.0).collect())?;
    let segments = Image::from_fn(columns, rows, |column, row| {
        frame.segments[((2 * column + 1) * width / (2 * columns), (2 * row + 1) * height / (2 * rows))]
    });
    Ok((color, segments))
}

//! `splatseg inspect FOLDER`: shows what a run would read from a scene, without reading all frames.

use super::{InspectArguments, print_json};
use crate::Failure;
use crate::terminal::counted;
use serde_json::{Value, json};
use splatseg_dataset::{DatasetSettings, FrameSource, FrameStream, GroundTruth, LeftOut, Scene, has_depth, open_scene};
use splatseg_geometry::CameraFrame;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// The largest value of the setting: no image that can be read is downscaled.
const MAX_PIXELS: usize = 67_108_864;

/// Returns true if a path is that of a scene, not of a checkpoint. Folders never are checkpoints.
pub fn is_scene(path: &Path) -> bool {
    path.is_dir() || splatseg_dataset::is_scene(path)
}

/// Returns true for a video without depth.
fn is_video(path: &Path) -> bool {
    path.is_file() && !has_depth(path, &DatasetSettings::default())
}

/// Prints what is known about a scene from its files, its first good frame, and the time of its last one.
pub fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    arguments.refuse_checkpoint_options("a scene")?;
    let mut settings = arguments.topics.settings(&arguments.camera)?;
    // The camera is that of the stored images.
    settings.max_pixels = MAX_PIXELS;
    // Decoding a whole video may take minutes.
    let is_video = is_video(&arguments.file);
    if is_video {
        settings.max_frames = Some(1);
    }
    let scene = open_scene(&arguments.file, &settings).map_err(Failure::input)?;
    if arguments.json {
        let mut described = described(&arguments.file, &scene, &settings)?;
        if is_video {
            (described["frames"], described["last_s"]) = (Value::Null, Value::Null);
        }
        return print_json(&described);
    }
    say!("file           {}", arguments.file.display());
    let format = scene.format().map_or("a scene", |format| format.name());
    say!("kind           scene, format {format}");
    if is_video {
        say!("frames         not counted: only the first one was decoded");
    } else {
        say!("frames         {}", scene.frame_count());
    }
    print_all("left out", scene.left_out());
    print_first_frame(&scene, &settings)?;
    say!("poses          {}", if scene.has_poses() { "recorded" } else { "none: a run tracks the camera" });
    print_all("no pose", scene.without_pose());
    say!("ground truth   {}", if scene.has_ground_truth() { "segments" } else { "none" });
    scene.sources().iter().for_each(|source| say!("  {source}"));
    Ok(())
}

/// The content of `--json`.
fn described(path: &Path, scene: &Arc<dyn Scene>, settings: &DatasetSettings) -> Result<Value, Failure> {
    let mut stream = FrameStream::open(Arc::clone(scene), settings, GroundTruth::Skip).map_err(Failure::input)?;
    let Some(first) = stream.find_map(Result::ok).map(|first| first.frame) else {
        return Err(Failure::input(format!("{}: none of its frames can be read", scene.name())));
    };
    let left_out = |kind: &LeftOut| json!({"frames": kind.count, "what": kind.what});
    let camera = first.intrinsics();
    let seconds = |time: Option<Duration>| time.map(|time| time.as_secs_f64());
    Ok(json!({
        "file": path,
        "kind": "scene",
        "format": scene.format().map(|format| format.name()),
        "frames": scene.frame_count(),
        "left_out": scene.left_out().iter().map(left_out).collect::<Vec<_>>(),
        "width": first.width(),
        "height": first.height(),
        "camera": {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy},
        "first_s": seconds(first.timestamp()),
        "last_s": seconds(last_time(scene.as_ref())),
        "has_depth": scene.has_depth(),
        "has_poses": scene.has_poses(),
        "has_ground_truth": scene.has_ground_truth(),
        "sources": scene.sources(),
    }))
}

fn print_all(title: &str, kinds: &[LeftOut]) {
    for kind in kinds {
        say!("  {title}: {} {}", counted(kind.count, "frame"), kind.what);
    }
}

/// Prints sizes, camera and times. Fails if no frame can be read.
fn print_first_frame(scene: &Arc<dyn Scene>, settings: &DatasetSettings) -> Result<(), Failure> {
    let mut stream = FrameStream::open(Arc::clone(scene), settings, GroundTruth::Skip).map_err(Failure::input)?;
    let description = stream.description().clone();
    let mut first_error = None;
    let first = stream.find_map(|frame| frame.map_err(|error| first_error.get_or_insert(error).index).ok());
    if let Some(error) = &first_error {
        say!("damaged        {error}");
    }
    let Some(first) = first.map(|first| first.frame) else {
        return Err(Failure::input(format!("{}: none of its frames can be read", scene.name())));
    };
    let stored = description.color_size.filter(|size| *size != (first.width(), first.height()));
    let stored = stored.map_or_else(String::new, |(width, height)| format!(", colour stored as {width}x{height}"));
    say!("size           {}x{}{stored}", first.width(), first.height());
    let camera = first.intrinsics();
    say!("camera         fx {}, fy {}, cx {}, cy {}", camera.fx, camera.fy, camera.cx, camera.cy);
    match description.depth_range_m {
        _ if !scene.has_depth() => say!("depth          none: a run needs a depth predictor (--depth-weights)"),
        Some((nearest, farthest)) => say!("depth          {nearest:.2} to {farthest:.2} m in the first frame"),
        None => say!("depth          none in the first frame"),
    }
    say!("times          {}", times_text(scene.as_ref(), &first));
    Ok(())
}

fn times_text(scene: &dyn Scene, first: &CameraFrame<'_>) -> String {
    let Some(start) = first.timestamp() else { return "none".to_owned() };
    let seconds = |time: Duration| time.as_secs_f64();
    let is_alone = scene.frame_count() == 1;
    match last_time(scene).filter(|_| !is_alone) {
        Some(end) => {
            let (start, end) = (seconds(start), seconds(end));
            format!("{start:.3} s to {end:.3} s, {:.1} s", end - start)
        }
        None if is_alone => format!("{:.3} s, of one frame", seconds(start)),
        None => format!("from {:.3} s, that of the last frame is unknown", seconds(start)),
    }
}

/// The time of the last frame, if it has one and can be read.
fn last_time(scene: &dyn Scene) -> Option<Duration> {
    scene.read_recorded(scene.frame_count().checked_sub(1)?).ok()?.frame.timestamp()
}

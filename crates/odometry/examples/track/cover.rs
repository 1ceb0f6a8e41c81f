//! A lens that is covered for a while, and how far the map is when the camera is searched for.

use splatseg_geometry::{CameraFrame, Image, Pose};
use std::error::Error;
use std::ops::Range;

/// A view is mapped if a keyframe is this close to it, metres and degrees.
const MAPPED: (f64, f64) = (0.5, 30.0);

/// The frames that `FROM+COUNT` means.
pub fn covered_frames(text: &str) -> Result<Range<usize>, Box<dyn Error>> {
    let (from, count) = text.split_once('+').ok_or("expected FROM+COUNT")?;
    let from: usize = from.parse()?;
    Ok(from..from + count.parse::<usize>()?)
}

/// The frame with a covered lens: black and without depth.
pub fn covered(frame: &CameraFrame<'_>) -> Result<CameraFrame<'static>, Box<dyn Error>> {
    let (width, height) = (frame.width(), frame.height());
    let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, 0.0));
    Ok(CameraFrame::new(frame.name(), color, depth, *frame.intrinsics())?)
}

/// Distance of the keyframe nearest to a pose, relative to [`MAPPED`]: metres and degrees.
pub fn nearest(keyframes: impl Iterator<Item = Pose>, truth: &Pose) -> (f64, f64) {
    let relative = |(metres, degrees): &(f64, f64)| (metres / MAPPED.0).max(degrees / MAPPED.1);
    let distances = keyframes.map(|pose| apart(&pose, truth));
    let nearest = distances.min_by(|one, other| relative(one).total_cmp(&relative(other)));
    nearest.unwrap_or((f64::INFINITY, f64::INFINITY))
}

/// True if a keyframe at this distance shows the view.
pub fn is_mapped((metres, degrees): (f64, f64)) -> bool {
    metres <= MAPPED.0 && degrees <= MAPPED.1
}

/// Distance of two poses, metres, and angle between them, degrees.
pub fn apart(one: &Pose, other: &Pose) -> (f64, f64) {
    let rotation = (one.inverse() * *other).rotation();
    let trace = rotation.x_axis.x + rotation.y_axis.y + rotation.z_axis.z;
    let angle = ((trace - 1.0) * 0.5).clamp(-1.0, 1.0).acos().to_degrees();
    (one.translation().distance(other.translation()), angle)
}

//! Assignment of poses to the colour images of a plain folder: by time if both have times, otherwise in order.

use super::names::{COLOR_FOLDER, Images};
use super::poses::ListedPose;
use crate::DatasetError;
use crate::recorded_poses::no_common_time;
use crate::text::shortened;
use crate::tum::nearest_time;
use std::path::Path;

/// Maximum time between an image and its pose, seconds.
pub(super) const MAX_SECONDS_APART: f64 = 0.02;

/// Assigns a pose to every colour image, `None` if no pose was measured near its time. `path` is the list of poses, for
/// errors.
///
/// # Errors
/// If no pose is near any image, or, without times, there are not as many poses as images.
pub(super) fn poses_of(
    color: &Images,
    mut poses: Vec<ListedPose>,
    path: &Path,
) -> Result<Vec<Option<ListedPose>>, DatasetError> {
    let pose_times: Option<Vec<f64>> = poses.iter().map(|pose| pose.seconds).collect();
    if let (Some(times), Some(mut pose_times), false) = (color.times(), pose_times, poses.is_empty()) {
        poses.sort_by(|a, b| a.seconds.unwrap_or(0.0).total_cmp(&b.seconds.unwrap_or(0.0)));
        pose_times.sort_by(f64::total_cmp);
        let pose_at = |time: &f64| poses.get(nearest_time(&pose_times, *time, MAX_SECONDS_APART)?).copied();
        let assigned: Vec<_> = times.iter().map(pose_at).collect();
        if assigned.iter().all(Option::is_none) {
            return Err(no_common_time(path, &pose_times, &times));
        }
        return Ok(assigned);
    }
    if poses.len() == color.images.len() {
        return Ok(poses.into_iter().map(Some).collect());
    }
    Err(time_missing(color, &poses, path).unwrap_or_else(|| {
        let images = color.images.len();
        DatasetError::Field {
            path: path.to_owned(),
            field: "number of poses".to_owned(),
            found: poses.len().to_string(),
            expected: format!("{images}, as {COLOR_FOLDER}/ has {images} images"),
        }
    }))
}

/// Returns the error for a list of poses that cannot be assigned by time because of some images or lines without one;
/// `None` if no image is named by time, or no pose has a time.
fn time_missing(color: &Images, poses: &[ListedPose], path: &Path) -> Option<DatasetError> {
    let named_by_time = color.images.iter().any(|image| image.seconds.is_some());
    if !named_by_time || poses.is_empty() {
        return None;
    }
    let counts = format!("{} poses for {} images", poses.len(), color.images.len());
    let (place, field, found) = match color.images.iter().find(|image| image.seconds.is_none()) {
        Some(image) => (image.path.as_path(), "name", shortened(&image.stem)),
        None => (path, "poses", "no times".to_owned()),
    };
    Some(DatasetError::Field {
        path: place.to_owned(),
        field: field.to_owned(),
        found,
        expected: format!("a time, as in the names of other images ({counts} cannot be assigned in order)"),
    })
}

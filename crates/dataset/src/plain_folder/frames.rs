//! The frames of a plain folder: images of one name, and their poses.

use super::names::{Images, NamedImage};
use super::poses::ListedPose;
use crate::LeftOut;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A colour and a depth image, and the pose if there is one.
#[derive(Clone, Debug)]
pub(super) struct FolderFrame {
    pub(super) name: String,
    pub(super) timestamp: Option<Duration>,
    pub(super) color: PathBuf,
    /// `None` if depth is to be predicted.
    pub(super) depth: Option<PathBuf>,
    pub(super) pose: Option<ListedPose>,
}

/// Returns the frames that have colour and depth, and the counts of images that have no partner.
pub(super) fn frames_of(
    color: &Images,
    depth: &Images,
    poses: &[Option<ListedPose>],
) -> (Vec<FolderFrame>, Vec<LeftOut>) {
    let mut depth_files: BTreeMap<&str, &Path> =
        depth.images.iter().map(|image| (image.stem.as_str(), image.path.as_path())).collect();
    let mut without_depth = 0;
    let mut frames = Vec::new();
    for (image, pose) in color.images.iter().zip(poses) {
        let Some(depth) = depth_files.remove(image.stem.as_str()) else {
            without_depth += 1;
            continue;
        };
        frames.push(frame_of(image, Some(depth.to_owned()), *pose));
    }
    let left_out = LeftOut::list([
        (without_depth, "without a depth image of the same name".to_owned()),
        (depth_files.len(), "without a colour image of the same name".to_owned()),
        (color.unreadable + depth.unreadable, "with names that are not UTF-8".to_owned()),
    ]);
    (frames, left_out)
}

/// Returns the frames of images without depth, and the counts of images that are left out.
pub(super) fn frames_without_depth(color: &Images, poses: &[Option<ListedPose>]) -> (Vec<FolderFrame>, Vec<LeftOut>) {
    let frames = color.images.iter().zip(poses).map(|(image, pose)| frame_of(image, None, *pose)).collect();
    (frames, LeftOut::list([(color.unreadable, "with names that are not UTF-8".to_owned())]))
}

fn frame_of(image: &NamedImage, depth: Option<PathBuf>, pose: Option<ListedPose>) -> FolderFrame {
    let seconds = image.seconds.or(pose.and_then(|pose| pose.seconds));
    FolderFrame {
        name: image.stem.clone(),
        timestamp: seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()),
        color: image.path.clone(),
        depth,
        pose,
    }
}

//! The world frame in `/tf`: the one in which the camera's poses are.

use super::contents::{Content, Contents};
use super::frame_names::{bare_frame, listed};
use super::transform_tree::{Purpose, Route, TransformTree};
use crate::DatasetSettings;

/// Names of world frames (REP 105) without their namespace, the outermost first.
const WORLDS: [&str; 6] = ["earth", "map", "world", "odom", "odom_combined", "vicon"];

/// The frames between which `/tf` gives the camera's poses.
#[derive(Clone, Debug)]
pub(super) struct TreePoses<'a> {
    /// Frame whose poses are used: the camera's, or the one that the setting `pose_frame` names instead.
    pub(super) body: &'a str,
    pub(super) world: &'a str,
    /// `None` if they are not connected.
    pub(super) route: Option<Route>,
    /// Why the world is not the root of the tree, if it was not named.
    pub(super) remark: Option<String>,
    /// Frames that move relative to the body, one of which may be the world, if none is certain.
    pub(super) candidates: Vec<&'a str>,
}

impl TreePoses<'_> {
    /// Returns true if `/tf` moves the body.
    pub(super) fn moves(&self, tree: &TransformTree) -> bool {
        self.route.as_ref().is_some_and(|route| tree.is_moving(route))
    }
}

/// Finds the poses of a camera, whose images are in the frame `camera`, in the transform tree.
///
/// The world is the frame that the settings name, otherwise the root above the camera if the camera moves in it. Some
/// systems publish the inverse transform, so that the world is below the camera: then it is known by its name, or because
/// nothing else moves.
pub(super) fn tree_poses<'a>(contents: &'a Contents, settings: &'a DatasetSettings, camera: &'a str) -> TreePoses<'a> {
    let tree = &contents.tree;
    let named = settings.pose_frame.as_deref().map(bare_frame);
    let body = named.filter(|body| tree.route(camera, body, Purpose::Fixed).is_none()).unwrap_or(camera);
    let to = |world: &'a str, remark: Option<String>| {
        let route = tree.route(body, world, Purpose::Poses).filter(|_| tree.has(body));
        TreePoses { body, world, route, remark, candidates: Vec::new() }
    };
    if let Some(world) = settings.world_frame.as_deref().map(bare_frame) {
        return to(world, None);
    }
    let upward = to(tree.ancestors(body).last().copied().unwrap_or(body), None);
    let is_stationary = settings.pose.as_deref().is_some_and(|name| bare_frame(name) == "tf_static");
    if is_stationary || upward.moves(tree) {
        return upward;
    }
    let candidates = tree.moving_from(body);
    match below(tree, upward.world, &candidates) {
        Some((world, why)) => {
            let remark = format!(
                "{world} is below {} in /tf, which publishes the inverse of the camera's poses: it is taken as the world, \
                 because {why}; --world-frame names another one",
                upward.world
            );
            to(world, Some(remark))
        }
        None => TreePoses { candidates, ..upward },
    }
}

/// Returns the world among the frames that move relative to the camera, none of which is above it, and the reason; `None`
/// if there is none for certain. `root` is the root above the camera.
fn below<'a>(tree: &TransformTree, root: &str, candidates: &[&'a str]) -> Option<(&'a str, &'static str)> {
    let name = |frame: &str| frame.rsplit('/').next().unwrap_or_default().to_ascii_lowercase();
    for world in WORLDS {
        let mut named = candidates.iter().filter(|frame| name(frame) == world);
        if let Some(first) = named.next() {
            return named.next().is_none().then_some((first, "its name is that of a world"));
        }
    }
    match candidates {
        // The joints of a robot move, too, but the root of a robot's frames is not the camera.
        [only] if tree.is_root(root) && is_image_frame(root) => Some((only, "no other frame moves")),
        _ => None,
    }
}

/// Returns true if the name of a frame is that of a camera's.
fn is_image_frame(frame: &str) -> bool {
    let frame = frame.to_ascii_lowercase();
    ["optical", "camera", "cam", "rgb", "color", "colour"].iter().any(|part| frame.contains(part))
}

/// Describes why a recording has no poses. `camera` is the frame of the colour images.
pub(super) fn no_poses_text(contents: &Contents, settings: &DatasetSettings, camera: &str) -> String {
    let tree = &contents.tree;
    let poses = tree_poses(contents, settings, camera);
    let moving = tree.moving_frames();
    let names = |frames: &[&str]| listed(frames.iter().map(|frame| (*frame).to_owned()).collect());
    let mut text = if !poses.candidates.is_empty() {
        format!(
            "none: {camera} has no parent in /tf in which it moves; these move relative to it: {}; if one of them is the \
             world, name it with --world-frame",
            names(&poses.candidates)
        )
    } else if poses.world != camera {
        format!(
            "none: no topic has poses, and {camera} does not move in {}; for a stationary camera use --pose /tf_static",
            poses.world
        )
    } else if let Some(first) = moving.first() {
        format!(
            "none: /tf has poses of {}, but nothing connects {camera:?} to them: record /tf_static, or take the poses of a \
             frame for the camera's with --pose /tf --pose-frame {first}",
            names(&moving)
        )
    } else if tree.has(camera) {
        format!("none: no topic has poses, and nothing moves relative to {camera:?} in /tf")
    } else {
        format!("none: no topic has poses, and {camera:?} is not in /tf")
    };
    for topic in &contents.topics {
        match (&topic.content, &topic.unreadable) {
            (Content::Path(path), _) if !path.is_empty() => {
                text += &format!("; {} ({}) only corrects poses", topic.name, topic.type_name);
            }
            (Content::Poses(_), Some((count, first))) => {
                text += &format!("; {count} messages of {} cannot be read: {first}", topic.name);
            }
            (Content::Poses(poses), None) if topic.messages > 0 && poses.timeline.is_empty() => {
                text += &format!("; none of the {} messages of {} has a valid pose", topic.messages, topic.name);
            }
            _ => {}
        }
    }
    text
}

//! Corrected paths in a recording (`nav_msgs/msg/Path`), as a SLAM system publishes them when it closes a loop.

use super::choice::{NO_POSES, PoseChoice, listed};
use super::clock::Recorded;
use super::contents::{Content, Topic};
use super::frame_names::{bare_frame, frame_name};
use super::frames::{FrameMaker, PairedFrame};
use super::poses::rigid_of_pose;
use super::transforms::Rigid;
use super::world::tree_poses;
use crate::DatasetError;
use crate::corrections::CorrectionList;
use splatseg_ros::{CdrError, NavPath, from_cdr};
use std::collections::BTreeMap;

/// Poses of a path that differ from the last one of the same time by less are not kept: metres, and the cosine of half
/// the angle. A tenth of the least correction.
const SAME_SHIFT: f64 = 1e-4;
const SAME_HALF_TURN: f64 = 4.4e-5;

/// A pose of a path, when it first appears and whenever it changes.
#[derive(Clone, Copy, Debug)]
struct PathPose {
    stamp: i64,
    /// Recording time of the path.
    recorded: Recorded,
    transform: Rigid,
}

/// The poses in the messages of a topic.
#[derive(Debug, Default)]
pub(crate) struct PathPoses {
    /// Coordinate frame of the paths.
    world: String,
    /// In file order.
    poses: Vec<PathPose>,
    latest: BTreeMap<i64, Rigid>,
}

impl PathPoses {
    /// Returns true if no message had poses with times.
    pub(crate) fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Records the poses of a message that have changed. Returns the memory they use, bytes.
    pub(crate) fn record(&mut self, data: &[u8], recorded: Recorded) -> Result<u64, CdrError> {
        let path: NavPath = from_cdr(data)?;
        let stamped = path.poses.iter().map(|pose| (pose.header.stamp.nanoseconds(), rigid_of_pose(&pose.pose)));
        let stamped: BTreeMap<i64, Rigid> =
            stamped.filter(|(stamp, _)| *stamp > 0).filter_map(|(stamp, pose)| Some((stamp, pose?))).collect();
        // The poses of a planned path have one time or none.
        if stamped.len() == 1 && path.poses.len() > 1 {
            return Ok(0);
        }
        if self.poses.is_empty() {
            self.world = frame_name(&path.header.frame_id);
        }
        let before = self.poses.len();
        for (stamp, transform) in stamped {
            if self.latest.get(&stamp).is_none_or(|old| differ(old, &transform)) {
                self.latest.insert(stamp, transform);
                self.poses.push(PathPose { stamp, recorded, transform });
            }
        }
        Ok(((self.poses.len() - before) * 3 * size_of::<PathPose>()) as u64)
    }
}

fn differ(one: &Rigid, other: &Rigid) -> bool {
    one.translation.distance(other.translation) > SAME_SHIFT
        || one.rotation.dot(other.rotation).abs() < SAME_HALF_TURN.cos()
}

impl<'a> FrameMaker<'a> {
    /// Returns the corrections of the frames' poses, and their description if there is a topic with paths.
    ///
    /// # Errors
    /// If the topic named in the settings has no paths with times.
    pub(crate) fn corrections(&self, frames: &[PairedFrame]) -> Result<(CorrectionList, Option<String>), DatasetError> {
        let nothing = |why: String| Ok((CorrectionList::default(), Some(format!("corrected poses: none: {why}"))));
        let (topic, path) = match self.path_topics()?.as_slice() {
            [] => return Ok((CorrectionList::default(), None)),
            [only] => *only,
            several => {
                let names = listed(several.iter().map(|(topic, _)| topic.name.clone()).collect());
                return nothing(format!("choose one of {names} with --set dataset.corrections=TOPIC"));
            }
        };
        if self.choice.color.1.timeline.stretches.len() > 1 {
            return nothing(format!("the clock was set back, so that the times in {} are ambiguous", topic.name));
        }
        let Some(world) = self.world_of_poses() else {
            return nothing("the frames have no poses to correct".to_owned());
        };
        let tree = &self.contents.tree;
        let world_from_path = if path.world.is_empty() || path.world == world {
            Some(Rigid::IDENTITY)
        } else {
            tree.fixed_transform(&path.world, world)
        };
        let Some(world_from_path) = world_from_path else {
            return nothing(format!("{} is in {}, the poses are in {world}", topic.name, path.world));
        };
        let (body, body_from_camera) = self.path_body();
        let list = self.matched(frames, path, |pose| world_from_path.after(pose).after(&body_from_camera));
        let count = list.corrected_frames();
        let of = if list.is_empty() { "none of the frames".to_owned() } else { format!("{count} frames") };
        Ok((list, Some(format!("corrected poses: {} ({}) of {body}: {of}", topic.name, topic.type_name))))
    }

    /// Returns the topics with paths that may be used: the one named in the settings, or all.
    fn path_topics(&self) -> Result<Vec<(&'a Topic, &'a PathPoses)>, DatasetError> {
        let all = self.contents.topics.iter().filter_map(|topic| match &topic.content {
            Content::Path(path) if !path.poses.is_empty() => Some((topic, path)),
            _ => None,
        });
        let all: Vec<_> = all.collect();
        match self.settings.corrections.as_deref() {
            None => Ok(all),
            Some(NO_POSES) => Ok(Vec::new()),
            Some(name) => {
                let named = self.contents.find(name);
                let is_named = |topic: &Topic| named.is_some_and(|named| std::ptr::eq(named, topic));
                let found = all.iter().find(|(topic, _)| is_named(topic)).copied();
                found.map(|found| vec![found]).ok_or_else(|| {
                    let names = listed(all.iter().map(|(topic, _)| topic.name.clone()).collect());
                    let expected = format!("{NO_POSES}, or a topic of paths whose poses have times: {names}");
                    self.error("dataset.corrections", format!("{name:?}"), expected)
                })
            }
        }
    }

    /// Returns the coordinate frame of the frames' poses; `None` if they have none.
    fn world_of_poses(&self) -> Option<&str> {
        let camera = self.choice.color.1.frame.as_str();
        match self.choice.pose {
            PoseChoice::Tree => Some(tree_poses(self.contents, self.settings, camera).world),
            PoseChoice::Topic(_, poses) => Some(&poses.world),
            PoseChoice::None(_) => None,
        }
    }

    /// Returns the frame whose poses are in a path, and its transform from the camera: the same as that of a pose topic;
    /// with `/tf`, the camera's topmost ancestor that does not move relative to it, e.g. the robot's base.
    fn path_body(&self) -> (&str, Rigid) {
        let tree = &self.contents.tree;
        let camera = self.choice.color.1.frame.as_str();
        let fixed = |body: &str| tree.fixed_transform(camera, body);
        let named = self.settings.pose_frame.as_deref().map(bare_frame).or(match self.choice.pose {
            PoseChoice::Topic(_, poses) => Some(poses.body.as_deref().unwrap_or(camera)),
            _ => None,
        });
        let topmost = || tree.ancestors(camera).into_iter().rev().find(|ancestor| fixed(ancestor).is_some());
        let body = named.or_else(topmost).unwrap_or(camera);
        fixed(body).map_or((camera, Rigid::IDENTITY), |transform| (body, transform))
    }

    /// Assigns the poses of a path to the frames nearest in time, and to the frames with which they become known.
    fn matched(
        &self,
        frames: &[PairedFrame],
        path: &PathPoses,
        world_from_camera: impl Fn(&Rigid) -> Rigid,
    ) -> CorrectionList {
        let order = self.contents.order;
        let nearest = |stamp: i64| {
            let after = frames.partition_point(|frame| frame.stamp < stamp);
            let candidates = [after.checked_sub(1), Some(after)].into_iter().flatten();
            let apart = |index: &usize| frames.get(*index).map(|frame| frame.stamp.abs_diff(stamp));
            let found = candidates.filter(|index| apart(index).is_some()).min_by_key(apart)?;
            (apart(&found)? <= self.tolerance().nearest.unsigned_abs()).then_some(found)
        };
        let mut list = CorrectionList::default();
        for pose in &path.poses {
            let known = order.of(pose.recorded);
            let Some(index) = nearest(pose.stamp) else { continue };
            let Some(frame) = frames.get(index).filter(|frame| order.of(frame.recorded) <= known) else { continue };
            let known_with = frames.partition_point(|frame| order.of(frame.recorded) < known).max(index + 1);
            // A path that was recorded after the last frame corrects nothing any more.
            if known_with < frames.len()
                && let Ok(corrected) = world_from_camera(&pose.transform).to_pose()
            {
                list.add(known_with, index, frame.pose, corrected);
            }
        }
        list
    }
}

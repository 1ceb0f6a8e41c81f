//! Corrections of the frames' poses from the corrected paths of a recording (`paths.rs`).

use super::choice::{NO_POSES, PoseChoice};
use super::contents::{Content, Topic};
use super::frame_names::{bare_frame, listed};
use super::frames::{FrameMaker, PairedFrame};
use super::paths::PathPoses;
use super::transforms::Rigid;
use crate::DatasetError;
use crate::corrections::CorrectionList;

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
        let Some(world) = self.world_frame() else {
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
            Content::Path(path) if !path.is_empty() => Some((topic, path)),
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

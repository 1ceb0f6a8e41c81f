//! Matching of a stream's messages into frames: choice of topics, pairs, poses, and what is dropped.

use super::counts::DropCounts;
use super::matcher::FrameMatcher;
use super::stream_topics::StreamTopics;
use super::undecoded_frame::UndecodedFrame;
use super::waiting::Pair;
use crate::ros_topics::choice::{NO_POSES, is_tree};
use crate::ros_topics::contents::{Content, StampedPlace};
use crate::ros_topics::frames::{PairedFrame, PoseSource, paired, tolerance};
use crate::ros_topics::stream_clock::SetBack;
use splatseg_geometry::Pose;
use std::sync::Arc;

impl FrameMatcher {
    /// Completes frames as far as possible. With `is_end`, nothing more is waited for.
    pub(super) fn match_frames(&mut self, is_end: bool) {
        if self.chosen.is_none() {
            self.choose(is_end);
        }
        self.pair_images(is_end);
        self.find_poses(is_end);
    }

    /// Chooses topics if it is time.
    fn choose(&mut self, is_end: bool) {
        let settings = &self.settings;
        // Otherwise a part of the tree that comes later could change the meaning of the poses.
        let names_poses = match settings.pose.as_deref() {
            Some(name) if name == NO_POSES => true,
            Some(name) if !is_tree(name) => false,
            _ => settings.world_frame.is_some(),
        };
        let names_all = settings.color.is_some() && settings.depth.is_some() && names_poses;
        let is_time = is_end || names_all || self.elapsed >= self.limits.settle;
        // Frames that must not be missed would soon be dropped.
        let is_full = self.keeps_frames && self.images.bytes() > self.limits.bytes / 2;
        if self.images.len() == 0 || !(is_time || is_full) {
            return;
        }
        match StreamTopics::new(&self.contents, settings) {
            // They may still come.
            Ok(chosen) if !is_time && matches!(chosen.poses, PoseSource::None) => {}
            Ok(chosen) => {
                self.undecided = None;
                self.chosen = Some(chosen);
                self.ignore_others();
            }
            Err(error) => self.undecided = Some(error),
        }
    }

    /// Ignores the images of topics that were not chosen.
    fn ignore_others(&mut self) {
        for index in 0..self.contents.topics.len() {
            let Some((chosen, topic)) = self.chosen.as_ref().zip(self.contents.topics.get(index)) else { return };
            if chosen.uses(index, topic) {
                continue;
            }
            let Some(timeline) = self.timeline(index) else { continue };
            for image in timeline.take_all().into_iter().chain(timeline.take_held()) {
                self.images.remove(image.recorded.number);
                self.counts.images = self.counts.images.saturating_sub(1);
                self.counts.ignored += 1;
            }
        }
    }

    /// Prepares reading images with the latest camera infos. Returns false if the last one is invalid, and removes it.
    pub(super) fn renew_reader(&mut self) -> bool {
        let Some(chosen) = &mut self.chosen else { return true };
        let is_valid = chosen.renew_reader(&self.contents, &self.settings).is_ok();
        if !is_valid {
            for topic in &mut self.contents.topics {
                if let Content::Calibrations { list, .. } = &mut topic.content
                    && list.len() > 1
                    && list.last().is_some_and(|(place, _)| place.recorded.number == self.number)
                {
                    list.pop();
                }
            }
        }
        is_valid
    }

    /// Pairs images that belong together for certain, in time order.
    fn pair_images(&mut self, is_end: bool) {
        let Some((color, depth)) = self.chosen.as_ref().map(|chosen| (chosen.color, chosen.depth)) else { return };
        let of = |matcher: &mut Self, topic| {
            matcher.timeline(topic).map(|images| (images.messages().to_vec(), images.newest()))
        };
        let (Some((color, newest_color)), Some((depth, newest_depth))) = (of(self, color), of(self, depth)) else {
            return;
        };
        let newest = newest_color.min(newest_depth);
        for (color, depth) in paired(&color, &depth, self.settings.max_time_difference_ms) {
            let received = [&color, &depth].map(|image| self.images.get(image).map(|image| image.elapsed));
            let since = received.into_iter().flatten().max().unwrap_or_default();
            let apart = color.stamp.saturating_sub(depth.stamp).saturating_abs();
            // Later images that are closer to one of them have stamps before this.
            let decided = color.stamp.max(depth.stamp).saturating_add(apart);
            let waited = self.elapsed.saturating_sub(since) >= self.limits.pair_wait;
            if !(apart == 0 || newest >= Some(decided) || waited || is_end) {
                break;
            }
            self.accept(Pair { color, depth, since });
        }
    }

    fn accept(&mut self, pair: Pair) {
        let Some((color, depth)) = self.chosen.as_ref().map(|chosen| (chosen.color, chosen.depth)) else { return };
        for (topic, image) in [(color, pair.color), (depth, pair.depth)] {
            if let Some(timeline) = self.timeline(topic) {
                timeline.take_if(|other| other.recorded.number == image.recorded.number);
            }
        }
        self.paired = Some((pair.color.stamp, pair.depth.stamp));
        self.pairs.push_back(pair);
        let limit = tolerance(&self.settings).nearest;
        let earliest_depth = pair.color.stamp.saturating_sub(limit);
        for (topic, earliest) in [(color, pair.color.stamp), (depth, earliest_depth)] {
            let unpaired = self.timeline(topic).map(|images| images.take_if(|image| image.stamp < earliest));
            self.drop_images(unpaired.unwrap_or_default(), |dropped| &mut dropped.unpaired);
        }
    }

    /// Drops images of a topic that are not after those of the newest pair.
    pub(super) fn drop_late(&mut self, topic: usize) {
        let limit = tolerance(&self.settings).nearest;
        let Some(((color, depth), chosen)) = self.paired.zip(self.chosen.as_ref()) else { return };
        let (used, earliest) = match (topic == chosen.color, self.depth_is_ahead) {
            (true, _) => (color, color),
            (false, false) => (depth, color.saturating_sub(limit)),
            (false, true) => return,
        };
        let Some(timeline) = self.timeline(topic) else { return };
        let repeated = timeline.take_if(|image| image.stamp == used);
        let late = timeline.take_if(|image| image.stamp < earliest);
        self.drop_images(repeated, |dropped| &mut dropped.repeated);
        self.drop_images(late, |dropped| &mut dropped.late);
    }

    /// Completes pairs whose poses are known, or have been waited for long enough, in order.
    fn find_poses(&mut self, is_end: bool) {
        while let Some((pair, chosen)) = self.pairs.front().copied().zip(self.chosen.as_ref()) {
            let pose = chosen.poses.at(&self.contents, pair.color.instant(), tolerance(&self.settings));
            let has_source = !matches!(chosen.poses, PoseSource::None);
            let is_known = pose.is_some() && chosen.poses.reaches(&self.contents, pair.color.stamp);
            let waited = self.elapsed.saturating_sub(pair.since) >= self.limits.pose_wait;
            let too_many = self.pairs.len() > self.limits.waiting && !self.keeps_frames;
            if has_source && !(is_known || waited || too_many || is_end) {
                return;
            }
            self.pairs.pop_front();
            self.complete_frame(&pair, pose, has_source && pose.is_none());
        }
    }

    fn complete_frame(&mut self, pair: &Pair, pose: Option<Pose>, lacks_pose: bool) {
        let Some(chosen) = &self.chosen else { return };
        let Pair { color, depth, .. } = *pair;
        let Some((color_image, depth_image)) = self.images.get(&color).zip(self.images.get(&depth)) else { return };
        let reader = Arc::clone(&chosen.reader);
        let frame = PairedFrame::new((&color, &depth), pose, (&reader.color.cameras, &reader.depth.cameras));
        self.complete.push_back(UndecodedFrame {
            index: 0,
            frame,
            color: Arc::clone(&color_image.data),
            depth: Arc::clone(&depth_image.data),
            lacks_pose,
            received: color_image.received.max(depth_image.received),
            reader,
            common: Arc::clone(&self.common),
        });
        while self.complete.len() > self.limits.complete {
            self.drop_complete(|dropped| &mut dropped.busy);
        }
    }

    /// Drops the oldest complete frame for a reason.
    fn drop_complete(&mut self, reason: fn(&mut DropCounts) -> &mut u64) {
        if let Some(frame) = self.complete.pop_front() {
            self.forget(&frame);
            *reason(&mut self.counts.dropped) += frame.images().count() as u64;
        }
    }

    /// Forgets the data of a frame's images.
    pub(super) fn forget(&mut self, frame: &UndecodedFrame) {
        for place in [frame.frame.color, frame.frame.depth] {
            self.images.remove(i64::try_from(place.offset).unwrap_or(i64::MAX));
        }
    }

    /// Drops the image that was received first, and the other one of its pair.
    pub(super) fn drop_oldest(&mut self) {
        let Some((number, topic)) = self.images.oldest() else { return };
        let is_it = |image: &StampedPlace| image.recorded.number == number;
        let is_of_frame = |frame: &UndecodedFrame| {
            [frame.frame.color, frame.frame.depth].iter().any(|place| place.offset == number.unsigned_abs())
        };
        if self.complete.iter().any(is_of_frame) {
            // Those before it are older still.
            self.drop_complete(|dropped| &mut dropped.memory);
        } else if let Some(place) = self.pairs.iter().position(|pair| is_it(&pair.color) || is_it(&pair.depth)) {
            let pair = self.pairs.remove(place);
            self.drop_images(pair.into_iter().flat_map(Pair::images), |dropped| &mut dropped.memory);
        } else {
            let dropped = self.timeline(topic).map(|images| images.take_number(number)).unwrap_or_default();
            self.drop_images(dropped, |dropped| &mut dropped.memory);
        }
    }

    /// Forgets what is from before the clock of the colour images was set back.
    pub(super) fn start_again(&mut self, at: &SetBack) {
        self.counts.clock_set_back += 1;
        self.paired = None;
        self.depth_is_ahead = false;
        let pairs: Vec<Pair> = self.pairs.drain(..).collect();
        self.drop_images(pairs.into_iter().flat_map(Pair::images), |dropped| &mut dropped.set_back);
        while !self.complete.is_empty() && !self.keeps_frames {
            self.drop_complete(|dropped| &mut dropped.set_back);
        }
        let depth = self.chosen.as_ref().filter(|chosen| chosen.has_depth()).map(|chosen| chosen.depth);
        let before = depth.and_then(|depth| Some(self.timeline(depth)?.restart(at))).unwrap_or_default();
        self.drop_images(before, |dropped| &mut dropped.set_back);
        self.contents.tree.restart(at);
        for topic in &mut self.contents.topics {
            match &mut topic.content {
                Content::Poses(poses) => _ = poses.timeline.restart(at),
                // Stamps by the clock before say nothing about the images after.
                Content::Calibrations { list, .. } => _ = list.drain(..list.len().saturating_sub(1)),
                _ => {}
            }
        }
        self.renew_reader();
    }
}

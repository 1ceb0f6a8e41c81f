//! Matching of a stream's messages into frames: what a caller sees, and what becomes of each message.

use super::coordinate_frames::CoordinateFrames;
use super::counts::{DropCounts, MatchCounts};
use super::limits::MatchLimits;
use super::stream_topics::StreamTopics;
use super::undecoded_frame::{FramesInCommon, STREAM, UndecodedFrame};
use super::waiting::{Pair, WaitingImage, WaitingImages};
use crate::frame_checks::FrameChecks;
use crate::own_camera::OwnCamera;
use crate::ros_topics::clock::Recorded;
use crate::ros_topics::contents::{Content, Contents, MessagePlace, StampedPlace, TopicMessage};
use crate::ros_topics::timeline::Timeline;
use crate::{DatasetError, DatasetSettings};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Maximum number of topics; messages of others are ignored.
const MAX_TOPICS: usize = 256;
/// Maximum length of a name, bytes.
const MAX_NAME_BYTES: usize = 256;
/// Maximum size of transforms, and of camera infos and poses, bytes.
const MAX_TRANSFORMS_BYTES: usize = 1 << 20;
const MAX_MESSAGE_BYTES: usize = 64 << 10;
/// Maximum number of different camera infos kept of a topic.
const MAX_CALIBRATIONS: usize = 16;

/// Matches the messages of ROS 2 topics into frames while they arrive: colour, depth, the camera, and its pose if there
/// are poses.
///
/// Topics are chosen as for recordings, by the settings `color`, `depth`, `camera_info`, `depth_camera_info`, `pose`,
/// `world_frame` and `pose_frame`, or because they are the only suitable ones. Images are paired within
/// `max_time_difference_ms`. Poses are interpolated; a frame waits for them for a limited time and is then given without
/// one, as are such frames of a recording. Paths (`corrections`), `start`, `stride` and `max_frames` are not used.
///
/// Frames are given in time order. The newest wins: a complete frame replaces one that was not taken yet
/// ([`MatchLimits::complete`]). Time goes back only if the clock of the colour images was set back: then all that waits
/// is dropped, unless the matcher is [`keeping_frames`](FrameMatcher::keeping_frames). Memory is bounded, whatever is
/// fed.
///
/// ```
/// use splatseg_dataset::{DatasetSettings, FrameMatcher, MatchLimits};
/// use std::time::Duration;
/// let mut matcher = FrameMatcher::new(&DatasetSettings::default(), MatchLimits::default())?;
/// let received = Duration::from_secs(1_700_000_000);
/// matcher.feed("/camera/color/image_raw", "sensor_msgs/msg/Image", &[0, 1, 0, 0], received);
/// if let Some(frame) = matcher.take(received) {
///     let streamed = frame.read()?;
///     println!("{}", streamed.frame.name());
/// }
/// assert_eq!(matcher.counts().to_string(), "0 frames of 1 messages; 1 messages damaged");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct FrameMatcher {
    pub(super) settings: DatasetSettings,
    pub(super) limits: MatchLimits,
    pub(super) contents: Contents,
    pub(super) chosen: Option<StreamTopics>,
    /// Why no topics are chosen yet.
    pub(super) undecided: Option<DatasetError>,
    pub(super) images: WaitingImages,
    pub(super) pairs: VecDeque<Pair>,
    pub(super) complete: VecDeque<UndecodedFrame>,
    pub(super) common: Arc<FramesInCommon>,
    /// Without what [`Self::counts`] adds.
    pub(super) counts: MatchCounts,
    /// Number of messages recorded.
    pub(super) number: i64,
    /// Time since the first message; it does not go back if the receiver's clock does.
    pub(super) elapsed: Duration,
    last_received: Option<Duration>,
    /// Stamps of the newest pair.
    pub(super) paired: Option<(i64, i64)>,
    /// True if the clock of the depth images was set back, and that of the colour images not yet.
    pub(super) depth_is_ahead: bool,
    /// True if frames from before a clock was set back are kept.
    pub(super) keeps_frames: bool,
}

/// Use of a message, or the reason for dropping it.
enum Use {
    Image,
    TakenIn,
    Ignored,
    Damaged,
}

impl FrameMatcher {
    /// Creates a matcher. Nothing is known of the topics before their first messages.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: &DatasetSettings, limits: MatchLimits) -> Result<Self, DatasetError> {
        settings.validate()?;
        let checks = FrameChecks::new(settings.framing());
        let checks = if settings.reads_depth_topic() { checks } else { checks.without_depth() };
        let common = FramesInCommon {
            checks: Mutex::new(checks),
            pose_format: settings.pose_format(),
            unreadable: AtomicU64::new(0),
            unreadable_without_pose: AtomicU64::new(0),
        };
        Ok(Self {
            settings: settings.clone(),
            limits: MatchLimits { waiting: limits.waiting.max(1), complete: limits.complete.max(1), ..limits },
            contents: Contents::streamed(Path::new(STREAM)),
            chosen: None,
            undecided: None,
            images: WaitingImages::default(),
            pairs: VecDeque::new(),
            complete: VecDeque::new(),
            common: Arc::new(common),
            counts: MatchCounts::default(),
            number: 0,
            elapsed: Duration::ZERO,
            last_received: None,
            paired: None,
            depth_is_ahead: false,
            keeps_frames: false,
        })
    }

    /// Keeps the frames from before topics are chosen, those that wait for their poses, and those from before a clock was
    /// set back, which are completed with what is known by then. For a consumer that must not miss frames, e.g. of a
    /// recording; others need what is now. Memory is limited by [`MatchLimits::bytes`].
    #[must_use]
    pub fn keeping_frames(self) -> Self {
        Self { keeps_frames: true, ..self }
    }

    /// Takes in a message: `data` in CDR, of type `type_name` (e.g. `sensor_msgs/msg/Image`), received at `received` by
    /// the caller's clock, since any fixed time. It is the time of messages without a stamp, so use the clock of the
    /// stamps, usually that of the Unix epoch. Messages that cannot be read or used are counted.
    pub fn feed(&mut self, topic: &str, type_name: &str, data: &[u8], received: Duration) {
        self.pass_time(received);
        self.counts.messages += 1;
        let count = match self.take_in((topic, type_name), data, received) {
            Use::Image => &mut self.counts.images,
            Use::TakenIn => &mut self.counts.taken_in,
            Use::Ignored => &mut self.counts.ignored,
            Use::Damaged => &mut self.counts.damaged,
        };
        *count += 1;
        self.match_frames(false);
    }

    /// Returns the next complete frame, the newest unless [`MatchLimits::complete`] lets more wait. `received` is the
    /// time, as in [`Self::feed`].
    pub fn take(&mut self, received: Duration) -> Option<UndecodedFrame> {
        // Nothing waits before the first message.
        if self.counts.messages > 0 {
            self.pass_time(received);
            self.match_frames(false);
        }
        let mut frame = self.complete.pop_front()?;
        self.forget(&frame);
        frame.index = usize::try_from(self.counts.frames).unwrap_or(usize::MAX);
        self.counts.frames += 1;
        self.counts.without_pose += u64::from(frame.lacks_pose);
        Some(frame)
    }

    /// Returns the number of complete frames that wait to be taken.
    pub fn complete_frames(&self) -> usize {
        self.complete.len()
    }

    /// Decides about everything that waits as if nothing more came, e.g. at the end of a recording. Images without a
    /// partner are dropped.
    pub fn flush(&mut self) {
        self.match_frames(true);
        for index in 0..self.contents.topics.len() {
            let Some(timeline) = self.timeline(index) else { continue };
            let (unpaired, misfits) = (timeline.take_all(), timeline.take_held());
            self.drop_images(unpaired, |dropped| &mut dropped.unpaired);
            self.drop_images(misfits, |dropped| &mut dropped.misfits);
        }
    }

    /// Returns what has become of the messages so far.
    pub fn counts(&self) -> MatchCounts {
        let unreadable = self.common.unreadable.load(Ordering::Relaxed);
        let without_pose = self.common.unreadable_without_pose.load(Ordering::Relaxed);
        MatchCounts {
            frames: self.counts.frames.saturating_sub(unreadable),
            without_pose: self.counts.without_pose.saturating_sub(without_pose),
            unreadable,
            waiting: self.images.len() as u64,
            ..self.counts
        }
    }

    /// Returns the topics used, one line each, as for recordings. Empty until they are chosen.
    pub fn sources(&self) -> &[String] {
        self.chosen.as_ref().map_or(&[], |chosen| &chosen.sources)
    }

    /// Returns true if messages of a topic may be used: once topics are chosen, of these and of transforms; before, of all
    /// topics of suitable types, but of images only those that the settings name, if they name both.
    pub fn wants(&self, topic: &str, type_name: &str) -> bool {
        if let Some(index) = self.contents.known_topic(topic, type_name)
            && let Some(known) = self.contents.topics.get(index)
            && let Some(chosen) = &self.chosen
        {
            return chosen.uses(index, known);
        }
        let is_open = self.chosen.is_none();
        match Content::for_topic(topic, type_name) {
            Content::Path(_) | Content::Other => false,
            Content::Transforms { .. } => true,
            Content::Images(_) => {
                let names = [&self.settings.color, &self.settings.depth];
                let is_this = |name: &str| name.trim_start_matches('/') == topic.trim_start_matches('/');
                is_open && names.iter().any(|name| name.as_deref().is_none_or(is_this))
            }
            Content::Calibrations { .. } | Content::Poses(_) | Content::DepthUnit { .. } => is_open,
        }
    }

    /// Returns the names of the coordinate frames; `None` until topics are chosen.
    pub fn coordinate_frames(&self) -> Option<&CoordinateFrames> {
        self.chosen.as_ref().map(|chosen| &chosen.coordinate_frames)
    }

    /// Returns why no topics have been chosen, at the last attempt: something is missing or ambiguous. `None` once they
    /// are chosen, and before the first attempt.
    pub fn undecided(&self) -> Option<&DatasetError> {
        self.undecided.as_ref()
    }

    fn pass_time(&mut self, received: Duration) {
        let passed = received.saturating_sub(self.last_received.unwrap_or(received));
        self.elapsed = self.elapsed.saturating_add(passed);
        self.last_received = Some(received);
    }

    /// Returns the index of a topic, unless there are too many.
    fn topic(&mut self, (name, type_name): (&str, &str)) -> Option<usize> {
        let fits = name.len().max(type_name.len()) <= MAX_NAME_BYTES;
        let index = fits.then(|| self.contents.known_topic(name, type_name))?;
        match index {
            None if self.contents.topics.len() < MAX_TOPICS => self.contents.topic(name, type_name, "cdr").ok(),
            index => index,
        }
    }

    fn take_in(&mut self, topic: (&str, &str), data: &[u8], received: Duration) -> Use {
        let Some(index) = self.topic(topic) else { return Use::Ignored };
        let Some(topic) = self.contents.topics.get(index) else { return Use::Ignored };
        let limit = match &topic.content {
            Content::Path(_) | Content::Other => return Use::Ignored,
            _ if self.chosen.as_ref().is_some_and(|chosen| !chosen.uses(index, topic)) => return Use::Ignored,
            Content::Images(_) => usize::MAX,
            Content::Transforms { .. } => MAX_TRANSFORMS_BYTES,
            Content::Calibrations { .. } | Content::Poses(_) | Content::DepthUnit { .. } => MAX_MESSAGE_BYTES,
        };
        self.number += 1;
        let log_time = i64::try_from(received.as_nanos()).unwrap_or(i64::MAX);
        let place = MessagePlace { chunk: None, offset: self.number.unsigned_abs(), len: data.len() as u64 };
        let message = TopicMessage { data, recorded: Recorded { log_time, number: self.number }, place };
        if data.len() > limit || self.contents.record(index, &message).is_err() {
            return Use::Damaged;
        }
        self.sort_in(index, data, received)
    }

    /// Sorts a recorded message into the others of its topic.
    fn sort_in(&mut self, index: usize, data: &[u8], received: Duration) -> Use {
        if self.keeps_frames && self.is_set_back(index) {
            self.match_frames(true);
        }
        match self.contents.topics.get_mut(index).map(|topic| &mut topic.content) {
            Some(Content::Images(images)) => {
                let Some(place) = images.timeline.take_unsorted().pop() else { return Use::Damaged };
                if images.frame.len() > MAX_NAME_BYTES {
                    images.kind = None;
                    images.frame.clear();
                    return Use::Damaged;
                }
                self.take_image(index, place, data, received);
                Use::Image
            }
            Some(Content::Poses(poses)) => {
                poses.timeline.arrive_all();
                Use::TakenIn
            }
            Some(Content::Calibrations { .. }) => self.take_calibration(index),
            Some(Content::Transforms { .. }) => {
                self.contents.tree.arrive();
                Use::TakenIn
            }
            _ => Use::Ignored,
        }
    }

    /// True if the message that was recorded last, of this topic, confirms that its clock was set back.
    fn is_set_back(&self, index: usize) -> bool {
        match self.contents.topics.get(index).map(|topic| &topic.content) {
            Some(Content::Images(images)) => images.timeline.is_set_back(),
            Some(Content::Poses(poses)) => poses.timeline.is_set_back(),
            Some(Content::Transforms { .. }) => self.contents.tree.are_set_back(),
            _ => false,
        }
    }

    /// Takes in the last camera info of a topic. One without a usable camera, as some drivers send at first, is removed.
    fn take_calibration(&mut self, index: usize) -> Use {
        let list_of = |contents: &mut Contents| match contents.topics.get_mut(index).map(|topic| &mut topic.content) {
            Some(Content::Calibrations { list, .. }) => Some(std::mem::take(list)),
            _ => None,
        };
        let Some(mut list) = list_of(&mut self.contents) else { return Use::Ignored };
        let own = OwnCamera::from_settings(&self.settings).ok().flatten();
        let is_usable = list.last().is_none_or(|(_, info)| info.is_usable(own));
        if !is_usable {
            list.pop();
        }
        list.drain(..list.len().saturating_sub(MAX_CALIBRATIONS));
        if let Some(Content::Calibrations { list: place, .. }) =
            self.contents.topics.get_mut(index).map(|topic| &mut topic.content)
        {
            *place = list;
        }
        if is_usable && self.renew_reader() { Use::TakenIn } else { Use::Damaged }
    }

    /// Keeps an image, or drops it if it cannot become part of a frame.
    fn take_image(&mut self, topic: usize, place: StampedPlace, data: &[u8], received: Duration) {
        if data.len() > self.limits.bytes {
            self.counts.dropped.memory += 1;
            return;
        }
        let image = WaitingImage { topic, data: data.into(), received, elapsed: self.elapsed };
        self.images.insert(place.recorded.number, image);
        let Some(arrival) = self.timeline(topic).map(|timeline| timeline.arrive(place)) else { return };
        self.drop_images(arrival.misfits, |dropped| &mut dropped.misfits);
        self.drop_images(arrival.repeated, |dropped| &mut dropped.repeated);
        if let Some((before, at)) = arrival.set_back {
            self.drop_images(before, |dropped| &mut dropped.set_back);
            match &self.chosen {
                Some(chosen) if chosen.color == topic => self.start_again(&at),
                _ => self.depth_is_ahead = true,
            }
        }
        self.drop_late(topic);
        // Before topics are chosen, nothing can be paired: then only memory limits those that must not be missed.
        let most = if self.keeps_frames && self.chosen.is_none() { usize::MAX } else { self.limits.waiting };
        let Some(timeline) = self.timeline(topic) else { return };
        let messages = timeline.messages();
        let first_kept =
            messages.len().checked_sub(most).and_then(|first| messages.get(first)).map(|first| first.stamp);
        let too_many = first_kept.map(|first| timeline.take_if(|image| image.stamp < first)).unwrap_or_default();
        let reason: fn(&mut DropCounts) -> &mut u64 = match self.chosen {
            None => |dropped| &mut dropped.early,
            Some(_) => |dropped| &mut dropped.unpaired,
        };
        self.drop_images(too_many, reason);
        while self.images.bytes() > self.limits.bytes {
            self.drop_oldest();
        }
    }

    /// Returns the images of a topic.
    pub(super) fn timeline(&mut self, topic: usize) -> Option<&mut Timeline<StampedPlace>> {
        match &mut self.contents.topics.get_mut(topic)?.content {
            Content::Images(images) => Some(&mut images.timeline),
            _ => None,
        }
    }

    /// Drops images for a reason.
    pub(super) fn drop_images(
        &mut self,
        images: impl IntoIterator<Item = StampedPlace>,
        reason: fn(&mut DropCounts) -> &mut u64,
    ) {
        for image in images {
            self.images.remove(image.recorded.number);
            *reason(&mut self.counts.dropped) += 1;
        }
    }
}

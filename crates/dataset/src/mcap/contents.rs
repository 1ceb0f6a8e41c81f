//! What a recording holds: its topics, and of those that matter the times and places of their messages.

use super::cameras::Calibration;
use super::clock::{Order, Recorded, Stamped, Timeline};
use super::container::{FoundMessage, MessagePlace, RecordSink};
use super::images::{ImageKind, compressed_kind, raw_kind};
use super::transforms::{Rigid, Sample, TransformTree};
use crate::DatasetError;
use glam::{DQuat, DVec3};
use mcap::records::Channel;
use splatseg_input::{MemoryLimit, display_bytes};
use splatseg_ros::{
    CameraInfo, CdrError, CompressedImage, Header, Image, Odometry, PoseMessage, PoseStamped,
    PoseWithCovarianceStamped, TfMessage, Time, TransformStamped, from_cdr,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What part of the memory limit the list of messages may take.
const MEMORY_PART: u64 = 4;
/// What a topic takes beside its names.
const TOPIC_BYTES: u64 = 512;

/// A topic.
#[derive(Debug)]
pub(super) struct Topic {
    pub(super) name: String,
    /// The type of its messages, e.g. `sensor_msgs/msg/Image`.
    pub(super) type_name: String,
    /// How they are encoded: `cdr` for ROS 2.
    pub(super) encoding: String,
    pub(super) messages: u64,
    /// The first and the last time at which a message was recorded, nanoseconds.
    pub(super) recorded: Option<(u64, u64)>,
    /// Whether a message was recorded before the one before it.
    goes_back: bool,
    /// Messages that cannot be read, and what is wrong with the first.
    pub(super) unreadable: Option<(u64, String)>,
    pub(super) content: Content,
}

/// What is known of the messages of a topic.
#[derive(Debug)]
pub(super) enum Content {
    Images(Images),
    Calibrations { frame: String, list: Vec<(StampedPlace, Calibration)> },
    Poses(Poses),
    Transforms { is_fixed: bool },
    Other,
}

/// A message and the stamp in it, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StampedPlace {
    pub(super) stamp: i64,
    pub(super) recorded: Recorded,
    pub(super) place: MessagePlace,
}

impl Stamped for StampedPlace {
    fn stamp(&self) -> i64 {
        self.stamp
    }

    fn recorded(&self) -> Recorded {
        self.recorded
    }
}

/// The images of a topic.
#[derive(Debug, Default)]
pub(super) struct Images {
    /// Whether they are files (`CompressedImage`).
    pub(super) is_compressed: bool,
    /// What the first one shows; `None` before it.
    pub(super) kind: Option<ImageKind>,
    /// Encoding or format of the first one.
    pub(super) encoding: String,
    /// The frame of the first one.
    pub(super) frame: String,
    /// In the order of the file, until they are sorted.
    pub(super) list: Vec<StampedPlace>,
    pub(super) timeline: Timeline<StampedPlace>,
}

/// The types of messages with a pose.
#[derive(Clone, Copy, Debug)]
enum PoseType {
    Odometry,
    Pose,
    PoseWithCovariance,
    Transform,
}

/// The poses of a topic.
#[derive(Debug)]
pub(super) struct Poses {
    kind: PoseType,
    /// The frame that they are in.
    pub(super) world: String,
    /// The frame whose poses they are, if the messages say so.
    pub(super) body: Option<String>,
    /// In the order of the file, until they are sorted.
    pub(super) samples: Vec<Sample>,
    pub(super) timeline: Timeline<Sample>,
}

/// Everything that a recording holds.
#[derive(Debug)]
pub(super) struct Contents {
    path: PathBuf,
    /// In the order of their first channels.
    pub(super) topics: Vec<Topic>,
    pub(super) tree: TransformTree,
    /// The names of types.
    schemas: BTreeMap<u16, String>,
    /// The topic of each channel.
    channels: BTreeMap<u16, usize>,
    /// The topic of each name and type.
    known: BTreeMap<(String, String), usize>,
    /// Messages of channels that were not declared.
    pub(super) without_channel: u64,
    /// Messages so far.
    messages: i64,
    pub(super) order: Order,
    /// What the lists take so far, and may take, bytes.
    memory: u64,
    limit: u64,
}

impl Contents {
    pub(super) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            topics: Vec::new(),
            tree: TransformTree::default(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            known: BTreeMap::new(),
            without_channel: 0,
            messages: 0,
            order: Order::default(),
            memory: 0,
            limit: MemoryLimit::in_force() / MEMORY_PART,
        }
    }

    /// Puts everything in order of time, when all messages have been read.
    pub(super) fn sort(&mut self) {
        // Of one message nothing can be told.
        let stands = |topic: &Topic| topic.messages > 1 && topic.recorded.is_some_and(|(first, last)| first == last);
        if self.topics.iter().any(|topic| topic.goes_back || stands(topic)) {
            self.order = Order::Number;
        }
        self.tree.sort(self.order);
        for topic in &mut self.topics {
            match &mut topic.content {
                Content::Images(images) => {
                    images.timeline = Timeline::new(std::mem::take(&mut images.list), self.order);
                }
                Content::Poses(poses) => {
                    poses.timeline = Timeline::new(std::mem::take(&mut poses.samples), self.order);
                }
                _ => {}
            }
        }
    }

    /// The topic of a name, with or without the slash at its start.
    pub(super) fn find(&self, name: &str) -> Option<&Topic> {
        let bare = |name: &str| name.trim_start_matches('/').to_owned();
        self.topics.iter().find(|topic| topic.name == name).or_else(|| {
            let wanted = bare(name);
            self.topics.iter().find(|topic| bare(&topic.name) == wanted)
        })
    }

    /// Notes that so many bytes more are kept.
    fn keep(&mut self, bytes: u64) -> Result<(), DatasetError> {
        self.memory = self.memory.saturating_add(bytes);
        if self.memory <= self.limit {
            return Ok(());
        }
        Err(DatasetError::Field {
            path: self.path.clone(),
            field: "list of topics and messages".to_owned(),
            found: format!("more than {}", display_bytes(self.limit)),
            expected: "at most a quarter of the memory limit: raise --memory-limit, or cut the recording".to_owned(),
        })
    }
}

/// `sensor_msgs/msg/Image` of `sensor_msgs/Image`, as some writers have it.
fn full_type_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, kind)) if !kind.contains('/') => format!("{package}/msg/{kind}"),
        _ => name.to_owned(),
    }
}

/// A frame without the slash with which ROS 1 began it.
fn frame_name(name: &str) -> String {
    one_line(bare_frame(name))
}

/// The same of a name that the user gives.
pub(super) fn bare_frame(name: &str) -> &str {
    name.strip_prefix('/').unwrap_or(name)
}

/// A name from a file, with control characters replaced: messages are one line.
fn one_line(name: &str) -> String {
    name.replace(char::is_control, "\u{fffd}")
}

impl RecordSink for Contents {
    fn schema(&mut self, id: u16, name: &str) -> Result<(), DatasetError> {
        if !self.schemas.contains_key(&id) {
            self.keep(name.len() as u64 + TOPIC_BYTES)?;
            self.schemas.insert(id, full_type_name(&one_line(name)));
        }
        Ok(())
    }

    fn channel(&mut self, channel: Channel) -> Result<(), DatasetError> {
        if self.channels.contains_key(&channel.id) {
            return Ok(());
        }
        let type_name = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
        let key = (one_line(&channel.topic), type_name);
        if let Some(topic) = self.known.get(&key) {
            self.channels.insert(channel.id, *topic);
            return Ok(());
        }
        self.keep(2 * (key.0.len() + key.1.len()) as u64 + TOPIC_BYTES)?;
        let (name, type_name) = key.clone();
        let content = if channel.message_encoding == "cdr" { Content::of(&name, &type_name) } else { Content::Other };
        let (encoding, messages) = (one_line(&channel.message_encoding), 0);
        self.topics.push(Topic {
            name,
            type_name,
            encoding,
            messages,
            recorded: None,
            goes_back: false,
            unreadable: None,
            content,
        });
        self.channels.insert(channel.id, self.topics.len() - 1);
        self.known.insert(key, self.topics.len() - 1);
        Ok(())
    }

    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError> {
        let Some(topic) = self.channels.get(&message.channel).and_then(|index| self.topics.get_mut(*index)) else {
            self.without_channel += 1;
            return Ok(());
        };
        topic.messages += 1;
        self.messages += 1;
        let time = message.log_time;
        topic.goes_back |= topic.recorded.is_some_and(|(_, last)| time < last);
        let log_time = i64::try_from(time).unwrap_or(i64::MAX);
        let recorded = Recorded { log_time, number: self.messages };
        topic.recorded = Some(topic.recorded.map_or((time, time), |(first, last)| (first.min(time), last.max(time))));
        match topic.content.take(&topic.name, (message, recorded), &mut self.tree) {
            Ok(kept) => self.keep(kept),
            Err(error) => {
                let (count, _) = topic.unreadable.get_or_insert_with(|| (0, error.to_string()));
                *count += 1;
                Ok(())
            }
        }
    }
}

impl Content {
    /// What the messages of a topic are kept as.
    fn of(name: &str, type_name: &str) -> Self {
        match type_name {
            "sensor_msgs/msg/Image" => Self::Images(Images::default()),
            "sensor_msgs/msg/CompressedImage" => Self::Images(Images { is_compressed: true, ..Images::default() }),
            "sensor_msgs/msg/CameraInfo" => Self::Calibrations { frame: String::new(), list: Vec::new() },
            "tf2_msgs/msg/TFMessage" => Self::Transforms { is_fixed: name.ends_with("tf_static") },
            "nav_msgs/msg/Odometry" => Self::Poses(Poses::new(PoseType::Odometry)),
            "geometry_msgs/msg/PoseStamped" => Self::Poses(Poses::new(PoseType::Pose)),
            "geometry_msgs/msg/PoseWithCovarianceStamped" => Self::Poses(Poses::new(PoseType::PoseWithCovariance)),
            "geometry_msgs/msg/TransformStamped" => Self::Poses(Poses::new(PoseType::Transform)),
            _ => Self::Other,
        }
    }

    /// Takes a message; gives what it takes in memory, bytes.
    fn take(
        &mut self,
        topic: &str,
        (message, recorded): (&FoundMessage<'_>, Recorded),
        tree: &mut TransformTree,
    ) -> Result<u64, CdrError> {
        let stamp_of = |stamp: Time| match stamp.nanoseconds() {
            // A driver that does not set it.
            0 => recorded.log_time,
            stamp => stamp,
        };
        match self {
            Self::Images(images) => images.take(topic, (message, recorded), stamp_of),
            Self::Calibrations { frame, list } => {
                let info: CameraInfo = from_cdr(message.data)?;
                let calibration = Calibration::new(&info);
                if list.last().is_some_and(|(_, last)| *last == calibration) {
                    return Ok(0);
                }
                *frame = frame_name(&info.header.frame_id);
                let memory = calibration.memory();
                let stamp = stamp_of(info.header.stamp);
                list.push((StampedPlace { stamp, recorded, place: message.place }, calibration));
                Ok(memory)
            }
            Self::Poses(poses) => poses.take((message.data, recorded), stamp_of),
            Self::Transforms { is_fixed } => {
                let transforms: TfMessage = from_cdr(message.data)?;
                for transform in &transforms.transforms {
                    let (parent, child) =
                        (frame_name(&transform.header.frame_id), frame_name(&transform.child_frame_id));
                    if let Some(rigid) = rigid_of_transform(transform) {
                        let sample = Sample { stamp: stamp_of(transform.header.stamp), recorded, transform: rigid };
                        tree.add(&parent, &child, sample, *is_fixed);
                    }
                }
                // Fixed ones replace each other, moving ones are kept.
                Ok((transforms.transforms.len() * size_of::<Sample>()) as u64)
            }
            Self::Other => Ok(0),
        }
    }
}

impl Images {
    fn take(
        &mut self,
        topic: &str,
        (message, recorded): (&FoundMessage<'_>, Recorded),
        stamp_of: impl Fn(Time) -> i64,
    ) -> Result<u64, CdrError> {
        let (header, kind, encoding) = if self.is_compressed {
            let image: CompressedImage<'_> = from_cdr(message.data)?;
            (image.header.clone(), compressed_kind(topic, &image), image.format)
        } else {
            let image: Image<'_> = from_cdr(message.data)?;
            (image.header, raw_kind(topic, image.encoding), image.encoding)
        };
        if self.kind.is_none() {
            self.kind = Some(kind);
            self.encoding = one_line(encoding).chars().take(60).collect();
            self.frame = frame_name(&header.frame_id);
        }
        self.list.push(StampedPlace { stamp: stamp_of(header.stamp), recorded, place: message.place });
        Ok(2 * size_of::<StampedPlace>() as u64)
    }
}

impl Poses {
    fn new(kind: PoseType) -> Self {
        Self { kind, world: String::new(), body: None, samples: Vec::new(), timeline: Timeline::default() }
    }

    fn take(&mut self, (data, recorded): (&[u8], Recorded), stamp_of: impl Fn(Time) -> i64) -> Result<u64, CdrError> {
        let (header, body, rigid) = self.kind.read(data)?;
        if self.samples.is_empty() {
            self.world = frame_name(&header.frame_id);
            self.body = body.map(|body| frame_name(&body)).filter(|body| !body.is_empty());
        }
        let Some(transform) = rigid else { return Ok(0) };
        self.samples.push(Sample { stamp: stamp_of(header.stamp), recorded, transform });
        Ok(2 * size_of::<Sample>() as u64)
    }
}

impl PoseType {
    /// The header of a message, the frame whose pose it is if it says so, and the pose if it is one.
    fn read(self, data: &[u8]) -> Result<(Header, Option<String>, Option<Rigid>), CdrError> {
        Ok(match self {
            Self::Odometry => {
                let message: Odometry = from_cdr(data)?;
                (message.header, Some(message.child_frame_id), rigid_of_pose(&message.pose.pose))
            }
            Self::Pose => {
                let message: PoseStamped = from_cdr(data)?;
                (message.header, None, rigid_of_pose(&message.pose))
            }
            Self::PoseWithCovariance => {
                let message: PoseWithCovarianceStamped = from_cdr(data)?;
                (message.header, None, rigid_of_pose(&message.pose.pose))
            }
            Self::Transform => {
                let message: TransformStamped = from_cdr(data)?;
                let rigid = rigid_of_transform(&message);
                (message.header, Some(message.child_frame_id), rigid)
            }
        })
    }
}

fn rigid_of_pose(pose: &PoseMessage) -> Option<Rigid> {
    let (position, turn) = (&pose.position, &pose.orientation);
    Rigid::new(DVec3::new(position.x, position.y, position.z), DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w))
}

fn rigid_of_transform(transform: &TransformStamped) -> Option<Rigid> {
    let (shift, turn) = (&transform.transform.translation, &transform.transform.rotation);
    Rigid::new(DVec3::new(shift.x, shift.y, shift.z), DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w))
}

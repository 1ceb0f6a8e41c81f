//! Contents of a recording: its topics, and the times and locations of the relevant messages.

use super::cameras::Calibration;
use super::clock::{Order, Recorded, Stamped, Timeline};
use super::container::{FoundMessage, MessagePlace, RecordSink};
use super::corrections::PathPoses;
use super::frame_names::{frame_name, one_line};
use super::images::{ImageKind, compressed_kind, raw_kind};
use super::poses::{PoseType, Poses, rigid_of_transform};
use super::transforms::{Sample, TransformTree};
use crate::DatasetError;
use mcap::records::Channel;
use splatseg_files::{MemoryLimit, display_bytes};
use splatseg_ros::{CameraInfo, CdrError, CompressedImage, Image, TfMessage, Time, from_cdr};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Divisor of the memory limit that gives the limit of the list of messages.
const MEMORY_PART: u64 = 4;
/// Memory per topic, in addition to its names.
const TOPIC_BYTES: u64 = 512;

/// A topic.
#[derive(Debug)]
pub(super) struct Topic {
    pub(super) name: String,
    /// Message type, e.g. `sensor_msgs/msg/Image`.
    pub(super) type_name: String,
    /// Message encoding: `cdr` for ROS 2.
    pub(super) encoding: String,
    pub(super) messages: u64,
    /// First and last recording time of a message, nanoseconds.
    pub(super) recorded: Option<(u64, u64)>,
    /// True if a recording time was earlier than that of the message before.
    goes_back: bool,
    /// Number of unreadable messages, and the error of the first.
    pub(super) unreadable: Option<(u64, String)>,
    pub(super) content: Content,
}

/// Data kept from the messages of a topic.
#[derive(Debug)]
pub(super) enum Content {
    Images(Images),
    Calibrations { frame: String, list: Vec<(StampedPlace, Calibration)> },
    Poses(Poses),
    Transforms { is_fixed: bool },
    Path(PathPoses),
    Other,
}

/// Location of a message, with its stamp, nanoseconds.
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
    /// True if they are image files (`CompressedImage`).
    pub(super) is_compressed: bool,
    /// Kind of the first image; `None` before it.
    pub(super) kind: Option<ImageKind>,
    /// Encoding or format of the first image.
    pub(super) encoding: String,
    /// Coordinate frame of the first image.
    pub(super) frame: String,
    /// In file order, until they are sorted.
    pub(super) list: Vec<StampedPlace>,
    pub(super) timeline: Timeline<StampedPlace>,
}

/// Contents of a whole recording.
#[derive(Debug)]
pub(super) struct Contents {
    path: PathBuf,
    /// In the order of their first channels.
    pub(super) topics: Vec<Topic>,
    pub(super) tree: TransformTree,
    /// Message type of each schema.
    schemas: BTreeMap<u16, String>,
    /// Index of each channel's topic.
    channels: BTreeMap<u16, usize>,
    /// Index of the topic with each name and type.
    known: BTreeMap<(String, String), usize>,
    /// Number of messages of undeclared channels.
    pub(super) without_channel: u64,
    /// Number of messages so far.
    messages: i64,
    pub(super) order: Order,
    /// Memory used by the lists so far, and their limit, bytes.
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

    /// Sorts everything by time, once all messages have been read.
    pub(super) fn sort(&mut self) {
        // A single message says nothing about the clock.
        let clock_stands_still =
            |topic: &Topic| topic.messages > 1 && topic.recorded.is_some_and(|(first, last)| first == last);
        if self.topics.iter().any(|topic| topic.goes_back || clock_stands_still(topic)) {
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

    /// Finds a topic by name, with or without the leading slash.
    pub(super) fn find(&self, name: &str) -> Option<&Topic> {
        let bare = |name: &str| name.trim_start_matches('/').to_owned();
        self.topics.iter().find(|topic| topic.name == name).or_else(|| {
            let wanted = bare(name);
            self.topics.iter().find(|topic| bare(&topic.name) == wanted)
        })
    }

    /// Adds `bytes` to the memory used by the lists. Errors if it exceeds the limit.
    fn add_memory(&mut self, bytes: u64) -> Result<(), DatasetError> {
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

/// Expands `sensor_msgs/Image`, written by some recorders, to `sensor_msgs/msg/Image`.
fn full_type_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, kind)) if !kind.contains('/') => format!("{package}/msg/{kind}"),
        _ => name.to_owned(),
    }
}

impl RecordSink for Contents {
    fn schema(&mut self, id: u16, name: &str) -> Result<(), DatasetError> {
        if !self.schemas.contains_key(&id) {
            self.add_memory(name.len() as u64 + TOPIC_BYTES)?;
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
        self.add_memory(2 * (key.0.len() + key.1.len()) as u64 + TOPIC_BYTES)?;
        let (name, type_name) = key.clone();
        let content =
            if channel.message_encoding == "cdr" { Content::for_topic(&name, &type_name) } else { Content::Other };
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
        match topic.content.record(&topic.name, (message, recorded), &mut self.tree) {
            Ok(kept) => self.add_memory(kept),
            Err(error) => {
                let (count, _) = topic.unreadable.get_or_insert_with(|| (0, error.to_string()));
                *count += 1;
                Ok(())
            }
        }
    }
}

impl Content {
    /// Selects the content kept from a topic by its name and type.
    fn for_topic(name: &str, type_name: &str) -> Self {
        match type_name {
            "sensor_msgs/msg/Image" => Self::Images(Images::default()),
            "sensor_msgs/msg/CompressedImage" => Self::Images(Images { is_compressed: true, ..Images::default() }),
            "sensor_msgs/msg/CameraInfo" => Self::Calibrations { frame: String::new(), list: Vec::new() },
            "tf2_msgs/msg/TFMessage" => Self::Transforms { is_fixed: name.ends_with("tf_static") },
            "nav_msgs/msg/Path" => Self::Path(PathPoses::default()),
            "nav_msgs/msg/Odometry" => Self::Poses(Poses::new(PoseType::Odometry)),
            "geometry_msgs/msg/PoseStamped" => Self::Poses(Poses::new(PoseType::Pose)),
            "geometry_msgs/msg/PoseWithCovarianceStamped" => Self::Poses(Poses::new(PoseType::PoseWithCovariance)),
            "geometry_msgs/msg/TransformStamped" => Self::Poses(Poses::new(PoseType::Transform)),
            _ => Self::Other,
        }
    }

    /// Records a message. Returns the memory it uses, bytes.
    fn record(
        &mut self,
        topic: &str,
        (message, recorded): (&FoundMessage<'_>, Recorded),
        tree: &mut TransformTree,
    ) -> Result<u64, CdrError> {
        let stamp_of = |stamp: Time| match stamp.nanoseconds() {
            // Some drivers do not set the stamp.
            0 => recorded.log_time,
            stamp => stamp,
        };
        match self {
            Self::Images(images) => images.record(topic, (message, recorded), stamp_of),
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
            Self::Poses(poses) => poses.record((message.data, recorded), stamp_of),
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
                // Fixed transforms replace each other, moving ones are all kept.
                Ok((transforms.transforms.len() * size_of::<Sample>()) as u64)
            }
            Self::Path(path) => path.record(message.data, recorded),
            Self::Other => Ok(0),
        }
    }
}

impl Images {
    fn record(
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

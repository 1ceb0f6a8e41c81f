//! Contents of a recording or stream: its topics, and the times and locations of the relevant messages.

use super::cameras::Calibration;
use super::clock::{Recorded, Stamped};
use super::frame_names::{frame_name, one_line};
use super::images::{ImageKind, compressed_kind, compressed_size, raw_kind};
use super::paths::PathPoses;
use super::poses::{PoseType, Poses, parts_of_transform};
use super::quaternions::QuaternionCounts;
use super::sdk_topics::{is_depth_unit, is_extrinsics};
use super::timeline::{Order, Timeline};
use super::transform_tree::TransformTree;
use super::transforms::{Instant, Sample};
use crate::DatasetError;
use crate::plausibility::warn_once;
use splatseg_files::{MemoryLimit, display_bytes};
use splatseg_ros::{CameraInfo, CdrError, CompressedImage, Image, TfMessage, Time, from_cdr};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Divisor of the memory limit that gives the limit of the list of messages.
const MEMORY_PART: u64 = 4;
/// Bytes of a message with a number of 32 bits.
const FLOAT_MESSAGE_BYTES: usize = 8;
/// Number of compressed images whose size is read if that of those before cannot be.
const SIZE_TRIES: usize = 8;
/// Memory per topic, in addition to its names.
pub(crate) const TOPIC_BYTES: u64 = 512;

/// Location of a message's data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MessagePlace {
    /// Index of the compressed chunk, or of the database; `None` for uncompressed data in the file, and for messages of
    /// a stream.
    pub(crate) chunk: Option<u32>,
    /// Offset in the unpacked chunk, or in the file; the place in a database; the number of a message of a stream.
    pub(crate) offset: u64,
    pub(crate) len: u64,
}

/// A message of a topic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TopicMessage<'a> {
    pub(crate) data: &'a [u8],
    pub(crate) recorded: Recorded,
    pub(crate) place: MessagePlace,
}

/// A topic.
#[derive(Debug)]
pub(crate) struct Topic {
    pub(crate) name: String,
    /// Message type, e.g. `sensor_msgs/msg/Image`.
    pub(crate) type_name: String,
    /// Message encoding: `cdr` for ROS 2.
    pub(crate) encoding: String,
    pub(crate) messages: u64,
    /// First and last recording time of a message, nanoseconds.
    pub(crate) recorded: Option<(u64, u64)>,
    /// True if a recording time was earlier than that of the message before.
    goes_back: bool,
    /// Number of unreadable messages, and the error of the first.
    pub(crate) unreadable: Option<(u64, String)>,
    pub(crate) content: Content,
}

/// Data kept from the messages of a topic.
#[derive(Debug)]
pub(crate) enum Content {
    Images(Images),
    Calibrations {
        frame: String,
        list: Vec<(StampedPlace, Calibration)>,
    },
    Poses(Poses),
    Transforms {
        is_fixed: bool,
    },
    Path(PathPoses),
    /// The unit of a RealSense's depth, if it can be read.
    DepthUnit {
        metres: Option<f64>,
    },
    Other,
}

/// Location of a message, with its stamp, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StampedPlace {
    pub(crate) stamp: i64,
    pub(crate) recorded: Recorded,
    pub(crate) place: MessagePlace,
}

impl StampedPlace {
    pub(crate) fn instant(&self) -> Instant {
        Instant { stamp: self.stamp, recorded: self.recorded }
    }
}

impl Stamped for StampedPlace {
    fn stamp(&self) -> i64 {
        self.stamp
    }

    fn set_stamp(&mut self, stamp: i64) {
        self.stamp = stamp;
    }

    fn recorded(&self) -> Recorded {
        self.recorded
    }
}

/// The images of a topic.
#[derive(Debug, Default)]
pub(crate) struct Images {
    /// True if they are image files (`CompressedImage`).
    pub(crate) is_compressed: bool,
    /// Kind of the first image; `None` before it.
    pub(crate) kind: Option<ImageKind>,
    /// Encoding or format of the first image.
    pub(crate) encoding: String,
    /// Coordinate frame of the first image.
    pub(crate) frame: String,
    /// Size of the first image, `(width, height)`, as far as it can be read.
    pub(crate) size: Option<(usize, usize)>,
    pub(crate) timeline: Timeline<StampedPlace>,
}

/// Contents of a whole recording, or of a stream so far.
#[derive(Debug)]
pub(crate) struct Contents {
    path: PathBuf,
    /// In the order of their first channels.
    pub(crate) topics: Vec<Topic>,
    pub(crate) tree: TransformTree,
    pub(crate) quaternions: QuaternionCounts,
    /// Index of the topic with each name and type.
    known: BTreeMap<(String, String), usize>,
    /// Number of messages so far.
    messages: i64,
    pub(crate) order: Order,
    /// Memory used by the lists so far, and their limit, bytes.
    memory: u64,
    limit: u64,
}

impl Contents {
    pub(crate) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            topics: Vec::new(),
            tree: TransformTree::default(),
            quaternions: QuaternionCounts::default(),
            known: BTreeMap::new(),
            messages: 0,
            order: Order::default(),
            memory: 0,
            limit: MemoryLimit::in_force() / MEMORY_PART,
        }
    }

    /// Creates the contents of a stream, whose transforms are limited. `name` is that of the stream, for messages.
    pub(crate) fn streamed(name: &Path) -> Self {
        Self { tree: TransformTree::streamed(), ..Self::new(name) }
    }

    /// Sorts everything by time, once all messages have been read.
    pub(crate) fn sort(&mut self) {
        // A single message says nothing about the clock.
        let clock_stands_still =
            |topic: &Topic| topic.messages > 1 && topic.recorded.is_some_and(|(first, last)| first == last);
        if self.topics.iter().any(|topic| topic.goes_back || clock_stands_still(topic)) {
            self.order = Order::Number;
        }
        self.replace_constant_stamps();
        self.tree.sort(self.order);
        for topic in &mut self.topics {
            match &mut topic.content {
                Content::Images(images) => images.timeline.sort(self.order),
                Content::Poses(poses) => poses.timeline.sort(self.order),
                _ => {}
            }
        }
    }

    /// Replaces constant stamps by recording times, with a warning, as missing stamps are. Those of poses and transforms only
    /// count if those of images are constant: latched ones are repeated.
    fn replace_constant_stamps(&mut self) {
        let mut is_stuck = false;
        for topic in &mut self.topics {
            let Content::Images(images) = &mut topic.content else { continue };
            let Some(stamp) = images.timeline.constant_stamp() else { continue };
            is_stuck = true;
            images.timeline.replace_constant_stamp();
            warn_once(format!(
                "{}: all images of {} have one stamp, {:.3} s: their recording times are used instead, which may be late",
                self.path.display(),
                topic.name,
                stamp as f64 * 1e-9
            ));
        }
        if !is_stuck {
            return;
        }
        self.tree.replace_constant_stamps();
        for topic in &mut self.topics {
            if let Content::Poses(poses) = &mut topic.content {
                poses.timeline.replace_constant_stamp();
            }
        }
    }

    /// Returns true if a topic has images with depth.
    pub(crate) fn has_depth(&self) -> bool {
        let is_depth = |content: &Content| match content {
            Content::Images(images) => images.kind == Some(ImageKind::Depth),
            _ => false,
        };
        self.topics.iter().any(|topic| is_depth(&topic.content))
    }

    /// Finds a topic by name, with or without the leading slash.
    pub(crate) fn find(&self, name: &str) -> Option<&Topic> {
        let bare = |name: &str| name.trim_start_matches('/').to_owned();
        self.topics.iter().find(|topic| topic.name == name).or_else(|| {
            let wanted = bare(name);
            self.topics.iter().find(|topic| bare(&topic.name) == wanted)
        })
    }

    /// Returns the index of the topic with a name and type, if it is known.
    pub(crate) fn known_topic(&self, name: &str, type_name: &str) -> Option<usize> {
        self.known.get(&(one_line(name), full_type_name(&one_line(type_name)))).copied()
    }

    /// Returns the index of the topic with a name and type, which is added if it is new.
    ///
    /// # Errors
    /// If the list of topics takes too much memory.
    pub(crate) fn topic(&mut self, name: &str, type_name: &str, encoding: &str) -> Result<usize, DatasetError> {
        let key = (one_line(name), full_type_name(&one_line(type_name)));
        if let Some(topic) = self.known.get(&key) {
            return Ok(*topic);
        }
        self.add_memory(2 * (key.0.len() + key.1.len()) as u64 + TOPIC_BYTES)?;
        let (name, type_name) = key.clone();
        let content = if encoding == "cdr" { Content::for_topic(&name, &type_name) } else { Content::Other };
        let index = self.topics.len();
        self.topics.push(Topic {
            name,
            type_name,
            encoding: one_line(encoding),
            messages: 0,
            recorded: None,
            goes_back: false,
            unreadable: None,
            content,
        });
        self.known.insert(key, index);
        Ok(index)
    }

    /// Records a message of a topic. `log_time` is its recording time, nanoseconds.
    ///
    /// # Errors
    /// If the list of messages takes too much memory. A message that cannot be read is counted.
    pub(crate) fn message(
        &mut self,
        topic: usize,
        (log_time, place): (u64, MessagePlace),
        data: &[u8],
    ) -> Result<(), DatasetError> {
        let Some(topic) = self.topics.get_mut(topic) else { return Ok(()) };
        self.messages += 1;
        let recorded = Recorded { log_time: i64::try_from(log_time).unwrap_or(i64::MAX), number: self.messages };
        topic.count(log_time);
        let message = TopicMessage { data, recorded, place };
        match topic.content.record(&topic.name, &message, (&mut self.tree, &mut self.quaternions)) {
            Ok(kept) => self.add_memory(kept),
            Err(error) => {
                topic.count_unreadable(&error);
                Ok(())
            }
        }
    }

    /// Counts a message of a topic that cannot be read.
    pub(crate) fn unreadable_message(&mut self, topic: usize, log_time: u64, error: &str) {
        self.messages += 1;
        if let Some(topic) = self.topics.get_mut(topic) {
            topic.count(log_time);
            topic.count_unreadable(&CdrError::Content(error.to_owned()));
        }
    }

    /// Records a message of a stream's topic. It is not sorted into the others yet.
    ///
    /// # Errors
    /// If it cannot be read.
    pub(crate) fn record(&mut self, topic: usize, message: &TopicMessage<'_>) -> Result<(), CdrError> {
        let Some(topic) = self.topics.get_mut(topic) else { return Ok(()) };
        let recorded = topic.content.record(&topic.name, message, (&mut self.tree, &mut self.quaternions));
        recorded.map(drop).inspect_err(|error| topic.count_unreadable(error))
    }

    /// Returns the index of one of its topics.
    pub(crate) fn index_of(&self, topic: &Topic) -> Option<usize> {
        self.topics.iter().position(|other| std::ptr::eq(other, topic))
    }

    /// Returns the poses of the topic with an index.
    pub(crate) fn poses(&self, topic: usize) -> Option<&Poses> {
        match &self.topics.get(topic)?.content {
            Content::Poses(poses) => Some(poses),
            _ => None,
        }
    }

    /// Adds `bytes` to the memory used by the lists. Errors if it exceeds the limit.
    pub(crate) fn add_memory(&mut self, bytes: u64) -> Result<(), DatasetError> {
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

impl Topic {
    /// Counts a message. `log_time` is its recording time, nanoseconds.
    fn count(&mut self, log_time: u64) {
        self.messages += 1;
        self.goes_back |= self.recorded.is_some_and(|(_, last)| log_time < last);
        let first_and_last = self.recorded.map(|(first, last)| (first.min(log_time), last.max(log_time)));
        self.recorded = Some(first_and_last.unwrap_or((log_time, log_time)));
    }

    fn count_unreadable(&mut self, error: &CdrError) {
        let (count, _) = self.unreadable.get_or_insert_with(|| (0, error.to_string()));
        *count += 1;
    }
}

impl Content {
    /// Selects the content kept from a topic by its name and type.
    pub(crate) fn for_topic(name: &str, type_name: &str) -> Self {
        match type_name {
            "sensor_msgs/msg/Image" => Self::Images(Images::default()),
            "sensor_msgs/msg/CompressedImage" => Self::Images(Images { is_compressed: true, ..Images::default() }),
            "sensor_msgs/msg/CameraInfo" => Self::Calibrations { frame: String::new(), list: Vec::new() },
            "tf2_msgs/msg/TFMessage" => {
                Self::Transforms { is_fixed: name.ends_with("tf_static") || is_extrinsics(name) }
            }
            "std_msgs/msg/Float32" | "std_msgs/msg/String" if is_depth_unit(name) => Self::DepthUnit { metres: None },
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
        message: &TopicMessage<'_>,
        (tree, quaternions): (&mut TransformTree, &mut QuaternionCounts),
    ) -> Result<u64, CdrError> {
        let recorded = message.recorded;
        let stamp_of = |stamp: Time| match stamp.nanoseconds() {
            // Some drivers do not set the stamp.
            0 => recorded.log_time,
            stamp => stamp,
        };
        match self {
            Self::Images(images) => images.record(topic, message, stamp_of),
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
            Self::Poses(poses) => {
                poses.record((message.data, recorded), stamp_of, |parts| quaternions.pose(topic, parts))
            }
            Self::Transforms { is_fixed } => {
                let transforms: TfMessage = from_cdr(message.data)?;
                for transform in &transforms.transforms {
                    let (parent, child) =
                        (frame_name(&transform.header.frame_id), frame_name(&transform.child_frame_id));
                    if let Some(rigid) = quaternions.transform((&parent, &child), parts_of_transform(transform)) {
                        let sample = Sample { stamp: stamp_of(transform.header.stamp), recorded, transform: rigid };
                        tree.add(&parent, &child, sample, *is_fixed);
                    }
                }
                // Fixed transforms replace each other, moving ones are all kept.
                Ok((transforms.transforms.len() * size_of::<Sample>()) as u64)
            }
            Self::Path(path) => path.record(message.data, recorded),
            Self::DepthUnit { metres } => {
                // As text, or as a number of 32 bits, whose shortest text is what was meant.
                let text = match message.data.len() {
                    FLOAT_MESSAGE_BYTES => from_cdr::<f32>(message.data)?.to_string(),
                    _ => from_cdr(message.data)?,
                };
                let number = text.trim().parse();
                *metres = Some(number.map_err(|_| CdrError::Content(format!("found {text:?}, expected metres")))?);
                Ok(0)
            }
            Self::Other => Ok(0),
        }
    }
}

impl Images {
    fn record(
        &mut self,
        topic: &str,
        message: &TopicMessage<'_>,
        stamp_of: impl Fn(Time) -> i64,
    ) -> Result<u64, CdrError> {
        let needs_size = self.size.is_none() && self.timeline.unsorted() < SIZE_TRIES;
        let (header, kind, encoding) = if self.is_compressed {
            let image: CompressedImage<'_> = from_cdr(message.data)?;
            if needs_size {
                self.size = compressed_size(&image);
            }
            (image.header.clone(), compressed_kind(topic, &image), image.format)
        } else {
            let image: Image<'_> = from_cdr(message.data)?;
            self.size.get_or_insert((image.width as usize, image.height as usize));
            (image.header, raw_kind(topic, image.encoding), image.encoding)
        };
        if self.kind.is_none() {
            self.kind = Some(kind);
            self.encoding = one_line(encoding).chars().take(60).collect();
            self.frame = frame_name(&header.frame_id);
        }
        self.timeline.record(StampedPlace {
            stamp: stamp_of(header.stamp),
            recorded: message.recorded,
            place: message.place,
        });
        Ok(2 * size_of::<StampedPlace>() as u64)
    }
}

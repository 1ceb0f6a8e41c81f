//! Summary of a recording's contents, for inspection.

use super::RecordingScene;
use super::recorded_file::RecordedFile;
use super::recorded_topics::RecordedTopics;
use super::recording_parts::RecordingParts;
use crate::ros_topics::contents::Content;
use crate::{DatasetError, DatasetSettings, Format, LeftOut, Scene};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Summary of a recording's contents and of the parts that would be used.
#[derive(Debug)]
pub struct RecordingSummary {
    /// The file, or the folder of a recording in several files.
    pub path: PathBuf,
    /// Its format: MCAP, SQLite, a bag of ROS 1 or Matroska of Azure Kinect.
    pub format: Format,
    /// The name of the format for people.
    pub title: &'static str,
    /// Number of files.
    pub files: usize,
    /// How rosbag2 has compressed it, e.g. `zstd, each message`; `None` if it has not.
    pub compression: Option<&'static str>,
    /// The camera as the file describes it; `None` without a description.
    pub camera: Option<String>,
    /// Topics, in order of appearance.
    pub topics: Vec<RecordingTopic>,
    /// Damage to the file, one line each.
    pub damage: Vec<String>,
    /// The frames that would be used, or the reason that nothing can be used.
    pub scene: Result<RecordingFrames, DatasetError>,
}

/// The frames of a recording.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordingFrames {
    /// The topics used, one line each.
    pub sources: Vec<String>,
    /// Number of frames.
    pub count: usize,
    /// Frames without a pose in a recording that has poses.
    pub without_pose: Vec<LeftOut>,
    /// The skipped frames.
    pub left_out: Vec<LeftOut>,
}

/// A topic of a recording.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RecordingTopic {
    /// Name, e.g. `/camera/color/image_raw`.
    pub name: String,
    /// Message type, e.g. `sensor_msgs/msg/Image`; empty if the file does not state it.
    pub type_name: String,
    /// Message encoding: `cdr` for ROS 2, and for messages of ROS 1 that are converted to it.
    pub encoding: String,
    /// Number of messages.
    pub messages: u64,
    /// Recording times of the first and last message, since the Unix epoch.
    pub recorded: Option<(Duration, Duration)>,
    /// For images: their encoding and coordinate frame.
    pub images: Option<(String, String)>,
    /// Number of unreadable messages, and the error of the first.
    pub unreadable: Option<(u64, String)>,
}

impl RecordingSummary {
    /// Reads all of a recording, or of the only one in a folder.
    ///
    /// # Errors
    /// If there is no recording, or a file is not of the kind that its name says, or cannot be read. A recording without usable frames is not an
    /// error.
    pub fn read(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let recording = RecordingParts::find_any(path)?;
        let path = recording.path.clone();
        let mut recorded = RecordedTopics::new(&path);
        let file = RecordedFile::scan(&recording, &mut recorded)?;
        let (files, compression) = (recording.files.len(), file.compression());
        let RecordedTopics { mut contents, without_channel, .. } = recorded;
        contents.sort();
        let mut damage = file.damage().to_vec();
        let camera = file.camera().map(str::to_owned);
        if without_channel > 0 {
            damage.push(format!("{}: {} messages belong to no topic", path.display(), without_channel));
        }
        let topics = contents.topics.iter().map(|topic| RecordingTopic {
            name: topic.name.clone(),
            type_name: topic.type_name.clone(),
            encoding: topic.encoding.clone(),
            messages: topic.messages,
            recorded: topic.recorded.map(|(first, last)| (Duration::from_nanos(first), Duration::from_nanos(last))),
            images: match &topic.content {
                Content::Images(images) if images.kind.is_some() => {
                    Some((images.encoding.trim().to_owned(), images.frame.clone()))
                }
                _ => None,
            },
            unreadable: topic.unreadable.clone(),
        });
        let topics = topics.collect();
        let scene =
            RecordingScene::from_contents((recording.name(), file), &contents, settings).map(|scene| RecordingFrames {
                sources: scene.sources().to_vec(),
                count: scene.frame_count(),
                without_pose: scene.without_pose().to_vec(),
                left_out: scene.left_out().to_vec(),
            });
        let (format, title) = (recording.container.format(), recording.container.title());
        Ok(Self { path, format, title, files, compression, camera, topics, damage, scene })
    }
}

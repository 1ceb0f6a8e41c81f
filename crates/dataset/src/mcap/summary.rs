//! What is in a recording, for people who look into it.

use super::container::McapFile;
use super::contents::{Content, Contents};
use super::{McapScene, RECORDING};
use crate::{DatasetError, DatasetSettings, LeftOut, Scene};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What is in a recording, and what of it would be used.
#[derive(Debug)]
pub struct McapSummary {
    /// The file.
    pub path: PathBuf,
    /// Its topics, in the order in which they appear.
    pub topics: Vec<McapTopic>,
    /// What is wrong with the file, one line each.
    pub damage: Vec<String>,
    /// The topics that are used, one line each, the number of frames, and what is left out; or why nothing can be used.
    pub scene: Result<(Vec<String>, usize, Vec<LeftOut>), DatasetError>,
}

/// A topic of a recording.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct McapTopic {
    /// Its name, e.g. `/camera/color/image_raw`.
    pub name: String,
    /// The type of its messages, e.g. `sensor_msgs/msg/Image`; empty if the file does not say.
    pub type_name: String,
    /// How they are encoded: `cdr` for ROS 2.
    pub encoding: String,
    /// How many there are.
    pub messages: u64,
    /// When the first and the last were recorded, since the Unix epoch.
    pub recorded: Option<(Duration, Duration)>,
    /// For images: their encoding and coordinate frame.
    pub images: Option<(String, String)>,
    /// How many messages cannot be read, and what is wrong with the first.
    pub unreadable: Option<(u64, String)>,
}

impl McapSummary {
    /// Reads all of a recording, or of the only one in a folder.
    ///
    /// # Errors
    /// If there is no recording, if it is no MCAP file, or if it cannot be read. A recording without usable frames is no
    /// error.
    pub fn read(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let path = RECORDING.find(path)?;
        let mut contents = Contents::new(&path);
        let file = McapFile::scan(&path, &mut contents)?;
        contents.sort();
        let mut damage = file.damage().to_vec();
        if contents.without_channel > 0 {
            damage.push(format!("{}: {} messages belong to no topic", path.display(), contents.without_channel));
        }
        let topics = contents.topics.iter().map(|topic| McapTopic {
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
        let scene = McapScene::of(file, &contents, settings)
            .map(|scene| (scene.sources().to_vec(), scene.frame_count(), scene.left_out().to_vec()));
        Ok(Self { path, topics, damage, scene })
    }
}

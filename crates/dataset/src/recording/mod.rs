//! Recordings of ROS messages, as written by cameras and robots: images, camera infos, transforms and poses.
//!
//! Three containers hold them: MCAP (`mcap/`), SQLite (`sqlite/`) and the bags of ROS 1 (`bag/`), whose messages are
//! converted to CDR. The tracks of an Azure Kinect's Matroska (`mkv/`) become such messages, too. Each reader passes on topics and messages in order (`container.rs`), and reads a message again by its
//! place (`recorded_file.rs`). All that follows is the same for them. What RealSense's SDK says in messages of its own is
//! translated on the way (`realsense.rs`).
//!
//! The file is read once on opening, to list the topics and the times of their messages (`recorded_topics.rs`). Topics
//! are chosen, colour and depth are paired by their stamps, and poses are interpolated as in
//! [`ros_topics`](crate::ros_topics). Images are read on demand.

mod bag;
mod chunked_files;
mod chunks;
mod container;
mod mcap;
mod messages;
mod mkv;
mod realsense;
mod recorded_file;
mod recorded_topics;
mod recording_parts;
mod sqlite;
mod summary;
mod zstd;

pub(crate) use container::Container;
pub use messages::{RecordedMessage, read_messages};
pub use summary::{RecordingFrames, RecordingSummary, RecordingTopic};

use crate::corrections::CorrectionList;
use crate::own_camera::camera_place;
use crate::plausibility::warn_once;
use crate::recorded_poses::PoseCoverage;
use crate::ros_topics::choice::{Choice, Chooser};
use crate::ros_topics::contents::Contents;
use crate::ros_topics::frames::{FrameMaker, Frames, PairedFrame};
use crate::ros_topics::reader::{FrameReader, MessageSource};
use crate::scene::{FramePart, FrameParts, LeftOut, entry};
use crate::{CorrectedPose, DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use recorded_file::RecordedFile;
use recorded_topics::RecordedTopics;
use recording_parts::RecordingParts;
use splatseg_geometry::SegmentMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A recording of ROS messages in a file of MCAP, SQLite or ROS 1, or of Azure Kinect in Matroska, or in several files into which rosbag2 has split it.
///
/// Frames are those of the colour camera, undistorted and named by number. If depth is not registered to colour and has
/// fewer pixels per degree, frames are downscaled to the resolution of depth.
#[derive(Debug)]
pub struct RecordingScene {
    name: String,
    file: RecordedFile,
    frames: Vec<PairedFrame>,
    poses: PoseCoverage,
    reader: FrameReader,
    left_out: Vec<LeftOut>,
    sources: Vec<String>,
    corrections: CorrectionList,
}

impl RecordingScene {
    /// Opens a recording, or the only one in a folder: reads all of it once, and chooses topics according to
    /// `settings`.
    ///
    /// # Errors
    /// If there is no recording or there are several, a file is not of the kind that its name says, no topic or several
    /// are suitable, a camera info is invalid, no frame has colour and depth, or there is a source of poses and no frame
    /// has one. A recording without any source of poses has frames without poses.
    pub fn open(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        Self::open_parts(&RecordingParts::find_any(path)?, settings)
    }

    /// Opens a recording in a container.
    pub(crate) fn open_as(path: &Path, container: Container, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        Self::open_parts(&RecordingParts::find(path, container)?, settings)
    }

    fn open_parts(recording: &RecordingParts, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let mut recorded = RecordedTopics::new(&recording.path);
        let file = RecordedFile::scan(recording, &mut recorded)?;
        let mut contents = recorded.contents;
        contents.sort();
        for text in file.damage() {
            warn_once(text.clone());
        }
        Self::from_contents((recording.name(), file), &contents, settings)
    }

    /// Returns true if a recording, or the only one in a folder, has no topic with depth. Reads all of it once.
    ///
    /// # Errors
    /// If there is no recording or there are several, or the file is not of the kind that its name says.
    pub(crate) fn lacks_depth(path: &Path) -> Result<bool, DatasetError> {
        let recording = RecordingParts::find_any(path)?;
        let mut recorded = RecordedTopics::new(&recording.path);
        RecordedFile::scan(&recording, &mut recorded)?;
        Ok(!recorded.contents.has_depth())
    }

    /// Returns true if a path has the name of a recording, or is a folder containing some.
    pub fn is_recording(path: &Path) -> bool {
        Container::ALL.iter().any(|container| RecordingParts::looks_like(path, *container))
    }

    /// Builds the scene from a scanned recording and its name.
    fn from_contents(
        (name, file): (String, RecordedFile),
        contents: &Contents,
        settings: &DatasetSettings,
    ) -> Result<Self, DatasetError> {
        let path = file.path().to_owned();
        file.require_images(settings)?;
        let choice = Chooser { path: &path, contents, settings }.choose()?;
        warn_of_unreadable(&path, &choice);
        let maker = FrameMaker { path: &path, contents, settings, choice };
        maker.warn_of_quaternions();
        let reader = FrameReader::new(&maker)?;
        let (pose_source, pose_text) = maker.pose_source()?;
        let cameras = (&reader.color.cameras, &reader.depth.cameras);
        let Frames { list: frames, poses, left_out } = maker.frames(&pose_source, cameras)?;
        let sources = reader.sources(&choice).into_iter().chain([format!("poses: {pose_text}")]);
        let (corrections, correction_text) = maker.corrections(&frames)?;
        let sources = sources.chain(correction_text).collect();
        Ok(Self { name, file, frames, poses, reader, left_out, sources, corrections })
    }

    /// Describes a message of a frame, for errors.
    fn place(&self, topic: &str, frame: &PairedFrame) -> PathBuf {
        let seconds = frame.stamp as f64 * 1e-9;
        format!("{}: {topic} at {seconds:.3} s", self.file.path().display()).into()
    }
}

/// Warns about messages of the chosen topics that cannot be read.
fn warn_of_unreadable(path: &Path, choice: &Choice<'_>) {
    let images = [choice.color.0, choice.depth.0];
    for topic in images.into_iter().chain(choice.color_info).chain(choice.depth_info) {
        if let Some((count, first)) = &topic.unreadable {
            warn_once(format!("{}: {}: {count} messages cannot be read: {first}", path.display(), topic.name));
        }
    }
}

/// Returns true if a path is a recording in a container, or a folder containing some.
pub(crate) fn looks_like(path: &Path, container: Container) -> bool {
    RecordingParts::looks_like(path, container)
}

impl Scene for RecordingScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.frames.len()
    }

    fn frame_name(&self, index: usize) -> String {
        if index < self.frames.len() { index.to_string() } else { String::new() }
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let frame = entry(&self.frames, index, &self.name)?;
        let data = |place| self.file.read(place);
        let messages = MessageSource { data, place: |topic: &str| self.place(topic, frame) };
        let (color, depth, intrinsics) = self.reader.read(frame, &messages)?;
        let timestamp = u64::try_from(frame.stamp).ok().map(Duration::from_nanos);
        let name = self.frame_name(index);
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera: frame.pose }.into_frame()
    }

    fn has_depth(&self) -> bool {
        self.reader.has_depth()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.poses.without_pose()
    }

    fn corrections(&self, known_with: Range<usize>) -> Vec<CorrectedPose> {
        self.corrections.known_with(known_with)
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }

    fn format(&self) -> Option<Format> {
        Some(self.file.container().format())
    }

    fn stored_color_size(&self, index: usize) -> Option<(usize, usize)> {
        let camera = self.reader.color.cameras.list.get(self.frames.get(index)?.cameras.0)?;
        Some((camera.intrinsics.width, camera.intrinsics.height))
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn sources(&self) -> &[String] {
        &self.sources
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(frame), FramePart::Depth) => self.place(&self.reader.depth.topic, frame),
            (Some(frame), FramePart::Pose) => self.place("pose", frame),
            (_, FramePart::Intrinsics) => {
                let place =
                    PathBuf::from(format!("{}: {}", self.file.path().display(), self.reader.color.cameras.topic));
                camera_place(self.reader.own_camera.as_ref(), &place)
            }
            (None, _) => self.file.path().to_owned(),
        }
    }
}

//! Frames of a stream whose images have not been decoded yet.

use crate::frame_checks::FrameChecks;
use crate::ros_topics::contents::MessagePlace;
use crate::ros_topics::frames::PairedFrame;
use crate::ros_topics::reader::{FrameReader, MessageSource};
use crate::scene::FrameParts;
use crate::{DatasetError, FramePart, FrameReadError, StreamedFrame};
use splatseg_geometry::PoseFormat;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Name of the stream in messages.
pub(super) const STREAM: &str = "live";

/// State shared by the frames of a stream.
#[derive(Debug)]
pub(super) struct FramesInCommon {
    pub(super) checks: Mutex<FrameChecks>,
    /// How the poses of the stream are stated.
    pub(super) pose_format: PoseFormat,
    /// Number of frames that could not be read, and of those among them without a pose.
    pub(super) unreadable: AtomicU64,
    pub(super) unreadable_without_pose: AtomicU64,
}

/// A frame of a stream: two images that belong together, or one of colour if there is no depth, and the camera's pose if it is known. Reading it takes time
/// (decoding, undistortion, registration), so do this where it does not keep the [`FrameMatcher`](crate::FrameMatcher)
/// from receiving messages.
#[derive(Debug)]
pub struct UndecodedFrame {
    pub(super) index: usize,
    pub(super) frame: PairedFrame,
    pub(super) color: Arc<[u8]>,
    pub(super) depth: Arc<[u8]>,
    /// True if there is a source of poses, and none of this time.
    pub(super) lacks_pose: bool,
    pub(super) received: Duration,
    pub(super) reader: Arc<FrameReader>,
    pub(super) common: Arc<FramesInCommon>,
}

impl UndecodedFrame {
    /// Returns the index of the frame among those given by its matcher, which is also its name.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Returns the stamp of the colour image, nanoseconds by the clock of its publisher.
    pub fn stamp(&self) -> i64 {
        self.frame.stamp
    }

    /// Returns the topic of its colour image and the message, in CDR, and those of its depth image, if it has one.
    pub fn images(&self) -> impl Iterator<Item = (&str, &[u8])> {
        let depth = (self.reader.depth.topic.as_str(), &*self.depth);
        let depth = Some(depth).filter(|_| self.reader.has_depth());
        [(self.reader.color.topic.as_str(), &*self.color)].into_iter().chain(depth)
    }

    /// Returns when the last of its images was received, as passed to [`FrameMatcher::feed`](crate::FrameMatcher::feed).
    pub fn received(&self) -> Duration {
        self.received
    }

    /// Returns true if the pose of the camera is known.
    pub fn has_pose(&self) -> bool {
        self.frame.pose.is_some()
    }

    /// Decodes the frame, resized and cropped as the settings say. Frames must be read in order, as the first determines
    /// the size of the others.
    ///
    /// # Errors
    /// If an image is damaged, is of another size than its camera info says or than the first frame, or the camera info
    /// is implausible. The frame then counts as unreadable. Later frames can still be read.
    pub fn read(self) -> Result<StreamedFrame, FrameReadError> {
        let index = self.index;
        self.try_read().map_err(|error| {
            self.common.unreadable.fetch_add(1, Ordering::Relaxed);
            self.common.unreadable_without_pose.fetch_add(u64::from(self.lacks_pose), Ordering::Relaxed);
            FrameReadError { index, name: index.to_string(), source: Box::new(error) }
        })
    }

    fn try_read(&self) -> Result<StreamedFrame, DatasetError> {
        let frame = &self.frame;
        let data = |place: MessagePlace| {
            Ok(if place == frame.color { Arc::clone(&self.color) } else { Arc::clone(&self.depth) })
        };
        let place = |topic: &str| PathBuf::from(format!("{STREAM}: {topic} at {:.3} s", frame.stamp as f64 * 1e-9));
        let (color, depth, intrinsics) = self.reader.read(frame, &MessageSource { data, place })?;
        let timestamp = u64::try_from(frame.stamp).ok().map(Duration::from_nanos);
        let name = self.index.to_string();
        let world_from_camera = frame.pose.map(|stated| self.common.pose_format.pose(&stated));
        let recorded = FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera }.into_frame()?;
        let part = |part| match part {
            FramePart::Depth => place(&self.reader.depth.topic),
            FramePart::Pose => place("pose"),
            FramePart::Intrinsics => {
                let info = PathBuf::from(format!("{STREAM}: {}", self.reader.color.cameras.topic));
                crate::own_camera::camera_place(self.reader.own_camera.as_ref(), &info)
            }
        };
        let mut checks = self.common.checks.lock().unwrap_or_else(PoisonError::into_inner);
        let is_first = checks.original_size.is_none();
        checks.check_size(&recorded.frame, STREAM)?;
        if is_first {
            crate::plausibility::check_intrinsics(&intrinsics, &part)?;
        }
        let (frame, world_from_camera) = checks.framed(recorded, &part)?;
        Ok(StreamedFrame { index: self.index, frame, world_from_camera, corrections: Vec::new(), ground_truth: None })
    }
}

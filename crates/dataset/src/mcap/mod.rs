//! ROS 2 recordings in MCAP files, as written by cameras and robots: images, camera infos, transforms and poses in CDR.
//!
//! The file is read once on opening (`container.rs`), to list the topics and the times of their messages
//! (`contents.rs`). Topics are chosen by settings or because they are the only suitable ones (`topics.rs`). Colour and
//! depth are paired by their stamps, and poses are interpolated (`frames.rs`, `transforms.rs`). Images are read on
//! demand (`images.rs`) and undistorted, and depth is registered to colour if necessary.

mod cameras;
mod chunks;
mod clock;
mod compressed_depth;
mod container;
mod contents;
mod corrections;
mod frame_names;
mod frames;
mod images;
mod poses;
mod summary;
mod text_lengths;
mod topics;
mod transforms;

pub use summary::{McapFrames, McapSummary, McapTopic};

use crate::corrections::CorrectionList;
use crate::own_camera::{OwnCamera, camera_place};
use crate::plausibility::warn_once;
use crate::recorded_poses::PoseCoverage;
use crate::recording_file::RecordingFile;
use crate::register::{CameraPair, register_depth};
use crate::resample::{ImageMap, resample_color};
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::undistort::Undistortion;
use crate::{CorrectedPose, DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use cameras::{Camera, UndistortionCache};
use container::{McapFile, MessagePlace};
use contents::{Contents, Images};
use frames::{Cameras, FrameMaker, Frames, PairedFrame};
use glam::DVec3;
use splatseg_geometry::{Image, Intrinsics, Pose, SegmentMap};
use splatseg_ros::{CompressedImage, Image as RawImage, from_cdr};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;
use topics::{Choice, Chooser};

/// Layout of a recording, for messages.
pub(crate) const LAYOUT: &str = "a file recording.mcap with ROS 2 messages: colour and depth images, camera infos, and \
                                 transforms (/tf) or poses; or a folder with one, as rosbag2 writes it";

const RECORDING: RecordingFile = RecordingFile { extension: "mcap", expected: "a file <recording>.mcap" };
/// Colour is downscaled if the ratio of depth to colour focal length, in pixels, is at most this and depth is not
/// registered. Otherwise registered depth would be full of holes.
const MIN_FOCAL_RATIO: f32 = 0.95;

/// A recording of ROS 2 messages in an MCAP file.
///
/// Frames are those of the colour camera, undistorted and named by number. If depth is not registered to colour and has
/// fewer pixels per degree, frames are downscaled to the resolution of depth.
#[derive(Debug)]
pub struct McapScene {
    name: String,
    file: McapFile,
    frames: Vec<PairedFrame>,
    poses: PoseCoverage,
    own_camera: Option<OwnCamera>,
    color: ImageSource,
    depth: ImageSource,
    registration: Option<Registration>,
    left_out: Vec<LeftOut>,
    sources: Vec<String>,
    corrections: CorrectionList,
}

/// Images of a topic, and the cameras that took them.
#[derive(Debug)]
struct ImageSource {
    topic: String,
    is_compressed: bool,
    cameras: Cameras,
    undistortion: UndistortionCache,
}

/// Transform for registering depth to the colour camera.
#[derive(Clone, Copy, Debug)]
struct Registration {
    color_from_depth: Pose,
}

impl McapScene {
    /// Opens a recording, or the only one in a folder: reads all of it once, and chooses topics according to
    /// `settings`.
    ///
    /// # Errors
    /// If there is no recording or there are several, the file is not an MCAP file, no topic or several are suitable, a
    /// camera info is invalid, no frame has colour and depth, or there is a source of poses and no frame has one. A
    /// recording without any source of poses has frames without poses.
    pub fn open(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let path = RECORDING.find(path)?;
        let mut contents = Contents::new(&path);
        let file = McapFile::scan(&path, &mut contents)?;
        contents.sort();
        for text in file.damage() {
            warn_once(text.clone());
        }
        Self::from_contents(file, &contents, settings)
    }

    /// Returns true if a path has the name of a recording, or is a folder containing some.
    pub fn is_recording(path: &Path) -> bool {
        looks_like(path)
    }

    /// Builds the scene from a scanned recording.
    fn from_contents(file: McapFile, contents: &Contents, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let path = file.path().to_owned();
        let choice = Chooser { path: &path, contents, settings }.choose()?;
        warn_of_unreadable(&path, &choice);
        let own_camera = OwnCamera::from_settings(settings)?;
        let mut color = ImageSource::new(choice.color, choice.color_info, &path)?;
        let mut depth = ImageSource::new(choice.depth, choice.depth_info, &path)?;
        if let Some(camera) = own_camera {
            replace_camera(&camera, &choice, (&mut color, &mut depth));
        }
        let maker = FrameMaker { path: &path, contents, settings, choice };
        let (pose_source, pose_text) = maker.pose_source()?;
        let Frames { list: frames, poses, left_out } = maker.frames(&pose_source, (&color.cameras, &depth.cameras))?;
        let registration = registration(&maker, &color, &depth, &path)?;
        let sources = [
            source_text("colour", choice.color, &color.cameras.topic),
            source_text("depth", choice.depth, &depth.cameras.topic)
                + if registration.is_some() { ", registered to colour here" } else { "" },
            format!("poses: {pose_text}"),
        ];
        let (corrections, correction_text) = maker.corrections(&frames)?;
        let sources = sources.into_iter().chain(correction_text).collect();
        let name = path.file_stem().map_or_else(|| "recording".to_owned(), |stem| stem.to_string_lossy().into_owned());
        Ok(Self { name, file, frames, poses, own_camera, color, depth, registration, left_out, sources, corrections })
    }

    /// Describes a message of a frame, for errors.
    fn place(&self, topic: &str, frame: &PairedFrame) -> PathBuf {
        let seconds = frame.stamp as f64 * 1e-9;
        format!("{}: {topic} at {seconds:.3} s", self.file.path().display()).into()
    }

    /// Reads and undistorts an image of a frame. Also returns its camera.
    fn read_image<'s, T>(
        &self,
        source: &'s ImageSource,
        frame: &PairedFrame,
        (message, camera): (MessagePlace, usize),
        decode: &ImageDecoder<T>,
    ) -> Result<(Image<T>, &'s Camera), DatasetError>
    where
        T: Clone + 'static,
    {
        let path = self.place(&source.topic, frame);
        let data = self.file.read(message)?;
        let damaged = |error: splatseg_ros::CdrError| DatasetError::Other {
            scene: path.display().to_string(),
            source: error.into(),
        };
        let image = if source.is_compressed {
            (decode.compressed)(&from_cdr(&data).map_err(damaged)?, &path)?
        } else {
            (decode.raw)(&from_cdr(&data).map_err(damaged)?, &path)?
        };
        let camera = entry(&source.cameras.list, camera, &source.cameras.topic)?;
        let expected = (camera.intrinsics.width, camera.intrinsics.height);
        if image.size() != expected {
            let (what, found, expected_from) = (decode.what, image.size(), "its camera info");
            return Err(DatasetError::SizesDiffer { path, what, found, expected, expected_from });
        }
        let image = match source.undistortion.get(camera, &path)? {
            Some(map) => (decode.undistort)(&map, &image, &path)?,
            None => image,
        };
        Ok((image, camera))
    }

    /// Reads registered colour and depth images, and their camera.
    fn read_images(&self, frame: &PairedFrame) -> Result<RegisteredImages, DatasetError> {
        let (color, color_camera) = self.read_image(&self.color, frame, (frame.color, frame.cameras.0), &COLOR)?;
        let (depth, depth_camera) = self.read_image(&self.depth, frame, (frame.depth, frame.cameras.1), &DEPTH)?;
        let camera = color_camera.intrinsics;
        let Some(Registration { color_from_depth }) = self.registration else {
            require_registered(&color, &depth, &self.place(&self.depth.topic, frame))?;
            return Ok((color, depth, camera));
        };
        let target = target_camera(&camera, &depth_camera.intrinsics);
        let cameras = CameraPair {
            depth: depth_camera.intrinsics,
            color: target,
            color_from_depth: color_from_depth.relative_to(DVec3::ZERO),
        };
        let depth = register_depth(&depth, &cameras);
        let size = (target.width, target.height);
        let color =
            if size == color.size() { color } else { resample_color(&color, &ImageMap::resize(color.size(), size)) };
        Ok((color, depth, target))
    }
}

impl ImageSource {
    fn new(
        (topic, images): (&contents::Topic, &Images),
        info: &contents::Topic,
        path: &Path,
    ) -> Result<Self, DatasetError> {
        Ok(Self {
            topic: topic.name.clone(),
            is_compressed: images.is_compressed,
            cameras: Cameras::new(info, topic, path)?,
            undistortion: UndistortionCache::default(),
        })
    }
}

/// Replaces the intrinsics of the colour camera, and those of depth that is registered to it.
fn replace_camera(own: &OwnCamera, choice: &Choice<'_>, (color, depth): (&mut ImageSource, &mut ImageSource)) {
    color.cameras.replace_intrinsics(|size| own.intrinsics(size));
    let first = color.cameras.list.first().map(|camera| camera.intrinsics);
    if let (Some(camera), true) = (first, choice.color.1.frame == choice.depth.1.frame) {
        depth.cameras.replace_intrinsics(|(width, height)| camera.resized(width, height));
    }
}

/// Registered colour and depth images, and their camera.
type RegisteredImages = (Image<[u8; 3]>, Image<f32>, Intrinsics);

/// Function that undistorts an image. The path is named in errors.
type Undistort<T> = fn(&Undistortion, &Image<T>, &Path) -> Result<Image<T>, DatasetError>;

/// Functions for reading images of one kind.
struct ImageDecoder<T: Clone + 'static> {
    what: &'static str,
    raw: fn(&RawImage<'_>, &Path) -> Result<Image<T>, DatasetError>,
    compressed: fn(&CompressedImage<'_>, &Path) -> Result<Image<T>, DatasetError>,
    undistort: Undistort<T>,
}

const COLOR: ImageDecoder<[u8; 3]> = ImageDecoder {
    what: crate::decode::COLOR_IMAGE,
    raw: images::raw_color,
    compressed: images::compressed_color,
    undistort: |map, image, path| map.color(image, path),
};
const DEPTH: ImageDecoder<f32> = ImageDecoder {
    what: crate::decode::DEPTH_IMAGE,
    raw: images::raw_depth,
    compressed: images::compressed_depth,
    undistort: |map, image, path| map.depth(image, path),
};

/// Returns the registration of depth; `None` if it is registered already.
fn registration(
    maker: &FrameMaker<'_>,
    color: &ImageSource,
    depth: &ImageSource,
    path: &Path,
) -> Result<Option<Registration>, DatasetError> {
    let color_from_depth = maker.color_from_depth()?;
    let same_camera = match (color.cameras.list.first(), depth.cameras.list.first()) {
        (Some(color), Some(depth)) => color.is_same(depth),
        _ => true,
    };
    match color_from_depth {
        None if same_camera => Ok(None),
        transform => transform
            .unwrap_or(transforms::Rigid::IDENTITY)
            .to_pose()
            .map(|color_from_depth| Some(Registration { color_from_depth }))
            .map_err(|source| DatasetError::Pose { path: path.to_owned(), source }),
    }
}

/// Returns the colour camera, downscaled if its pixels are smaller than those of the depth camera.
fn target_camera(color: &Intrinsics, depth: &Intrinsics) -> Intrinsics {
    let ratio = depth.fx / color.fx;
    if ratio > MIN_FOCAL_RATIO {
        return *color;
    }
    let side = |side: usize| ((side as f32 * ratio).round() as usize).max(1);
    color.resized(side(color.width), side(color.height))
}

fn source_text(what: &str, (topic, images): (&contents::Topic, &Images), info: &str) -> String {
    format!("{what}: {} ({}, {}), camera {info}", topic.name, topic.type_name, images.encoding.trim())
}

/// Warns about messages of the chosen topics that cannot be read.
fn warn_of_unreadable(path: &Path, choice: &Choice<'_>) {
    for topic in [choice.color.0, choice.depth.0, choice.color_info, choice.depth_info] {
        if let Some((count, first)) = &topic.unreadable {
            warn_once(format!("{}: {}: {count} messages cannot be read: {first}", path.display(), topic.name));
        }
    }
}

/// Returns true if a path is a recording or a folder containing some.
pub(crate) fn looks_like(path: &Path) -> bool {
    RECORDING.looks_like(path)
}

impl Scene for McapScene {
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
        let (color, depth, intrinsics) = self.read_images(frame)?;
        let timestamp = u64::try_from(frame.stamp).ok().map(Duration::from_nanos);
        let name = self.frame_name(index);
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera: frame.pose }.into_frame()
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
        Some(Format::Mcap)
    }

    fn stored_color_size(&self, index: usize) -> Option<(usize, usize)> {
        let camera = self.color.cameras.list.get(self.frames.get(index)?.cameras.0)?;
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
            (Some(frame), FramePart::Depth) => self.place(&self.depth.topic, frame),
            (Some(frame), FramePart::Pose) => self.place("pose", frame),
            (_, FramePart::Intrinsics) => {
                let place = PathBuf::from(format!("{}: {}", self.file.path().display(), self.color.cameras.topic));
                camera_place(self.own_camera.as_ref(), &place)
            }
            (None, _) => self.file.path().to_owned(),
        }
    }
}

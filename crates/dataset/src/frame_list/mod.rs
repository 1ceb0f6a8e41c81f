//! Scenes that are lists of frames, each with its images, its own camera and its own pose: recordings of phones, and
//! nerfstudio's `transforms.json`. Their formats make the list; what is common to reading them is here.
//!
//! Colour and depth show the same view, usually at different resolutions. The frame has the resolution of the smaller one:
//! colour is resampled to the scale of depth, as for recordings with topics. Depth of the lowest confidence is left out.

mod files;
mod stated_poses;

pub(crate) use files::{FrameFiles, PlainFiles, drop_unconfident};
pub(crate) use stated_poses::StatedPoses;

use crate::error::{COLOR_IMAGE, DEPTH_IMAGE};
use crate::own_camera::{OwnCamera, camera_place, has_shape};
use crate::recorded_poses::{LOST, PoseCoverage};
use crate::ros_topics::reader::RegisteredImages;
use crate::scene::{FramePart, FrameParts, LeftOut, entry};
use crate::undistort::{Camera, UndistortionCache};
use crate::{DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use glam::DVec3;
use splatseg_geometry::{Image, Intrinsics, Pose, SegmentMap};
use splatseg_imaging::{ImageMap, resample_color, resample_depth};
use std::path::PathBuf;
use std::time::Duration;

/// A frame of a list.
#[derive(Clone, Debug)]
pub(crate) struct ListedFrame {
    pub(crate) name: String,
    pub(crate) timestamp: Option<Duration>,
    /// The images, as paths or as members of an archive.
    pub(crate) color: PathBuf,
    pub(crate) depth: PathBuf,
    pub(crate) confidence: Option<PathBuf>,
    /// The camera of colour. Images may have another resolution than that of its intrinsics.
    pub(crate) camera: Camera,
    /// As in this project; `None` if tracking was lost.
    pub(crate) world_from_camera: Option<Pose>,
    /// Where the pose and the camera are stated, for messages.
    pub(crate) pose_place: PathBuf,
    pub(crate) camera_place: PathBuf,
}

/// The frames that a format has listed, and how to read them.
#[derive(Debug)]
pub(crate) struct FrameList {
    pub(crate) name: String,
    pub(crate) format: Format,
    /// In order.
    pub(crate) frames: Vec<ListedFrame>,
    pub(crate) left_out: Vec<LeftOut>,
    /// True if the recording states poses, though none may be usable: frames without one are counted then.
    pub(crate) states_poses: bool,
    /// Size of colour, `(width, height)`, where its images were made smaller when they were extracted.
    pub(crate) stored_color: Option<(usize, usize)>,
    /// Reads the images.
    pub(crate) files: Box<dyn FrameFiles>,
}

/// A scene that is a list of frames. It has no ground truth segments.
#[derive(Debug)]
pub(crate) struct FrameListScene {
    list: FrameList,
    poses: PoseCoverage,
    own_camera: Option<OwnCamera>,
    world_up: Option<DVec3>,
    undistortions: [UndistortionCache; 2],
}

impl FrameListScene {
    /// Makes a scene of a list that is not empty. Uses only `fx` to `cy` and those about poses of `settings`.
    ///
    /// # Errors
    /// If the settings give a camera in part.
    pub(crate) fn new(list: FrameList, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let own_camera = OwnCamera::from_settings(settings)?;
        let lost = list.frames.iter().filter(|frame| frame.world_from_camera.is_none()).count();
        let poses = PoseCoverage::new(list.frames.len(), [(lost, format!("whose pose is missing or {LOST}"))]);
        // ARKit measures gravity: y is up.
        let is_arkit = matches!(list.format, Format::R3d | Format::Polycam | Format::Stray);
        let world_up = (is_arkit && settings.pose_format().is_default()).then_some(DVec3::Y);
        Ok(Self { list, poses, own_camera, world_up, undistortions: Default::default() })
    }

    /// Returns the camera of a colour image of `size` `(width, height)`.
    fn color_camera(&self, frame: &ListedFrame, size: (usize, usize)) -> Result<Intrinsics, DatasetError> {
        if let Some(own) = &self.own_camera {
            return Ok(scaled(own.intrinsics(self.list.stored_color.unwrap_or(size)), size));
        }
        let stated = frame.camera.intrinsics;
        if !has_shape(size, (stated.width, stated.height)) {
            return Err(DatasetError::SizesDiffer {
                path: self.list.files.place(&frame.color),
                what: COLOR_IMAGE,
                found: size,
                expected: (stated.width, stated.height),
                expected_from: "its camera",
            });
        }
        Ok(scaled(stated, size))
    }

    /// Reads the images of a frame and its camera, all of one size.
    fn read_images(&self, frame: &ListedFrame) -> Result<RegisteredImages, DatasetError> {
        let mut depth = self.list.files.depth(frame)?;
        if let Some(confidence) = self.list.files.confidence(frame)? {
            let place = self.list.files.place(frame.confidence.as_deref().unwrap_or(&frame.depth));
            drop_unconfident(&mut depth, &confidence, &place)?;
        }
        let mut color = self.list.files.color(frame)?;
        let camera = self.color_camera(frame, color.size())?;
        if !has_shape(depth.size(), color.size()) {
            return Err(DatasetError::SizesDiffer {
                path: self.list.files.place(&frame.depth),
                what: DEPTH_IMAGE,
                found: depth.size(),
                expected: color.size(),
                expected_from: "its colour image",
            });
        }
        let distortion = frame.camera.distortion;
        let lens = |size| Camera { intrinsics: scaled(camera, size), distortion };
        let [of_color, of_depth] = &self.undistortions;
        if let Some(map) = of_color.get(&lens(color.size()), &frame.camera_place)?.map {
            color = map.color(&color, &self.list.files.place(&frame.color))?;
        }
        // One map serves both where they have one size.
        let of_depth = if depth.size() == color.size() { of_color } else { of_depth };
        if let Some(map) = of_depth.get(&lens(depth.size()), &frame.camera_place)?.map {
            depth = map.depth(&depth, &self.list.files.place(&frame.depth))?;
        }
        let (color, depth) = at_one_size(color, depth);
        let camera = scaled(camera, color.size());
        Ok((color, depth, camera))
    }
}

/// Returns the camera for an image of another size of the same view.
fn scaled(camera: Intrinsics, size: (usize, usize)) -> Intrinsics {
    if (camera.width, camera.height) == size { camera } else { camera.resized(size.0, size.1) }
}

/// Resamples the larger one of two images of one view to the size of the other.
fn at_one_size(color: Image<[u8; 3]>, depth: Image<f32>) -> (Image<[u8; 3]>, Image<f32>) {
    let (from, to) = (color.size(), depth.size());
    if from == to {
        (color, depth)
    } else if from.0 >= to.0 {
        let color = resample_color(&color, &ImageMap::resize(from, to));
        (color, depth)
    } else {
        let depth = resample_depth(&depth, &ImageMap::resize(to, from));
        (color, depth)
    }
}

impl Scene for FrameListScene {
    fn name(&self) -> &str {
        &self.list.name
    }

    fn frame_count(&self) -> usize {
        self.list.frames.len()
    }

    fn frame_name(&self, index: usize) -> String {
        self.list.frames.get(index).map(|frame| frame.name.clone()).unwrap_or_default()
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let frame = entry(&self.list.frames, index, &self.list.name)?;
        let (color, depth, intrinsics) = self.read_images(frame)?;
        let ListedFrame { name, timestamp, world_from_camera, .. } = frame.clone();
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera }.into_frame()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        if self.list.states_poses { self.poses.without_pose() } else { &[] }
    }

    fn world_up(&self) -> Option<DVec3> {
        self.world_up
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }

    fn format(&self) -> Option<Format> {
        Some(self.list.format)
    }

    fn stored_color_size(&self, index: usize) -> Option<(usize, usize)> {
        let frame = self.list.frames.get(index)?;
        self.list.stored_color.or_else(|| self.list.files.color_size(frame).ok())
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.list.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.list.frames.get(index), part) {
            (Some(frame), FramePart::Depth) => self.list.files.place(&frame.depth),
            (Some(frame), FramePart::Pose) => frame.pose_place.clone(),
            (Some(frame), FramePart::Intrinsics) => camera_place(self.own_camera.as_ref(), &frame.camera_place),
            (None, _) => self.list.name.clone().into(),
        }
    }
}

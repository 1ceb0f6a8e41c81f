//! Reading of a frame's images: decoding, undistortion, and registration of depth to colour.

use super::cameras::{Camera, UndistortionCache};
use super::choice::Choice;
use super::contents::{Images, MessagePlace, Topic};
use super::frames::{Cameras, FrameMaker, PairedFrame};
use super::images;
use super::transforms::Rigid;
use crate::DatasetError;
use crate::depth_scale::DepthScale;
use crate::own_camera::OwnCamera;
use crate::register::{CameraPair, register_depth};
use crate::resample::{ImageMap, resample_color};
use crate::scene::{entry, require_registered};
use crate::undistort::Undistortion;
use glam::DVec3;
use splatseg_geometry::{Image, Intrinsics, Pose};
use splatseg_ros::{CompressedImage, Image as RawImage, from_cdr};
use std::ops::Deref;
use std::path::{Path, PathBuf};

/// Colour is downscaled if the ratio of depth to colour focal length, in pixels, is at most this and depth is not
/// registered. Otherwise registered depth would be full of holes.
const MIN_FOCAL_RATIO: f32 = 0.95;

/// Reader of the images of the chosen topics. Frames are those of the colour camera.
#[derive(Debug)]
pub(crate) struct FrameReader {
    pub(crate) own_camera: Option<OwnCamera>,
    pub(crate) color: ImageSource,
    pub(crate) depth: ImageSource,
    registration: Option<Registration>,
}

/// Images of a topic, and the cameras that took them.
#[derive(Debug)]
pub(crate) struct ImageSource {
    pub(crate) topic: String,
    is_compressed: bool,
    pub(crate) cameras: Cameras,
    /// Unit of depth; that of the encoding if `None`.
    depth_scale: Option<DepthScale>,
    undistortion: UndistortionCache,
}

/// Transform for registering depth to the colour camera.
#[derive(Clone, Copy, Debug)]
struct Registration {
    color_from_depth: Pose,
}

/// Gives the data of messages, and describes messages of a topic for errors.
pub(crate) struct MessageSource<Data, Place> {
    pub(crate) data: Data,
    pub(crate) place: Place,
}

impl FrameReader {
    /// Prepares reading the topics chosen by `maker`, with the cameras described so far.
    ///
    /// # Errors
    /// If a camera info or a setting is invalid, or depth is in another frame and nothing connects them.
    pub(crate) fn new(maker: &FrameMaker<'_>) -> Result<Self, DatasetError> {
        let (choice, path) = (&maker.choice, maker.path);
        let own_camera = OwnCamera::from_settings(maker.settings)?;
        let mut color = ImageSource::new(choice.color, choice.color_info, path)?;
        let mut depth = ImageSource::new(choice.depth, choice.depth_info, path)?;
        depth.depth_scale = DepthScale::from_settings(maker.settings);
        if let Some(camera) = own_camera {
            replace_camera(&camera, choice, (&mut color, &mut depth));
        }
        let registration = registration(maker, &color, &depth)?;
        Ok(Self { own_camera, color, depth, registration })
    }

    /// Describes the images, for people. `choice` is that of [`Self::new`].
    pub(crate) fn sources(&self, choice: &Choice<'_>) -> [String; 2] {
        let registered = if self.registration.is_some() { ", registered to colour here" } else { "" };
        [
            source_text("colour", choice.color, &self.color.cameras.topic),
            source_text("depth", choice.depth, &self.depth.cameras.topic) + registered,
        ]
    }

    /// Reads and undistorts an image of a frame. Also returns its camera.
    fn read_image<'s, T, D>(
        source: &'s ImageSource,
        messages: &MessageSource<impl Fn(MessagePlace) -> Result<D, DatasetError>, impl Fn(&str) -> PathBuf>,
        (message, camera): (MessagePlace, usize),
        decode: &ImageDecoder<T>,
    ) -> Result<(Image<T>, &'s Camera), DatasetError>
    where
        T: Clone + 'static,
        D: Deref<Target = [u8]>,
    {
        let path = (messages.place)(&source.topic);
        let data = (messages.data)(message)?;
        let damaged = |error: splatseg_ros::CdrError| DatasetError::Other {
            scene: path.display().to_string(),
            source: error.into(),
        };
        let image = if source.is_compressed {
            (decode.compressed)(&from_cdr(&data).map_err(damaged)?, source.depth_scale, &path)?
        } else {
            (decode.raw)(&from_cdr(&data).map_err(damaged)?, source.depth_scale, &path)?
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
    pub(crate) fn read<D: Deref<Target = [u8]>>(
        &self,
        frame: &PairedFrame,
        messages: &MessageSource<impl Fn(MessagePlace) -> Result<D, DatasetError>, impl Fn(&str) -> PathBuf>,
    ) -> Result<RegisteredImages, DatasetError> {
        let (color, color_camera) = Self::read_image(&self.color, messages, (frame.color, frame.cameras.0), &COLOR)?;
        let (depth, depth_camera) = Self::read_image(&self.depth, messages, (frame.depth, frame.cameras.1), &DEPTH)?;
        let camera = color_camera.intrinsics;
        let Some(Registration { color_from_depth }) = self.registration else {
            require_registered(&color, &depth, &(messages.place)(&self.depth.topic))?;
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
    fn new((topic, images): (&Topic, &Images), info: &Topic, path: &Path) -> Result<Self, DatasetError> {
        Ok(Self {
            topic: topic.name.clone(),
            is_compressed: images.is_compressed,
            cameras: Cameras::new(info, topic, path)?,
            depth_scale: None,
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
pub(crate) type RegisteredImages = (Image<[u8; 3]>, Image<f32>, Intrinsics);

/// Function that undistorts an image. The path is named in errors.
type Undistort<T> = fn(&Undistortion, &Image<T>, &Path) -> Result<Image<T>, DatasetError>;

/// Functions for reading images of one kind.
struct ImageDecoder<T: Clone + 'static> {
    what: &'static str,
    raw: fn(&RawImage<'_>, Option<DepthScale>, &Path) -> Result<Image<T>, DatasetError>,
    compressed: fn(&CompressedImage<'_>, Option<DepthScale>, &Path) -> Result<Image<T>, DatasetError>,
    undistort: Undistort<T>,
}

const COLOR: ImageDecoder<[u8; 3]> = ImageDecoder {
    what: crate::decode::COLOR_IMAGE,
    raw: |message, _, path| images::raw_color(message, path),
    compressed: |message, _, path| images::compressed_color(message, path),
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
) -> Result<Option<Registration>, DatasetError> {
    let color_from_depth = maker.color_from_depth()?;
    let same_camera = match (color.cameras.list.first(), depth.cameras.list.first()) {
        (Some(color), Some(depth)) => color.is_same(depth),
        _ => true,
    };
    match color_from_depth {
        None if same_camera => Ok(None),
        transform => transform
            .unwrap_or(Rigid::IDENTITY)
            .to_pose()
            .map(|color_from_depth| Some(Registration { color_from_depth }))
            .map_err(|source| DatasetError::Pose { path: maker.path.to_owned(), source }),
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

fn source_text(what: &str, (topic, images): (&Topic, &Images), info: &str) -> String {
    format!("{what}: {} ({}, {}), camera {info}", topic.name, topic.type_name, images.encoding.trim())
}

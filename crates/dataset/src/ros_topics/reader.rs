//! Reading of a frame's images: decoding, undistortion, and registration of depth to colour.

use super::camera_list::{Cameras, image_facts, warn_of_assumptions};
use super::choice::Choice;
use super::contents::{Images, MessagePlace, Topic};
use super::frames::{FrameMaker, PairedFrame};
use super::images;
use super::registration::{Alignment, Decision, decide};
use crate::depth_scale::DepthScale;
use crate::own_camera::{OwnCamera, has_shape};
use crate::plausibility::warn_once;
use crate::scene::{entry, require_registered};
use crate::undistort::{Camera, Undistortion, UndistortionCache};
use crate::{DatasetError, DepthRegistration};
use glam::DVec3;
use splatseg_geometry::{Image, Intrinsics, Pose};
use splatseg_imaging::{CameraPair, ImageMap, SeenBy, register_depth, resample_color};
use splatseg_ros::{CompressedImage, Image as RawImage, from_cdr};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Colour is downscaled if the ratio of depth to colour focal length, in pixels, is at most this and depth is not
/// registered. Otherwise registered depth would be full of holes.
const MIN_FOCAL_RATIO: f32 = 0.95;

/// Reader of the images of the chosen topics. Frames are those of the colour camera.
#[derive(Debug)]
pub(crate) struct FrameReader {
    pub(crate) own_camera: Option<OwnCamera>,
    pub(crate) color: ImageSource,
    pub(crate) depth: ImageSource,
    alignment: Alignment,
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
    /// True if the bytes of depth have the other order than the messages say, as its first image shows.
    has_swapped_bytes: OnceLock<bool>,
}

impl ImageSource {
    /// Corrects what a message says about the order of its bytes, with a warning. `path` is named.
    fn correct_byte_order(&self, message: &mut RawImage<'_>, path: &Path) {
        let is_swapped = self.has_swapped_bytes.get_or_init(|| {
            let is_swapped = images::has_swapped_bytes(message);
            if is_swapped {
                warn_once(format!(
                    "{}: the bytes of the depth image have the other order than is_bigendian says, {}: they are read so",
                    path.display(),
                    message.is_bigendian
                ));
            }
            is_swapped
        });
        if *is_swapped {
            message.is_bigendian = u8::from(message.is_bigendian == 0);
        }
    }
}

/// Gives the data of messages, and describes messages of a topic for errors.
pub(crate) struct MessageSource<Data, Place> {
    pub(crate) data: Data,
    pub(crate) place: Place,
}

impl FrameReader {
    /// Prepares reading the topics chosen by `maker`, with the cameras described so far. Warns about camera infos that
    /// contradict each other.
    ///
    /// # Errors
    /// If a camera info or a setting is invalid, or depth is in another frame and nothing connects them.
    pub(crate) fn new(maker: &FrameMaker<'_>) -> Result<Self, DatasetError> {
        let (choice, path) = (&maker.choice, maker.path);
        let own_camera = OwnCamera::from_settings(maker.settings)?;
        let color = Cameras::new(choice.color_info, choice.color, own_camera, path)?;
        warn_of_assumptions(choice.color_info, choice.color, own_camera, path);
        let (mut depth, Decision { alignment, warning }) = if choice.has_depth {
            let depth = depth_cameras(maker, own_camera)?;
            let decision = decide(maker, own_camera, (&color, &depth))?;
            (depth, decision)
        } else {
            (Cameras::unknown(), Decision { alignment: Alignment::NoDepth, warning: None })
        };
        if let Some(warning) = warning {
            warn_once(format!("{}: {warning}", path.display()));
        }
        if let (Some(_), Alignment::SameCamera, Some(camera)) = (own_camera, alignment, color.list.first()) {
            let camera = camera.intrinsics;
            let unstated = image_facts(choice.depth, choice.depth_info, own_camera).unstated_size();
            depth.replace_intrinsics(|stated| {
                let (width, height) = unstated.unwrap_or(stated);
                camera.resized(width, height)
            });
        }
        let depth_scale = match maker.contents.depth_unit_of(&choice.depth.0.name) {
            Some((topic, metres)) => {
                let field = format!("{topic}, as units per metre");
                Some(DepthScale::stated(1.0 / metres, (path, &field), maker.settings)?)
            }
            None => DepthScale::from_settings(maker.settings),
        };
        let source = |(topic, images): (&Topic, &Images), cameras| ImageSource {
            topic: topic.name.clone(),
            is_compressed: images.is_compressed,
            cameras,
            depth_scale,
            undistortion: UndistortionCache::default(),
            has_swapped_bytes: OnceLock::new(),
        };
        let (color, mut depth) = (source(choice.color, color), source(choice.depth, depth));
        // What a wide lens shows at the edges would be lost.
        if let Alignment::Registered { color_from_depth } = alignment {
            let cameras = color.cameras.list.iter().map(|camera| camera.intrinsics).collect();
            let seen_by = SeenBy { cameras, from_undistorted: color_from_depth };
            depth.undistortion = UndistortionCache::warped_to(seen_by);
        }
        Ok(Self { own_camera, color, depth, alignment })
    }

    /// True if the chosen topics have depth.
    pub(crate) fn has_depth(&self) -> bool {
        self.alignment != Alignment::NoDepth
    }

    /// Describes the images, for people. `choice` is that of [`Self::new`].
    pub(crate) fn sources(&self, choice: &Choice<'_>) -> [String; 2] {
        let size = |source: &ImageSource| {
            let camera = source.cameras.list.first()?.intrinsics;
            Some((camera.width, camera.height))
        };
        let is_resized = || size(&self.color).zip(size(&self.depth)).is_some_and(|(color, depth)| color != depth);
        let aligned = match self.alignment {
            Alignment::Registered { .. } => ", registered to colour here",
            Alignment::SameCamera if is_resized() => ", registered to colour here",
            Alignment::SameCamera | Alignment::NoDepth => "",
            Alignment::AsColor => ", taken as registered to colour",
        };
        let depth = match self.has_depth() {
            true => source_text("depth", choice.depth, &self.depth.cameras.topic) + aligned,
            false => "depth: none (dataset.depth)".to_owned(),
        };
        [source_text("colour", choice.color, &self.color.cameras.topic), depth]
    }

    /// Decodes an image of a frame. Also returns its place, for errors.
    fn decode<T, D>(
        source: &ImageSource,
        messages: &MessageSource<impl Fn(MessagePlace) -> Result<D, DatasetError>, impl Fn(&str) -> PathBuf>,
        message: MessagePlace,
        decode: &ImageDecoder<T>,
    ) -> Result<(Image<T>, PathBuf), DatasetError>
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
            let mut message: RawImage<'_> = from_cdr(&data).map_err(damaged)?;
            source.correct_byte_order(&mut message, &path);
            (decode.raw)(&message, source.depth_scale, &path)?
        };
        Ok((image, path))
    }

    /// Reads and undistorts an image of a frame. Also returns its camera, and that of the undistorted image.
    fn read_image<'s, T, D>(
        source: &'s ImageSource,
        messages: &MessageSource<impl Fn(MessagePlace) -> Result<D, DatasetError>, impl Fn(&str) -> PathBuf>,
        (message, camera): (MessagePlace, usize),
        decode: &ImageDecoder<T>,
    ) -> Result<(Image<T>, &'s Camera, Intrinsics), DatasetError>
    where
        T: Clone + 'static,
        D: Deref<Target = [u8]>,
    {
        let (image, path) = Self::decode(source, messages, message, decode)?;
        let camera = entry(&source.cameras.list, camera, &source.cameras.topic)?;
        let expected = (camera.intrinsics.width, camera.intrinsics.height);
        if image.size() != expected {
            return Err(of_another_size((path, decode.what), image.size(), expected, decode.remedy));
        }
        let undistorted = source.undistortion.get(camera, &path)?;
        let image = match undistorted.map {
            Some(map) => (decode.undistort)(&map, &image, &path)?,
            None => image,
        };
        Ok((image, camera, undistorted.camera))
    }

    /// Reads the depth of a frame, and returns its camera and the transform to that of colour; `None` for the pixels of
    /// colour.
    fn read_depth<D: Deref<Target = [u8]>>(
        &self,
        frame: &PairedFrame,
        messages: &MessageSource<impl Fn(MessagePlace) -> Result<D, DatasetError>, impl Fn(&str) -> PathBuf>,
        color_camera: &Camera,
    ) -> Result<DepthFrame, DatasetError> {
        let color_size = (color_camera.intrinsics.width, color_camera.intrinsics.height);
        if self.alignment == Alignment::AsColor {
            let (depth, path) = Self::decode(&self.depth, messages, frame.depth, &DEPTH)?;
            let size = depth.size();
            if !has_shape(size, color_size) {
                return Err(DatasetError::SizesDiffer {
                    path,
                    what: DEPTH.what,
                    found: size,
                    expected: color_size,
                    expected_from: "its colour image",
                });
            }
            let intrinsics = if size == color_size {
                color_camera.intrinsics
            } else {
                color_camera.intrinsics.resized(size.0, size.1)
            };
            let camera = Camera { intrinsics, distortion: color_camera.distortion };
            // One map serves both, as they usually have one size.
            let source = if size == color_size { &self.color } else { &self.depth };
            let depth = match source.undistortion.get(&camera, &path)?.map {
                Some(map) => (DEPTH.undistort)(&map, &depth, &path)?,
                None => depth,
            };
            return Ok((depth, (size != color_size).then_some((intrinsics, Pose::IDENTITY))));
        }
        let (depth, _, intrinsics) = Self::read_image(&self.depth, messages, (frame.depth, frame.cameras.1), &DEPTH)?;
        let warp = match self.alignment {
            Alignment::Registered { color_from_depth } => Some((intrinsics, color_from_depth)),
            _ if depth.size() != color_size => Some((intrinsics, Pose::IDENTITY)),
            _ => None,
        };
        Ok((depth, warp))
    }

    /// Reads registered colour and depth images, and their camera. Depth is 0 if there is none.
    pub(crate) fn read<D: Deref<Target = [u8]>>(
        &self,
        frame: &PairedFrame,
        messages: &MessageSource<impl Fn(MessagePlace) -> Result<D, DatasetError>, impl Fn(&str) -> PathBuf>,
    ) -> Result<RegisteredImages, DatasetError> {
        let (color, color_camera, _) = Self::read_image(&self.color, messages, (frame.color, frame.cameras.0), &COLOR)?;
        let camera = color_camera.intrinsics;
        if !self.has_depth() {
            let depth = Image::filled(color.width(), color.height(), 0.0);
            return Ok((color, depth, camera));
        }
        let (depth, warp) = self.read_depth(frame, messages, color_camera)?;
        let Some((depth_camera, color_from_depth)) = warp else {
            require_registered(&color, &depth, &(messages.place)(&self.depth.topic))?;
            return Ok((color, depth, camera));
        };
        let target = target_camera(&camera, &depth_camera);
        let cameras = CameraPair {
            depth: depth_camera,
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

/// Returns the error for an image, described by its path and kind, that has another size than its camera.
fn of_another_size(
    (path, what): (PathBuf, &str),
    found: (usize, usize),
    expected: (usize, usize),
    remedy: &str,
) -> DatasetError {
    DatasetError::Field {
        path,
        field: what.to_owned(),
        found: format!("{}x{} pixels", found.0, found.1),
        expected: format!("{}x{}, as its camera info says; {remedy}", expected.0, expected.1),
    }
}

/// Returns the cameras of depth; none if its camera info is unusable and depth may be that of the colour camera.
fn depth_cameras(maker: &FrameMaker<'_>, own: Option<OwnCamera>) -> Result<Cameras, DatasetError> {
    let choice = &maker.choice;
    let may_follow = choice.color.1.frame == choice.depth.1.frame
        || own.is_some()
        || maker.settings.register_depth == DepthRegistration::False;
    let infos = choice.color_info.zip(choice.depth_info);
    let has_info_of_color = infos.is_some_and(|(color, depth)| std::ptr::eq(color, depth));
    let cameras = Cameras::new(choice.depth_info, choice.depth, None, maker.path);
    match (cameras, choice.depth_info) {
        (Err(error), Some(_)) if may_follow => {
            if !has_info_of_color {
                warn_once(format!("{error}; depth is taken as that of the colour camera"));
            }
            Ok(Cameras::unknown())
        }
        (cameras, info) => {
            // The settings replace what is described by the camera info of colour.
            if cameras.is_ok() && !(own.is_some() && has_info_of_color) {
                warn_of_assumptions(info, choice.depth, None, maker.path);
            }
            cameras
        }
    }
}

/// Registered colour and depth images, and their camera.
pub(crate) type RegisteredImages = (Image<[u8; 3]>, Image<f32>, Intrinsics);

/// Depth, and its camera and the transform to that of colour, if it still has to be registered.
type DepthFrame = (Image<f32>, Option<(Intrinsics, Pose)>);

/// A decoded image message.
type Decoded<T> = Result<Image<T>, DatasetError>;

/// Function that undistorts an image. The path is named in errors.
type Undistort<T> = fn(&Undistortion, &Image<T>, &Path) -> Result<Image<T>, DatasetError>;

/// Functions for reading images of one kind.
struct ImageDecoder<T: Clone + 'static> {
    what: &'static str,
    /// The remedy if the camera info belongs to other images.
    remedy: &'static str,
    raw: fn(&RawImage<'_>, Option<DepthScale>, &Path) -> Decoded<T>,
    compressed: fn(&CompressedImage<'_>, Option<DepthScale>, &Path) -> Decoded<T>,
    undistort: Undistort<T>,
}

const COLOR: ImageDecoder<[u8; 3]> = ImageDecoder {
    what: crate::error::COLOR_IMAGE,
    remedy: "--fx (--fy, --cx, --cy) describes the camera of these images",
    raw: |message, _, path| images::raw_color(message, path),
    compressed: |message, _, path| images::compressed_color(message, path),
    undistort: |map, image, path| map.color(image, path),
};
const DEPTH: ImageDecoder<f32> = ImageDecoder {
    what: crate::error::DEPTH_IMAGE,
    remedy: "--set dataset.depth_camera_info=TOPIC chooses another one, or --register-depth false takes the pixels of depth \
             for those of colour",
    raw: images::raw_depth,
    compressed: images::compressed_depth,
    undistort: |map, image, path| map.depth(image, path),
};

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

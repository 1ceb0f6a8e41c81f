//! MVPd (Opipari et al., 2025), rendered from HM3D: a split's folder with `panoptic_<split>.json`,
//! `imagesRGB/<video>/<view>.jpg`, `imagesDEPTH/<video>/<view>.png` (uint16 millimetres) and
//! `panomasksRGB/<video>/<view>.png`, or one HM3D scene's `.tar.gz` with `panoptic.json` and the same folders.
//!
//! Each video is one scene. It is chosen by name: `FOLDER:VIDEO`, `FOLDER/imagesRGB/VIDEO` or `SCENE.tar.gz:VIDEO`. The
//! name may be omitted if there is only one video. Only the chosen video is kept from the JSON file, which may have
//! gigabytes. An archive is read twice, once up to its JSON file and once up to the video's last image. The images of
//! the chosen video are copied to a temporary file (see `archive/tarred.rs`).
//!
//! Poses are a position and a quaternion (w, x, y, z) of a camera with Blender's axes: x right, y up, looking along -z.
//! The intrinsics are those in the authors' code, unchanged. A renderer's principal point would be half a pixel up and
//! to the left of theirs. Images without a pose in the annotations are read without one.
//!
//! Ground truth ids are the `instance_id`s of `segments_info`, unique within the video's HM3D scene. If a video's
//! annotations lack some (the authors' script can remove them), the ids in the mask images are used, unique within the
//! video. Regions marked `iscrowd` are not instances and have id 0. Unlike the authors' loader, which can do both, this
//! one does not merge segments or filter them by area.

mod listing;
mod panoptic;
mod video_files;
mod video_path;

pub use listing::{MvpdVideo, MvpdVideos};
pub(crate) use video_path::{looks_like, parts};

use crate::decode::{decode_color, decode_depth, decode_panoptic, encoded_size};
use crate::depth_scale::DepthScale;
use crate::error::{COLOR_IMAGE, DEPTH_IMAGE, SEGMENT_IMAGE};
use crate::own_camera::{OwnCamera, camera_place};
use crate::recorded_poses::{PoseCoverage, tracked};
use crate::scene::{FramePart, FrameParts, entry, require_registered};
use crate::{DatasetError, DatasetSettings, Format, LeftOut, RecordedFrame, Scene};
use glam::{DQuat, DVec3};
use panoptic::{PanopticVideo, SegmentInfo};
use splatseg_geometry::{Intrinsics, Pose, SegmentMap};
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use video_files::VideoFiles;
use video_path::VideoPath;

/// Layout of MVPd, for messages.
pub(crate) const LAYOUT: &str = "panoptic_<split>.json, imagesRGB/<video>/<view>.jpg, imagesDEPTH/, panomasksRGB/ (optional), or a \
                                 scene's .tar.gz with the same; one of several videos is chosen as PATH:VIDEO";

/// Camera of every video.
const PUBLISHED: Intrinsics = Intrinsics { fx: 465.6029, fy: 465.6029, cx: 320.0, cy: 240.0, width: 640, height: 480 };

/// Half a turn about x, from this project's camera axes (y down, z forward) to Blender's (y up, z backward).
const BLENDER_FROM_OURS: DQuat = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);

/// One frame of a video.
#[derive(Clone, Debug)]
struct View {
    /// File name without its extension, which also names the frame and mask.
    stem: String,
    color: String,
    depth: String,
    /// Camera position, metres, and rotation from Blender's camera axes to world axes, not normalised.
    pose: Option<(DVec3, DQuat)>,
}

/// An MVPd video. Frames are named like their images.
#[derive(Debug)]
pub struct MvpdScene {
    name: String,
    files: VideoFiles,
    views: Vec<View>,
    masks: BTreeMap<String, Mask>,
    poses: PoseCoverage,
    own_camera: Option<OwnCamera>,
    depth_scale: DepthScale,
    /// Annotation file, for messages.
    annotations: PathBuf,
}

/// The labels of one frame.
#[derive(Clone, Debug)]
struct Mask {
    file: String,
    /// Ground truth id of each id in the mask image; `None` if they are the same.
    instances: Option<BTreeMap<u32, u32>>,
}

impl MvpdScene {
    /// Opens one video of a split's folder or of a scene's archive. See [`Format::Mvpd`] for the syntax of paths. Uses
    /// only `fx` to `cy` and `depth_scale` of `settings`.
    ///
    /// # Errors
    /// If the annotations or their archive are missing or damaged, all depth images are missing, the video does not
    /// exist or none of several is chosen, or names in the annotations point outside the video's folders or occur
    /// twice.
    pub fn open(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let own_camera = OwnCamera::from_settings(settings)?;
        let chosen = VideoPath::parse(path).ok_or_else(|| DatasetError::NotFound { path: path.to_owned() })?;
        let annotations = chosen.read_annotations()?;
        let (video, source) = (annotations.content, annotations.path);
        let name = safe_name(&video.name, "video_name", &source)?.to_owned();
        let views = views_of(&video, &source)?;
        if views.is_empty() {
            return Err(DatasetError::NoFrames { path: source, expected: "images of the video" });
        }
        let masks = masks_of(&video, &source)?;
        let mask_files = masks.values().map(|mask| mask.file.as_str());
        let members = [
            ("imagesRGB", views.iter().map(|view| view.color.as_str()).collect::<Vec<_>>()),
            ("imagesDEPTH", views.iter().map(|view| view.depth.as_str()).collect()),
            ("panomasksRGB", mask_files.collect()),
        ];
        let wanted = members.iter().flat_map(|(folder, files)| {
            files.iter().map(|file| video_files::member(folder, &name, file)).collect::<Vec<_>>()
        });
        let files = chosen.files(&annotations.prefix, wanted.collect())?;
        let has_depth =
            views.iter().any(|view| files.contains(&video_files::member("imagesDEPTH", &name, &view.depth)));
        if !has_depth {
            let path = files.path_of(&format!("imagesDEPTH/{name}"));
            return Err(DatasetError::NoFrames { path, expected: "the depth images that the annotations name" });
        }
        // The masks are in a separate folder. Without them, the video has no ground truth.
        let has_masks =
            masks.values().any(|mask| files.contains(&video_files::member("panomasksRGB", &name, &mask.file)));
        let masks = if has_masks { masks } else { BTreeMap::new() };
        let missing = views.iter().filter(|view| view.pose.is_none()).count();
        let poses = if missing == views.len() {
            PoseCoverage::NONE
        } else {
            PoseCoverage::new(views.len(), [(missing, "without a pose in the annotations".to_owned())])
        };
        let depth_scale = DepthScale::MILLIMETRES.or_of(settings);
        Ok(Self { files, views, masks, poses, own_camera, depth_scale, name, annotations: source })
    }

    fn member(&self, folder: &str, file: &str) -> String {
        video_files::member(folder, &self.name, file)
    }
}

fn views_of(video: &PanopticVideo, source: &Path) -> Result<Vec<View>, DatasetError> {
    let mut stems = HashSet::new();
    let mut views = Vec::with_capacity(video.images.len());
    for image in &video.images {
        let color = safe_name(&image.file_name, "file_name", source)?;
        let stem = stem_of(color);
        if !stems.insert(stem) {
            return Err(wrong(source, "file_name", color, "each image once"));
        }
        let depth = match &image.depth_file_name {
            Some(depth) => safe_name(depth, "depth_file_name", source)?.to_owned(),
            None => format!("{stem}.png"),
        };
        let pose = match (image.camera_position, image.camera_rotation) {
            (Some(position), Some([w, x, y, z])) => Some((DVec3::from_array(position), DQuat::from_xyzw(x, y, z, w))),
            (None, None) => None,
            _ => return Err(wrong(source, "pose of", color, "camera_position and camera_rotation, or neither")),
        };
        views.push(View { stem: stem.to_owned(), color: color.to_owned(), depth, pose });
    }
    Ok(views)
}

fn masks_of(video: &PanopticVideo, source: &Path) -> Result<BTreeMap<String, Mask>, DatasetError> {
    let segments = || video.annotations.iter().map(|frame| frame.segments_info.as_deref());
    // All or none: a mixture of both kinds of ids would not be unique.
    let use_instances =
        segments().all(|infos| infos.is_some_and(|infos| infos.iter().all(|info| info.instance_id.is_some())));
    let true_id = |info: &SegmentInfo| match info.instance_id {
        _ if info.iscrowd != 0 => 0,
        Some(instance) if use_instances => instance,
        _ => info.id,
    };
    let mut masks = BTreeMap::new();
    for frame in &video.annotations {
        let file = safe_name(&frame.file_name, "file_name", source)?.to_owned();
        let instances =
            frame.segments_info.as_ref().map(|infos| infos.iter().map(|info| (info.id, true_id(info))).collect());
        masks.insert(stem_of(&file).to_owned(), Mask { file, instances });
    }
    Ok(masks)
}

/// Returns a name from the annotations if it is a plain file or folder name, not a path elsewhere.
fn safe_name<'a>(name: &'a str, field: &str, source: &Path) -> Result<&'a str, DatasetError> {
    let is_plain = !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', '\0']);
    if is_plain { Ok(name) } else { Err(wrong(source, field, name, "a name without folders")) }
}

fn stem_of(file: &str) -> &str {
    file.rsplit_once('.').map_or(file, |(stem, _)| if stem.is_empty() { file } else { stem })
}

fn wrong(source: &Path, field: &str, found: &str, expected: &str) -> DatasetError {
    DatasetError::Field {
        path: source.to_owned(),
        field: field.to_owned(),
        found: crate::text::shortened(found),
        expected: expected.to_owned(),
    }
}

impl Scene for MvpdScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.views.len()
    }

    fn frame_name(&self, index: usize) -> String {
        self.views.get(index).map(|view| view.stem.clone()).unwrap_or_default()
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let view = entry(&self.views, index, &self.name)?;
        let (color_file, depth_file) = (self.member("imagesRGB", &view.color), self.member("imagesDEPTH", &view.depth));
        let (color_path, depth_path) = (self.files.path_of(&color_file), self.files.path_of(&depth_file));
        let stated = view.pose.map(|(at, turn)| Pose::from_quaternion(at, turn * BLENDER_FROM_OURS));
        let pose = stated.map(|pose| tracked(pose, || color_path.clone())).transpose()?.flatten();
        let depth = decode_depth(&depth_path, &self.files.read(&depth_file, DEPTH_IMAGE)?, self.depth_scale)?;
        let color = decode_color(&color_path, &self.files.read(&color_file, COLOR_IMAGE)?)?;
        require_registered(&color, &depth, &depth_path)?;
        let intrinsics = match self.own_camera {
            Some(camera) => camera.intrinsics(color.size()),
            None => PUBLISHED.resized(color.width(), color.height()),
        };
        let name = view.stem.clone();
        FrameParts { name, timestamp: None, color, depth, intrinsics, world_from_camera: pose }.into_frame()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.poses.without_pose()
    }

    fn has_ground_truth(&self) -> bool {
        !self.masks.is_empty()
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        let view = entry(&self.views, index, &self.name)?;
        let Some(mask) = self.masks.get(&view.stem) else { return Ok(None) };
        let file = self.member("panomasksRGB", &mask.file);
        let path = self.files.path_of(&file);
        let stored = decode_panoptic(&path, &self.files.read(&file, SEGMENT_IMAGE)?)?;
        let color_file = self.member("imagesRGB", &view.color);
        let color = self.files.read(&color_file, COLOR_IMAGE)?;
        let expected = encoded_size(&self.files.path_of(&color_file), COLOR_IMAGE, &color)?;
        if stored.size() != expected {
            return Err(DatasetError::SizesDiffer {
                path,
                what: SEGMENT_IMAGE,
                found: stored.size(),
                expected,
                expected_from: "its colour image",
            });
        }
        let Some(instances) = &mask.instances else { return Ok(Some(stored)) };
        let unknown = stored.areas().into_keys().find(|id| !instances.contains_key(id));
        if let Some(id) = unknown {
            return Err(wrong(&path, "id", &id.to_string(), "one of the segments_info of its annotation"));
        }
        Ok(Some(stored.map(|id| instances.get(id).copied().unwrap_or(0))))
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Mvpd)
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.views.get(index), part) {
            (Some(view), FramePart::Depth) => self.files.path_of(&self.member("imagesDEPTH", &view.depth)),
            (Some(view), FramePart::Pose) => {
                format!("{}: camera_position of {}", self.annotations.display(), view.stem).into()
            }
            (_, FramePart::Intrinsics) => camera_place(self.own_camera.as_ref(), &self.annotations),
            _ => self.annotations.clone(),
        }
    }
}

//! nerfstudio's `transforms.json` with `depth_file_path`: a camera, global or of each frame, and for each frame a colour
//! image, a depth image and a camera-to-world matrix with the axes of OpenGL.
//!
//! As in nerfstudio, frames are sorted by file name, depth of every kind is in millimetres unless the file has
//! `depth_unit_scale_factor`, and pixel (0, 0) is the corner of the image, not the centre of its first pixel. Poses are
//! those in the file: `applied_transform` is left as it is.

mod camera;

use crate::depth_scale::DepthScale;
use crate::frame_list::{FrameList, FrameListScene, ListedFrame, PlainFiles, StatedPoses};
use crate::listing::folder_name;
use crate::scene::LeftOut;
use crate::text::{read_json, shortened};
use crate::{DatasetError, DatasetSettings, Format};
use camera::{CameraFields, CameraReader};
use serde::Deserialize;
use splatseg_geometry::{CameraAxes, Pose};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// Layout, for messages.
pub(crate) const LAYOUT: &str =
    "transforms.json with depth_file_path in its frames, or a folder with it, as nerfstudio reads it";

const FILE: &str = "transforms.json";
/// Enough for a hundred thousand frames.
const MAX_BYTES: u64 = 128 << 20;
const DEPTH_KEY: &str = "depth_file_path";
/// Extensions tried for images that are named without one, as in Blender's data sets.
const COLOR_ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];

/// The file.
#[derive(Debug, Deserialize)]
struct Transforms {
    #[serde(flatten)]
    camera: CameraFields,
    depth_unit_scale_factor: Option<f64>,
    frames: Vec<FrameFields>,
}

#[derive(Debug, Deserialize)]
struct FrameFields {
    #[serde(flatten)]
    camera: CameraFields,
    file_path: String,
    depth_file_path: Option<String>,
    transform_matrix: Vec<Vec<f64>>,
}

/// Reads the list of frames. Uses only `fx` to `cy`, `depth_scale` and those about poses of `settings`.
///
/// # Errors
/// If the file is missing or damaged, no frame has depth, a path leads out of the folder, or a camera or pose is invalid.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<FrameListScene, DatasetError> {
    settings.validate()?;
    let file = file_of(path);
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    let Transforms { camera, depth_unit_scale_factor, mut frames } = read_json(&file, "list of frames", MAX_BYTES)?;
    let factor = depth_unit_scale_factor.unwrap_or(0.001);
    let depth_scale = DepthScale::stated(factor.recip(), (&file, "depth_unit_scale_factor"), settings)?;
    frames.sort_by(|a, b| Path::new(&a.file_path).cmp(Path::new(&b.file_path)));
    let listed = frames.len();
    frames.retain(|frame| frame.depth_file_path.is_some());
    if frames.is_empty() {
        return Err(DatasetError::Field {
            path: file,
            field: "frames".to_owned(),
            found: format!("{listed}, none of them with {DEPTH_KEY}"),
            expected: "frames with depth".to_owned(),
        });
    }
    let left_out = LeftOut::list([(listed - frames.len(), format!("without {DEPTH_KEY}"))]);
    let names = frame_names(&frames);
    let poses = StatedPoses::camera_to_world(CameraAxes::OpenGl, settings);
    let reader = Reader { file: &file, folder: &folder, cameras: CameraReader::new(&file, &camera), poses };
    let frames = frames.iter().zip(names).map(|(frame, name)| reader.frame(frame, name));
    let list = FrameList {
        name: folder_name(if folder.as_os_str().is_empty() { Path::new(".") } else { &folder }),
        format: Format::Nerfstudio,
        frames: frames.collect::<Result<_, _>>()?,
        left_out,
        states_poses: true,
        stored_color: None,
        files: Box::new(PlainFiles { depth_scale, _extracted: None }),
    };
    FrameListScene::new(list, settings)
}

/// Values shared by all frames.
struct Reader<'a> {
    file: &'a Path,
    folder: &'a Path,
    cameras: CameraReader<'a>,
    poses: StatedPoses,
}

impl Reader<'_> {
    fn frame(&self, frame: &FrameFields, name: String) -> Result<ListedFrame, DatasetError> {
        let place = PathBuf::from(format!("{}: {}", self.file.display(), frame.file_path));
        let color = self.color_path(&frame.file_path)?;
        let depth = self.path(frame.depth_file_path.as_deref().unwrap_or_default(), DEPTH_KEY)?;
        let matrix = matrix(&frame.transform_matrix).ok_or_else(|| DatasetError::Field {
            path: place.clone(),
            field: "transform_matrix".to_owned(),
            found: format!("{} rows", frame.transform_matrix.len()),
            expected: "a 4x4 or 3x4 matrix".to_owned(),
        })?;
        Ok(ListedFrame {
            name,
            timestamp: None,
            camera: self.cameras.camera(&frame.camera, &color, &place)?,
            color,
            depth,
            confidence: None,
            world_from_camera: self.poses.pose(Pose::from_row_major(matrix), || place.clone())?,
            pose_place: place.clone(),
            camera_place: place,
        })
    }

    /// Returns a path relative to the file, which must not lead out of its folder.
    fn path(&self, relative: &str, key: &str) -> Result<PathBuf, DatasetError> {
        let parts = Path::new(relative);
        let is_inside = parts.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if is_inside && !relative.is_empty() {
            return Ok(self.folder.join(parts));
        }
        Err(DatasetError::Field {
            path: self.file.to_owned(),
            field: key.to_owned(),
            found: shortened(relative),
            expected: "a path inside the folder of this file".to_owned(),
        })
    }

    fn color_path(&self, relative: &str) -> Result<PathBuf, DatasetError> {
        let path = self.path(relative, "file_path")?;
        if path.extension().is_some() {
            return Ok(path);
        }
        let with = |ending: &str| path.with_extension(ending);
        Ok(COLOR_ENDINGS.into_iter().map(with).find(|path| path.is_file()).unwrap_or(path.clone()))
    }
}

/// Returns the names of frames: those of their images, with their folders if they would not differ otherwise.
fn frame_names(frames: &[FrameFields]) -> Vec<String> {
    let stem = |frame: &FrameFields| {
        Path::new(&frame.file_path).file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
    };
    let stems: Vec<String> = frames.iter().map(stem).collect();
    if stems.iter().collect::<BTreeSet<_>>().len() == stems.len() {
        return stems;
    }
    let whole = |frame: &FrameFields| {
        let path = Path::new(&frame.file_path).with_extension("");
        let parts = path.components().filter(|part| matches!(part, Component::Normal(_)));
        parts.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("_")
    };
    frames.iter().map(whole).collect()
}

/// Returns a matrix of three or four rows, row by row.
fn matrix(rows: &[Vec<f64>]) -> Option<[f64; 16]> {
    let mut matrix = [0.0; 16];
    matrix[15] = 1.0;
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return None;
    }
    for (entry, number) in matrix.iter_mut().zip(rows.iter().flatten()) {
        *entry = *number;
    }
    Some(matrix)
}

/// Returns the file of a scene: the path itself or the one in its folder.
fn file_of(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE) } else { path.to_owned() }
}

/// Returns the required parts of a scene, each with true if the path has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    vec![(FILE, looks_like(path))]
}

/// Returns true if a path is a `transforms*.json` or a folder with one.
pub(crate) fn looks_like(path: &Path) -> bool {
    let file = file_of(path);
    let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    name.starts_with("transforms") && name.ends_with(".json") && file.is_file()
}

/// Returns true if the frames have depth.
pub(crate) fn is_whole(path: &Path) -> bool {
    let text = splatseg_files::read_file(&file_of(path), MAX_BYTES).unwrap_or_default();
    text.windows(DEPTH_KEY.len()).any(|window| window == DEPTH_KEY.as_bytes())
}

//! Record3D's `.r3d`: a zip file, or a folder it was unpacked to, with `metadata` (JSON) and, for each frame,
//! `rgbd/N.jpg`, `rgbd/N.depth` and, from LiDAR, `rgbd/N.conf`.
//!
//! Depth is 32-bit floats in metres and confidence bytes from 0 to 2, both compressed with LZFSE. Depth has 192x256 pixels
//! (LiDAR) or 480x640 (TrueDepth), colour more; both are portrait. Poses `qx qy qz qw px py pz` are camera-to-world with the
//! axes of ARKit, which are OpenGL's, for the portrait image. The camera is `K` for images of `w` x `h` pixels, column by
//! column, or `perFrameIntrinsicCoeffs`, `fx fy cx cy` of each frame.

use crate::archive::ZippedImages;
use crate::decode::{MAX_PIXELS, decode_color, encoded_size, require_decoding_memory};
use crate::depth_scale::DepthScale;
use crate::error::{COLOR_IMAGE, CONFIDENCE_IMAGE, DEPTH_IMAGE};
use crate::files::{is_there, open_file, read_file};
use crate::frame_list::{FrameFiles, FrameList, FrameListScene, ListedFrame, StatedPoses};
use crate::listing::{folder_name, names_in};
use crate::recorded_poses::listed_quaternion;
use crate::scene::LeftOut;
use crate::text::{none_if_null, not_text, parse_json};
use crate::undistort::Camera;
use crate::{DatasetError, DatasetSettings, Format};
use glam::{DQuat, DVec3};
use lzfse_rust::LzfseRingDecoder;
use serde::Deserialize;
use splatseg_files::text_of;
use splatseg_geometry::{CameraAxes, Image, Intrinsics};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Layout, for messages.
pub(crate) const LAYOUT: &str = "a Record3D file (.r3d), or the folder it was unpacked to, with metadata and rgbd/";

const METADATA: &str = "metadata";
const IMAGES: &str = "rgbd";
/// Name of the camera matrix in messages.
const MATRIX: &str = "K";
/// Larger members are not images or depth of a phone. An hour's poses are smaller, too.
const MAX_MEMBER_BYTES: u64 = 32 << 20;

/// The file `metadata`. Other keys are not needed.
#[derive(Debug, Deserialize)]
#[allow(non_snake_case)] // Names of the file.
struct Metadata {
    w: usize,
    h: usize,
    dw: Option<usize>,
    dh: Option<usize>,
    fps: Option<f64>,
    K: Vec<f64>,
    #[serde(default, deserialize_with = "none_if_null")]
    poses: Vec<[f64; 7]>,
    #[serde(default, deserialize_with = "none_if_null")]
    perFrameIntrinsicCoeffs: Vec<[f64; 4]>,
    #[serde(default, deserialize_with = "none_if_null")]
    frameTimestamps: Vec<f64>,
}

/// Where the members are.
#[derive(Debug)]
enum Members {
    Zip(ZippedImages),
    Folder(PathBuf),
}

impl Members {
    fn open(path: &Path) -> Result<Self, DatasetError> {
        Ok(if path.is_dir() { Self::Folder(path.to_owned()) } else { Self::Zip(ZippedImages::open(path)?) })
    }

    fn place(&self, name: &str) -> PathBuf {
        match self {
            Self::Zip(zip) => zip.place(name),
            Self::Folder(folder) => folder.join(name),
        }
    }

    fn read(&self, name: &str, what: &'static str) -> Result<Vec<u8>, DatasetError> {
        match self {
            Self::Folder(folder) => read_file(&folder.join(name), what, MAX_MEMBER_BYTES),
            Self::Zip(zip) => {
                let missing = || DatasetError::MissingFile { path: zip.place(name), what };
                Ok(zip.read(name, what)?.ok_or_else(missing)?.1)
            }
        }
    }

    /// Returns the numbers of the members `rgbd/<number>.<ending>`.
    fn numbers(&self, ending: &str) -> BTreeSet<usize> {
        let names = match self {
            Self::Zip(zip) => zip.names(),
            Self::Folder(folder) => {
                names_in(&folder.join(IMAGES)).into_iter().map(|name| format!("{IMAGES}/{name}")).collect()
            }
        };
        let number = |name: &String| {
            let digits = name.strip_prefix(IMAGES)?.strip_prefix('/')?.strip_suffix(ending)?.strip_suffix('.')?;
            digits.bytes().all(|byte| byte.is_ascii_digit()).then(|| digits.parse().ok())?
        };
        names.iter().filter_map(number).collect()
    }
}

/// Lists the frames. Uses only `fx` to `cy`, `depth_scale` and those about poses of `settings`.
///
/// # Errors
/// If the archive or its metadata is damaged, there are no frames with depth, or a pose or camera is invalid.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<FrameListScene, DatasetError> {
    settings.validate()?;
    let members = Members::open(path)?;
    let place = members.place(METADATA);
    let text = text_of(members.read(METADATA, METADATA)?).map_err(|error| not_text(&place, METADATA, error))?;
    let metadata: Metadata = parse_json(&place, &text)?;
    let [color, depth, confidence] = ["jpg", "depth", "conf"].map(|ending| members.numbers(ending));
    let numbers: Vec<usize> = color.intersection(&depth).copied().collect();
    if numbers.is_empty() {
        return Err(DatasetError::NoFrames { path: path.to_owned(), expected: "rgbd/<number>.jpg and .depth" });
    }
    let depth_size = depth_size(&metadata, &place)?;
    let reader = ListReader {
        place: &place,
        metadata: &metadata,
        confidence: &confidence,
        poses: StatedPoses::camera_to_world(CameraAxes::OpenGl, settings),
    };
    let left_out = LeftOut::list([
        (color.len() - numbers.len(), "without depth".to_owned()),
        (depth.len() - numbers.len(), "without a colour image".to_owned()),
    ]);
    reader.require_common_frames(&numbers)?;
    let frames = numbers.iter().map(|number| reader.frame(*number)).collect::<Result<_, _>>()?;
    let depth_scale = DepthScale::METRES.or_of(settings);
    let color_size = (metadata.w, metadata.h);
    let files = Box::new(R3dFiles { members, color_size, depth_size, depth_scale });
    let states_poses = !metadata.poses.is_empty();
    let list = FrameList {
        name: scene_name(path),
        format: Format::R3d,
        frames,
        left_out,
        states_poses,
        stored_color: None,
        files,
    };
    FrameListScene::new(list, settings)
}

fn scene_name(path: &Path) -> String {
    let name = folder_name(path);
    name.strip_suffix(".r3d").map(str::to_owned).unwrap_or(name)
}

/// Returns the stated `(width, height)` of depth; `None` in files of early versions.
fn depth_size(metadata: &Metadata, place: &Path) -> Result<Option<(usize, usize)>, DatasetError> {
    let Some(size) = metadata.dw.zip(metadata.dh) else { return Ok(None) };
    let pixels = (size.0 as u64).saturating_mul(size.1 as u64);
    if !(1..=MAX_PIXELS).contains(&pixels) {
        return Err(DatasetError::Field {
            path: place.to_owned(),
            field: "dw, dh".to_owned(),
            found: format!("{}x{}", size.0, size.1),
            expected: format!("1 to {MAX_PIXELS} pixels"),
        });
    }
    require_decoding_memory(place, DEPTH_IMAGE, size)?;
    Ok(Some(size))
}

/// Makes the list of frames.
struct ListReader<'a> {
    place: &'a Path,
    metadata: &'a Metadata,
    /// Numbers of the frames that have one.
    confidence: &'a BTreeSet<usize>,
    poses: StatedPoses,
}

impl ListReader<'_> {
    /// Checks that any frame has a pose, if there are poses. `numbers` are those of the frames, ascending.
    fn require_common_frames(&self, numbers: &[usize]) -> Result<(), DatasetError> {
        let poses = self.metadata.poses.len();
        let first = numbers.first().copied().unwrap_or(0);
        if poses == 0 || first < poses {
            return Ok(());
        }
        Err(DatasetError::Field {
            path: self.place.to_owned(),
            field: "poses".to_owned(),
            found: format!("those of frames 0 to {}", poses - 1),
            expected: format!("those of the images, {first} to {}", numbers.last().copied().unwrap_or(0)),
        })
    }

    fn frame(&self, number: usize) -> Result<ListedFrame, DatasetError> {
        let member = |ending: &str| PathBuf::from(format!("{IMAGES}/{number}.{ending}"));
        let place = PathBuf::from(format!("{}: frame {number}", self.place.display()));
        let world_from_camera = match self.metadata.poses.get(number) {
            Some([qx, qy, qz, qw, x, y, z]) => {
                let (position, rotation) = (DVec3::new(*x, *y, *z), DQuat::from_xyzw(*qx, *qy, *qz, *qw));
                let stated = listed_quaternion(position, rotation, (self.place, &format!("pose {number}")))?;
                self.poses.pose(stated, || place.clone())?
            }
            None => None,
        };
        let confidence = self.confidence.contains(&number).then(|| member("conf"));
        Ok(ListedFrame {
            name: number.to_string(),
            timestamp: self.seconds(number).and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()),
            color: member("jpg"),
            depth: member("depth"),
            confidence,
            camera: self.camera(number)?,
            world_from_camera,
            pose_place: place.clone(),
            camera_place: place,
        })
    }

    /// Returns the time of a frame.
    fn seconds(&self, number: usize) -> Option<f64> {
        let stated = self.metadata.frameTimestamps.get(number).copied();
        stated.or_else(|| self.metadata.fps.filter(|fps| *fps > 0.0).map(|fps| number as f64 / fps))
    }

    fn camera(&self, number: usize) -> Result<Camera, DatasetError> {
        let numbers = match (self.metadata.perFrameIntrinsicCoeffs.get(number), self.metadata.K.as_slice()) {
            (Some(own), _) => *own,
            (None, [fx, _, _, _, fy, _, cx, cy, _]) => [*fx, *fy, *cx, *cy],
            (None, other) => {
                return Err(DatasetError::Field {
                    path: self.place.to_owned(),
                    field: MATRIX.to_owned(),
                    found: format!("{} numbers", other.len()),
                    expected: "9, a 3x3 matrix column by column".to_owned(),
                });
            }
        };
        let [fx, fy, cx, cy] = numbers.map(|number| number as f32);
        let (width, height) = (self.metadata.w, self.metadata.h);
        Camera::pinhole(Intrinsics { fx, fy, cx, cy, width, height }, self.place)
    }
}

/// The bytes of each pixel, and the `(width, height)`.
type Unpacked<const N: usize> = (Vec<[u8; N]>, (usize, usize));

/// Reads the members of a recording.
#[derive(Debug)]
struct R3dFiles {
    members: Members,
    /// Stated size of colour, `(width, height)`, whose shape depth has.
    color_size: (usize, usize),
    /// `(width, height)`; if it is not stated, it follows from the number of values.
    depth_size: Option<(usize, usize)>,
    depth_scale: DepthScale,
}

impl R3dFiles {
    /// Reads a compressed member of `N` bytes for each pixel.
    fn unpack<const N: usize>(&self, member: &Path, what: &'static str) -> Result<Unpacked<N>, DatasetError> {
        let name = member.to_string_lossy();
        let packed = self.members.read(&name, what)?;
        let most = match self.depth_size {
            Some((width, height)) => (width * height * N) as u64,
            None => MAX_MEMBER_BYTES,
        };
        let place = || self.members.place(&name);
        let wrong = |found: String, expected: String| DatasetError::Field {
            path: place(),
            field: what.to_owned(),
            found,
            expected,
        };
        let mut bytes = Vec::new();
        let mut decoder = LzfseRingDecoder::default();
        let unpacked = decoder.reader(packed.as_slice()).take(most + 1).read_to_end(&mut bytes);
        unpacked.map_err(|error| wrong(format!("damaged LZFSE ({error})"), "LZFSE".to_owned()))?;
        let size = self.depth_size.or_else(|| size_of_shape(bytes.len() / N, self.color_size));
        let size = size.filter(|(width, height)| width * height * N == bytes.len()).ok_or_else(|| {
            let expected = match self.depth_size {
                Some((width, height)) => format!("{most} for {width}x{height} pixels"),
                None => format!("at most {most}, an image with the shape of colour, {:?}", self.color_size),
            };
            wrong(format!("{} bytes", bytes.len()), expected)
        })?;
        Ok((bytes.as_chunks().0.to_vec(), size))
    }
}

/// Returns the size `(width, height)` of an image with a number of pixels and the shape of another.
fn size_of_shape(pixels: usize, shape: (usize, usize)) -> Option<(usize, usize)> {
    let width = (pixels as f64 * shape.0 as f64 / shape.1 as f64).sqrt().round() as usize;
    let height = pixels.checked_div(width)?;
    (width * height == pixels && pixels > 0).then_some((width, height))
}

impl FrameFiles for R3dFiles {
    fn place(&self, image: &Path) -> PathBuf {
        self.members.place(&image.to_string_lossy())
    }

    fn color(&self, frame: &ListedFrame) -> Result<Image<[u8; 3]>, DatasetError> {
        let name = frame.color.to_string_lossy();
        decode_color(&self.members.place(&name), &self.members.read(&name, COLOR_IMAGE)?)
    }

    fn color_size(&self, frame: &ListedFrame) -> Result<(usize, usize), DatasetError> {
        let name = frame.color.to_string_lossy();
        encoded_size(&self.members.place(&name), COLOR_IMAGE, &self.members.read(&name, COLOR_IMAGE)?)
    }

    fn depth(&self, frame: &ListedFrame) -> Result<Image<f32>, DatasetError> {
        let (numbers, (width, height)) = self.unpack::<4>(&frame.depth, DEPTH_IMAGE)?;
        let metres = numbers.into_iter().map(|bytes| self.depth_scale.measured(f32::from_le_bytes(bytes))).collect();
        Image::from_pixels(width, height, metres).map_err(|_| self.no_image(&frame.depth))
    }

    fn confidence(&self, frame: &ListedFrame) -> Result<Option<Image<u32>>, DatasetError> {
        let Some(member) = &frame.confidence else { return Ok(None) };
        let (levels, (width, height)) = self.unpack::<1>(member, CONFIDENCE_IMAGE)?;
        let levels = levels.into_iter().map(|[level]| u32::from(level)).collect();
        Image::from_pixels(width, height, levels).map(Some).map_err(|_| self.no_image(member))
    }
}

impl R3dFiles {
    fn no_image(&self, member: &Path) -> DatasetError {
        DatasetError::NoFrames { path: self.members.place(&member.to_string_lossy()), expected: "an image" }
    }
}

/// Returns true if a path is such a file or folder.
pub(crate) fn looks_like(path: &Path) -> bool {
    if path.is_dir() {
        return is_there(&path.join(METADATA)) && path.join(IMAGES).is_dir();
    }
    let mut magic = [0; 4];
    let is_zip = path.is_file() && open_file(path).is_ok_and(|mut file| file.read_exact(&mut magic).is_ok());
    if !is_zip || magic != *b"PK\x03\x04" {
        return false;
    }
    let is_named = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("r3d"));
    is_named || ZippedImages::open(path).is_ok_and(|zip| zip.names().iter().any(|name| name == METADATA))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_follow_from_the_shape() {
        assert_eq!(size_of_shape(192 * 256, (720, 960)), Some((192, 256)));
        assert_eq!(size_of_shape(480 * 640, (480, 640)), Some((480, 640)));
        assert_eq!(size_of_shape(192 * 256 - 1, (720, 960)), None);
        assert_eq!(size_of_shape(0, (720, 960)), None);
        assert_eq!(size_of_shape(7, (0, 0)), None);
    }
}

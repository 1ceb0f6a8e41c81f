//! ScanNet's `.sens` recordings, read frame by frame without unpacking.

use super::labels::InstanceLabels;
use super::sens_file::{ColorCompression, DepthCompression, SensFile, SensHeader};
use super::{Camera, Cameras};
use crate::decode::{MAX_DEFLATE_RATIO, MAX_PIXELS};
use crate::decode::{decode_color, require_decoding_memory};
use crate::depth_scale::DepthScale;
use crate::error::{COLOR_IMAGE, DEPTH_IMAGE};
use crate::own_camera::OwnCamera;
use crate::plausibility::warn_once;
use crate::recorded_poses::{LOST, PoseCoverage, tracked};
use crate::recording_file::RecordingFile;
use crate::scene::{FramePart, FrameParts, LeftOut};
use crate::text::PinholeMatrix;
use crate::{DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use flate2::read::ZlibDecoder;
use splatseg_geometry::{Image, Pose, SegmentMap};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Layout of a `.sens` recording, for messages.
pub(crate) const LAYOUT: &str = "a file scene0000_00.sens, or a folder with one; beside it scene0000_00_2d-instance-filt.zip \
                                 or instance-filt/0.png (optional)";

const RECORDING: RecordingFile = RecordingFile { extension: "sens", expected: "a file <scene>.sens" };

/// A ScanNet recording in its published container, version 4, with raw or zlib-compressed depth and raw, PNG or JPEG
/// colour. Frames are named by number, as in an exported scene.
///
/// Nothing is unpacked to disk, and only the frames' offsets are kept in memory (24 bytes each). Ground truth comes
/// from `<scene>_2d-instance-filt.zip` next to the recording, read without unpacking, or from a folder `instance-filt`.
#[derive(Debug)]
pub struct SensScene {
    name: String,
    file: SensFile,
    cameras: Cameras,
    depth_scale: DepthScale,
    poses: PoseCoverage,
    labels: Option<InstanceLabels>,
    left_out: Vec<LeftOut>,
}

impl SensScene {
    /// Opens a recording, or the only one in a folder, by reading its header and locating its frames. Uses only `fx` to
    /// `cy` and `depth_scale` of `settings`.
    ///
    /// # Errors
    /// If there is no recording or there are several, its first frame is incomplete, its header is not version 4 or
    /// states another compression or images beyond the memory limit, or the labels' zip file is damaged.
    pub fn open(path: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let path = RECORDING.find(path)?;
        let file = SensFile::open(&path)?;
        if file.frame_count() == 0 {
            return Err(DatasetError::NoFrames { path, expected: "a frame count above 0 in the header" });
        }
        for (what, size) in [(COLOR_IMAGE, file.header().color_size), (DEPTH_IMAGE, file.header().depth_size)] {
            require_decoding_memory(&path, what, size)?;
        }
        let mut left_out = Vec::new();
        if let Some((missing, error)) = file.cut_off() {
            let whole = file.frame_count();
            warn_once(format!("{error}; only the frames before it are used: {whole}"));
            let what = format!("after frame {}, where the recording is cut off", whole - 1);
            left_out = LeftOut::list([(usize::try_from(*missing).unwrap_or(usize::MAX), what)]);
        }
        let cameras = match OwnCamera::from_settings(settings)? {
            Some(camera) => Cameras::Own(camera),
            None => recorded_cameras(file.header(), &path)?,
        };
        let lost = (file.lost(), format!("whose pose {LOST}"));
        let poses = PoseCoverage::new(file.frame_count(), [lost]);
        let name = path.file_stem().map_or_else(|| "scene".to_owned(), |stem| stem.to_string_lossy().into_owned());
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let labels = InstanceLabels::beside(folder, path.file_stem().unwrap_or_default())?;
        let depth_shift = f64::from(file.header().depth_shift);
        let depth_scale = DepthScale::stated(depth_shift, (&path, "depth shift"), settings)?;
        Ok(Self { name, file, cameras, depth_scale, poses, labels, left_out })
    }

    fn no_such_frame(&self, index: usize) -> DatasetError {
        DatasetError::NoSuchFrame { scene: self.name.clone(), index, count: self.file.frame_count() }
    }
}

/// Reads the cameras in the header. `path` is named in errors.
fn recorded_cameras(header: &SensHeader, path: &Path) -> Result<Cameras, DatasetError> {
    let camera = |numbers: &[f32; 16], what| -> Result<Camera, DatasetError> {
        let matrix = PinholeMatrix::from_numbers(&numbers.map(f64::from), path, what)?;
        Ok(Camera { matrix, path: format!("{}: {what}", path.display()).into() })
    };
    Ok(Cameras::Recorded {
        color: camera(&header.color_intrinsics, "intrinsics of colour")?,
        depth: camera(&header.depth_intrinsics, "intrinsics of depth")?,
    })
}

/// Returns true if a path is a recording or a folder containing some.
pub(crate) fn looks_like(path: &Path) -> bool {
    RECORDING.looks_like(path)
}

/// Decodes the colour image of a frame. `path` is that of the frame, for errors.
fn color_of(bytes: &[u8], header: &SensHeader, path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    let (width, height) = header.color_size;
    if header.color_compression == ColorCompression::Raw {
        require_bytes(bytes.len(), 3 * width * height, COLOR_IMAGE, path)?;
        let mut pixels = bytes.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]]);
        return Ok(Image::from_fn(width, height, |_, _| pixels.next().unwrap_or_default()));
    }
    let color = decode_color(path, bytes)?;
    if color.size() != header.color_size {
        return Err(DatasetError::SizesDiffer {
            path: path.to_owned(),
            what: COLOR_IMAGE,
            found: color.size(),
            expected: header.color_size,
            expected_from: "the recording's header",
        });
    }
    Ok(color)
}

/// Decodes the depth image of a frame, metres. `path` is that of the frame, for errors.
fn depth_of(bytes: &[u8], header: &SensHeader, scale: DepthScale, path: &Path) -> Result<Image<f32>, DatasetError> {
    require_plausible_depth(bytes.len() as u64, header, path)?;
    let (width, height) = header.depth_size;
    let expected = 2 * width * height;
    let wrong_bytes = |found| require_bytes(found, expected, DEPTH_IMAGE, path);
    let mut stored: Box<dyn Read + '_> = match header.depth_compression {
        DepthCompression::Raw => Box::new(bytes),
        DepthCompression::Zlib => Box::new(ZlibDecoder::new(bytes)),
    };
    let damaged = |source: std::io::Error| DatasetError::Field {
        path: path.to_owned(),
        field: DEPTH_IMAGE.to_owned(),
        found: format!("damaged zlib data ({source})"),
        expected: format!("{width}x{height} values"),
    };
    // Row by row, to avoid a second copy of the whole image.
    let mut pixels = Vec::with_capacity(width * height);
    let mut row = Vec::with_capacity(2 * width);
    for index in 0..height {
        row.clear();
        stored.by_ref().take(2 * width as u64).read_to_end(&mut row).map_err(damaged)?;
        if row.len() < 2 * width {
            wrong_bytes(2 * width * index + row.len())?;
        }
        let (values, _) = row.as_chunks::<2>();
        pixels.extend(values.iter().map(|value| scale.metres(u16::from_le_bytes(*value))));
    }
    // One extra byte is enough to detect excess data, without unpacking all of it.
    wrong_bytes(expected + stored.take(1).read_to_end(&mut Vec::new()).map_err(damaged)?)?;
    Image::from_pixels(width, height, pixels)
        .map_err(|error| DatasetError::Other { scene: path.display().to_string(), source: error.into() })
}

/// Checks that the stored bytes can contain a depth image of the stated size at all.
fn require_plausible_depth(bytes: u64, header: &SensHeader, path: &Path) -> Result<(), DatasetError> {
    let (width, height) = header.depth_size;
    if 2 * (width * height) as u64 <= bytes.saturating_mul(MAX_DEFLATE_RATIO) {
        return Ok(());
    }
    Err(DatasetError::ImplausibleSize {
        path: path.to_owned(),
        what: DEPTH_IMAGE,
        width: width as u32,
        height: height as u32,
        bytes: bytes as usize,
        limit: MAX_PIXELS,
    })
}

fn require_bytes(found: usize, expected: usize, what: &'static str, path: &Path) -> Result<(), DatasetError> {
    if found == expected {
        return Ok(());
    }
    Err(DatasetError::Field {
        path: path.to_owned(),
        field: what.to_owned(),
        found: if found > expected { format!("more than {expected} bytes") } else { format!("{found} bytes") },
        expected: format!("{expected}, from its size in the header"),
    })
}

impl Scene for SensScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.file.frame_count()
    }

    fn frame_name(&self, index: usize) -> String {
        if index < self.file.frame_count() { index.to_string() } else { String::new() }
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let path = self.file.frame_path(index);
        // Pose first: it is quick to read and the most likely to be damaged.
        let header = self.file.read_frame_header(index)?.ok_or_else(|| self.no_such_frame(index))?;
        let pose = tracked(Pose::from_row_major(header.world_from_camera.map(f64::from)), || path.clone())?;
        let stored = self.file.read_images(index)?.ok_or_else(|| self.no_such_frame(index))?;
        let depth = depth_of(&stored.depth, self.file.header(), self.depth_scale, &path)?;
        let color = color_of(&stored.color, self.file.header(), &path)?;
        let (intrinsics, color) = self.cameras.color_at_depth(color, depth.size())?;
        let name = self.frame_name(index);
        FrameParts { name, timestamp: header.timestamp, color, depth, intrinsics, world_from_camera: pose }.into_frame()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.poses.without_pose()
    }

    fn has_ground_truth(&self) -> bool {
        self.labels.is_some()
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        let depth_bytes = self.file.depth_bytes(index).ok_or_else(|| self.no_such_frame(index))?;
        let Some(source) = &self.labels else { return Ok(None) };
        let Some((path, labels)) = source.read(&self.frame_name(index))? else { return Ok(None) };
        let header = self.file.header();
        require_plausible_depth(depth_bytes, header, &self.file.frame_path(index))?;
        self.cameras.labels_at_depth(labels, &path, header.depth_size, || Ok(header.color_size)).map(Some)
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Sens)
    }

    fn stored_color_size(&self, _index: usize) -> Option<(usize, usize)> {
        Some(self.file.header().color_size)
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match part {
            FramePart::Depth | FramePart::Pose => self.file.frame_path(index),
            FramePart::Intrinsics => self.cameras.place(),
        }
    }
}

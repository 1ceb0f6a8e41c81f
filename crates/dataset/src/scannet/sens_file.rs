//! The container of a `.sens` recording, version 4, as written by ScanNet's `SensReader`. Everything is little-endian:
//!
//! - `u32` version; `u64` length and bytes of the sensor's name;
//! - four row-major 4x4 `f32` matrices: intrinsics and extrinsics of colour, intrinsics and extrinsics of depth;
//! - `i32` compression of colour (0 raw RGB, 1 PNG, 2 JPEG) and of depth (0 raw `u16`, 1 zlib `u16`, 2 Occipital's);
//! - `u32` width and height of colour, then of depth; `f32` depth units per metre; `u64` number of frames;
//! - each frame: 4x4 `f32` camera-to-world, `u64` times of colour and depth (microseconds), `u64` sizes of the colour
//!   and of the depth data, and the data;
//! - measurements of the accelerometer, which are not read.

use crate::DatasetError;
use crate::decode::{MAX_IMAGE_FILE_BYTES, MAX_PIXELS};
use crate::files::{RandomAccessFile, open_file};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Duration;

const VERSION: u32 = 4;
/// Version and length of the sensor's name.
const START_BYTES: usize = 4 + 8;
/// Bytes between the sensor's name and the first frame.
const HEADER_BYTES: usize = 4 * 64 + 2 * 4 + 4 * 4 + 4 + 8;
/// Pose, times and sizes of a frame.
const FRAME_HEADER_BYTES: usize = 64 + 4 * 8;

/// Storage of the colour images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ColorCompression {
    /// RGB bytes.
    Raw,
    /// PNG or JPEG files.
    ImageFile,
}

/// Storage of the depth images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DepthCompression {
    Raw,
    Zlib,
}

/// Header of a recording.
#[derive(Clone, Debug)]
pub(super) struct SensHeader {
    /// 4x4, row-major.
    pub(super) color_intrinsics: [f32; 16],
    /// 4x4, row-major.
    pub(super) depth_intrinsics: [f32; 16],
    pub(super) color_compression: ColorCompression,
    pub(super) depth_compression: DepthCompression,
    /// `(width, height)` of the colour images.
    pub(super) color_size: (usize, usize),
    /// `(width, height)` of the depth images.
    pub(super) depth_size: (usize, usize),
    /// Stored units of depth per metre, as stated.
    pub(super) depth_shift: f32,
}

/// Location of a frame's data.
#[derive(Clone, Copy, Debug)]
struct FrameSpan {
    /// Offset of its pose, bytes from the start of the file.
    offset: u64,
    color_bytes: u64,
    depth_bytes: u64,
}

/// Data stored before the images of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameHeader {
    /// 4x4, row-major.
    pub(super) world_from_camera: [f32; 16],
    /// Time of the colour image; `None` for 0, written by recorders that keep no time. It is the time of the first frame if
    /// the second one has a later time.
    pub(super) timestamp: Option<Duration>,
}

/// Encoded images of one frame.
#[derive(Clone, Debug)]
pub(super) struct StoredImages {
    pub(super) color: Vec<u8>,
    pub(super) depth: Vec<u8>,
}

/// An open recording. Only its header and the locations of its frames are in memory.
#[derive(Debug)]
pub(super) struct SensFile {
    path: PathBuf,
    header: SensHeader,
    frames: Vec<FrameSpan>,
    /// Number of frames in which tracking was lost.
    lost: usize,
    /// True if the times of the first frames are 0 and later.
    starts_at_zero: bool,
    /// Number of frames missing at the end, and the error.
    cut_off: Option<(u64, DatasetError)>,
    file: RandomAccessFile,
}

impl SensFile {
    /// Reads the header and the frames' headers, skipping their data. If a recording is truncated, keeps the complete
    /// frames.
    pub(super) fn open(path: &Path) -> Result<Self, DatasetError> {
        let mut file = open_file(path)?;
        let len = file.metadata().map_err(|source| DatasetError::Io { path: path.to_owned(), source })?.len();
        let mut first_pass = FirstPass { path, file: &mut file, position: 0, len };
        let (header, frame_count) = first_pass.header()?;
        // The list grows with the frames present, because the number in the header may be wrong.
        let (mut frames, mut lost) = (Vec::new(), 0);
        let mut first_times = Vec::new();
        let mut cut_off = None;
        for index in 0..frame_count {
            match first_pass.frame_span(index) {
                Ok((span, is_tracked, microseconds)) => {
                    frames.push(span);
                    lost += usize::from(!is_tracked);
                    if index < 2 {
                        first_times.push(microseconds.min(1));
                    }
                }
                Err(error @ DatasetError::EndsEarly { .. }) if index > 0 => {
                    cut_off = Some((frame_count - index, error));
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        let (path, file) = (path.to_owned(), RandomAccessFile::new(file));
        Ok(Self { path, header, frames, lost, starts_at_zero: first_times == [0, 1], cut_off, file })
    }

    /// Returns the number of frames missing from a truncated recording, and the error for the first of them.
    pub(super) fn cut_off(&self) -> Option<&(u64, DatasetError)> {
        self.cut_off.as_ref()
    }

    pub(super) fn header(&self) -> &SensHeader {
        &self.header
    }

    pub(super) fn frame_count(&self) -> usize {
        self.frames.len()
    }

    /// Returns the number of frames whose poses are not finite, because tracking was lost.
    pub(super) fn lost(&self) -> usize {
        self.lost
    }

    /// Returns the path of a frame, for messages.
    pub(super) fn frame_path(&self, index: usize) -> PathBuf {
        PathBuf::from(format!("{}: frame {index}", self.path.display()))
    }

    /// Reads a frame's header; `None` past the last frame.
    pub(super) fn read_frame_header(&self, index: usize) -> Result<Option<FrameHeader>, DatasetError> {
        let Some(span) = self.frames.get(index) else { return Ok(None) };
        let bytes = self.read(span.offset, FRAME_HEADER_BYTES as u64)?;
        let mut fields = Fields(&bytes);
        let (matrix, microseconds) = (fields.matrix(), fields.u64());
        let is_time = |time: &u64| *time > 0 || index == 0 && self.starts_at_zero;
        let timestamp = microseconds.filter(is_time).map(Duration::from_micros);
        Ok(matrix.map(|world_from_camera| FrameHeader { world_from_camera, timestamp }))
    }

    /// Reads the images of a frame; `None` past the last frame.
    pub(super) fn read_images(&self, index: usize) -> Result<Option<StoredImages>, DatasetError> {
        let Some(span) = self.frames.get(index) else { return Ok(None) };
        let color_offset = span.offset + FRAME_HEADER_BYTES as u64;
        let color = self.read(color_offset, span.color_bytes)?;
        let depth = self.read(color_offset + span.color_bytes, span.depth_bytes)?;
        Ok(Some(StoredImages { color, depth }))
    }

    /// Returns the number of bytes of a frame's depth image; `None` past the last frame.
    pub(super) fn depth_bytes(&self, index: usize) -> Option<u64> {
        self.frames.get(index).map(|span| span.depth_bytes)
    }

    fn read(&self, offset: u64, len: u64) -> Result<Vec<u8>, DatasetError> {
        self.file.read(offset, len).map_err(|source| DatasetError::Io { path: self.path.clone(), source })
    }
}

/// Sequential reader for the first pass over a recording.
struct FirstPass<'a> {
    path: &'a Path,
    file: &'a mut File,
    position: u64,
    len: u64,
}

impl FirstPass<'_> {
    fn ends_early(&self, what: String, needed: u64) -> DatasetError {
        let end = self.position.saturating_add(needed);
        DatasetError::EndsEarly { path: self.path.to_owned(), what, end, bytes: self.len }
    }

    fn wrong(&self, field: &str, found: impl ToString, expected: &str) -> DatasetError {
        DatasetError::Field {
            path: self.path.to_owned(),
            field: field.to_owned(),
            found: found.to_string(),
            expected: expected.to_owned(),
        }
    }

    /// Reads the next bytes. `what` names them.
    fn take<const N: usize>(&mut self, what: impl Fn() -> String) -> Result<[u8; N], DatasetError> {
        if self.len - self.position < N as u64 {
            return Err(self.ends_early(what(), N as u64));
        }
        let mut bytes = [0; N];
        self.file.read_exact(&mut bytes).map_err(|source| DatasetError::Io { path: self.path.to_owned(), source })?;
        self.position += N as u64;
        Ok(bytes)
    }

    /// Skips bytes that are not needed now. `what` names them.
    fn skip(&mut self, bytes: u64, what: impl Fn() -> String) -> Result<(), DatasetError> {
        if self.len - self.position < bytes {
            return Err(self.ends_early(what(), bytes));
        }
        self.position += bytes;
        self.file
            .seek(SeekFrom::Start(self.position))
            .map_err(|source| DatasetError::Io { path: self.path.to_owned(), source })?;
        Ok(())
    }

    /// Reads the header. Also returns the stated number of frames.
    fn header(&mut self) -> Result<(SensHeader, u64), DatasetError> {
        let start: [u8; START_BYTES] = self.take(|| "the header".to_owned())?;
        let mut fields = Fields(&start);
        // The arrays contain all their fields, so the defaults are never used.
        let (version, name_bytes) = (fields.u32().unwrap_or(0), fields.u64().unwrap_or(0));
        if version != VERSION {
            return Err(self.wrong("version", version, "4, the only one that ScanNet publishes"));
        }
        self.skip(name_bytes, || format!("the sensor's name of {name_bytes} bytes"))?;
        let rest: [u8; HEADER_BYTES] = self.take(|| "the header".to_owned())?;
        let raw = RawHeader::parse(&rest).ok_or_else(|| self.ends_early("the header".to_owned(), 0))?;
        let color_compression = match raw.color_compression {
            0 => ColorCompression::Raw,
            1 | 2 => ColorCompression::ImageFile,
            other => return Err(self.wrong("colour compression", other, "0 (raw), 1 (PNG) or 2 (JPEG)")),
        };
        let depth_compression = match raw.depth_compression {
            0 => DepthCompression::Raw,
            1 => DepthCompression::Zlib,
            other => return Err(self.wrong("depth compression", other, "0 (raw) or 1 (zlib)")),
        };
        let header = SensHeader {
            color_intrinsics: raw.color_intrinsics,
            depth_intrinsics: raw.depth_intrinsics,
            color_compression,
            depth_compression,
            color_size: self.image_size("colour size", raw.color_size)?,
            depth_size: self.image_size("depth size", raw.depth_size)?,
            depth_shift: raw.depth_shift,
        };
        Ok((header, raw.frame_count))
    }

    fn image_size(&self, field: &str, (width, height): (u32, u32)) -> Result<(usize, usize), DatasetError> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > MAX_PIXELS {
            let expected = format!("1 to {MAX_PIXELS} pixels");
            return Err(self.wrong(field, format!("{width}x{height}"), &expected));
        }
        Ok((width as usize, height as usize))
    }

    /// Finds the offset of the next frame and skips it. Also returns true if its pose is finite, and its time in microseconds.
    fn frame_span(&mut self, index: u64) -> Result<(FrameSpan, bool, u64), DatasetError> {
        let name = || format!("frame {index}");
        let offset = self.position;
        let bytes: [u8; FRAME_HEADER_BYTES] = self.take(name)?;
        let mut fields = Fields(&bytes);
        let is_tracked = fields.matrix().is_some_and(|matrix| matrix.iter().all(|entry| entry.is_finite()));
        let (microseconds, _of_depth) = (fields.u64().unwrap_or(0), fields.u64());
        let (color_bytes, depth_bytes) = (fields.u64().unwrap_or(0), fields.u64().unwrap_or(0));
        for (what, found) in [("colour", color_bytes), ("depth", depth_bytes)] {
            if found > MAX_IMAGE_FILE_BYTES {
                let field = format!("frame {index}, bytes of {what}");
                return Err(self.wrong(&field, found, &format!("at most {MAX_IMAGE_FILE_BYTES}")));
            }
        }
        self.skip(color_bytes + depth_bytes, name)?;
        Ok((FrameSpan { offset, color_bytes, depth_bytes }, is_tracked, microseconds))
    }
}

/// Unchecked fields of the header.
struct RawHeader {
    color_intrinsics: [f32; 16],
    depth_intrinsics: [f32; 16],
    color_compression: i32,
    depth_compression: i32,
    color_size: (u32, u32),
    depth_size: (u32, u32),
    depth_shift: f32,
    frame_count: u64,
}

impl RawHeader {
    fn parse(bytes: &[u8; HEADER_BYTES]) -> Option<Self> {
        let mut fields = Fields(bytes);
        let color_intrinsics = fields.matrix()?;
        let _color_extrinsics = fields.matrix()?;
        let depth_intrinsics = fields.matrix()?;
        let _depth_extrinsics = fields.matrix()?;
        Some(Self {
            color_intrinsics,
            depth_intrinsics,
            color_compression: i32::from_le_bytes(fields.take()?),
            depth_compression: i32::from_le_bytes(fields.take()?),
            color_size: (fields.u32()?, fields.u32()?),
            depth_size: (fields.u32()?, fields.u32()?),
            depth_shift: f32::from_le_bytes(fields.take()?),
            frame_count: fields.u64()?,
        })
    }
}

/// Parser of little-endian numbers from the front of a byte slice.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn matrix(&mut self) -> Option<[f32; 16]> {
        let mut matrix = [0.0; 16];
        for entry in &mut matrix {
            *entry = f32::from_le_bytes(self.take()?);
        }
        Some(matrix)
    }
}

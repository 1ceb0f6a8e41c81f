//! Reading of all elements of a file: its tracks, and the places and times of their blocks.

use super::Recording;
use super::calibration::Calibration;
use super::ebml::{FileWindow, Header, id, unsigned, variable_number};
use super::head::{Head, Role};
use super::track::{Content, Track, tracks_of};
use crate::DatasetError;
use crate::files::RandomAccessFile;
use crate::recording::container::{Channel, FoundMessage, RecordSink, max_message_bytes};
use crate::recording::recorded_file::ScannedFile;
use crate::ros_topics::contents::MessagePlace;
use splatseg_ros::{CameraInfo, Message, TfMessage, to_cdr};

/// Maximum length of a part of the head. Calibrations have 10 kB.
const MAX_PART_BYTES: u64 = 16 << 20;
/// Maximum length of a block's header: track, time and flags.
const BLOCK_HEADER_BYTES: usize = 11;
/// The first bytes of an image, which say whether it is a JPEG.
const FIRST_BYTES: usize = 16;
/// Number of images of a track whose size is looked for.
const SIZED_IMAGES: usize = 8;
/// Number of bytes of an image in which its size is looked for.
const SIZED_BYTES: u64 = 1 << 16;
/// Bits of a block's flags that say that it has several frames.
const LACING: u8 = 0b110;
/// Numbers of the channels that are no tracks.
const COLOR_INFO: u64 = u64::MAX;
const DEPTH_INFO: u64 = u64::MAX - 1;
const TRANSFORMS: u64 = u64::MAX - 2;
/// Place of a message that is not in the file.
const NOWHERE: MessagePlace = MessagePlace { chunk: None, offset: 0, len: 0 };

/// Reads a file: its tracks, and the places and times of their blocks. Skips damaged parts.
///
/// # Errors
/// If the file cannot be read, is not Matroska, or the sink fails.
pub(in super::super) fn scan(
    file: &mut ScannedFile<'_>,
    recording: &mut Recording,
    sink: &mut dyn RecordSink,
) -> Result<(), DatasetError> {
    let window = FileWindow::new(file.reader()?, file.bytes);
    let mut scan = Scan {
        file,
        window,
        sink,
        recording,
        head: Head::default(),
        segment_start: 0,
        is_declared: false,
        has_cameras: false,
        cluster: Cluster::default(),
        images: Vec::new(),
        damaged: 0,
    };
    scan.read_all()?;
    if scan.damaged > 1 {
        let line = format!("{}: {} more parts are damaged", scan.file.path.display(), scan.damaged - 1);
        scan.file.damage.push(line);
    }
    let reader = RandomAccessFile::new(scan.file.reader()?);
    let start = scan.file.start;
    scan.recording.files.add_file(start, reader);
    Ok(())
}

/// The cluster whose blocks are read.
#[derive(Clone, Copy, Debug, Default)]
struct Cluster {
    /// Time, nanoseconds.
    time: i64,
    /// Where it ends, if it says so.
    end: Option<u64>,
}

/// State while reading a file.
struct Scan<'a, 'f> {
    file: &'a mut ScannedFile<'f>,
    window: FileWindow,
    sink: &'a mut dyn RecordSink,
    recording: &'a mut Recording,
    head: Head,
    /// Offset of the segment's data, from which the offsets in the file count.
    segment_start: u64,
    /// True once the tracks have been passed on.
    is_declared: bool,
    /// True once the cameras have been.
    has_cameras: bool,
    cluster: Cluster,
    /// Number of images of each track so far, at most [`SIZED_IMAGES`].
    images: Vec<usize>,
    damaged: usize,
}

impl Scan<'_, '_> {
    fn io_error(&self, source: std::io::Error) -> DatasetError {
        DatasetError::Io { path: self.file.path.to_owned(), source }
    }

    fn header(&mut self, at: u64) -> Result<Option<Header>, DatasetError> {
        self.window.header(at).map_err(|source| DatasetError::Io { path: self.file.path.to_owned(), source })
    }

    /// Notes a damaged part.
    fn report(&mut self, what: &str) {
        if self.damaged == 0 {
            self.file.damage.push(format!("{}: {what}", self.file.path.display()));
        }
        self.damaged += 1;
    }

    fn read_all(&mut self) -> Result<(), DatasetError> {
        let mut at = self.enter_segment()?;
        self.segment_start = at;
        while at < self.window.bytes {
            at = match self.read_element(at)? {
                Some(next) => next,
                None => match self.next_cluster(at)? {
                    Some(next) => next,
                    None => break,
                },
            };
        }
        self.declare()
    }

    /// Returns where the data of the segment begin.
    fn enter_segment(&mut self) -> Result<u64, DatasetError> {
        let start = self.window.peek(0, FIRST_BYTES).map(<[u8]>::to_vec).map_err(|source| self.io_error(source))?;
        let found = if start.is_empty() { "an empty file".to_owned() } else { format!("\"{}\"", start.escape_ascii()) };
        let error = |found: String| DatasetError::Field {
            path: self.file.path.to_owned(),
            field: "first bytes".to_owned(),
            found,
            expected: "\"\\x1aE\\xdf\\xa3\", the start of every file in Matroska".to_owned(),
        };
        if Header::parse(&start).is_none_or(|header| header.id != id::EBML) {
            return Err(error(found));
        }
        let error = error(format!("{found}, without a segment"));
        let mut at = 0;
        while let Some(header) = self.header(at)? {
            let data = at + header.length as u64;
            match header {
                Header { id: id::SEGMENT, .. } => return Ok(data),
                Header { size: Some(size), .. } => at = data.saturating_add(size),
                Header { size: None, .. } => break,
            }
        }
        Err(error)
    }

    /// Reads the element at an offset. Returns where the next one begins, inside it or after it; `None` if it is damaged.
    fn read_element(&mut self, at: u64) -> Result<Option<u64>, DatasetError> {
        let Some(header) = self.header(at)? else { return Ok(None) };
        let data = at + header.length as u64;
        if header.id == id::CLUSTER {
            self.declare()?;
            self.cluster = Cluster { time: 0, end: header.size.map(|size| data.saturating_add(size)) };
            return Ok(Some(data));
        }
        let Some(size) = header.size else { return Ok(None) };
        let end = data.saturating_add(size);
        if end > self.window.bytes || self.cluster.end.is_some_and(|last| at < last && end > last) {
            return Ok(None);
        }
        match header.id {
            // Its blocks are read like those outside.
            id::BLOCK_GROUP => return Ok(Some(data)),
            id::TIMESTAMP => {
                let bytes = self
                    .window
                    .peek(data, size.min(9) as usize)
                    .map_err(|source| DatasetError::Io { path: self.file.path.to_owned(), source })?;
                let Some(time) = unsigned(bytes) else { return Ok(None) };
                let time = i64::try_from(time).unwrap_or(i64::MAX);
                self.cluster.time = time.saturating_mul(self.head.timestamp_scale());
            }
            id::SIMPLE_BLOCK | id::BLOCK => self.read_block(data, size)?,
            part if Head::has_part(part) => self.read_part(part, data, size)?,
            _ => {}
        }
        Ok(Some(end))
    }

    /// Returns where reading goes on after a damaged element at an offset: at the next cluster. `None` if there is none.
    fn next_cluster(&mut self, at: u64) -> Result<Option<u64>, DatasetError> {
        let after = self.cluster.end.filter(|end| *end > at);
        self.cluster = Cluster::default();
        let is_cluster = |header: Option<Header>| header.is_some_and(|header| header.id == id::CLUSTER);
        if let Some(end) = after
            && is_cluster(self.header(end)?)
        {
            self.report(&format!(
                "the cluster is damaged at byte {at}: reading goes on with the next one, at byte {end}"
            ));
            return Ok(Some(end));
        }
        let found = self.window.find(id::CLUSTER, at + 1).map_err(|source| self.io_error(source))?;
        match found {
            Some(next) => {
                self.report(&format!("it is damaged at byte {at}: reading goes on with the cluster at byte {next}"));
            }
            None => {
                let bytes = self.window.bytes;
                self.report(&format!(
                    "the recording was not finished, or is damaged: it is read up to byte {at} of {bytes}"
                ));
            }
        }
        Ok(found)
    }

    /// Reads a part of the head.
    fn read_part(&mut self, part: u32, data: u64, size: u64) -> Result<(), DatasetError> {
        if size > MAX_PART_BYTES {
            let limit = splatseg_files::display_bytes(MAX_PART_BYTES);
            self.report(&format!(
                "the part of the head at byte {data} has {size} bytes, more than {limit}: it is left out"
            ));
            return Ok(());
        }
        let bytes = self.window.read(data, size).map_err(|source| self.io_error(source))?;
        self.head.add(part, &bytes);
        // The calibration may come last.
        if self.is_declared { self.declare_cameras() } else { Ok(()) }
    }

    /// Reads the parts of the head that come later, as far as the file says where they are. Then passes the tracks on.
    fn declare(&mut self) -> Result<(), DatasetError> {
        if self.is_declared {
            return Ok(());
        }
        for (part, offset) in self.head.missing_parts() {
            let at = self.segment_start.saturating_add(offset);
            let header = self.header(at)?.filter(|header| header.id == part);
            let Some((length, size)) = header.and_then(|header| Some((header.length as u64, header.size?))) else {
                continue;
            };
            // One that is cut off is reported where it is.
            if at.saturating_add(length).saturating_add(size) <= self.window.bytes {
                self.read_part(part, at + length, size)?;
            }
        }
        self.is_declared = true;
        self.recording.camera = self.head.camera();
        self.recording.tracks = tracks_of(&self.head);
        self.images = vec![0; self.recording.tracks.len()];
        for track in &self.recording.tracks {
            let (topic, encoding) = (&track.topic, track.encoding());
            self.sink.channel(&Channel { id: track.number, topic, type_name: track.type_name(), encoding })?;
        }
        self.declare_cameras()
    }

    /// Passes the cameras on, once the calibration has been read.
    fn declare_cameras(&mut self) -> Result<(), DatasetError> {
        let Some(Some(bytes)) = self.head.calibration.as_ref().filter(|_| !self.has_cameras) else { return Ok(()) };
        self.has_cameras = true;
        match cameras(bytes, &self.recording.tracks) {
            Ok((infos, transforms)) => {
                self.recording.no_calibration = None;
                for (channel, topic, info) in infos {
                    self.send(channel, &topic, CameraInfo::INTERFACE.name, to_cdr(&info))?;
                }
                self.send(TRANSFORMS, "/tf_static", TfMessage::INTERFACE.name, to_cdr(&transforms))
            }
            Err(what) => {
                self.report(&format!("calibration.json: {what}"));
                self.recording.no_calibration = Some(format!("one that cannot be used: {what}"));
                Ok(())
            }
        }
    }

    /// Passes on a topic with one message.
    fn send(
        &mut self,
        channel: u64,
        topic: &str,
        type_name: &str,
        data: Result<Vec<u8>, splatseg_ros::CdrError>,
    ) -> Result<(), DatasetError> {
        self.sink.channel(&Channel { id: channel, topic, type_name, encoding: "cdr" })?;
        let data = data.map_err(|error| error.to_string());
        let data = data.as_ref().map(Vec::as_slice).map_err(String::as_str);
        self.sink.message(&FoundMessage { channel, log_time: 0, place: NOWHERE, data })
    }

    /// Reads the header of the block with the given data.
    fn read_block(&mut self, data: u64, size: u64) -> Result<(), DatasetError> {
        let path = self.file.path;
        let start = self.window.peek(data, size.min((BLOCK_HEADER_BYTES + FIRST_BYTES) as u64) as usize);
        let start = start.map_err(|source| DatasetError::Io { path: path.to_owned(), source })?;
        let Some((number, time, flags, length)) = block_header(start) else {
            self.report(&format!("the block at byte {data} is damaged"));
            return Ok(());
        };
        let first = start.get(length..).unwrap_or_default().to_vec();
        let Some(index) = self.recording.tracks.iter().position(|track| track.number == number) else {
            self.report(&format!("the block at byte {data} belongs to no track"));
            return Ok(());
        };
        let time = self.cluster.time.saturating_add(i64::from(time).saturating_mul(self.head.timestamp_scale())).max(0);
        let len = size - length as u64;
        let offset = self.file.start.saturating_add(data + length as u64);
        let place = MessagePlace { chunk: u32::try_from(index).ok(), offset, len };
        let image = self.image(index, (time, flags), (data + length as u64, len), first)?;
        let data = image.as_ref().map(Vec::as_slice).map_err(String::as_str);
        self.sink.message(&FoundMessage { channel: number, log_time: time.unsigned_abs(), place, data })
    }

    /// Returns the message of a block, or why it is not read; nothing for tracks that are not read. Its data begin at an offset,
    /// with `first`.
    fn image(
        &mut self,
        index: usize,
        (time, flags): (i64, u8),
        (at, len): (u64, u64),
        first: Vec<u8>,
    ) -> Result<Result<Vec<u8>, String>, DatasetError> {
        let Some(track) = self.recording.tracks.get(index).filter(|track| track.is_read()) else {
            return Ok(Ok(Vec::new()));
        };
        if flags & LACING != 0 {
            return Ok(Err("several images in one block (lacing)".to_owned()));
        }
        if len > max_message_bytes() {
            return Ok(Err(format!("an image of {len} bytes, which is too long to be read")));
        }
        let delay = if matches!(track.role, Role::Depth | Role::Infrared) { self.head.depth_delay() } else { 0 };
        // A stamp of 0 would mean that there is none.
        let stamp = Some(time.saturating_sub(delay)).filter(|stamp| *stamp != 0).unwrap_or(1);
        let seen = self.images.get_mut(index).filter(|seen| **seen < SIZED_IMAGES && track.content == Content::Jpeg);
        let needed = match (self.sink.needs_images(), seen) {
            (true, _) => len,
            (false, Some(seen)) => {
                *seen += 1;
                len.min(SIZED_BYTES)
            }
            (false, None) => 0,
        };
        let data = if needed > first.len() as u64 {
            self.window
                .read(at, needed)
                .map_err(|source| DatasetError::Io { path: self.file.path.to_owned(), source })?
        } else {
            first
        };
        Ok(track.message(stamp, &data).map_err(|error| error.to_string()))
    }
}

/// Parses the header of a block: number of its track, time after that of the cluster, flags, and the length of all that.
fn block_header(bytes: &[u8]) -> Option<(u64, i16, u8, usize)> {
    let (number, length) = variable_number(bytes)?;
    let &[high, low, flags] = bytes.get(length..)?.first_chunk()?;
    Some((number?, i16::from_be_bytes([high, low]), flags, length + 3))
}

/// A channel, its topic, and the camera info that it gives.
type InfoChannel = (u64, String, CameraInfo);

/// Returns the camera infos of the tracks and the transform between their cameras.
fn cameras(bytes: &[u8], tracks: &[Track]) -> Result<(Vec<InfoChannel>, TfMessage), String> {
    let calibration = Calibration::parse(bytes)?;
    let mut infos = Vec::new();
    for track in tracks {
        let (channel, info) = match track.role {
            Role::Color => (COLOR_INFO, calibration.color_info(track.size, &track.frame)?),
            Role::Depth => (DEPTH_INFO, calibration.depth_info(track.size, &track.frame)?),
            Role::Infrared | Role::Other => continue,
        };
        infos.push((channel, format!("{}/camera_info", track.topic), info));
    }
    Ok((infos, calibration.color_from_depth("COLOR", "DEPTH")?))
}

//! Messages of bags that Orbbec's SDK (version 2) and OrbbecViewer record, converted to those of ROS's drivers.
//!
//! Its types are read by hand: what they hold is not what the definitions in the bag say. The topics are
//! `/cam/sensor_N/frameType_M` (images), `/cam/streamProfileType_N` (camera and lens; that of depth also has its place
//! beside colour) and `/cam/property` (settings of the camera, by number). The source is `src/media/ros/` and
//! `3rdparty/rosbag/src/msgs/` of <https://github.com/orbbec/OrbbecSDK_v2>.

use crate::recording::realsense::extrinsics;
use glam::{DMat3, DQuat, DVec3};
use splatseg_ros::{CameraInfo, CdrError, Float32Message, Header, Image, Message, TfMessage, Time, to_cdr};

/// Numbers of the SDK's sensors (`OBSensorType`).
const COLOR: u8 = 2;
const DEPTH: u8 = 3;
/// Numbers of the SDK's settings (`OBPropertyID`): 1 if the camera registers depth to colour; the unit of depth by its
/// place in [`UNITS`]; 0 if the camera sends disparities, which the SDK makes depth of; the unit of depth, millimetres.
const ALIGNS_DEPTH: u32 = 42;
const DEPTH_PRECISION: u32 = 75;
const SENDS_DEPTH: u32 = 85;
const DEPTH_UNIT: u32 = 176;
/// Units of depth, millimetres (`OBDepthPrecisionLevel`).
const UNITS: [f64; 7] = [1.0, 0.8, 0.4, 0.1, 0.2, 0.5, 0.05];
/// Model of a fisheye (`OBCameraDistortionModel`), and of no lens.
const KANNALA_BRANDT4: u8 = 5;
const NO_LENS: u8 = 0;
/// Added to the number of a connection: the channel of the second message that a message becomes.
const SECOND_CHANNEL: u64 = 1 << 32;

const CUT_OFF: &str = "the message is cut off, or not of its type";
/// Encoding of images that have no depth yet. Nothing reads it, so it is named in messages.
const DISPARITY: &str = "disparity, which only Orbbec's SDK makes depth of: record with hardware disparity-to-depth";

/// The kind of messages on a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Image {
        sensor: u8,
        /// True for versions before May 2025: the data begin with other values, whose length is before them.
        has_metadata_first: bool,
    },
    Profile {
        sensor: u8,
    },
    Property,
}

/// The settings in the bag that concern depth.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Recorded {
    is_aligned: bool,
    is_disparity: bool,
}

/// A channel, relative to the number of its connection: added number, topic and type.
pub(super) type OwnChannel = (u64, String, &'static str);

impl Content {
    /// Returns what a connection of Orbbec's has; `None` for those of others.
    pub(super) fn of(topic: &str, type_name: &str, definition: &str) -> Option<Self> {
        let number = |start: &str| topic.strip_prefix(start)?.split('/').next()?.parse::<u8>().ok();
        match type_name {
            "sensor_msgs/Image" if definition.contains("metadatasize") => Some(Self::Image {
                sensor: number("/cam/sensor_")?,
                has_metadata_first: !definition.contains("uint8[] metadata"),
            }),
            "custom_msg/OBStreamProfileInfo" => Some(Self::Profile { sensor: number("/cam/streamProfileType_")? }),
            "custom_msg/OBProperty" => Some(Self::Property),
            _ => None,
        }
    }

    /// Returns the channels of the converted messages. Images keep their topic.
    pub(super) fn channels(self, topic: &str) -> Vec<OwnChannel> {
        match self {
            Self::Image { .. } => vec![(0, topic.to_owned(), Image::INTERFACE.name)],
            Self::Profile { sensor } => {
                let mut channels = vec![(0, format!("/cam/sensor_{sensor}/camera_info"), CameraInfo::INTERFACE.name)];
                if sensor == DEPTH {
                    channels.push((SECOND_CHANNEL, "/cam/tf_static".to_owned(), TfMessage::INTERFACE.name));
                }
                channels
            }
            Self::Property => {
                vec![(0, format!("/cam/sensor_{DEPTH}/depth_unit"), Float32Message::INTERFACE.name)]
            }
        }
    }

    /// Converts a message. Returns those that it becomes, with what is added to the number of the connection.
    ///
    /// # Errors
    /// Description of the damage.
    pub(super) fn convert(self, data: &[u8], recorded: &mut Recorded) -> Result<Vec<(u64, Vec<u8>)>, String> {
        match self {
            Self::Image { sensor, has_metadata_first } => {
                Ok(vec![(0, image(data, (sensor, has_metadata_first), *recorded)?)])
            }
            Self::Profile { sensor } => profile(data, sensor, *recorded),
            Self::Property => property(data, recorded),
        }
    }
}

/// Reads numbers, little endian, and texts.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes<const COUNT: usize>(&mut self) -> Result<[u8; COUNT], String> {
        let (bytes, rest) = self.0.split_first_chunk().ok_or(CUT_OFF)?;
        self.0 = rest;
        Ok(*bytes)
    }

    fn u8(&mut self) -> Result<u8, String> {
        self.bytes().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Result<u16, String> {
        self.bytes().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn floats<const COUNT: usize>(&mut self) -> Result<[f64; COUNT], String> {
        let mut numbers = [0.0; COUNT];
        for number in &mut numbers {
            *number = f32::from_le_bytes(self.bytes()?).into();
        }
        Ok(numbers)
    }

    /// Reads what has its length before it.
    fn part(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()? as usize;
        let (part, rest) = self.0.split_at_checked(length).ok_or(CUT_OFF)?;
        self.0 = rest;
        Ok(part)
    }

    /// Reads a header. Its frame is empty, or a number of a version.
    fn header(&mut self, frame: String) -> Result<Header, String> {
        let [_, sec, nanosec] = [self.u32()?, self.u32()?, self.u32()?];
        self.part()?;
        let sec = i32::try_from(sec).map_err(|_| CUT_OFF)?;
        Ok(Header { stamp: Time { sec, nanosec }, frame_id: frame })
    }
}

/// Returns the coordinate frame of a sensor.
fn frame_of(sensor: u8, recorded: Recorded) -> String {
    match sensor {
        COLOR => "Color".to_owned(),
        DEPTH if recorded.is_aligned => "Color".to_owned(),
        DEPTH => "Depth".to_owned(),
        other => format!("sensor_{other}"),
    }
}

fn cdr(message: Result<Vec<u8>, CdrError>) -> Result<Vec<u8>, String> {
    message.map_err(|error| error.to_string())
}

fn image(data: &[u8], (sensor, has_metadata_first): (u8, bool), recorded: Recorded) -> Result<Vec<u8>, String> {
    let mut reader = Reader(data);
    let header = reader.header(frame_of(sensor, recorded))?;
    let (height, width) = (reader.u32()?, reader.u32()?);
    let encoding = str::from_utf8(reader.part()?).map_err(|error| error.to_string())?;
    let (is_bigendian, step) = (reader.u8()?, reader.u32()?);
    let metadata = if has_metadata_first { reader.u32()? as usize } else { 0 };
    let data = reader.part()?.get(metadata..).ok_or(CUT_OFF)?;
    let encoding = match encoding {
        _ if sensor == DEPTH && recorded.is_disparity => DISPARITY,
        "mono16" | "z16" if sensor == DEPTH => "16UC1",
        "yuy2" | "gray" => "yuyv",
        other => other,
    };
    cdr(to_cdr(&Image { header, height, width, encoding, is_bigendian, step, data }))
}

fn profile(data: &[u8], sensor: u8, recorded: Recorded) -> Result<Vec<(u64, Vec<u8>)>, String> {
    let mut reader = Reader(data);
    let header = reader.header(frame_of(sensor, recorded))?;
    let [_stream, _format] = reader.bytes()?;
    let (rotation, shift) = (reader.floats::<9>()?, reader.floats::<3>()?);
    let (width, height, _rate) = (reader.u16()?, reader.u16()?, reader.u16()?);
    let [fx, fy, cx, cy] = reader.floats()?;
    let [k1, k2, k3, k4, k5, k6, p1, p2] = reader.floats()?;
    let (distortion_model, d) = match reader.u8()? {
        NO_LENS => ("plumb_bob", vec![0.0; 5]),
        KANNALA_BRANDT4 => ("equidistant", vec![k1, k2, k3, k4]),
        _ => ("rational_polynomial", vec![k1, k2, p1, p2, k3, k4, k5, k6]),
    };
    let info = CameraInfo {
        header,
        width: width.into(),
        height: height.into(),
        distortion_model: distortion_model.to_owned(),
        d,
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    };
    let mut messages = vec![(0, cdr(to_cdr(&info))?)];
    // By rows, of points from depth to colour, millimetres; zeros if there is no colour.
    let turn = DMat3::from_cols_array(&rotation).transpose();
    if sensor == DEPTH && !recorded.is_aligned && (turn.determinant() - 1.0).abs() < 0.01 {
        let shift = DVec3::from_array(shift) * 1e-3;
        messages.push((SECOND_CHANNEL, cdr(extrinsics("Color", "Depth", DQuat::from_mat3(&turn), shift))?));
    }
    Ok(messages)
}

fn property(data: &[u8], recorded: &mut Recorded) -> Result<Vec<(u64, Vec<u8>)>, String> {
    let mut reader = Reader(data);
    reader.header(String::new())?;
    let number = reader.u32()?;
    let value = reader.part()?;
    let is_set = || value.first().is_some_and(|byte| *byte != 0);
    let millimetres = match number {
        ALIGNS_DEPTH => {
            recorded.is_aligned = is_set();
            return Ok(Vec::new());
        }
        SENDS_DEPTH => {
            recorded.is_disparity = !is_set();
            return Ok(Vec::new());
        }
        DEPTH_PRECISION => {
            let level = value.first_chunk().map(|bytes| u32::from_le_bytes(*bytes));
            level.and_then(|level| UNITS.get(level as usize)).copied()
        }
        DEPTH_UNIT => value.first_chunk().map(|bytes| f64::from(f32::from_le_bytes(*bytes))),
        _ => return Ok(Vec::new()),
    };
    let millimetres =
        millimetres.filter(|unit| *unit > 0.0).ok_or_else(|| format!("the unit of depth is {value:?}"))?;
    let unit = Float32Message { data: (millimetres * 1e-3) as f32 };
    Ok(vec![(0, cdr(to_cdr(&unit))?)])
}

//! `sensor_msgs`.

use crate::cdr::serialize_bytes;
use crate::{Header, Interface, Message};
use serde::{Deserialize, Serialize};

/// An uncompressed image (`sensor_msgs/msg/Image`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Image<'a> {
    /// Capture time, and the camera's optical frame (x right, y down, z forward).
    pub header: Header,
    /// Number of rows.
    pub height: u32,
    /// Number of columns.
    pub width: u32,
    /// Pixel format, e.g. `rgb8` or `16UC1`.
    #[serde(borrow)]
    pub encoding: &'a str,
    /// Nonzero if multi-byte values are big endian.
    pub is_bigendian: u8,
    /// Number of bytes from one row to the next.
    pub step: u32,
    /// The pixels, row by row.
    #[serde(borrow, serialize_with = "serialize_bytes")]
    pub data: &'a [u8],
}

impl Message for Image<'_> {
    const INTERFACE: Interface = Interface {
        name: "sensor_msgs/msg/Image",
        fields: "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n\
                 uint8[] data\n",
        uses: &[&Header::INTERFACE],
    };
}

/// An image in a file format (`sensor_msgs/msg/CompressedImage`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressedImage<'a> {
    /// Capture time, and the camera's optical frame.
    pub header: Header,
    /// Format of the file and of the original image, e.g. `jpeg` or `16UC1; compressedDepth png`.
    #[serde(borrow)]
    pub format: &'a str,
    /// Content of the file.
    #[serde(borrow, serialize_with = "serialize_bytes")]
    pub data: &'a [u8],
}

impl Message for CompressedImage<'_> {
    const INTERFACE: Interface = Interface {
        name: "sensor_msgs/msg/CompressedImage",
        fields: "std_msgs/Header header\nstring format\nuint8[] data\n",
        uses: &[&Header::INTERFACE],
    };
}

/// A camera's intrinsics (`sensor_msgs/msg/CameraInfo`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Time of the image, and the camera's optical frame.
    pub header: Header,
    /// Number of rows of the calibrated image.
    pub height: u32,
    /// Number of columns of the calibrated image.
    pub width: u32,
    /// Distortion model, e.g. `plumb_bob`.
    pub distortion_model: String,
    /// Distortion coefficients.
    pub d: Vec<f64>,
    /// Camera matrix of the unrectified image, 3×3, row-major: fx 0 cx, 0 fy cy, 0 0 1.
    pub k: [f64; 9],
    /// Rotation that rectifies a stereo pair, 3×3, row-major.
    pub r: [f64; 9],
    /// Projection matrix of the rectified image, 3×4, row-major.
    pub p: [f64; 12],
    /// Number of columns binned into one pixel; 0 means 1.
    pub binning_x: u32,
    /// Number of rows binned into one pixel; 0 means 1.
    pub binning_y: u32,
    /// The region of the calibrated image that is captured.
    pub roi: RegionOfInterest,
}

impl Message for CameraInfo {
    const INTERFACE: Interface = Interface {
        name: "sensor_msgs/msg/CameraInfo",
        fields: "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
                 float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
        uses: &[&Header::INTERFACE, &RegionOfInterest::INTERFACE],
    };
}

/// A region of an image (`sensor_msgs/msg/RegionOfInterest`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegionOfInterest {
    /// First column.
    pub x_offset: u32,
    /// First row.
    pub y_offset: u32,
    /// Number of rows; 0 means all.
    pub height: u32,
    /// Number of columns; 0 means all.
    pub width: u32,
    /// True for a region of the rectified image.
    pub do_rectify: bool,
}

impl Message for RegionOfInterest {
    const INTERFACE: Interface = Interface {
        name: "sensor_msgs/msg/RegionOfInterest",
        fields: "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
        uses: &[],
    };
}

/// Points with named fields (`sensor_msgs/msg/PointCloud2`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointCloud2<'a> {
    /// Time of the measurement, and the frame of the coordinates.
    pub header: Header,
    /// Number of rows; 1 for unordered points.
    pub height: u32,
    /// Number of points per row.
    pub width: u32,
    /// The fields of a point.
    pub fields: Vec<PointField>,
    /// True if the data are big endian.
    pub is_bigendian: bool,
    /// Number of bytes per point.
    pub point_step: u32,
    /// Number of bytes per row.
    pub row_step: u32,
    /// The points.
    #[serde(borrow, serialize_with = "serialize_bytes")]
    pub data: &'a [u8],
    /// True if there are no invalid points.
    pub is_dense: bool,
}

impl Message for PointCloud2<'_> {
    const INTERFACE: Interface = Interface {
        name: "sensor_msgs/msg/PointCloud2",
        fields: "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
                 uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
        uses: &[&Header::INTERFACE, &PointField::INTERFACE],
    };
}

/// A field of a point (`sensor_msgs/msg/PointField`).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointField {
    /// Name, e.g. `x`.
    pub name: String,
    /// Offset from the start of the point, bytes.
    pub offset: u32,
    /// Type of its numbers: one of the constants of this type.
    pub datatype: u8,
    /// Number of elements.
    pub count: u32,
}

impl PointField {
    /// `datatype` of `i8`.
    pub const INT8: u8 = 1;
    /// `datatype` of `u8`.
    pub const UINT8: u8 = 2;
    /// `datatype` of `i16`.
    pub const INT16: u8 = 3;
    /// `datatype` of `u16`.
    pub const UINT16: u8 = 4;
    /// `datatype` of `i32`.
    pub const INT32: u8 = 5;
    /// `datatype` of `u32`.
    pub const UINT32: u8 = 6;
    /// `datatype` of `f32`.
    pub const FLOAT32: u8 = 7;
    /// `datatype` of `f64`.
    pub const FLOAT64: u8 = 8;
}

impl Message for PointField {
    const INTERFACE: Interface = Interface {
        name: "sensor_msgs/msg/PointField",
        fields: "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n\
                 uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
        uses: &[],
    };
}

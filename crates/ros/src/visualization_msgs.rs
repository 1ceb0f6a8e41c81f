//! `visualization_msgs`.

use crate::cdr::serialize_bytes;
use crate::{ColorRgba, CompressedImage, Duration, Header, Interface, Message, Point, PoseMessage, Vector3};
use serde::{Deserialize, Serialize};

/// Values of [`Marker::kind`].
pub mod marker_type {
    /// A box.
    pub const CUBE: i32 = 1;
    /// Lines between pairs of points.
    pub const LINE_LIST: i32 = 5;
    /// Text that faces the viewer.
    pub const TEXT_VIEW_FACING: i32 = 9;
}

/// Values of [`Marker::action`].
pub mod action {
    /// Add the marker, or replace the one with the same namespace and id.
    pub const ADD: i32 = 0;
    /// Delete the marker with the same namespace and id.
    pub const DELETE: i32 = 2;
    /// Delete all markers.
    pub const DELETE_ALL: i32 = 3;
}

/// An object to draw (`visualization_msgs/msg/Marker`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Marker<'a> {
    /// Time of the marker, and its frame.
    pub header: Header,
    /// Namespace. Together with `id`, identifies the marker.
    pub ns: String,
    /// Number in the namespace.
    pub id: i32,
    /// Type of the marker; see [`marker_type`]. (The field is called `type`.)
    pub kind: i32,
    /// Action; see [`action`].
    pub action: i32,
    /// Pose.
    pub pose: PoseMessage,
    /// Size, metres.
    pub scale: Vector3,
    /// Colour.
    pub color: ColorRgba,
    /// Time until the marker is deleted; 0 means never.
    pub lifetime: Duration,
    /// True if the marker moves with its frame.
    pub frame_locked: bool,
    /// For lists: the points.
    pub points: Vec<Point>,
    /// For lists: the colour of each point.
    pub colors: Vec<ColorRgba>,
    /// URI of the texture.
    pub texture_resource: String,
    /// Texture.
    #[serde(borrow)]
    pub texture: CompressedImage<'a>,
    /// Texture coordinates of the points.
    pub uv_coordinates: Vec<UvCoordinate>,
    /// For texts: the text.
    pub text: String,
    /// For meshes: URI of the mesh.
    pub mesh_resource: String,
    /// For meshes: the mesh.
    #[serde(borrow)]
    pub mesh_file: MeshFile<'a>,
    /// For meshes: true to use the materials in the mesh file.
    pub mesh_use_embedded_materials: bool,
}

impl Message for Marker<'_> {
    const INTERFACE: Interface = Interface {
        name: "visualization_msgs/msg/Marker",
        fields: "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\nint32 LINE_LIST=5\n\
                 int32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\nint32 TEXT_VIEW_FACING=9\n\
                 int32 MESH_RESOURCE=10\nint32 TRIANGLE_LIST=11\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\n\
                 int32 DELETEALL=3\nstd_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
                 geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
                 builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
                 std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n\
                 visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n\
                 visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n",
        uses: &[
            &Header::INTERFACE,
            &PoseMessage::INTERFACE,
            &Vector3::INTERFACE,
            &ColorRgba::INTERFACE,
            &Duration::INTERFACE,
            &Point::INTERFACE,
            &CompressedImage::INTERFACE,
            &UvCoordinate::INTERFACE,
            &MeshFile::INTERFACE,
        ],
    };
}

/// Several markers (`visualization_msgs/msg/MarkerArray`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MarkerArray<'a> {
    /// The markers.
    #[serde(borrow)]
    pub markers: Vec<Marker<'a>>,
}

impl Message for MarkerArray<'_> {
    const INTERFACE: Interface = Interface {
        name: "visualization_msgs/msg/MarkerArray",
        fields: "visualization_msgs/Marker[] markers\n",
        uses: &[&Marker::INTERFACE],
    };
}

/// A position in a texture (`visualization_msgs/msg/UVCoordinate`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UvCoordinate {
    /// Position along the width, 0 to 1.
    pub u: f32,
    /// Position along the height, 0 to 1.
    pub v: f32,
}

impl Message for UvCoordinate {
    const INTERFACE: Interface =
        Interface { name: "visualization_msgs/msg/UVCoordinate", fields: "float32 u\nfloat32 v\n", uses: &[] };
}

/// A mesh file (`visualization_msgs/msg/MeshFile`).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeshFile<'a> {
    /// File name. The extension gives the format.
    pub filename: String,
    /// Content of the file.
    #[serde(borrow, serialize_with = "serialize_bytes")]
    pub data: &'a [u8],
}

impl Message for MeshFile<'_> {
    const INTERFACE: Interface =
        Interface { name: "visualization_msgs/msg/MeshFile", fields: "string filename\nuint8[] data\n", uses: &[] };
}

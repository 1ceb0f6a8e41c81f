//! Where the results of a session go.

use crate::LiveStatus;
use splatseg_ros::{
    CompressedImage, Detection3dArray, DiagnosticArray, Image, MarkerArray, Message, PointCloud2, TfMessage,
};

/// A kind of message that a session publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Output {
    /// All objects of the map, with lasting ids and boxes.
    Objects,
    /// The same, as markers for RViz.
    Markers,
    /// The id of each pixel of a frame.
    Ids,
    /// A frame with coloured objects, JPEG.
    Overlay,
    /// The map as points.
    Points,
    /// Pose of the camera, if it is tracked.
    Transform,
    /// Rates, delays and drops.
    Diagnostics,
}

impl Output {
    /// All outputs.
    pub const ALL: [Self; 7] =
        [Self::Objects, Self::Markers, Self::Ids, Self::Overlay, Self::Points, Self::Transform, Self::Diagnostics];

    /// The topic. `~` stands for the name of the node.
    pub fn topic(self) -> &'static str {
        match self {
            Self::Objects => "~/objects",
            Self::Markers => "~/markers",
            Self::Ids => "~/ids",
            Self::Overlay => "~/overlay/compressed",
            Self::Points => "~/points",
            Self::Transform => "/tf",
            Self::Diagnostics => "/diagnostics",
        }
    }

    /// The type of the messages, e.g. `sensor_msgs/msg/Image`.
    pub fn type_name(self) -> &'static str {
        match self {
            Self::Objects => Detection3dArray::INTERFACE.name,
            Self::Markers => MarkerArray::INTERFACE.name,
            Self::Ids => Image::INTERFACE.name,
            Self::Overlay => CompressedImage::INTERFACE.name,
            Self::Points => PointCloud2::INTERFACE.name,
            Self::Transform => TfMessage::INTERFACE.name,
            Self::Diagnostics => DiagnosticArray::INTERFACE.name,
        }
    }

    /// True if the latest message is to be sent to whoever subscribes later (durability `TRANSIENT_LOCAL`).
    pub fn is_latched(self) -> bool {
        matches!(self, Self::Objects | Self::Markers | Self::Points)
    }
}

/// A receiver of a session's results. Its functions are called between two frames, so they must return at once.
pub trait Outlet: Send {
    /// Returns true if someone wants messages of a kind. Otherwise they are not made.
    fn wants(&self, output: Output) -> bool;

    /// Publishes a message in CDR.
    fn publish(&mut self, output: Output, message: Vec<u8>);

    /// Shows the state of the session, about once a second.
    fn show(&mut self, status: &LiveStatus);
}

/// An outlet that wants nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Outlet for Silent {
    fn wants(&self, _: Output) -> bool {
        false
    }

    fn publish(&mut self, _: Output, _: Vec<u8>) {}

    fn show(&mut self, _: &LiveStatus) {}
}

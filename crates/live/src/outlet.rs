//! Where the results of a session go.

use crate::{LiveStatus, Requests};
use glam::Vec3;
use splatseg::Pipeline;
use splatseg::pipeline::FrameResult;
use splatseg_geometry::{Image as Pixels, Intrinsics, MapView, RemappedId};
use splatseg_objects::ObjectList;
use splatseg_places::FloorPlan;
use splatseg_ros::{
    CompressedImage, Detection3dArray, DiagnosticArray, Image, MarkerArray, Message, OccupancyGrid, PointCloud2,
    TextMessage, TfMessage,
};
use std::time::Duration;

/// A kind of message that a session publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Output {
    /// The objects of the map that [count](splatseg_objects::Object::counts), with lasting ids and boxes.
    Objects,
    /// The same, as markers for RViz.
    Markers,
    /// The id of each pixel of a frame.
    Ids,
    /// A frame with coloured objects, JPEG.
    Overlay,
    /// The map as points.
    Points,
    /// Free space as Nav2 reads it, when it has changed.
    Map,
    /// The frame of [`Self::Map`], if z does not point up in the world.
    MapFrame,
    /// Rooms, objects and relations as JSON, when the map has changed.
    SceneGraph,
    /// Pose of the camera, if it is tracked.
    Transform,
    /// Rates, delays and drops.
    Diagnostics,
}

impl Output {
    /// All outputs.
    pub const ALL: [Self; 10] = [
        Self::Objects,
        Self::Markers,
        Self::Ids,
        Self::Overlay,
        Self::Points,
        Self::Map,
        Self::MapFrame,
        Self::SceneGraph,
        Self::Transform,
        Self::Diagnostics,
    ];

    /// The topic. `~` stands for the name of the node.
    pub fn topic(self) -> &'static str {
        match self {
            Self::Objects => "~/objects",
            Self::Markers => "~/markers",
            Self::Ids => "~/ids",
            Self::Overlay => "~/overlay/compressed",
            Self::Points => "~/points",
            Self::Map => "~/map",
            Self::MapFrame => "/tf_static",
            Self::SceneGraph => "~/scene_graph",
            Self::Transform => "/tf",
            Self::Diagnostics => "/diagnostics",
        }
    }

    /// The topic for a node with a full name, e.g. `/splatseg`.
    pub fn topic_of(self, node: &str) -> String {
        self.topic().replacen('~', node, 1)
    }

    /// The type of the messages, e.g. `sensor_msgs/msg/Image`.
    pub fn type_name(self) -> &'static str {
        match self {
            Self::Objects => Detection3dArray::INTERFACE.name,
            Self::Markers => MarkerArray::INTERFACE.name,
            Self::Ids => Image::INTERFACE.name,
            Self::Overlay => CompressedImage::INTERFACE.name,
            Self::Points => PointCloud2::INTERFACE.name,
            Self::Map => OccupancyGrid::INTERFACE.name,
            Self::SceneGraph => TextMessage::INTERFACE.name,
            Self::Transform | Self::MapFrame => TfMessage::INTERFACE.name,
            Self::Diagnostics => DiagnosticArray::INTERFACE.name,
        }
    }

    /// True if the latest message is to be sent to whoever subscribes later (durability `TRANSIENT_LOCAL`).
    pub fn is_latched(self) -> bool {
        matches!(self, Self::Objects | Self::Markers | Self::Points) || self.is_seldom()
    }

    /// True if a message is published only when it says something new. Every outlet gets it, for those who come later.
    pub fn is_seldom(self) -> bool {
        matches!(self, Self::Map | Self::MapFrame | Self::SceneGraph)
    }
}

/// A frame with its result.
#[derive(Clone, Copy)]
pub struct LiveFrame<'a> {
    /// Its number, counted from 0 over the frames with a result.
    pub number: usize,
    /// Its name.
    pub name: &'a str,
    /// Time of the image, since the Unix epoch unless its source has another clock.
    pub stamp: Duration,
    /// The colour image, sRGB, `[height, width]`; `None` unless somebody watches or wants [`Output::Overlay`].
    pub color: Option<&'a Pixels<[u8; 3]>>,
    /// Intrinsics of the camera.
    pub intrinsics: Intrinsics,
    /// The result.
    pub result: &'a FrameResult,
    /// The pipeline after the frame, with the map.
    pub pipeline: &'a Pipeline,
    /// The state after the newest frame, which with a lag is a later one.
    pub status: &'a LiveStatus,
    /// Time since the frame was received.
    pub delay: Duration,
}

/// A receiver of a session's results. Its functions are called between two frames, so they must return at once.
pub trait Outlet: Send {
    /// Returns true if someone wants messages of a kind. Otherwise they are not made.
    fn wants(&self, output: Output) -> bool;

    /// Publishes a message in CDR. One that [is seldom](Output::is_seldom) comes also if nobody wants it yet.
    fn publish(&mut self, output: Output, message: Vec<u8>);

    /// Receives the requests of the session, e.g. to pass on those of viewers. Called once, before the first frame.
    fn accept(&mut self, _requests: &Requests) {}

    /// Shows the state of the session, about once a second.
    fn show(&mut self, status: &LiveStatus);

    /// The time for messages that belong to no frame, if it is not that of the system.
    fn clock(&self) -> Option<Duration> {
        None
    }

    /// Returns true if someone watches: [`LiveFrame::color`], [`Self::show_objects`] and [`Self::show_map`] are for them.
    fn is_watched(&self) -> bool {
        false
    }

    /// Shows a frame, before its messages are published. Called for every frame.
    fn show_frame(&mut self, _frame: &LiveFrame<'_>) {}

    /// Shows a new plan of the map; `None` if the map was replaced or shows no floor any more.
    fn show_plan(&mut self, _plan: Option<&FloorPlan>) {}

    /// Shows all objects of the map after a number of frames, as often as [`Output::Objects`] is published, if someone
    /// watches. Also before the first frame, if a map was loaded.
    fn show_objects(&mut self, _objects: &ObjectList, _frames: usize) {}

    /// Shows the map, if someone watches. Called often; `version` differs once the map has changed. `up` is the
    /// unit vector that points up in the world, if keyframes tell.
    fn show_map(&mut self, _map: &MapView<'_>, _up: Option<Vec3>, _version: usize) {}

    /// As [`Self::show_map`], when no more frames come.
    fn show_last_map(&mut self, _map: &MapView<'_>, _up: Option<Vec3>, _version: usize) {}

    /// Objects were merged by hand. Those that a frame shows to be one are in its result.
    fn merge(&mut self, _merged: &[RemappedId]) {}

    /// The map was replaced: nothing that was shown before belongs to the present one.
    fn reset(&mut self) {}
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

/// Several outlets as one. Each gets what it wants.
impl Outlet for Vec<Box<dyn Outlet>> {
    fn wants(&self, output: Output) -> bool {
        self.iter().any(|outlet| outlet.wants(output))
    }

    fn publish(&mut self, output: Output, message: Vec<u8>) {
        for outlet in self.iter_mut().filter(|outlet| output.is_seldom() || outlet.wants(output)) {
            outlet.publish(output, message.clone());
        }
    }

    fn accept(&mut self, requests: &Requests) {
        self.iter_mut().for_each(|outlet| outlet.accept(requests));
    }

    fn show(&mut self, status: &LiveStatus) {
        self.iter_mut().for_each(|outlet| outlet.show(status));
    }

    fn clock(&self) -> Option<Duration> {
        self.iter().find_map(|outlet| outlet.clock())
    }

    fn is_watched(&self) -> bool {
        self.iter().any(|outlet| outlet.is_watched())
    }

    fn show_frame(&mut self, frame: &LiveFrame<'_>) {
        self.iter_mut().for_each(|outlet| outlet.show_frame(frame));
    }

    fn show_plan(&mut self, plan: Option<&FloorPlan>) {
        self.iter_mut().for_each(|outlet| outlet.show_plan(plan));
    }

    fn show_objects(&mut self, objects: &ObjectList, frames: usize) {
        self.iter_mut().filter(|outlet| outlet.is_watched()).for_each(|outlet| outlet.show_objects(objects, frames));
    }

    fn show_map(&mut self, map: &MapView<'_>, up: Option<Vec3>, version: usize) {
        self.iter_mut().filter(|outlet| outlet.is_watched()).for_each(|outlet| outlet.show_map(map, up, version));
    }

    fn show_last_map(&mut self, map: &MapView<'_>, up: Option<Vec3>, version: usize) {
        self.iter_mut().filter(|outlet| outlet.is_watched()).for_each(|outlet| outlet.show_last_map(map, up, version));
    }

    fn merge(&mut self, merged: &[RemappedId]) {
        self.iter_mut().for_each(|outlet| outlet.merge(merged));
    }

    fn reset(&mut self) {
        self.iter_mut().for_each(|outlet| outlet.reset());
    }
}

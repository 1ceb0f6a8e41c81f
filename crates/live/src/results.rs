//! The messages of a session's results.

use crate::saved_map::objects;
use crate::{LiveFrame, Outlet, Output};
use splatseg::Pipeline;
use splatseg::pipeline::{FrameResult, MapPlaces};
use splatseg_dataset::CoordinateFrames;
use splatseg_geometry::Image;
use splatseg_objects::{Object, ObjectList, SeenObjects};
use splatseg_odometry::PoseState;
use splatseg_output::draw_overlay;
use splatseg_output::ros_messages::{
    CAMERA, CameraPose, IdPixels, PointBytes, ShownObject, WORLD, all_markers, camera_pose, detections, id_image,
    occupancy_grid, overlay, plan_transform,
};
use splatseg_places::FloorPlan;
use splatseg_ros::{Detection3dArray, Header, OccupancyGrid, TextMessage, Time, to_cdr};
use std::time::Duration;

/// Child frame of the transform with the tracked pose. The camera's own frame may have a parent already.
const TRACKED_CAMERA: &str = "splatseg_camera";
const JPEG_QUALITY: u8 = 80;
/// Value of a cell of which nothing is known, as in `nav_msgs/OccupancyGrid`.
const UNKNOWN: i8 = -1;

/// Makes and publishes messages.
#[derive(Debug, Default)]
pub(crate) struct Results {
    frames: CoordinateFrames,
    /// The latest grid with all cells unknown; `None` before the first, and after this was published.
    unknown_grid: Option<OccupancyGrid>,
    /// True once a plan or a scene graph was published.
    has_places: bool,
}

impl Results {
    /// Sets the names of the coordinate frames.
    pub(crate) fn set_frames(&mut self, frames: CoordinateFrames) {
        self.frames = frames;
    }

    /// The world frame; `world` if the stream names none.
    pub(crate) fn world(&self) -> &str {
        self.frames.world.as_deref().unwrap_or(WORLD)
    }

    /// Publishes the ids and the overlay of a frame on its stamp.
    pub(crate) fn publish_frame(&self, frame: &LiveFrame<'_>, outlet: &mut dyn Outlet) {
        let segments = &frame.result.output.segments;
        let named = |name: &str| if name.is_empty() { CAMERA.to_owned() } else { name.to_owned() };
        if outlet.wants(Output::Ids) {
            let pixels = IdPixels::new(segments);
            if let Ok(mut message) = id_image(time(frame.stamp), segments.size(), &pixels) {
                message.header.frame_id = named(&self.frames.camera);
                send(outlet, Output::Ids, to_cdr(&message));
            }
        }
        let color = frame.color.filter(|_| outlet.wants(Output::Overlay));
        if let Some(jpeg) = color.and_then(|color| overlay_jpeg(color, frame.result)) {
            let mut message = overlay(time(frame.stamp), &jpeg);
            message.header.frame_id = named(&self.frames.camera);
            send(outlet, Output::Overlay, to_cdr(&message));
        }
    }

    /// Publishes the pose of a frame if it is tracked.
    pub(crate) fn publish_pose(&self, stamp: Duration, result: &FrameResult, outlet: &mut dyn Outlet) {
        if result.pose.state == PoseState::Tracked && outlet.wants(Output::Transform) {
            let mut message = camera_pose(time(stamp), CameraPose::new(&result.pose.world_from_camera));
            for transform in &mut message.transforms {
                transform.header.frame_id = self.world().to_owned();
                transform.child_frame_id = TRACKED_CAMERA.to_owned();
            }
            send(outlet, Output::Transform, to_cdr(&message));
        }
    }

    /// Publishes the objects that count ([`Object::counts`]), with the stamp of the latest frame.
    pub(crate) fn publish_objects(&self, list: &ObjectList, stamp: Duration, outlet: &mut dyn Outlet) {
        if outlet.wants(Output::Objects) {
            send(outlet, Output::Objects, to_cdr(&self.detections(stamp, list.objects.iter())));
        }
        if outlet.wants(Output::Markers) {
            let nanoseconds = time(stamp).nanoseconds();
            let shown: Vec<ShownObject> =
                list.objects.iter().filter_map(|object| ShownObject::new(nanoseconds, object)).collect();
            let mut message = all_markers(&shown);
            let header = header(stamp, self.world());
            message.markers.iter_mut().for_each(|marker| marker.header = header.clone());
            send(outlet, Output::Markers, to_cdr(&message));
        }
    }

    /// The boxes of objects, in the world frame.
    pub(crate) fn detections<'a>(
        &self,
        stamp: Duration,
        objects: impl Iterator<Item = &'a Object>,
    ) -> Detection3dArray {
        detections(&header(stamp, self.world()), objects)
    }

    /// Publishes free space and the scene graph of a plan that is new. If the map shows no floor any more, all cells of the
    /// grid become unknown.
    pub(crate) fn publish_places(
        &mut self,
        (pipeline, seen): (&Pipeline, &SeenObjects),
        places: &MapPlaces,
        stamp: Duration,
        outlet: &mut dyn Outlet,
    ) {
        self.has_places = true;
        outlet.show_plan(places.plan.as_ref().ok());
        match &places.plan {
            Ok(plan) => self.publish_grid(plan, stamp, outlet),
            Err(_) => self.withdraw_grid(stamp, outlet),
        }
        publish_graph(pipeline, &objects(pipeline, seen, Some(places)), outlet);
    }

    /// Takes back what was published of plans, if anything was: there is none of the map of `pipeline`. Who drives by the
    /// grid, or comes later, must not see walls of another place.
    pub(crate) fn withdraw_places(
        &mut self,
        (pipeline, seen): (&Pipeline, &SeenObjects),
        stamp: Duration,
        outlet: &mut dyn Outlet,
    ) {
        if self.has_places {
            outlet.show_plan(None);
            self.withdraw_grid(stamp, outlet);
            publish_graph(pipeline, &objects(pipeline, seen, None), outlet);
        }
    }

    /// Publishes the grid of a plan, and its frame if that is not the world.
    fn publish_grid(&mut self, plan: &FloorPlan, stamp: Duration, outlet: &mut dyn Outlet) {
        match occupancy_grid(time(stamp), plan, self.world()) {
            Ok(message) => {
                if let Some(transform) = plan_transform(time(stamp), plan, self.world()) {
                    send(outlet, Output::MapFrame, to_cdr(&transform));
                }
                send(outlet, Output::Map, to_cdr(&message));
                self.unknown_grid = Some(OccupancyGrid { data: vec![UNKNOWN; message.data.len()], ..message });
            }
            Err(error) => {
                tracing::warn!("{}: {error}", Output::Map.topic());
                self.withdraw_grid(stamp, outlet);
            }
        }
    }

    /// Publishes the latest grid with all cells unknown, unless that was done.
    fn withdraw_grid(&mut self, stamp: Duration, outlet: &mut dyn Outlet) {
        if let Some(mut message) = self.unknown_grid.take() {
            (message.header.stamp, message.info.map_load_time) = (time(stamp), time(stamp));
            send(outlet, Output::Map, to_cdr(&message));
        }
    }

    /// Publishes the map as points.
    pub(crate) fn publish_points(&self, pipeline: &Pipeline, stamp: Duration, outlet: &mut dyn Outlet) {
        let Some(map) = pipeline.map().filter(|_| outlet.wants(Output::Points)) else { return };
        if let Ok(mut message) = PointBytes::in_world(&map).message(time(stamp)) {
            self.world().clone_into(&mut message.header.frame_id);
            send(outlet, Output::Points, to_cdr(&message));
        }
    }
}

fn publish_graph(pipeline: &Pipeline, objects: &ObjectList, outlet: &mut dyn Outlet) {
    match pipeline.scene_graph(objects).to_json() {
        Ok(data) => send(outlet, Output::SceneGraph, to_cdr(&TextMessage { data })),
        Err(error) => tracing::warn!("{}: {error}", Output::SceneGraph.topic()),
    }
}

/// The header of messages about the map.
pub(crate) fn header(stamp: Duration, world: &str) -> Header {
    Header { stamp: time(stamp), frame_id: world.to_owned() }
}

fn time(stamp: Duration) -> Time {
    Time::from_nanoseconds(i64::try_from(stamp.as_nanos()).unwrap_or(i64::MAX))
}

/// Publishes a message; the types published here can all be encoded.
pub(crate) fn send(outlet: &mut dyn Outlet, output: Output, message: Result<Vec<u8>, splatseg_ros::CdrError>) {
    match message {
        Ok(message) => outlet.publish(output, message),
        Err(error) => tracing::warn!("{}: {error}", output.topic()),
    }
}

fn overlay_jpeg(color: &Image<[u8; 3]>, result: &FrameResult) -> Option<Vec<u8>> {
    let drawn = draw_overlay(color, &result.output.segments).ok()?;
    let bytes: Vec<u8> = drawn.pixels().iter().flatten().copied().collect();
    let (width, height) = (u32::try_from(drawn.width()).ok()?, u32::try_from(drawn.height()).ok()?);
    let mut encoded = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut encoded, JPEG_QUALITY);
    encoder.encode(&bytes, width, height, image::ExtendedColorType::Rgb8).ok()?;
    Some(encoded)
}

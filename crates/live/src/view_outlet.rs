//! A session in the browser and in Foxglove.

use crate::{LiveFrame, LiveRequest, LiveSession, LiveStatus, LiveStream, Outlet, Output, Requests};
use glam::Vec3;
use splatseg::segmenter::Detail;
use splatseg_geometry::{Image as Pixels, MapView, RemappedId, SegmentId};
use splatseg_objects::ObjectList;
use splatseg_odometry::PoseState;
use splatseg_places::FloorPlan;
use splatseg_ros::{
    CompressedImage, Detection3dArray, DiagnosticArray, Image, MarkerArray, OccupancyGrid, PointCloud2, TextMessage,
    TfMessage,
};
use splatseg_settings::Choice;
use splatseg_view::{
    Channel, ChannelId, SeenSpans, ViewAnswer, ViewError, ViewFrame, ViewObject, ViewOptions, ViewRequest, ViewServer,
    ViewStatus,
};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

/// Name of the node in the topics shown to Foxglove.
const NODE: &str = "/splatseg";
/// Longest time that a viewer waits for an answer of the session.
const ANSWER_TIME: Duration = Duration::from_secs(5);

/// Shows a session to viewers: the page of [`ViewServer`], and each [`Output`] as a channel for Foxglove.
#[derive(Debug)]
pub struct ViewOutlet {
    server: ViewServer,
    channels: BTreeMap<Output, ChannelId>,
    seen: SeenSpans,
    /// Version of the map that was shown last.
    shown_map: Option<usize>,
    /// Time of the latest frame.
    stamp: Option<Duration>,
}

impl ViewOutlet {
    /// Starts the server.
    ///
    /// # Errors
    /// As [`ViewServer::start`].
    pub fn start(options: ViewOptions) -> Result<Self, ViewError> {
        let server = ViewServer::start(options)?;
        let channels = Output::ALL.map(|output| (output, server.add_channel(channel(output)))).into();
        Ok(Self { server, channels, seen: SeenSpans::default(), shown_map: None, stamp: None })
    }

    /// The server, e.g. for its links.
    pub fn server(&self) -> &ViewServer {
        &self.server
    }
}

fn channel(output: Output) -> Channel {
    let topic = output.topic_of(NODE);
    let channel = match output {
        Output::Objects => Channel::of::<Detection3dArray>(&topic),
        Output::Markers => Channel::of::<MarkerArray<'_>>(&topic),
        Output::Ids => Channel::of::<Image<'_>>(&topic),
        Output::Overlay => Channel::of::<CompressedImage<'_>>(&topic),
        Output::Points => Channel::of::<PointCloud2<'_>>(&topic),
        Output::Map => Channel::of::<OccupancyGrid>(&topic),
        Output::SceneGraph => Channel::of::<TextMessage>(&topic),
        Output::Transform | Output::MapFrame => Channel::of::<TfMessage>(&topic),
        Output::Diagnostics => Channel::of::<DiagnosticArray>(&topic),
    };
    if output.is_latched() { channel.latched() } else { channel }
}

impl Outlet for ViewOutlet {
    fn wants(&self, output: Output) -> bool {
        self.channels.get(&output).is_some_and(|channel| self.server.wants_message(*channel))
    }

    fn publish(&mut self, output: Output, message: Vec<u8>) {
        let time = self.stamp.unwrap_or_else(LiveStream::now);
        if let Some(channel) = self.channels.get(&output) {
            self.server.publish_message(*channel, message, u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
        }
    }

    fn accept(&mut self, requests: &Requests) {
        let requests = requests.clone();
        self.server.answer_with(Arc::new(move |request| answer(&requests, request)));
    }

    fn show(&mut self, status: &LiveStatus) {
        self.server.set_notes(status.problems());
    }

    fn is_watched(&self) -> bool {
        self.server.viewers() > 0
    }

    fn show_frame(&mut self, frame: &LiveFrame<'_>) {
        self.stamp = Some(frame.stamp);
        self.seen.remap(&frame.result.remapped);
        self.seen.record(frame.stamp, frame.result.objects.iter().map(|object| object.id));
        let pose = &frame.result.pose;
        let known = (pose.state != PoseState::Lost).then_some(&pose.world_from_camera);
        // The first viewer may have come after the image was read; the next frame has it.
        self.server.publish_frame(known, || Some(view_frame(frame, frame.color?)));
    }

    fn show_plan(&mut self, plan: Option<&FloorPlan>) {
        self.server.publish_plan(plan);
    }

    fn show_objects(&mut self, objects: &ObjectList, frames: usize) {
        let shown = objects.all().map(|object| ViewObject {
            id: object.id,
            label: object.label.clone(),
            oriented_box: object.shape.as_ref().map(|shape| shape.oriented_box),
            frames: object.frames,
            state: object.state,
            seen: self.seen.of(object.id).to_vec(),
        });
        let shown: Vec<ViewObject> = shown.collect();
        let ids: BTreeSet<SegmentId> = shown.iter().map(|object| object.id).collect();
        self.server.publish_objects(shown, frames);
        self.seen.keep_only(|id| ids.contains(&id));
    }

    fn show_map(&mut self, map: &MapView<'_>, up: Option<Vec3>, version: usize) {
        if self.shown_map != Some(version) && self.server.publish_map(map, up) {
            self.shown_map = Some(version);
        }
    }

    fn show_last_map(&mut self, map: &MapView<'_>, up: Option<Vec3>, version: usize) {
        if self.shown_map != Some(version) && self.server.publish_last_map(map, up) {
            self.shown_map = Some(version);
        }
    }

    fn merge(&mut self, merged: &[RemappedId]) {
        self.seen.remap(merged);
    }

    fn reset(&mut self) {
        (self.seen, self.shown_map) = (SeenSpans::default(), None);
        self.server.restart();
    }
}

/// Answers a viewer of the page.
fn answer(requests: &Requests, request: ViewRequest) -> Result<ViewAnswer, String> {
    match request {
        ViewRequest::Find(text) => {
            let words = requests.look(LiveSession::words, ANSWER_TIME)?;
            let found = words.find(&text).map_err(|error| error.to_string())?;
            Ok(ViewAnswer::Found(found.into_iter().map(|found| (found.id, found.score)).collect()))
        }
        ViewRequest::Name(id, label) => {
            requests.send(LiveRequest::Name(id, label), ANSWER_TIME).map(|_| ViewAnswer::Done)
        }
        ViewRequest::Merge(ids) => requests.send(LiveRequest::Merge(ids), ANSWER_TIME).map(|_| ViewAnswer::Done),
        ViewRequest::Detail(name) => {
            let detail = Detail::from_name(&name)
                .ok_or_else(|| format!("the detail is {name:?}, expected {}", Detail::NAMES.join(", ")))?;
            requests.send(LiveRequest::Detail(detail), ANSWER_TIME).map(|_| ViewAnswer::Done)
        }
    }
}

fn view_frame(frame: &LiveFrame<'_>, color: &Pixels<[u8; 3]>) -> ViewFrame {
    let segments = &frame.result.output.segments;
    let lost = (frame.result.pose.state == PoseState::Lost)
        .then(|| "The camera's pose is lost: turn it to a place that it has seen.".to_owned());
    ViewFrame {
        number: frame.number,
        name: frame.name.to_owned(),
        timestamp: Some(frame.stamp),
        color: color.clone(),
        segments: segments.clone(),
        intrinsics: frame.intrinsics,
        status: ViewStatus {
            dropped: frame.status.dropped_frames,
            is_pose_given: frame.result.pose.state == PoseState::Given,
            detail: frame.pipeline.detail().map(Detail::name),
            delay: Some(frame.delay),
            lines: lost.into_iter().collect(),
        },
    }
}

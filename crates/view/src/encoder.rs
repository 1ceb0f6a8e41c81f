//! The thread that encodes results for the page.

use crate::hub::{PlacedFrame, Shared, Work};
use crate::slots::PageMessage;
use crate::{ViewObject, page_messages};
use splatseg_output::MapData;
use std::time::{Duration, Instant};

/// Interval of messages about the state.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);
/// Minimum interval between lists of objects.
const OBJECTS_INTERVAL: Duration = Duration::from_millis(400);

/// The last messages, so that nothing is sent twice.
#[derive(Default)]
struct Sent {
    objects: Vec<ViewObject>,
    /// A newer list that is not due yet.
    newer_objects: Option<Vec<ViewObject>>,
    /// When the list of objects was sent.
    objects_time: Option<Instant>,
    map: Option<Box<MapData>>,
}

/// Encodes until the server stops.
pub(crate) fn run(shared: &Shared) {
    let mut sent = Sent::default();
    let mut next_status = Instant::now();
    loop {
        let time = next_status.saturating_duration_since(Instant::now());
        match shared.pages.next_work(time, || shared.is_stopping()) {
            Work::Frame(placed) => send_frame(shared, *placed, &mut sent),
            Work::Map(map, up) => {
                if sent.map.as_ref() != Some(&map) {
                    let (origin, _) = shared.pages.origin_and_rate();
                    let message = page_messages::map(&map, up, origin);
                    shared.pages.send(PageMessage::Map, &message, &shared.counters);
                    sent.map = Some(map);
                }
            }
            Work::Plan(plan) => {
                let (origin, _) = shared.pages.origin_and_rate();
                let message = page_messages::plan(plan.as_deref(), origin);
                shared.pages.send(PageMessage::Plan, &message, &shared.counters);
            }
            Work::Idle => send_objects(shared, &mut sent),
            Work::Last => {
                sent.objects_time = None;
                send_objects(shared, &mut sent);
                shared.pages.set_finished();
            }
            Work::Stop => return,
        }
        if Instant::now() >= next_status {
            next_status = Instant::now() + STATUS_INTERVAL;
            let (_, rate) = shared.pages.origin_and_rate();
            let message = page_messages::status(rate, shared.viewers(), &shared.pages.notes());
            shared.pages.send(PageMessage::Status, &message, &shared.counters);
        }
    }
}

fn send_frame(shared: &Shared, placed: PlacedFrame, sent: &mut Sent) {
    let (origin, rate) = shared.pages.origin_and_rate();
    match page_messages::frame(&placed, origin, rate) {
        Ok(message) => shared.pages.send(PageMessage::Frame, &message, &shared.counters),
        Err(error) => tracing::warn!("frame {} cannot be shown: {error}", placed.frame.name),
    }
    sent.newer_objects = Some(placed.frame.objects);
    send_objects(shared, sent);
}

/// Sends the newest list of objects if it is due and differs.
fn send_objects(shared: &Shared, sent: &mut Sent) {
    if sent.objects_time.is_some_and(|time| time.elapsed() < OBJECTS_INTERVAL) {
        return;
    }
    if let Some(objects) = sent.newer_objects.take().filter(|objects| *objects != sent.objects) {
        shared.pages.send(PageMessage::Objects, &page_messages::objects(&objects), &shared.counters);
        sent.objects = objects;
        sent.objects_time = Some(Instant::now());
    }
}

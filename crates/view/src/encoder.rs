//! The thread that encodes results for the page.

use crate::hub::{ListedObjects, PlacedFrame, RunNumber, Shared, Work};
use crate::page_messages;
use crate::slots::PageMessage;
use glam::Vec3;
use splatseg_output::MapData;
use std::time::{Duration, Instant};

/// Interval of messages about the state.
const STATUS_INTERVAL: Duration = Duration::from_secs(1);
/// Minimum interval between lists of objects.
const OBJECTS_INTERVAL: Duration = Duration::from_millis(400);

/// The last messages of a run, so that nothing is sent twice.
#[derive(Default)]
struct Sent {
    run: RunNumber,
    objects: ListedObjects,
    /// A newer list that is not due yet.
    newer_objects: Option<ListedObjects>,
    /// When the list of objects was sent.
    objects_time: Option<Instant>,
    /// The map, and where it said that up is.
    map: Option<(Box<MapData>, Vec3)>,
}

/// Encodes until the server stops.
pub(crate) fn run(shared: &Shared) {
    let mut sent = Sent::default();
    let mut next_status = Instant::now();
    loop {
        let time = next_status.saturating_duration_since(Instant::now());
        let (work, run) = shared.pages.next_work(time, || shared.is_stopping());
        if run != sent.run {
            sent = Sent { run, ..Sent::default() };
        }
        match work {
            Work::Frame(placed) => {
                send_frame(shared, &placed, run);
                send_objects(shared, &mut sent);
            }
            Work::Map(map, up) => {
                let newest = (map, up);
                if sent.map.as_ref() != Some(&newest) {
                    let (origin, _) = shared.pages.origin_and_rate();
                    let message = page_messages::map(&newest.0, up, origin);
                    shared.pages.send(run, PageMessage::Map, &message, &shared.counters);
                    sent.map = Some(newest);
                }
            }
            Work::Objects(objects) => {
                sent.newer_objects = Some(objects);
                send_objects(shared, &mut sent);
            }
            Work::Plan(plan) => {
                let (origin, _) = shared.pages.origin_and_rate();
                let message = page_messages::plan(plan.as_deref(), origin);
                shared.pages.send(run, PageMessage::Plan, &message, &shared.counters);
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
            shared.pages.send(run, PageMessage::Status, &message, &shared.counters);
        }
    }
}

fn send_frame(shared: &Shared, placed: &PlacedFrame, run: RunNumber) {
    let (origin, rate) = shared.pages.origin_and_rate();
    match page_messages::frame(placed, origin, rate) {
        Ok(message) => shared.pages.send(run, PageMessage::Frame, &message, &shared.counters),
        Err(error) => tracing::warn!("frame {} cannot be shown: {error}", placed.frame.name),
    }
}

/// Sends the newest list of objects if it is due and differs.
fn send_objects(shared: &Shared, sent: &mut Sent) {
    if sent.objects_time.is_some_and(|time| time.elapsed() < OBJECTS_INTERVAL) {
        return;
    }
    if let Some(objects) = sent.newer_objects.take().filter(|listed| listed.objects != sent.objects.objects) {
        shared.pages.send(sent.run, PageMessage::Objects, &page_messages::objects(&objects), &shared.counters);
        sent.objects = objects;
        sent.objects_time = Some(Instant::now());
    }
}

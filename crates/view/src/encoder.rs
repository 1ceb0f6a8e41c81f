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

/// What was sent last, so that nothing is sent twice.
#[derive(Default)]
struct Sent {
    objects: Vec<ViewObject>,
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
                    let message = page_messages::map(&map, up);
                    shared.pages.send(PageMessage::Map, &message, &shared.counters);
                    sent.map = Some(map);
                }
            }
            Work::Idle => {}
            Work::Stop => return,
        }
        if Instant::now() >= next_status {
            next_status = Instant::now() + STATUS_INTERVAL;
            let (_, rate) = shared.pages.origin_and_rate();
            let message = page_messages::status(rate, shared.viewers());
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
    let is_due = sent.objects_time.is_none_or(|time| time.elapsed() >= OBJECTS_INTERVAL);
    if is_due && placed.frame.objects != sent.objects {
        sent.objects = placed.frame.objects;
        sent.objects_time = Some(Instant::now());
        shared.pages.send(PageMessage::Objects, &page_messages::objects(&sent.objects), &shared.counters);
    }
}

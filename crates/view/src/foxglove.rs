//! Foxglove's websocket protocol: channels, subscriptions and messages.
//!
//! <https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>. The subprotocol `foxglove.sdk.v1` of newer versions has
//! the same messages as far as they are used here.

use crate::channel::{Channel, ChannelId};
use crate::counts::{Counters, count};
use crate::slots::{MessageQueue, Queued, lock};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use tungstenite::Bytes;

/// The subprotocols, the preferred first.
pub(crate) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Code of a message with data.
const MESSAGE_DATA: u8 = 1;

/// The channels and the viewers subscribed to them.
#[derive(Debug, Default)]
pub(crate) struct MessageHub {
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    channels: Vec<ChannelState>,
    viewers: Vec<Viewer>,
}

#[derive(Debug)]
struct ChannelState {
    channel: Channel,
    /// The latest message with its time, if the channel is latched.
    latest: Option<(u64, Bytes)>,
}

#[derive(Debug)]
struct Viewer {
    queue: Arc<MessageQueue>,
    /// The viewer's number for each subscription.
    subscriptions: BTreeMap<ChannelId, u32>,
}

/// The message that introduces the server. `session` differs between servers.
fn server_info(session: &str) -> String {
    json!({ "op": "serverInfo", "name": "splatseg", "capabilities": [], "metadata": {}, "sessionId": session })
        .to_string()
}

fn advertisement(id: ChannelId, channel: &Channel) -> Value {
    json!({
        "id": id.0,
        "topic": channel.topic,
        "encoding": "cdr",
        "schemaName": channel.schema_name,
        "schema": channel.schema,
        "schemaEncoding": "ros2msg",
    })
}

fn advertise(channels: &[Value]) -> String {
    json!({ "op": "advertise", "channels": channels }).to_string()
}

/// A text that Foxglove shows as an error.
pub(crate) fn error_status(message: &str) -> String {
    json!({ "op": "status", "level": 2, "message": message }).to_string()
}

/// Bytes of a message with data; the time is in nanoseconds.
pub(crate) fn message_data(subscription: u32, time: u64, data: &[u8]) -> Vec<u8> {
    [&[MESSAGE_DATA], &subscription.to_le_bytes()[..], &time.to_le_bytes(), data].concat()
}

/// A viewer's request.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Request {
    /// Pairs of the viewer's number and the channel.
    Subscribe(Vec<(u32, ChannelId)>),
    /// The viewer's numbers.
    Unsubscribe(Vec<u32>),
    /// Valid, but not offered by this server.
    Other(String),
}

/// Parses a viewer's text. `None` if it violates the protocol.
pub(crate) fn parse_request(text: &str) -> Option<Request> {
    let value: Value = serde_json::from_str(text).ok()?;
    let number = |value: &Value| u32::try_from(value.as_u64()?).ok();
    match value.get("op")?.as_str()? {
        "subscribe" => {
            let subscriptions = value.get("subscriptions")?.as_array()?.iter();
            let pair = |entry: &Value| Some((number(entry.get("id")?)?, ChannelId(number(entry.get("channelId")?)?)));
            subscriptions.map(pair).collect::<Option<_>>().map(Request::Subscribe)
        }
        "unsubscribe" => {
            let numbers = value.get("subscriptionIds")?.as_array()?.iter();
            numbers.map(number).collect::<Option<_>>().map(Request::Unsubscribe)
        }
        other => Some(Request::Other(other.chars().take(40).collect())),
    }
}

impl MessageHub {
    pub(crate) fn viewers(&self) -> usize {
        lock(&self.state).viewers.len()
    }

    /// Adds a channel and announces it.
    pub(crate) fn add_channel(&self, channel: Channel) -> ChannelId {
        let mut state = lock(&self.state);
        // Ids start at 1.
        let id = ChannelId(u32::try_from(state.channels.len() + 1).unwrap_or(u32::MAX));
        let text = advertise(&[advertisement(id, &channel)]);
        for viewer in &state.viewers {
            viewer.queue.push(Queued::Text(text.clone()));
        }
        state.channels.push(ChannelState { channel, latest: None });
        id
    }

    /// True if somebody has subscribed to the channel.
    pub(crate) fn wants(&self, id: ChannelId) -> bool {
        lock(&self.state).viewers.iter().any(|viewer| viewer.subscriptions.contains_key(&id))
    }

    /// Gives a message to the viewers subscribed to the channel.
    pub(crate) fn publish(&self, id: ChannelId, data: Bytes, time: u64, counters: &Counters) {
        let mut state = lock(&self.state);
        for viewer in &state.viewers {
            let Some(subscription) = viewer.subscriptions.get(&id) else { continue };
            if viewer.queue.push(Queued::Data { subscription: *subscription, time, data: data.clone() }) {
                count(&counters.messages_dropped);
            }
        }
        if let Some(channel) = state.channel_mut(id).filter(|channel| channel.channel.latched) {
            channel.latest = Some((time, data));
        }
    }

    /// Adds a viewer, with the channels announced to it. `None` if there are too many.
    pub(crate) fn join(&self, session: &str, max: usize) -> Option<Arc<MessageQueue>> {
        let mut state = lock(&self.state);
        if state.viewers.len() >= max {
            return None;
        }
        let queue = Arc::new(MessageQueue::default());
        queue.push(Queued::Text(server_info(session)));
        let ids = (1..).map(ChannelId);
        let channels: Vec<Value> =
            ids.zip(&state.channels).map(|(id, channel)| advertisement(id, &channel.channel)).collect();
        queue.push(Queued::Text(advertise(&channels)));
        state.viewers.push(Viewer { queue: Arc::clone(&queue), subscriptions: BTreeMap::new() });
        Some(queue)
    }

    /// Removes a viewer.
    pub(crate) fn leave(&self, queue: &Arc<MessageQueue>) {
        lock(&self.state).viewers.retain(|viewer| !Arc::ptr_eq(&viewer.queue, queue));
    }

    /// Subscribes a viewer to a channel, and queues the channel's latest message if it is latched. Returns false for an
    /// unknown channel, a number in use, or a second subscription.
    pub(crate) fn subscribe(&self, queue: &Arc<MessageQueue>, subscription: u32, id: ChannelId) -> bool {
        let mut state = lock(&self.state);
        let Some(latest) = state.channel(id).map(|channel| channel.latest.clone()) else { return false };
        let Some(viewer) = state.viewers.iter_mut().find(|viewer| Arc::ptr_eq(&viewer.queue, queue)) else {
            return false;
        };
        let in_use = viewer.subscriptions.values().any(|used| *used == subscription);
        if in_use || viewer.subscriptions.contains_key(&id) {
            return false;
        }
        viewer.subscriptions.insert(id, subscription);
        if let Some((time, data)) = latest {
            queue.push(Queued::Data { subscription, time, data });
        }
        true
    }

    /// Ends a subscription. Returns false for an unknown one.
    pub(crate) fn unsubscribe(&self, queue: &Arc<MessageQueue>, subscription: u32) -> bool {
        let mut state = lock(&self.state);
        let Some(viewer) = state.viewers.iter_mut().find(|viewer| Arc::ptr_eq(&viewer.queue, queue)) else {
            return false;
        };
        let before = viewer.subscriptions.len();
        viewer.subscriptions.retain(|_, used| *used != subscription);
        queue.forget(subscription);
        viewer.subscriptions.len() < before
    }
}

impl State {
    fn channel(&self, id: ChannelId) -> Option<&ChannelState> {
        self.channels.get((id.0 as usize).checked_sub(1)?)
    }

    fn channel_mut(&mut self, id: ChannelId) -> Option<&mut ChannelState> {
        self.channels.get_mut((id.0 as usize).checked_sub(1)?)
    }
}

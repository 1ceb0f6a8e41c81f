//! The topics that the session is fed with.

use crate::Ros2Error;
use crate::endpoints::{Endpoints, Quality, Reader};
use crate::names::{topic_of, type_of};
use rustdds::discovery::PublicationBuiltinTopicData;
use rustdds::policy::{Durability, Reliability};
use splatseg_live::LiveStream;
use std::collections::{BTreeMap, BTreeSet};
use std::task::Waker;

/// Messages kept of a topic with images, and of one with other messages.
const IMAGES: i32 = 5;
const OTHERS: i32 = 100;
/// Maximum number of messages taken from a topic before the others have their turn.
const TURN: usize = 32;
/// Maximum number of topics that are named where none is suitable.
const NAMED: usize = 10;

/// Readers of all topics that may be used; once the session has chosen some, of these.
pub(crate) struct Subscriptions {
    /// By name and type.
    readers: BTreeMap<(String, String), (Reader, Quality)>,
}

impl Subscriptions {
    pub(crate) fn new() -> Self {
        Self { readers: BTreeMap::new() }
    }

    /// Subscribes to what is published now, and returns what has changed, a sentence each.
    pub(crate) fn update(&mut self, endpoints: &Endpoints, stream: &LiveStream) -> Result<Vec<String>, Ros2Error> {
        let mut changes = Vec::new();
        let unused: Vec<_> =
            self.readers.keys().filter(|(name, type_name)| !stream.wants(name, type_name)).cloned().collect();
        for topic in unused {
            if let Some((reader, _)) = self.readers.remove(&topic) {
                endpoints.forget(&reader);
                changes.push(format!("{}: not needed", topic.0));
            }
        }
        for ((name, type_name), quality) in published(endpoints, stream) {
            let known = self.readers.get(&(name.clone(), type_name.clone()));
            if known.is_some_and(|(_, present)| *present == quality) {
                continue;
            }
            if let Some((reader, _)) = self.readers.remove(&(name.clone(), type_name.clone())) {
                endpoints.forget(&reader);
            }
            let reader = endpoints.reader(&name, &type_name, quality)?;
            let reliability = if quality.reliable { "reliable" } else { "best effort" };
            let latched = if quality.latched { ", latched" } else { "" };
            changes.push(format!("{name}: {type_name}, {reliability}{latched}"));
            self.readers.insert((name, type_name), (reader, quality));
        }
        Ok(changes)
    }

    /// True if nothing is subscribed to.
    pub(crate) fn is_empty(&self) -> bool {
        self.readers.is_empty()
    }

    /// Says which topics other nodes publish, e.g. `found /chatter (std_msgs/msg/String)`.
    pub(crate) fn other_topics(endpoints: &Endpoints) -> String {
        let writers = endpoints.participant().discovered_writers();
        let others = writers.iter().map(|writer| &writer.publication_topic_data);
        let topic = |data: &PublicationBuiltinTopicData| {
            Some(format!("{} ({})", topic_of(&data.topic_name)?, type_of(&data.type_name)?))
        };
        let topics: BTreeSet<String> = others.filter(|data| !endpoints.is_own(data.key)).filter_map(topic).collect();
        let (count, first) = (topics.len(), topics.into_iter().take(NAMED).collect::<Vec<_>>());
        match count {
            0 => "no other node publishes".to_owned(),
            count if count > NAMED => format!("found {} and {} more topics", first.join(", "), count - NAMED),
            _ => format!("found {}", first.join(", ")),
        }
    }

    /// Feeds the session with what has arrived. Returns true if there may be more.
    pub(crate) fn feed(&self, stream: &LiveStream, waker: &Waker) -> bool {
        let mut has_more = false;
        for ((name, type_name), (reader, _)) in &self.readers {
            reader.set_waker(Some(waker.clone()));
            reader.drain_read_notifications();
            let mut left = TURN;
            while left > 0 {
                match reader.try_take_one() {
                    Ok(Some(message)) => stream.feed(name, type_name, &message.into_value().0),
                    Ok(None) => break,
                    // A message that cannot be taken; the next one may be better.
                    Err(error) => tracing::debug!("{name}: {error}"),
                }
                left -= 1;
            }
            has_more |= left == 0;
        }
        has_more
    }
}

/// The topics published by other nodes that the session may use, with the best quality that all publishers offer.
fn published(endpoints: &Endpoints, stream: &LiveStream) -> BTreeMap<(String, String), Quality> {
    let mut topics: BTreeMap<(String, String), Quality> = BTreeMap::new();
    for writer in endpoints.participant().discovered_writers() {
        let data = &writer.publication_topic_data;
        let (Some(name), Some(type_name)) = (topic_of(&data.topic_name), type_of(&data.type_name)) else { continue };
        if endpoints.is_own(data.key) || !stream.wants(name, &type_name) {
            continue;
        }
        // Policies that a publisher does not name have the values of DDS 1.4, table 2.2.3: writers are reliable.
        let reliable = data.reliability != Some(Reliability::BestEffort);
        let latched = data.durability.is_some_and(|durability| durability >= Durability::TransientLocal);
        let is_image = type_name.ends_with("Image");
        let depth = if is_image { IMAGES } else { OTHERS };
        let offered = Quality { reliable, latched: latched && !is_image, depth };
        let quality = topics.entry((name.to_owned(), type_name)).or_insert(offered);
        quality.reliable &= offered.reliable;
        quality.latched &= offered.latched;
    }
    topics
}

//! A node's readers and writers, and what it tells others about them.

use crate::names::{dds_topic, dds_type};
use crate::raw_cdr::{RawAdapter, RawCdr};
use crate::{Domain, NodeName, Ros2Error};
use rustdds::no_key::{DataWriter, SimpleDataReader};
use rustdds::policy::{Durability, History};
use rustdds::{
    DomainParticipant, Duration, GUID, Publisher, QosPolicies, QosPolicyBuilder, RTPSEntity, Subscriber, Topic,
    TopicKind,
};
use serde::Serialize;
use splatseg_ros::to_cdr;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

pub(crate) type Reader = SimpleDataReader<RawCdr, RawAdapter>;
pub(crate) type Writer = DataWriter<RawCdr, RawAdapter>;

/// Longest time that a writer waits for slow readers before it drops what they have not acknowledged.
const MAX_BLOCKING: Duration = Duration::from_millis(100);

/// Quality of service, as far as the node chooses it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Quality {
    pub reliable: bool,
    /// The latest messages are also sent to whoever subscribes later.
    pub latched: bool,
    /// Messages kept.
    pub depth: i32,
}

impl Quality {
    /// As services, parameters and most topics.
    pub(crate) const RELIABLE: Self = Self { reliable: true, latched: false, depth: 10 };

    fn policies(self) -> QosPolicies {
        let durability = if self.latched { Durability::TransientLocal } else { Durability::Volatile };
        let builder = QosPolicyBuilder::new().durability(durability).history(History::KeepLast { depth: self.depth });
        if self.reliable { builder.reliable(MAX_BLOCKING).build() } else { builder.best_effort().build() }
    }
}

/// A node's place in the network. Clones share it.
#[derive(Clone)]
pub(crate) struct Endpoints {
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
    domain_id: u16,
    announced: Arc<Mutex<Announced>>,
}

/// Announcement to other nodes: the node that the readers and writers belong to.
struct Announced {
    writer: Writer,
    name: NodeName,
    readers: BTreeSet<[u8; 16]>,
    writers: BTreeSet<[u8; 16]>,
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo`, as since ROS 2 Iron.
#[derive(Serialize)]
struct ParticipantEntities {
    gid: [u8; 16],
    nodes: Vec<NodeEntities>,
}

/// `rmw_dds_common/msg/NodeEntitiesInfo`.
#[derive(Serialize)]
struct NodeEntities {
    namespace: String,
    name: String,
    readers: Vec<[u8; 16]>,
    writers: Vec<[u8; 16]>,
}

impl Endpoints {
    /// Joins a domain.
    ///
    /// # Errors
    /// [`Ros2Error::Network`] if there is no network.
    pub(crate) fn join(domain: Domain, name: NodeName) -> Result<Self, Ros2Error> {
        let participant = domain.join()?;
        let failed = |error: rustdds::dds::CreateError| network(domain.id, &error);
        let publisher = participant.create_publisher(&Quality::RELIABLE.policies()).map_err(failed)?;
        let subscriber = participant.create_subscriber(&Quality::RELIABLE.policies()).map_err(failed)?;
        let latched = Quality { latched: true, depth: 1, ..Quality::RELIABLE };
        let topic = participant.create_topic(
            "ros_discovery_info".to_owned(),
            "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_".to_owned(),
            &latched.policies(),
            TopicKind::NoKey,
        );
        let writer = publisher.create_datawriter_no_key(&topic.map_err(failed)?, None).map_err(failed)?;
        let announced = Announced { writer, name, readers: BTreeSet::new(), writers: BTreeSet::new() };
        let announced = Arc::new(Mutex::new(announced));
        Ok(Self { participant, publisher, subscriber, domain_id: domain.id, announced })
    }

    pub(crate) fn participant(&self) -> &DomainParticipant {
        &self.participant
    }

    /// True if another endpoint belongs to this node.
    pub(crate) fn is_own(&self, guid: GUID) -> bool {
        guid.prefix == self.participant.guid().prefix
    }

    /// A reader of a topic's messages.
    pub(crate) fn reader(&self, topic: &str, type_name: &str, quality: Quality) -> Result<Reader, Ros2Error> {
        self.dds_reader(dds_topic(topic), dds_type(type_name), quality)
    }

    /// A writer of a topic's messages.
    pub(crate) fn writer(&self, topic: &str, type_name: &str, quality: Quality) -> Result<Writer, Ros2Error> {
        self.dds_writer(dds_topic(topic), dds_type(type_name), quality)
    }

    pub(crate) fn dds_reader(&self, topic: String, type_name: String, quality: Quality) -> Result<Reader, Ros2Error> {
        let topic = self.topic(topic, type_name, quality)?;
        let reader: Reader = self
            .subscriber
            .create_simple_datareader_no_key(&topic, Some(quality.policies()))
            .map_err(|error| network(self.domain_id, &error))?;
        self.announce(|announced| announced.readers.insert(reader.guid().to_bytes()));
        Ok(reader)
    }

    pub(crate) fn dds_writer(&self, topic: String, type_name: String, quality: Quality) -> Result<Writer, Ros2Error> {
        let topic = self.topic(topic, type_name, quality)?;
        let writer: Writer = self
            .publisher
            .create_datawriter_no_key(&topic, Some(quality.policies()))
            .map_err(|error| network(self.domain_id, &error))?;
        self.announce(|announced| announced.writers.insert(writer.guid().to_bytes()));
        Ok(writer)
    }

    fn topic(&self, topic: String, type_name: String, quality: Quality) -> Result<Topic, Ros2Error> {
        self.participant
            .create_topic(topic, type_name, &quality.policies(), TopicKind::NoKey)
            .map_err(|error| network(self.domain_id, &error))
    }

    /// Forgets a reader that is about to be dropped.
    pub(crate) fn forget(&self, reader: &Reader) {
        self.announce(|announced| announced.readers.remove(&reader.guid().to_bytes()));
    }

    /// Tells other nodes what has changed.
    fn announce(&self, change: impl FnOnce(&mut Announced) -> bool) {
        let mut announced = self.announced.lock().unwrap_or_else(PoisonError::into_inner);
        if !change(&mut announced) {
            return;
        }
        let node = NodeEntities {
            namespace: announced.name.namespace().to_owned(),
            name: announced.name.name().to_owned(),
            readers: announced.readers.iter().copied().collect(),
            writers: announced.writers.iter().copied().collect(),
        };
        let message = ParticipantEntities { gid: self.participant.guid().to_bytes(), nodes: vec![node] };
        // Others still see the topics if they do not learn whose these are.
        if let Ok(message) = to_cdr(&message)
            && let Err(error) = announced.writer.write(RawCdr(message), None)
        {
            tracing::warn!("the node cannot be announced: {error}");
        }
    }
}

fn network(domain_id: u16, error: &dyn std::error::Error) -> Ros2Error {
    Ros2Error::Network { domain_id, reason: error.to_string() }
}

//! Channels of messages for Foxglove.

use splatseg_ros::Message;

/// A topic with messages in CDR.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// The topic, e.g. `/splatseg/points`.
    pub topic: String,
    /// Name of the messages' type, e.g. `sensor_msgs/msg/PointCloud2`.
    pub schema_name: String,
    /// Definition of the type, as in recordings (`ros2msg`).
    pub schema: String,
    /// If true, a viewer that subscribes later gets the latest message at once.
    pub latched: bool,
}

/// A channel of a [`ViewServer`](crate::ViewServer).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChannelId(pub(crate) u32);

impl Channel {
    /// A channel for messages of a known type.
    pub fn of<M: Message>(topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            schema_name: M::INTERFACE.name.to_owned(),
            schema: M::INTERFACE.schema(),
            latched: false,
        }
    }

    /// The same, with the latest message kept for those who subscribe later.
    #[must_use]
    pub fn latched(self) -> Self {
        Self { latched: true, ..self }
    }
}

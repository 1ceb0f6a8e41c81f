//! Names of topics, services and types in DDS (design.ros2.org, "Topic and Service name mapping to DDS").

use crate::Ros2Error;

/// Prefixes of the DDS topics of topics, requests and replies.
const TOPIC: &str = "rt";
const REQUEST: &str = "rq";
const REPLY: &str = "rr";

/// The DDS topic of a topic, e.g. `rt/camera/color/image_raw`.
pub(crate) fn dds_topic(name: &str) -> String {
    format!("{TOPIC}{name}")
}

/// The topic of a DDS topic; `None` if ROS 2 did not make it.
pub(crate) fn topic_of(dds: &str) -> Option<&str> {
    dds.strip_prefix(TOPIC).filter(|name| name.starts_with('/'))
}

/// The DDS topics of a service's requests and replies.
pub(crate) fn dds_service(name: &str) -> [String; 2] {
    [format!("{REQUEST}{name}Request"), format!("{REPLY}{name}Reply")]
}

/// The DDS type of a type, e.g. `sensor_msgs::msg::dds_::Image_` of `sensor_msgs/msg/Image`.
pub(crate) fn dds_type(name: &str) -> String {
    match name.rsplit_once('/') {
        Some((package, name)) => format!("{}::dds_::{name}_", package.replace('/', "::")),
        None => name.to_owned(),
    }
}

/// The type of a DDS type; `None` if ROS 2 did not make it.
pub(crate) fn type_of(dds: &str) -> Option<String> {
    let (package, name) = dds.split_once("::dds_::")?;
    Some(format!("{}/{}", package.replace("::", "/"), name.strip_suffix('_')?))
}

/// A node's name and namespace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeName {
    namespace: String,
    name: String,
}

impl Default for NodeName {
    fn default() -> Self {
        Self { namespace: "/".to_owned(), name: "splatseg".to_owned() }
    }
}

impl NodeName {
    /// A name, e.g. `splatseg`, in a namespace, e.g. `/robot1`.
    ///
    /// # Errors
    /// [`Ros2Error::Name`] unless both consist of letters, digits and underscores and no part starts with a digit.
    pub fn new(namespace: &str, name: &str) -> Result<Self, Ros2Error> {
        let is_part = |part: &str| {
            part.chars().all(|character| character.is_ascii_alphanumeric() || character == '_')
                && part.starts_with(|first: char| !first.is_ascii_digit())
        };
        let parts = namespace.strip_prefix('/').filter(|parts| parts.is_empty() || parts.split('/').all(is_part));
        if parts.is_none() || !is_part(name) || namespace.len() + name.len() > 200 {
            return Err(Ros2Error::Name { found: format!("{namespace} {name}") });
        }
        Ok(Self { namespace: namespace.to_owned(), name: name.to_owned() })
    }

    /// The namespace, e.g. `/`.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The name without the namespace.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The full name, e.g. `/robot1/splatseg`.
    pub fn full(&self) -> String {
        format!("{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_go_to_dds_and_back() {
        assert_eq!(dds_topic("/camera/image"), "rt/camera/image");
        assert_eq!(topic_of("rt/camera/image"), Some("/camera/image"));
        assert_eq!(topic_of("rtx"), None);
        assert_eq!(topic_of("rq/a/bRequest"), None);
        assert_eq!(dds_type("sensor_msgs/msg/Image"), "sensor_msgs::msg::dds_::Image_");
        assert_eq!(type_of("sensor_msgs::msg::dds_::Image_").as_deref(), Some("sensor_msgs/msg/Image"));
        assert_eq!(type_of("HelloWorld"), None);
        assert_eq!(dds_service("/splatseg/save"), ["rq/splatseg/saveRequest", "rr/splatseg/saveReply"]);
    }

    #[test]
    fn wrong_names_are_refused() {
        assert_eq!(NodeName::new("/robot1/a", "_x2").unwrap().full(), "/robot1/a/_x2");
        assert_eq!(NodeName::default().full(), "/splatseg");
        for (namespace, name) in
            [("", "a"), ("/", ""), ("/", "1a"), ("/", "a/b"), ("/a//b", "c"), ("/a/", "b"), ("a", "b")]
        {
            assert!(NodeName::new(namespace, name).is_err(), "{namespace} {name}");
        }
    }
}

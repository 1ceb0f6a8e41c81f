//! Which computers the node exchanges messages with.

use crate::Ros2Error;
use rustdds::{DomainParticipant, DomainParticipantBuilder};
use std::fmt;
use std::net::Ipv4Addr;

/// The highest domain that all systems have ports for (ROS 2 documentation, "The ROS_DOMAIN_ID").
const MAX_DOMAIN: u16 = 101;

/// How far discovery reaches, as `ROS_AUTOMATIC_DISCOVERY_RANGE`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DiscoveryRange {
    /// This computer.
    #[default]
    Localhost,
    /// The local network, by multicast.
    Subnet,
}

impl fmt::Display for DiscoveryRange {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Localhost => "this computer",
            Self::Subnet => "the local network",
        })
    }
}

/// The domain and its reach.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Domain {
    /// Nodes of other domains are invisible.
    pub id: u16,
    /// How far discovery reaches.
    pub range: DiscoveryRange,
}

impl Domain {
    /// The domain that the environment names: `ROS_DOMAIN_ID`, 0 to 101, and `ROS_AUTOMATIC_DISCOVERY_RANGE`, by default
    /// `LOCALHOST`. The node announces itself to other computers only if that is `SUBNET` (or `SYSTEM_DEFAULT`).
    ///
    /// # Errors
    /// [`Ros2Error::Environment`] if one has another value.
    pub fn from_environment(variable: impl Fn(&str) -> Option<String>) -> Result<Self, Ros2Error> {
        let wrong = |variable, found, expected| Ros2Error::Environment { variable, found, expected };
        let given = |name| variable(name).filter(|value| !value.is_empty());
        let id = match given("ROS_DOMAIN_ID") {
            Some(value) => match value.parse() {
                Ok(id) if id <= MAX_DOMAIN => id,
                _ => return Err(wrong("ROS_DOMAIN_ID", value, "0 to 101")),
            },
            None => 0,
        };
        let range = match given("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
            None | Some("LOCALHOST") => DiscoveryRange::Localhost,
            Some("SUBNET" | "SYSTEM_DEFAULT") => DiscoveryRange::Subnet,
            Some(other) => {
                let expected = "LOCALHOST or SUBNET";
                return Err(wrong("ROS_AUTOMATIC_DISCOVERY_RANGE", other.to_owned(), expected));
            }
        };
        Ok(Self { id, range })
    }

    /// Joins the domain.
    pub(crate) fn join(self) -> Result<DomainParticipant, Ros2Error> {
        let builder = DomainParticipantBuilder::new(self.id);
        let builder = match self.range {
            DiscoveryRange::Localhost => builder.with_only_networks([Ipv4Addr::LOCALHOST]),
            DiscoveryRange::Subnet => builder,
        };
        builder.build().map_err(|error| Ros2Error::Network { domain_id: self.id, reason: error.to_string() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn domain(id: &str, range: &str) -> Result<Domain, Ros2Error> {
        Domain::from_environment(|name| Some(if name == "ROS_DOMAIN_ID" { id } else { range }.to_owned()))
    }

    #[test]
    fn the_environment_names_the_domain() {
        assert_eq!(domain("", "").unwrap(), Domain::default());
        assert_eq!(domain("42", "SUBNET").unwrap(), Domain { id: 42, range: DiscoveryRange::Subnet });
        let error = domain("102", "").unwrap_err().to_string();
        assert_eq!(error, "ROS_DOMAIN_ID: found \"102\", expected 0 to 101");
        assert!(domain("-1", "").is_err());
        assert!(domain("0", "EVERYWHERE").is_err());
    }
}

//! Options of a server.

use crate::Token;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

/// Port that Foxglove suggests for a connection.
const PORT: u16 = 8765;

/// Who may connect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reach {
    /// This computer only.
    #[default]
    Loopback,
    /// Other computers, too. The connection is not encrypted: whoever reads the network can read the token.
    Network,
}

/// Options of a [`ViewServer`](crate::ViewServer).
#[derive(Clone, Debug)]
pub struct ViewOptions {
    /// Address and port; port 0 picks a free one. Default: 127.0.0.1:8765.
    pub address: SocketAddr,
    /// Who may connect. Default: this computer.
    pub reach: Reach,
    /// The token of the link. Default: a random one.
    pub token: Option<Token>,
    /// Name of the scene, shown on the page. Default: empty.
    pub scene: String,
    /// Names under which a browser may address the server, besides `localhost` and numeric addresses. Requests for
    /// others are refused, since a hostile site's name may resolve to this computer. Default: none.
    pub host_names: Vec<String>,
    /// Limits.
    pub limits: ViewLimits,
}

/// Limits of a [`ViewServer`](crate::ViewServer).
#[derive(Clone, Copy, Debug)]
pub struct ViewLimits {
    /// Number of viewers at a time. Default: 32. There may be 32 more connections that have shown the token, and 64 that
    /// have not: a new one of these takes the place of the oldest.
    pub viewers: usize,
    /// Time for a request to arrive, and for its response to leave. Default: 5 s.
    pub request_time: Duration,
    /// A viewer that takes nothing, does not confirm what it was sent, or does not answer pings for this long is
    /// disconnected. Default: 10 s.
    pub viewer_time: Duration,
    /// Interval between maps; longer if making one takes more than 2 % of it. Default: 2 s.
    pub map_interval: Duration,
}

impl Default for ViewOptions {
    fn default() -> Self {
        Self {
            address: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), PORT),
            reach: Reach::Loopback,
            token: None,
            scene: String::new(),
            host_names: Vec::new(),
            limits: ViewLimits::default(),
        }
    }
}

impl Default for ViewLimits {
    fn default() -> Self {
        Self {
            viewers: 32,
            request_time: Duration::from_secs(5),
            viewer_time: Duration::from_secs(10),
            map_interval: Duration::from_secs(2),
        }
    }
}

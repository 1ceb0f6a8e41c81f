//! A run in the browser and in Foxglove while it goes on.
//!
//! [`ViewServer`] serves one TCP port. A browser gets the page of a run (map, video with ids, list of objects), updated as
//! frames arrive. Foxglove gets the messages of [`ViewServer::publish_message`]. A random token is part of the link, and
//! nothing is served without it. Viewers cannot change anything but labels of objects, if the program lets them
//! ([`ViewServer::answer_with`]).
//!
//! `publish_*` never waits for a viewer. The newest frame waits in a slot until the encoding thread takes it, and each
//! viewer has slots of its own.
//!
//! | file | |
//! | --- | --- |
//! | `hub.rs`, `encoder.rs` | the newest frame, and the one thread that encodes it if anybody watches |
//! | `slots.rs` | the messages that wait for a viewer: the newest frame replaces an older one that was not sent |
//! | `connection.rs`, `page_viewer.rs`, `foxglove_viewer.rs` | a thread for each viewer |
//! | `request.rs` | who is served |
//! | `asking.rs` | what a viewer of the page may ask: objects by words, labels |
//!
//! A viewer that takes or answers nothing for ten seconds is disconnected. A page confirms each message once it is
//! shown, so that frames do not queue up in the browser.

mod asking;
mod camera_path;
mod channel;
mod connection;
mod counts;
mod encoder;
mod error;
mod foxglove;
mod foxglove_viewer;
mod frame;
mod hub;
mod options;
mod page_messages;
mod page_viewer;
mod request;
mod response;
mod seen_spans;
mod server;
mod slots;
mod timed_stream;
mod token;

pub use asking::{AnswerViewer, ViewAnswer, ViewRequest};
pub use channel::{Channel, ChannelId};
pub use counts::ViewCounts;
pub use error::ViewError;
pub use frame::{ViewFrame, ViewObject, ViewStatus};
pub use options::{Reach, ViewLimits, ViewOptions};
pub use seen_spans::SeenSpans;
pub use server::ViewServer;
pub use token::{Token, TokenError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

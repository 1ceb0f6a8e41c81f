//! Objects from a stream of ROS 2 messages while they arrive.
//!
//! [`LiveStream`] is fed with messages from any thread and gives the newest complete frame. [`LiveSession`] processes
//! these frames, publishes results through an [`Outlet`] and saves the map. There is no transport in this crate.
//!
//! Between two frames a session publishes all objects, points and its state when they are due, answers requests
//! (`requests.rs`) and saves the map (`saved_map.rs`). Messages that no outlet wants are not made. A transport has to
//! feed the stream and implement [`Outlet`]. With [`LiveStream::without_drops`] a session waits by the times of the
//! messages instead of the clock, so that the same messages give the same map.

mod error;
mod latest_times;
mod outlet;
mod places;
mod recorder;
mod requests;
mod results;
mod saved_map;
mod session;
mod status;
mod stream;
mod view_outlet;
mod words;

pub use error::LiveError;
pub use latest_times::LatestTimes;
pub use outlet::{LiveFrame, Outlet, Output, Silent};
pub use requests::{LiveRequest, Requests};
pub use saved_map::SavedMap;
pub use session::{BuildPipeline, LiveOptions, LiveSession, build_with};
pub use status::{LiveStatus, SaveStatus};
pub use stream::LiveStream;
pub use view_outlet::ViewOutlet;
pub use words::LiveWords;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

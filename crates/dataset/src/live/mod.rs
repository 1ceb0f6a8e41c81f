//! Frames from ROS 2 messages while they arrive: a robot's topics, or a recording played message by message.
//!
//! [`FrameMatcher`] has no thread, no clock and no transport: messages and the times of their receipt are passed in.
//! Topics, poses and images are handled as in a recording, by the same code ([`ros_topics`](crate::ros_topics)). A
//! recording is read with all of it at hand, a stream is not, so three things differ:
//!
//! - Topics are chosen once, when all that is needed has been seen and [`MatchLimits::settle`] has passed. What appears
//!   later changes nothing. A camera that has not moved by then is taken to have no poses in `/tf`, unless the settings
//!   name them.
//! - A stamp far from those before it is held until the next ones confirm or refute it (`ros_topics/stream_clock.rs`). A
//!   recording weighs all stamps against each other (`ros_topics/clock.rs`). So a clock that is set back by less than a
//!   second is not noticed: images are late until it has caught up.
//! - Waiting is bounded: for an image that would make a closer pair ([`MatchLimits::pair_wait`]), and for poses
//!   ([`MatchLimits::pose_wait`]). A frame waits until each part of its pose is known at its time or later; what lies
//!   between and comes still later is not waited for. After the longest wait, the pose is the nearest one known within the
//!   tolerance, or the frame is given without one.
//!
//! Corrected paths (`nav_msgs/msg/Path`) are not used yet.

mod coordinate_frames;
mod counts;
mod frame_completion;
mod limits;
mod matcher;
mod stream_topics;
mod undecoded_frame;
mod waiting;

pub use coordinate_frames::CoordinateFrames;
pub use counts::{DropCounts, MatchCounts};
pub use limits::MatchLimits;
pub use matcher::FrameMatcher;
pub use undecoded_frame::UndecodedFrame;

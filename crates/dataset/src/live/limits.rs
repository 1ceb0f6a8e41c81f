//! How much and how long a stream's messages may wait.

use std::time::Duration;

/// Bounds of a [`FrameMatcher`](crate::FrameMatcher). All times are by the clock of the receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MatchLimits {
    /// Time from the first message until topics are chosen. Nothing is waited for if the settings name colour and depth,
    /// and the world frame in `/tf` or that there are no poses.
    pub settle: Duration,
    /// Maximum number of images of a topic that wait for their partner, and of pairs that wait for their pose. At least
    /// 1. More than the images of a topic during `pose_wait`.
    pub waiting: usize,
    /// Maximum number of complete frames that wait for the consumer. At least 1, which gives always the newest. More
    /// for a consumer that must not miss frames.
    pub complete: usize,
    /// Maximum size of all waiting messages with images, bytes.
    pub bytes: usize,
    /// Maximum time that a pair of images with different stamps waits for an image that fits better.
    pub pair_wait: Duration,
    /// Maximum time that a pair waits for its pose, from the receipt of its second image.
    pub pose_wait: Duration,
}

impl Default for MatchLimits {
    fn default() -> Self {
        Self {
            settle: Duration::from_secs(2),
            waiting: 32,
            complete: 1,
            bytes: 256 << 20,
            pair_wait: Duration::from_millis(50),
            pose_wait: Duration::from_millis(500),
        }
    }
}

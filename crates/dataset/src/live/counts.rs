//! Counts of what has become of a stream's messages.

use std::fmt;

/// Counts of a stream's messages. Each message is counted once:
/// `messages = images + taken_in + ignored + damaged`, and
/// `images = 2 × (frames + unreadable) + dropped.total() + waiting`; without depth, a frame has one image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MatchCounts {
    /// Messages received.
    pub messages: u64,
    /// Of these: images of the topics used, or that may be.
    pub images: u64,
    /// Of these: camera infos, transforms and poses that were read.
    pub taken_in: u64,
    /// Of these: messages of topics that are not used.
    pub ignored: u64,
    /// Of these: messages that cannot be read or are too large.
    pub damaged: u64,
    /// Frames given to the consumer, without those counted as unreadable.
    pub frames: u64,
    /// Of these: frames without a pose, though there is a source of poses: it was late, or does not cover their time.
    pub without_pose: u64,
    /// Frames given to the consumer that turned out to be unreadable: their images are damaged, or of another size.
    pub unreadable: u64,
    /// Images that wait for their partner or their pose, or in complete frames for the consumer.
    pub waiting: u64,
    /// Images that were not used.
    pub dropped: DropCounts,
    /// How often the clock of the colour images was set back, as by a simulation that starts again. Whatever waited then
    /// was dropped.
    pub clock_set_back: u64,
}

/// Numbers of images that were not used, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct DropCounts {
    /// Before topics were chosen, see [`MatchLimits::settle`](crate::MatchLimits::settle).
    pub early: u64,
    /// Without an image of the other topic at their time.
    pub unpaired: u64,
    /// In complete frames that a newer one replaced before the consumer asked: it is slower than the camera.
    pub busy: u64,
    /// Received after a later frame was already complete.
    pub late: u64,
    /// With the stamp of another image.
    pub repeated: u64,
    /// With a stamp that does not fit its neighbours'.
    pub misfits: u64,
    /// Waiting when the clock was set back.
    pub set_back: u64,
    /// Because the waiting images took too much memory.
    pub memory: u64,
}

impl DropCounts {
    /// Returns the number of images that were not used.
    pub fn total(&self) -> u64 {
        let Self { early, unpaired, busy, late, repeated, misfits, set_back, memory } = self;
        early + unpaired + busy + late + repeated + misfits + set_back + memory
    }
}

impl fmt::Display for MatchCounts {
    /// Writes one line. Parts that are 0 are left out.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} frames of {} messages", self.frames, self.messages)?;
        let dropped = &self.dropped;
        let parts = [
            (self.without_pose, "frames without a pose"),
            (self.unreadable, "frames unreadable"),
            (dropped.early, "images before topics were chosen"),
            (dropped.unpaired, "images unpaired"),
            (dropped.busy, "images dropped, busy"),
            (dropped.late, "images late"),
            (dropped.repeated, "images repeated"),
            (dropped.misfits, "images with a wrong stamp"),
            (dropped.set_back, "images dropped, clock set back"),
            (dropped.memory, "images dropped, memory"),
            (self.waiting, "images waiting"),
            (self.damaged, "messages damaged"),
            (self.ignored, "messages of other topics"),
            (self.clock_set_back, "times the clock was set back"),
        ];
        parts.iter().filter(|(count, _)| *count > 0).try_for_each(|(count, what)| write!(formatter, "; {count} {what}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_has_what_happened() {
        let dropped = DropCounts { busy: 4, ..Default::default() };
        let counts = MatchCounts { frames: 3, messages: 30, without_pose: 1, dropped, ..Default::default() };
        assert_eq!(counts.to_string(), "3 frames of 30 messages; 1 frames without a pose; 4 images dropped, busy");
        assert_eq!(MatchCounts::default().to_string(), "0 frames of 0 messages");
    }
}

//! Where a frame's time went.

use serde::Serialize;
use splatseg_memory::FrameUpdate;
use std::time::Duration;

/// Wall-clock time of each stage of one frame, or summed over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StageTimes {
    /// Segmenting the image.
    pub segment: Duration,
    /// A tracker following its tracks and taking up new ones.
    pub track: Duration,
    /// Projecting Gaussians and binning them into tiles.
    pub project_and_bin: Duration,
    /// Making the blend weights and reading expected segments off them.
    pub rasterise: Duration,
    /// Putting together what was read.
    pub decode: Duration,
    /// Matching expected and predicted segments, or finding a tracker's errors.
    pub match_segments: Duration,
    /// Prompting a tracker to put its errors right.
    pub reprompt: Duration,
    /// Fusing them.
    pub fuse: Duration,
    /// Adding and removing Gaussians.
    pub grow: Duration,
    /// Taking in what was seen: votes, or gradient steps on the features.
    pub learn: Duration,
}

impl StageTimes {
    /// Notes the times of taking a frame into a memory.
    pub(crate) fn take_update(&mut self, update: &FrameUpdate) {
        self.project_and_bin = update.view_time.project;
        self.rasterise = update.view_time.rasterise;
        self.grow = update.grow_time;
        self.learn = update.learn_time;
    }

    /// Every stage by name, in the order of the method.
    pub fn stages(&self) -> [(&'static str, Duration); 10] {
        [
            ("segment", self.segment),
            ("track", self.track),
            ("project_and_bin", self.project_and_bin),
            ("rasterise", self.rasterise),
            ("decode", self.decode),
            ("match", self.match_segments),
            ("reprompt", self.reprompt),
            ("fuse", self.fuse),
            ("grow", self.grow),
            ("learn", self.learn),
        ]
    }

    /// Time of all stages but the segmenter; a tracker's are part of it.
    pub fn without_segmenter(&self) -> Duration {
        self.stages()[1..].iter().map(|(_, time)| *time).sum()
    }
}

impl std::ops::AddAssign for StageTimes {
    fn add_assign(&mut self, other: Self) {
        self.segment += other.segment;
        self.track += other.track;
        self.project_and_bin += other.project_and_bin;
        self.rasterise += other.rasterise;
        self.decode += other.decode;
        self.match_segments += other.match_segments;
        self.reprompt += other.reprompt;
        self.fuse += other.fuse;
        self.grow += other.grow;
        self.learn += other.learn;
    }
}

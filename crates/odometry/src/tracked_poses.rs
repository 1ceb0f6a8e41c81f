//! Poses that are tracked: always, where they are missing, or to refine given ones.

use crate::saved::SavedPoses;
use crate::{CameraPose, Odometry, PoseSource, PoseSourceError, PoseState};
use splatseg_geometry::{CameraFrame, Pose, SegmentMap};
use splatseg_settings::choices;

choices! {
    /// Source of the camera's poses.
    pub enum PoseMode, default Auto {
        /// The poses that come with the frames; frames without one are tracked from the last that has one. A scene
        /// without any poses is tracked.
        Auto = "auto",
        /// Only the poses that come with the frames. Frames without one are skipped.
        Given = "given",
        /// The camera is tracked. Poses that come with the frames are ignored, except that of the first frame.
        Track = "track",
        /// Given poses that drift, such as a robot's odometry: their motion from frame to frame is the start of
        /// tracking, and replaces it where tracking fails.
        Refine = "refine",
    }
}

/// Poses from [`Odometry`], or from the frames where [`PoseMode`] says so.
#[derive(Clone, Debug)]
pub struct TrackedPoses {
    mode: PoseMode,
    pub(crate) odometry: Odometry,
    /// The latest frame with a given pose, from which the next one may have to be tracked. Only with [`PoseMode::Auto`].
    anchor: Option<(CameraFrame<'static>, Pose)>,
    /// The latest given pose. Only with [`PoseMode::Refine`].
    pub(crate) last_given: Option<Pose>,
}

impl TrackedPoses {
    /// Creates a source that has seen no frame.
    pub fn new(mode: PoseMode) -> Self {
        Self { mode, odometry: Odometry::new(), anchor: None, last_given: None }
    }

    fn refined(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> CameraPose {
        let motion = given.zip(self.last_given.as_ref()).map(|(now, before)| before.inverse() * *now);
        let before = self.odometry.last_pose();
        let initial = given.copied().unwrap_or(Pose::IDENTITY);
        let found = self.odometry.track(frame, &initial, motion.as_ref());
        self.last_given = given.copied().or(self.last_given);
        match motion.filter(|_| found.state == PoseState::Lost) {
            Some(motion) => {
                let moved = CameraPose::given(before.unwrap_or(initial) * motion);
                self.odometry.set(frame, &moved.world_from_camera);
                moved
            }
            None => found,
        }
    }

    /// Tracks a frame without a pose between frames that have one.
    fn bridged(&mut self, frame: &CameraFrame<'_>) -> CameraPose {
        self.start_at_anchor();
        self.odometry.track(frame, &Pose::IDENTITY, None)
    }

    fn start_at_anchor(&mut self) {
        if let Some((frame, pose)) = self.anchor.take() {
            self.odometry.set(&frame, &pose);
        }
    }
}

impl PoseSource for TrackedPoses {
    fn pose(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> Result<CameraPose, PoseSourceError> {
        Ok(match (self.mode, given) {
            (PoseMode::Given | PoseMode::Auto, Some(pose)) => {
                if self.mode == PoseMode::Auto {
                    self.anchor = Some((frame.clone().into_owned(), *pose));
                }
                CameraPose::given(*pose)
            }
            (PoseMode::Given, None) => return Err(PoseSourceError::Missing { frame: frame.name().to_owned() }),
            (PoseMode::Auto, None) => self.bridged(frame),
            (PoseMode::Track, given) => self.odometry.track(frame, given.unwrap_or(&Pose::IDENTITY), None),
            (PoseMode::Refine, given) => self.refined(frame, given),
        })
    }

    fn set_segments(&mut self, segments: &SegmentMap) {
        self.odometry.set_segments(segments);
    }

    fn save(&self) -> Option<Vec<u8>> {
        let mut state = self.clone();
        state.start_at_anchor();
        serde_json::to_vec(&SavedPoses::of(&state)).ok()
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), PoseSourceError> {
        let saved: SavedPoses =
            serde_json::from_slice(state).map_err(|error| PoseSourceError::State(error.to_string()))?;
        (self.odometry, self.last_given) = saved.restored().map_err(PoseSourceError::State)?;
        self.anchor = None;
        Ok(())
    }
}

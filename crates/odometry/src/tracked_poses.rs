//! Poses that are tracked: always, where they are missing, or to refine given ones. Keyframes of all frames are kept.

use crate::input_checks::{InputChecks, InputDoubt};
use crate::keyframe_map::KeyframeMap;
use crate::lost::{Lost, Search};
use crate::odometry::TrackedFrame;
use crate::plausibility::ImageUse;
use crate::saved::SavedPoses;
use crate::saved_keyframes;
use crate::{CameraPose, Odometry, PoseEvent, PoseSource, PoseSourceError, PoseState};
use splatseg_geometry::{
    CameraFrame, FrameAnchor, KeyframeId, MapCorrection, Pose, PoseFormat, RemappedId, SegmentMap,
};
use splatseg_settings::choices;
use std::collections::BTreeMap;

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
    pub(crate) map: KeyframeMap,
    pub(crate) lost: Lost,
    /// True once a frame came with a pose that was used as it is.
    pub(crate) has_given: bool,
    /// Index of the next frame in its source.
    index: usize,
    correction: Option<MapCorrection>,
    /// Events of the latest frame.
    events: Vec<PoseEvent>,
    checks: InputChecks,
    images: ImageUse,
}

impl TrackedPoses {
    /// Creates a source that has seen no frame.
    pub fn new(mode: PoseMode) -> Self {
        Self {
            mode,
            odometry: Odometry::new(),
            anchor: None,
            last_given: None,
            map: KeyframeMap::default(),
            lost: Lost::default(),
            has_given: false,
            index: 0,
            correction: None,
            events: Vec::new(),
            checks: InputChecks::new(PoseFormat::default()),
            images: ImageUse::default(),
        }
    }

    /// Tells how the given poses were read, so that doubts about them can name what to change. By default they were not
    /// converted.
    #[must_use]
    pub fn with_pose_format(mut self, format: PoseFormat) -> Self {
        self.checks = InputChecks::new(format);
        self
    }

    /// Uses a pose that came with the frame.
    fn given(&mut self, frame: &CameraFrame<'_>, pose: &Pose) -> CameraPose {
        self.has_given = true;
        if self.map.wants_given(pose) {
            self.map.add_given(&TrackedFrame::new(frame), pose, self.index);
        }
        if self.mode == PoseMode::Auto {
            self.anchor = Some((frame.clone().into_owned(), *pose));
        }
        CameraPose::given(*pose)
    }

    fn refined(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> CameraPose {
        let motion = given.zip(self.last_given.as_ref()).map(|(now, before)| before.inverse() * *now);
        let before = self.odometry.last_pose();
        let initial = given.copied().unwrap_or(Pose::IDENTITY);
        let tracked = TrackedFrame::new(frame);
        let found = self.odometry.track_frame(&tracked, &initial, motion.as_ref());
        self.last_given = given.copied().or(self.last_given);
        let found = match motion.filter(|_| found.state == PoseState::Lost) {
            Some(motion) => {
                let moved = CameraPose::given(before.unwrap_or(initial) * motion);
                self.odometry.set_frame(&tracked, &moved.world_from_camera);
                moved
            }
            None => found,
        };
        self.after_tracking(&tracked, found)
    }

    /// Tracks a frame without a pose between frames that have one.
    fn bridged(&mut self, frame: &CameraFrame<'_>) -> CameraPose {
        self.start_at_anchor();
        self.odometry.next_keyframe = self.odometry.next_keyframe.max(self.map.store.next);
        let tracked = TrackedFrame::new(frame);
        let found = self.odometry.track_frame(&tracked, &Pose::IDENTITY, None);
        self.add_made_keyframe(&tracked);
        found
    }

    fn start_at_anchor(&mut self) {
        if let Some((frame, pose)) = self.anchor.take() {
            self.odometry.set(&frame, &pose);
            self.odometry.made = None;
        }
    }

    fn tracked(&mut self, frame: &CameraFrame<'_>, initial: &Pose) -> CameraPose {
        let tracked = TrackedFrame::new(frame);
        if self.is_unplaced() {
            return self.search(&tracked, None);
        }
        let last = self.odometry.last_pose();
        let found = self.odometry.track_frame(&tracked, initial, None);
        let found = match (found.state, last) {
            (PoseState::Lost, Some(last)) => self.search(&tracked, Some(&last)),
            _ => found,
        };
        self.after_tracking(&tracked, found)
    }

    /// True if a map was loaded in which the camera has not been found yet.
    fn is_unplaced(&self) -> bool {
        self.odometry.last.is_none() && self.map.store.len() > 0
    }

    /// Searches for a camera that is lost.
    fn search(&mut self, frame: &TrackedFrame<'_>, last: Option<&Pose>) -> CameraPose {
        let lost = |pose: Option<&Pose>| CameraPose {
            world_from_camera: pose.copied().unwrap_or(Pose::IDENTITY),
            state: PoseState::Lost,
            quality: None,
        };
        let (lost_frames, was_loaded) = (self.lost.frames as usize, last.is_none());
        match self.lost.search(&mut self.map, frame, last) {
            Search::Lost => lost(last),
            Search::Found(odometry, pose) => {
                self.events.push(match was_loaded {
                    true => PoseEvent::FoundInLoadedMap { lost_frames },
                    false => PoseEvent::FoundAgain { lost_frames },
                });
                let movers = std::mem::take(&mut self.odometry.movers);
                self.odometry = Odometry { movers, focal: self.odometry.focal, ..*odometry };
                self.map.part =
                    self.map.latest.and_then(|id| self.map.store.get(id)).map_or(0, |keyframe| keyframe.part);
                pose
            }
            Search::NewPart => {
                self.events.push(PoseEvent::NewPart { lost_frames, was_loaded });
                let start = self.map.start_of_part();
                self.map.begin_part();
                self.odometry.next_keyframe = self.map.store.next;
                self.odometry.set_frame(frame, &start);
                let pose = CameraPose { state: PoseState::Tracked, ..lost(Some(&start)) };
                self.add_made_keyframe(frame);
                pose
            }
        }
    }

    /// Keeps a new keyframe, and searches for loops.
    fn after_tracking(&mut self, frame: &TrackedFrame<'_>, found: CameraPose) -> CameraPose {
        if found.state == PoseState::Lost {
            return found;
        }
        self.lost = Lost { since: frame.timestamp, ..Lost::default() };
        if self.odometry.made.is_some() {
            self.add_made_keyframe(frame);
            if !self.map.is_behind() {
                return found;
            }
        }
        let parts = self.map.part_count();
        let Some(correction) = self.map.check_loops() else { return found };
        self.odometry.correct(&correction);
        let world_from_camera = self.odometry.last_pose().unwrap_or(found.world_from_camera);
        self.events.push(PoseEvent::LoopClosed {
            moved: world_from_camera.translation().distance(found.world_from_camera.translation()),
            keyframes: correction.new_from_old.len(),
            joined_parts: self.map.part_count() < parts,
        });
        self.correction = Some(correction);
        CameraPose { world_from_camera, ..found }
    }

    fn add_made_keyframe(&mut self, frame: &TrackedFrame<'_>) {
        if let Some(made) = self.odometry.made.take() {
            let keyframe = self.map.described(&made, frame);
            self.map.add_tracked(keyframe, made.link);
        }
    }

    /// True if the poses are tracked throughout.
    fn is_tracked(&self) -> bool {
        match self.mode {
            PoseMode::Track | PoseMode::Refine => true,
            PoseMode::Given => false,
            PoseMode::Auto => !self.has_given,
        }
    }
}

impl PoseSource for TrackedPoses {
    fn pose(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> Result<CameraPose, PoseSourceError> {
        self.checks.add(frame, given.filter(|_| self.mode != PoseMode::Track));
        let found = match (self.mode, given) {
            (PoseMode::Given | PoseMode::Auto, Some(pose)) => self.given(frame, pose),
            (PoseMode::Given, None) => return Err(PoseSourceError::Missing { frame: frame.name().to_owned() }),
            (PoseMode::Auto, None) if self.has_given => self.bridged(frame),
            (PoseMode::Auto, None) => self.tracked(frame, &Pose::IDENTITY),
            (PoseMode::Track, given) => self.tracked(frame, given.unwrap_or(&Pose::IDENTITY)),
            (PoseMode::Refine, given) => self.refined(frame, given),
        };
        self.checks.add_placed(frame, &found);
        self.images.add(&found);
        Ok(found)
    }

    fn set_segments(&mut self, segments: &SegmentMap) {
        self.odometry.set_segments(segments);
    }

    fn begin_frame(&mut self, index: usize, corrected: &[(usize, Pose)]) {
        self.index = index;
        if !corrected.is_empty() && !self.is_tracked() {
            self.correction = self.map.correct_given(corrected);
        }
    }

    fn anchor(&self) -> FrameAnchor {
        let is_tracked = self.is_tracked();
        self.map.anchor(self.odometry.active_keyframe().filter(|_| is_tracked), is_tracked)
    }

    fn take_correction(&mut self) -> Option<MapCorrection> {
        self.correction.take()
    }

    fn take_events(&mut self) -> Vec<PoseEvent> {
        std::mem::take(&mut self.events)
    }

    fn remap(&mut self, remapped: &[RemappedId]) {
        self.odometry.remap(remapped);
    }

    fn keyframe_poses(&self) -> BTreeMap<KeyframeId, Pose> {
        self.map.poses()
    }

    fn keyframe_parts(&self) -> BTreeMap<KeyframeId, u32> {
        self.map.parts()
    }

    fn keyframes(&self) -> Option<Vec<u8>> {
        saved_keyframes::bytes(&self.map)
    }

    fn load_keyframes(&mut self, keyframes: &[u8]) -> Result<(), PoseSourceError> {
        let mut map = saved_keyframes::parsed(keyframes).map_err(PoseSourceError::State)?;
        map.begin_session();
        self.odometry.next_keyframe = map.store.next;
        self.map = map;
        Ok(())
    }

    fn calibration_warnings(&self) -> Vec<String> {
        self.odometry.focal_doubt().into_iter().chain(self.images.doubt()).collect()
    }

    fn take_input_doubts(&mut self) -> Vec<InputDoubt> {
        self.checks.take()
    }

    fn take_last_input_doubts(&mut self) -> Vec<InputDoubt> {
        self.checks.take_last()
    }

    fn save(&self) -> Option<Vec<u8>> {
        let mut state = self.clone();
        state.start_at_anchor();
        SavedPoses::of(&state).to_bytes()
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), PoseSourceError> {
        let saved = SavedPoses::from_bytes(state).map_err(PoseSourceError::State)?;
        saved.restore(self).map_err(PoseSourceError::State)?;
        self.anchor = None;
        Ok(())
    }
}

//! Poses that are tracked: always, where they are missing, or to refine given ones. Keyframes of all frames are kept.

use crate::input_checks::InputChecks;
use crate::keyframe_map::KeyframeMap;
use crate::lost::{LostCamera, Search};
use crate::plausibility::ImageUse;
use crate::tracked_frame::TrackedFrame;
use crate::upright::Upright;
use crate::{CameraPose, Odometry, PoseEvent, PoseState};
use glam::DVec3;
use splatseg_geometry::{CameraFrame, FrameAnchor, MapCorrection, Pose, PoseFormat};
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
    pub(crate) mode: PoseMode,
    pub(crate) odometry: Odometry,
    /// The latest frame with a given pose, from which the next one may have to be tracked. Only with [`PoseMode::Auto`].
    pub(crate) bridge_from: Option<(CameraFrame<'static>, Pose)>,
    /// The latest given pose. Only with [`PoseMode::Refine`].
    pub(crate) last_given: Option<Pose>,
    pub(crate) map: KeyframeMap,
    pub(crate) lost: LostCamera,
    /// True once a frame came with a pose that was used as it is.
    pub(crate) has_given: bool,
    /// Index of the latest frame in its source.
    pub(crate) index: usize,
    /// A correction that is to be told with the latest frame.
    pub(crate) correction: Option<MapCorrection>,
    /// Events that are to be told with it.
    pub(crate) events: Vec<PoseEvent>,
    pub(crate) checks: InputChecks,
    pub(crate) images: ImageUse,
    pub(crate) upright: Upright,
}

impl TrackedPoses {
    /// Creates a source that has seen no frame.
    pub fn new(mode: PoseMode) -> Self {
        Self {
            mode,
            odometry: Odometry::new(),
            bridge_from: None,
            last_given: None,
            map: KeyframeMap::default(),
            lost: LostCamera::default(),
            has_given: false,
            index: 0,
            correction: None,
            events: Vec::new(),
            checks: InputChecks::new(PoseFormat::default()),
            images: ImageUse::default(),
            upright: Upright::default(),
        }
    }

    /// Tells how the given poses were read, so that doubts about them can name what to change. By default they were not
    /// converted.
    #[must_use]
    pub fn with_pose_format(mut self, format: PoseFormat) -> Self {
        self.checks = InputChecks::new(format);
        self
    }

    /// Tells which direction is up in the world of the given poses, a unit vector. Then images of a camera that is held
    /// sideways are known to be so from the first frame on.
    #[must_use]
    pub fn with_world_up(mut self, up: DVec3) -> Self {
        self.upright = Upright::measured(up);
        self
    }

    /// Moves the keyframes with corrected poses of earlier frames, which are not used where poses are tracked.
    pub(crate) fn correct_given(&mut self, corrected: &[(usize, Pose)]) {
        if !corrected.is_empty() && !self.is_tracked() {
            self.correction = self.map.correct_given(corrected);
        }
    }

    /// The keyframe to which the latest frame is attached.
    pub(crate) fn anchor(&self) -> FrameAnchor {
        let is_tracked = self.is_tracked();
        self.map.anchor(self.odometry.active_keyframe().filter(|_| is_tracked), is_tracked)
    }

    /// Uses a pose that came with the frame.
    pub(crate) fn given(&mut self, frame: &CameraFrame<'_>, pose: &Pose) -> CameraPose {
        self.has_given = true;
        if self.map.wants_given(pose) {
            self.map.add_given(&TrackedFrame::new(frame), pose, self.index);
        }
        if self.mode == PoseMode::Auto {
            self.bridge_from = Some((frame.clone().into_owned(), *pose));
        }
        CameraPose::given(*pose)
    }

    /// Tracks a frame from a given pose that may drift.
    pub(crate) fn refined(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> CameraPose {
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
    pub(crate) fn bridged(&mut self, frame: &CameraFrame<'_>) -> CameraPose {
        self.start_bridge();
        self.odometry.next_keyframe = self.odometry.next_keyframe.max(self.map.store.next);
        let tracked = TrackedFrame::new(frame);
        let found = self.odometry.track_frame(&tracked, &Pose::IDENTITY, None);
        self.link_to_given();
        self.add_made_keyframe(&tracked);
        found
    }

    /// Makes tracking go on from the latest frame with a given pose.
    pub(crate) fn start_bridge(&mut self) {
        if let Some((frame, pose)) = self.bridge_from.take() {
            // That frame is not a keyframe of the map, so it needs a number that no keyframe has.
            self.odometry.next_keyframe = self.odometry.next_keyframe.max(self.map.store.next);
            self.odometry.set(&frame, &pose);
            self.odometry.made = None;
        }
    }

    /// Links the keyframe just made to the latest one of the map if it was aligned with a frame that is none.
    fn link_to_given(&mut self) {
        let latest = self.map.latest.and_then(|latest| self.map.store.get(latest));
        let Some((latest, made)) = latest.zip(self.odometry.made.as_mut()) else { return };
        if let Some(link) = made.link.as_mut().filter(|link| self.map.store.get(link.from).is_none()) {
            link.from = latest.id;
            link.measured = latest.world_from_key.inverse() * made.world_from_key;
        }
    }

    /// Tracks a frame, or searches for a camera that is lost. `initial` is the pose of the first frame.
    pub(crate) fn tracked(&mut self, frame: &CameraFrame<'_>, initial: &Pose) -> CameraPose {
        let tracked = TrackedFrame::new(frame);
        if self.is_without_pose() {
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
    fn is_without_pose(&self) -> bool {
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
        self.lost = LostCamera { since: frame.timestamp, ..LostCamera::default() };
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

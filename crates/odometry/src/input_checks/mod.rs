//! Checks whether what came with the frames fits what the frames show: conventions of poses, units, and whether colour and
//! depth are of one camera and one time.
//!
//! The first frames are checked, and then a few now and then. All checks together take less than 1 % of a run.
//!
//! | file | |
//! | --- | --- |
//! | `seen_motion.rs` | the motion between two frames as the images show it |
//! | `format_fit.rs` | how well poses, read in different ways, explain it |
//! | `pose_check.rs` | doubts about conventions and units of given poses |
//! | `units.rs` | doubts about the unit of depth |
//! | `edges.rs` | edges of depth, and contrast of colour there |
//! | `registration.rs` | doubts about the registration of depth to colour |
//! | `delay.rs` | doubts about the times of colour and depth |

mod delay;
mod edges;
mod format_fit;
mod pose_check;
mod registration;
mod seen_motion;
mod units;

use crate::{CameraPose, DoubtKind, InputDoubt, PoseState};
use delay::DelayCheck;
use pose_check::PoseCheck;
use registration::{Explained, RegistrationCheck};
use splatseg_geometry::{CameraFrame, Pose, PoseFormat};
use units::UsualDepth;

/// The checks of one source of frames.
#[derive(Clone, Debug)]
pub(crate) struct InputChecks {
    poses: PoseCheck,
    depth: UsualDepth,
    registration: RegistrationCheck,
    delay: DelayCheck,
    /// Doubt about the registration of depth, held back until it is known whether a delay explains more.
    misplaced: Option<Explained>,
    /// True if colour and depth have been compared.
    is_compared: bool,
    /// True if given poses are doubted, so that nothing can be told by them.
    has_wrong_poses: bool,
    /// Doubts that have not been taken.
    found: Vec<InputDoubt>,
}

impl InputChecks {
    /// Creates checks of frames whose given poses were read in a certain way.
    pub(crate) fn new(format: PoseFormat) -> Self {
        Self {
            poses: PoseCheck::new(format),
            depth: UsualDepth::default(),
            registration: RegistrationCheck::default(),
            delay: DelayCheck::default(),
            misplaced: None,
            is_compared: false,
            has_wrong_poses: false,
            found: Vec::new(),
        }
    }

    /// Checks the next frame, with the pose that came with it unless poses are tracked anyway.
    pub(crate) fn add(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) {
        let doubt = given.and_then(|given| self.poses.add(frame, given));
        self.find_by_poses(doubt);
        let doubt = self.depth.add(frame);
        self.find(doubt);
        self.registration.add(frame);
    }

    /// Checks the same frame with the pose that was found for it.
    pub(crate) fn add_placed(&mut self, frame: &CameraFrame<'_>, found: &CameraPose) {
        let pose = Some(&found.world_from_camera).filter(|_| found.state != PoseState::Lost);
        self.delay.add(frame, pose);
        if self.registration.is_complete() && !self.is_compared {
            let misplaced = self.registration.doubt();
            self.misplaced = self.misplaced.take().or(misplaced);
            let cannot_be_late = self.misplaced.is_some() && !self.delay.has_motion();
            if self.delay.is_complete() || cannot_be_late {
                self.compare();
            }
        }
    }

    /// Returns the doubts that the latest frames have raised, each once.
    pub(crate) fn take(&mut self) -> Vec<InputDoubt> {
        std::mem::take(&mut self.found)
    }

    /// Returns the doubts that frames have raised which were too few to tell before the last one.
    pub(crate) fn take_last(&mut self) -> Vec<InputDoubt> {
        let doubt = self.poses.last_doubt();
        self.find_by_poses(doubt);
        let doubt = self.depth.doubt();
        self.find(doubt);
        if !self.is_compared {
            self.compare();
        }
        self.take()
    }

    /// Records a doubt of the given poses, unless it is known.
    fn find_by_poses(&mut self, doubt: Option<InputDoubt>) {
        self.find(doubt.filter(|doubt| doubt.kind != DoubtKind::DepthUnit || !self.depth.is_told()));
    }

    fn find(&mut self, doubt: Option<InputDoubt>) {
        match doubt.as_ref().map(|doubt| doubt.kind) {
            Some(DoubtKind::DepthUnit) => self.depth.set_told(),
            Some(DoubtKind::Poses) => self.has_wrong_poses = true,
            _ => {}
        }
        self.found.extend(doubt);
    }

    /// Compares colour and depth. A camera that moves steadily makes a delay look like a shift, and the other way round: what
    /// explains more is told.
    fn compare(&mut self) {
        self.is_compared = true;
        let delay = self.delay.doubt().filter(|_| !self.has_wrong_poses);
        let misplaced = self.misplaced.take().or_else(|| self.registration.doubt());
        let best = misplaced.into_iter().chain(delay).max_by(|one, other| one.gain.total_cmp(&other.gain));
        self.found.extend(best.map(|best| best.doubt));
    }
}

//! Hindsight: frames are decided again with the map of the end.

use super::Pipeline;
use splatseg_objects::ObjectLog;
use splatseg_tracking::Hindsight;

impl Pipeline {
    /// Decides earlier frames again, with the map as it is now; `None` if the method cannot. The frames need their final poses,
    /// see [`Self::keyframes`], and what they showed: [`FrameOutput::segments`](splatseg_tracking::FrameOutput::segments) and
    /// [`FrameResult::regions`](super::FrameResult::regions).
    pub fn hindsight(&self) -> Option<&dyn Hindsight> {
        self.method.hindsight()
    }

    /// Replaces the log of objects by that of the frames as they were decided again.
    pub fn set_objects(&mut self, objects: ObjectLog) {
        self.objects = objects;
    }
}

//! Motion, disappearance and appearance of things in the synthetic room.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

/// A thing of the synthetic room that moves, vanishes or appears during the video.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mover {
    /// Its id in the ground truth, constant throughout.
    pub id: SegmentId,
    /// Its motion.
    pub motion: Motion,
}

/// Motion of a thing during the video. Frames count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Slides back and forth along a straight line, from the first frame on.
    Slide {
        /// Displacement per frame, metres, world coordinates (z up); z is 0.
        step: Vec3,
        /// Number of frames in each direction, out and back.
        steps: usize,
    },
    /// Disappears.
    Vanish {
        /// First frame without it.
        frame: usize,
    },
    /// Appears.
    Appear {
        /// First frame with it.
        frame: usize,
    },
}

impl Motion {
    /// Returns a thing's offset from its initial position in a frame, metres, world coordinates (z up); `None` while it
    /// is not in the room.
    pub fn offset_at(&self, frame: usize) -> Option<Vec3> {
        match *self {
            Self::Slide { step, steps } => {
                let along = frame % steps.saturating_mul(2).max(1);
                Some(step * along.min(steps.saturating_mul(2) - along) as f32)
            }
            Self::Vanish { frame: first_without } => (frame < first_without).then_some(Vec3::ZERO),
            Self::Appear { frame: first_with } => (frame >= first_with).then_some(Vec3::ZERO),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slides_go_back_and_forth_in_equal_steps() {
        let slide = Motion::Slide { step: Vec3::new(0.03, 0.0, 0.0), steps: 3 };
        let steps: Vec<f32> = (0..9).map(|frame| (slide.offset_at(frame).unwrap().x / 0.03).round()).collect();
        assert_eq!(steps, [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0, 1.0, 2.0]);
        let stuck = Motion::Slide { step: Vec3::X, steps: 0 };
        assert_eq!(stuck.offset_at(5), Some(Vec3::ZERO));
    }

    #[test]
    fn things_come_and_go_with_the_frame_given() {
        let present = |motion: Motion| [3, 4, 5].map(|frame| motion.offset_at(frame).is_some());
        assert_eq!(present(Motion::Vanish { frame: 4 }), [true, false, false]);
        assert_eq!(present(Motion::Appear { frame: 4 }), [false, true, true]);
    }
}

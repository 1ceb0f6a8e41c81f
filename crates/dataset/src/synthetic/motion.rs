//! How single things of the synthetic room move, come and go.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

/// A thing of the synthetic room that does not just stand there for the whole video.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mover {
    /// Its id in the ground truth; it keeps it throughout.
    pub id: SegmentId,
    /// What happens to it.
    pub motion: Motion,
}

/// What happens to a thing during the video. Frames count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// It is pushed along a straight line from the first frame on, back and forth.
    Slide {
        /// The way from one frame to the next, metres, world coordinates (z up); z is 0.
        step: Vec3,
        /// So many frames out, then as many back, and so on.
        steps: usize,
    },
    /// It is carried away.
    Vanish {
        /// The first frame without it.
        frame: usize,
    },
    /// It is brought in.
    Appear {
        /// The first frame with it.
        frame: usize,
    },
}

impl Motion {
    /// How far from its place a thing is in a frame, metres, world coordinates (z up); `None` while it is not in the
    /// room.
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

//! Speed of all motion in the synthetic room.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Speed of the camera and of the sliding things, 0.001 to 1 in steps of 0.001.
///
/// At 1, the default, the camera of a tour or corridor moves about 1 cm per frame, like that of a video at 30 frames per
/// second. In the room it moves 13 cm per frame and turns by 7.5 degrees, or a little more or less as it sways:
/// few frames of a long walk. A hand-held camera at 30 frames per second moves and turns like 0.04 (5 mm and 0.3 degrees
/// per frame, 16 cm/s) when it scans a room slowly, and like 0.1 (13 mm and 0.75 degrees, 40 cm/s) when it is in a hurry.
///
/// ```
/// use splatseg_synthetic::{Speed, SyntheticSettings};
/// let hand_held: SyntheticSettings = "synthetic:frames=600,speed=0.04".parse()?;
/// assert_eq!(hand_held.speed, Speed::from_factor(0.04)?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Speed {
    /// In thousandths, so that frames at whole multiples of the default step have exactly its poses.
    thousandths: u32,
}

/// Error for a speed out of range.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("speed: found {found}, expected {}", Speed::EXPECTED)]
pub struct SpeedError {
    /// The value found.
    pub found: String,
}

/// Thousandths in 1.
const WHOLE: u32 = 1000;

impl Speed {
    /// Description of the allowed values, for messages.
    pub(crate) const EXPECTED: &str = "0.001 to 1, with at most three decimals";

    /// Creates a speed from a factor: 1 is the default, 0.1 a tenth of it.
    ///
    /// # Errors
    /// [`SpeedError`] unless the factor is a multiple of 0.001 from 0.001 to 1.
    pub fn from_factor(factor: f64) -> Result<Self, SpeedError> {
        let thousandths = (factor * f64::from(WHOLE)).round();
        let is_multiple = (factor * f64::from(WHOLE) - thousandths).abs() < 1e-6;
        if is_multiple && (1.0..=f64::from(WHOLE)).contains(&thousandths) {
            return Ok(Self { thousandths: thousandths as u32 });
        }
        Err(SpeedError { found: factor.to_string() })
    }

    /// Returns the factor, 0.001 to 1.
    pub fn factor(self) -> f64 {
        f64::from(self.thousandths) / f64::from(WHOLE)
    }

    /// Returns the time at which a frame is taken, in frames at speed 1.
    pub(super) fn time_at(self, frame: usize) -> f64 {
        frame as f64 * f64::from(self.thousandths) / f64::from(WHOLE)
    }

    /// Returns the number of frames, rounded down, that take as long as `frames` at speed 1.
    pub(super) fn frames_for(self, frames: usize) -> usize {
        frames.saturating_mul(WHOLE as usize) / self.thousandths as usize
    }
}

impl Default for Speed {
    fn default() -> Self {
        Self { thousandths: WHOLE }
    }
}

impl fmt::Display for Speed {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", self.factor())
    }
}

impl FromStr for Speed {
    type Err = SpeedError;

    fn from_str(text: &str) -> Result<Self, SpeedError> {
        let wrong = || SpeedError { found: text.to_owned() };
        Self::from_factor(text.parse().map_err(|_| wrong())?).map_err(|_| wrong())
    }
}

impl TryFrom<f64> for Speed {
    type Error = SpeedError;

    fn try_from(factor: f64) -> Result<Self, SpeedError> {
        Self::from_factor(factor)
    }
}

impl From<Speed> for f64 {
    fn from(speed: Speed) -> Self {
        speed.factor()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_allowed_speed_is_the_same_after_text_and_json() {
        for thousandths in 1..=WHOLE {
            let speed = Speed { thousandths };
            assert_eq!(speed.to_string().parse(), Ok(speed));
            assert_eq!(serde_json::from_str::<Speed>(&serde_json::to_string(&speed).unwrap()).unwrap(), speed);
        }
        assert!(serde_json::from_str::<Speed>("2").unwrap_err().to_string().contains("found 2, expected 0.001 to 1"));
    }

    #[test]
    fn slow_frames_pass_the_moments_of_fast_ones() {
        let slow = Speed::from_factor(0.04).unwrap();
        assert!((0..10_000).all(|frame| slow.time_at(25 * frame) == Speed::default().time_at(frame)));
        assert_eq!((slow.frames_for(48), slow.frames_for(0), Speed::default().frames_for(48)), (1200, 0, 48));
        assert_eq!(Speed::from_factor(0.3).unwrap().frames_for(1), 3);
    }
}

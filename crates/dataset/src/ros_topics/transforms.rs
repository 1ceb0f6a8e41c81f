//! Rigid transforms, and their lookup by time.

use super::clock::{Recorded, Stamped};
use super::timeline::Timeline;
use glam::{DQuat, DVec3};
use splatseg_geometry::{Pose, PoseError};

/// Transforms that differ by less are the same, printed with other precision: metres, and radians.
const SAME_DISTANCE_M: f64 = 1e-6;
const SAME_ANGLE: f64 = 1e-6;

/// The position and the quaternion of a message, as they are written.
pub(crate) type Parts = (DVec3, DQuat);

/// A rigid transform from one frame to another, in the precision of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rigid {
    pub(crate) translation: DVec3,
    /// Unit quaternion.
    pub(crate) rotation: DQuat,
}

impl Rigid {
    pub(crate) const IDENTITY: Self = Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// Creates a transform; `None` for NaN, infinity, or a quaternion of length zero.
    pub(crate) fn new(translation: DVec3, rotation: DQuat) -> Option<Self> {
        let length = rotation.length();
        let usable = translation.is_finite() && length.is_finite() && length > 1e-6;
        usable.then(|| Self { translation, rotation: rotation * length.recip() })
    }

    /// Composes two transforms: `a_from_b.after(b_from_c)` is `a_from_c`.
    pub(crate) fn after(&self, inner: &Self) -> Self {
        Self {
            translation: self.rotation * inner.translation + self.translation,
            rotation: (self.rotation * inner.rotation).normalize(),
        }
    }

    pub(crate) fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { translation: -(rotation * self.translation), rotation }
    }

    /// Returns the distance between the origins, metres, and the angle between the axes, radians.
    pub(crate) fn apart(&self, other: &Self) -> (f64, f64) {
        let turn = self.rotation.inverse() * other.rotation;
        // More precise than the arc cosine for small angles.
        let angle = 2.0 * turn.xyz().length().atan2(turn.w.abs());
        (self.translation.distance(other.translation), angle)
    }

    /// Returns true if two transforms differ by rounding only.
    pub(crate) fn is_about(&self, other: &Self) -> bool {
        let (distance, angle) = self.apart(other);
        distance < SAME_DISTANCE_M && angle < SAME_ANGLE
    }

    pub(crate) fn to_pose(self) -> Result<Pose, PoseError> {
        Pose::from_quaternion(self.translation, self.rotation)
    }
}

/// A transform at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    /// Nanoseconds.
    pub(crate) stamp: i64,
    pub(crate) recorded: Recorded,
    pub(crate) transform: Rigid,
}

impl Stamped for Sample {
    const KEEPS_LAST: bool = true;

    fn stamp(&self) -> i64 {
        self.stamp
    }

    fn set_stamp(&mut self, stamp: i64) {
        self.stamp = stamp;
    }

    fn recorded(&self) -> Recorded {
        self.recorded
    }
}

/// A time in a recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instant {
    /// Stamp by the clock of the messages, nanoseconds.
    pub(crate) stamp: i64,
    /// Recording time, to distinguish repeated stamps.
    pub(crate) recorded: Recorded,
}

impl Stamped for Instant {
    fn stamp(&self) -> i64 {
        self.stamp
    }

    fn set_stamp(&mut self, stamp: i64) {
        self.stamp = stamp;
    }

    fn recorded(&self) -> Recorded {
        self.recorded
    }
}

/// Tolerances for looking up a transform by time, nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tolerance {
    /// Maximum distance from the nearest measurement, if there is none on the other side.
    pub(crate) nearest: i64,
    /// Maximum distance between two measurements for interpolating between them.
    pub(crate) gap: i64,
}

/// Returns the transform at a time: interpolated between two measurements, otherwise the nearest one; `None` if they
/// are too far away. `samples` must be in time order.
pub(crate) fn at_time(samples: &[Sample], stamp: i64, tolerance: Tolerance) -> Option<Rigid> {
    let after = samples.partition_point(|sample| sample.stamp < stamp);
    let next = samples.get(after);
    if let Some(exact) = next.filter(|next| next.stamp == stamp) {
        return Some(exact.transform);
    }
    let before = after.checked_sub(1).and_then(|before| samples.get(before));
    if let (Some(before), Some(next)) = (before, next) {
        let gap = next.stamp.saturating_sub(before.stamp);
        if gap <= tolerance.gap {
            let part = stamp.saturating_sub(before.stamp) as f64 / gap as f64;
            let translation = before.transform.translation.lerp(next.transform.translation, part);
            return Some(Rigid {
                translation,
                rotation: before.transform.rotation.slerp(next.transform.rotation, part).normalize(),
            });
        }
    }
    let apart = |sample: &&Sample| sample.stamp.abs_diff(stamp);
    let nearest = before.into_iter().chain(next).min_by_key(apart)?;
    (apart(&nearest) <= tolerance.nearest.unsigned_abs()).then_some(nearest.transform)
}

impl Timeline<Sample> {
    /// Returns the transform at an instant, as found by [`at_time`].
    pub(crate) fn at(&self, instant: Instant, tolerance: Tolerance) -> Option<Rigid> {
        at_time(&self.stretch_of(&instant)?.messages, instant.stamp, tolerance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLISECOND: i64 = 1_000_000;
    const TOLERANCE: Tolerance = Tolerance { nearest: 20 * MILLISECOND, gap: 500 * MILLISECOND };

    fn sample(milliseconds: i64, x: f64, angle: f64) -> Sample {
        let transform = Rigid { translation: DVec3::X * x, rotation: DQuat::from_rotation_z(angle) };
        Sample { stamp: milliseconds * MILLISECOND, recorded: Recorded::default(), transform }
    }

    #[test]
    fn transforms_are_interpolated_but_not_across_a_gap() {
        let samples = [sample(0, 0.0, 0.0), sample(100, 1.0, 0.8), sample(5000, 9.0, 0.0)];
        let at = |milliseconds: i64| at_time(&samples, milliseconds * MILLISECOND, TOLERANCE);
        let (distance, angle) = at(25).unwrap().apart(&sample(0, 0.25, 0.2).transform);
        assert!(distance < 1e-9 && angle < 1e-6);
        assert_eq!(at(100), Some(samples[1].transform));
        assert_eq!(at(115), Some(samples[1].transform), "near enough to one of them");
        assert_eq!(at(-20), Some(samples[0].transform));
        for unknown in [-21, 200, 4900, 5021] {
            assert_eq!(at(unknown), None, "{unknown}");
        }
        assert_eq!(at_time(&[], 0, TOLERANCE), None);
        let far =
            [sample(0, 0.0, 0.0), Sample { stamp: i64::MAX, ..samples[0] }, Sample { stamp: i64::MIN, ..samples[0] }];
        assert_eq!(at_time(&far[1..2], i64::MIN, TOLERANCE), None);
    }

    #[test]
    fn invalid_transforms_are_refused() {
        assert_eq!(Rigid::new(DVec3::ZERO, DQuat::from_array([0.0; 4])), None);
        assert_eq!(Rigid::new(DVec3::X * f64::NAN, DQuat::IDENTITY), None);
        assert_eq!(Rigid::new(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, f64::INFINITY)), None);
        let scaled = Rigid::new(DVec3::X, DQuat::from_xyzw(0.0, 0.0, 0.0, 3.0)).unwrap();
        assert_eq!(scaled.rotation, DQuat::IDENTITY);
    }

    #[test]
    fn transforms_are_apart_by_a_distance_and_an_angle() {
        let (distance, angle) = sample(0, 1.0, 0.2).transform.apart(&sample(0, 1.5, 0.5).transform);
        assert!((distance - 0.5).abs() < 1e-12 && (angle - 0.3).abs() < 1e-12, "{distance} {angle}");
        let negated = Rigid { rotation: -sample(0, 1.0, 0.2).transform.rotation, ..sample(0, 1.0, 0.2).transform };
        assert!(negated.is_about(&sample(0, 1.0, 0.2).transform));
        assert!(!negated.is_about(&sample(0, 1.0, 0.200_01).transform));
    }
}

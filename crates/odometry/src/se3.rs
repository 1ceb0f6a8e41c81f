//! Small rigid motions as six numbers.

use glam::{DMat3, DMat4, DVec3};
use splatseg_geometry::Pose;

/// A small rigid motion: translation in metres, then the rotation vector in radians.
pub(crate) type Twist = [f64; 6];

/// The rigid motion of a twist whose translation is applied after its rotation. `sin` and `cos` are those of `libm`,
/// which return the same bits on every machine.
pub(crate) fn exponential(twist: &Twist) -> Pose {
    let axis = DVec3::new(twist[3], twist[4], twist[5]);
    let angle = axis.length();
    let cross = skew(axis);
    // Close to zero the quotients are replaced by the first terms of their series.
    let (first, second) = if angle < 1e-6 {
        (1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0)
    } else {
        (libm::sin(angle) / angle, (1.0 - libm::cos(angle)) / (angle * angle))
    };
    let rotation = DMat3::IDENTITY + cross * first + cross * cross * second;
    rigid(rotation, DVec3::new(twist[0], twist[1], twist[2]))
}

/// The twist of a rigid motion, the inverse of [`exponential`] for rotations below 180°.
pub(crate) fn logarithm(motion: &Pose) -> Twist {
    let rotation = motion.rotation();
    let doubled = DVec3::new(
        rotation.y_axis.z - rotation.z_axis.y,
        rotation.z_axis.x - rotation.x_axis.z,
        rotation.x_axis.y - rotation.y_axis.x,
    );
    let trace = rotation.x_axis.x + rotation.y_axis.y + rotation.z_axis.z;
    let (sine, cosine) = (doubled.length() * 0.5, (trace - 1.0) * 0.5);
    let angle = libm::atan2(sine, cosine);
    let scale = if sine < 1e-9 { 0.5 } else { 0.5 * angle / sine };
    let (axis, translation) = (doubled * scale, motion.translation());
    [translation.x, translation.y, translation.z, axis.x, axis.y, axis.z]
}

/// Length of a motion's translation, metres, and of its rotation, radians.
pub(crate) fn size(motion: &Pose) -> (f64, f64) {
    let twist = logarithm(motion);
    (DVec3::from_slice(&twist[..3]).length(), DVec3::from_slice(&twist[3..]).length())
}

/// The motion that is `share` of the given one.
pub(crate) fn scaled(motion: &Pose, share: f64) -> Pose {
    exponential(&logarithm(motion).map(|part| part * share))
}

/// A pose from a rotation and a translation that are known to be valid.
fn rigid(rotation: DMat3, translation: DVec3) -> Pose {
    // Twists are bounded by the caller and rotations are exact up to rounding, so this cannot fail; if numbers ever
    // were not finite, the camera would stand still.
    Pose::from_matrix(DMat4::from_mat3_translation(rotation, translation)).unwrap_or(Pose::IDENTITY)
}

fn skew(axis: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn logarithm_undoes_the_exponential(twist in prop::array::uniform6(-1.5f64..1.5), scale in 0.0f64..1.0) {
            let twist = twist.map(|part| part * scale);
            let again = logarithm(&exponential(&twist));
            for (found, expected) in again.iter().zip(twist) {
                prop_assert!((found - expected).abs() < 1e-8, "{again:?} {twist:?}");
            }
        }
    }

    #[test]
    fn a_quarter_turn_about_z_moves_x_to_y() {
        let motion = exponential(&[1.0, 2.0, 3.0, 0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let moved = motion.to_world(glam::Vec3::X);
        assert!((moved - DVec3::new(1.0, 3.0, 3.0)).length() < 1e-12);
        assert_eq!(size(&scaled(&motion, 0.0)), (0.0, 0.0));
    }
}

//! Origin of the map's coordinates.
//!
//! Gaussians are stored in single precision, which is exact to 8 µm up to 128 m from the origin. The world may be a map
//! projection or a drive of kilometres, so the origin follows the camera. While the camera is within 128 m of the
//! world's origin, the two origins are the same.
//!
//! Origins lie on a grid of 16 m, so that moving Gaussians to another origin rounds them only where they get farther
//! away: after a drive of 10 km and back they are still exact to a millimetre, however often the origin has moved.

use glam::DVec3;
use splatseg_geometry::{LocalPose, Pose};

/// The origin moves once the camera is farther from it than this along an axis, metres.
const MAX_DISTANCE: f64 = 128.0;

/// Spacing of the grid of origins, metres.
const GRID: f64 = 16.0;

/// Up to this distance from the origin, metres, Gaussians are exact to a millimetre. The pose of a frame whose camera
/// is farther away is taken to be wrong, unless [`MIN_FAR_FRAMES`] such frames come in a row.
const MAX_STEP: f64 = 1e4;

/// Number of far frames in a row whose poses are believed.
pub(crate) const MIN_FAR_FRAMES: u8 = 3;

/// True if a camera at `position`, world coordinates, is so far from the map's `origin` that the pose must be wrong:
/// following it would round the map.
pub(crate) fn is_far(position: DVec3, origin: DVec3) -> bool {
    position.distance(origin) > MAX_STEP
}

/// Returns the origin for a camera at `position`, world coordinates: `present` as long as that is near.
pub(crate) fn origin_for(position: DVec3, present: DVec3) -> DVec3 {
    if (position - present).abs().max_element() <= MAX_DISTANCE { present } else { (position / GRID).round() * GRID }
}

/// Returns the transform of the map's coordinates from one origin to another when the world is transformed as well.
pub(crate) fn change_of_origin(new_from_old_world: &Pose, old: DVec3, new: DVec3) -> LocalPose {
    (*new_from_old_world * Pose::from_translation(old)).relative_to(new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_near_camera_leaves_the_origin_and_a_far_one_moves_it() {
        let stays = |x: f64| origin_for(DVec3::new(x, 1.0, -2.0), DVec3::ZERO) == DVec3::ZERO;
        assert!(stays(0.0) && stays(128.0) && stays(-128.0) && !stays(128.1));
        let far = DVec3::new(500_003.7, 5_400_120.2, 341.0);
        let origin = origin_for(far, DVec3::ZERO);
        assert_eq!(origin, DVec3::new(500_000.0, 5_400_128.0, 336.0));
        assert_eq!(origin_for(far + 100.0, origin), origin);
    }

    #[test]
    fn a_drive_of_ten_kilometres_and_back_moves_gaussians_by_less_than_a_millimetre() {
        let places: Vec<Vec3> = (0..100u8).map(|index| Vec3::new(0.7, -0.3, 0.2) * f32::from(index)).collect();
        let (mut means, mut origin) = (places.clone(), DVec3::ZERO);
        let there = (0..1000).map(|step| 10.0 * f64::from(step));
        for x in there.clone().chain(there.clone().rev()).chain(there.clone()).chain(there.rev()) {
            let next = origin_for(DVec3::new(x, 0.4 * x, 0.0), origin);
            let moved = change_of_origin(&Pose::IDENTITY, origin, next);
            means.iter_mut().for_each(|mean| *mean = moved.to_world(*mean));
            origin = next;
        }
        assert!(origin.length() < 2.0 * MAX_DISTANCE, "{origin}");
        for (mean, place) in means.iter().zip(places) {
            let error = (mean.as_dvec3() + origin - place.as_dvec3()).length();
            assert!(error < 1e-3, "{error}");
        }
    }
}

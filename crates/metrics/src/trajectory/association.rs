//! Pairing of poses by time.

use splatseg_geometry::StampedPose;

/// Pairs each pose of the shorter trajectory (the estimate, if they are equally long) with the pose of the other that is
/// nearest in time, at most `max_seconds_apart` away. Returns the indices of the true and the estimated poses, in the
/// order of the shorter trajectory. As `evo`'s `associate_trajectories`.
pub(super) fn pairs_by_time(
    truth: &[StampedPose],
    estimate: &[StampedPose],
    max_seconds_apart: f64,
) -> Vec<(usize, usize)> {
    let truth_is_shorter = truth.len() < estimate.len();
    let (short, long) = if truth_is_shorter { (truth, estimate) } else { (estimate, truth) };
    let times: Vec<f64> = long.iter().map(|pose| pose.seconds).collect();
    let is_sorted = times.is_sorted();
    let pair = |(index, pose): (usize, &StampedPose)| {
        let nearest = if is_sorted { nearest_sorted(&times, pose.seconds) } else { nearest(&times, pose.seconds) }?;
        let apart = (times.get(nearest)? - pose.seconds).abs();
        (apart <= max_seconds_apart).then_some(if truth_is_shorter { (index, nearest) } else { (nearest, index) })
    };
    short.iter().enumerate().filter_map(pair).collect()
}

/// Returns the index of the time nearest to `seconds` in a sorted list. Of two equally near times it is the earlier, of
/// equal times the last, or at the end of the list the last but one.
fn nearest_sorted(times: &[f64], seconds: f64) -> Option<usize> {
    let last = times.len().checked_sub(1)?;
    let later = times.partition_point(|time| *time <= seconds).min(last);
    let Some(earlier) = later.checked_sub(1) else { return Some(later) };
    let (until_later, since_earlier) = (times.get(later)? - seconds, seconds - times.get(earlier)?);
    Some(if until_later < since_earlier { later } else { earlier })
}

/// Returns the index of the first of the times nearest to `seconds`.
fn nearest(times: &[f64], seconds: f64) -> Option<usize> {
    let apart = |index: &usize| times.get(*index).map_or(f64::INFINITY, |time| (time - seconds).abs());
    (0..times.len()).min_by(|one, other| apart(one).total_cmp(&apart(other)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Pose;

    fn poses(times: &[f64]) -> Vec<StampedPose> {
        times.iter().map(|seconds| StampedPose { seconds: *seconds, world_from_camera: Pose::IDENTITY }).collect()
    }

    fn pairs(truth: &[f64], estimate: &[f64]) -> Vec<(usize, usize)> {
        pairs_by_time(&poses(truth), &poses(estimate), 0.01)
    }

    #[test]
    fn each_pose_of_the_shorter_trajectory_gets_the_nearest_of_the_other() {
        assert_eq!(pairs(&[0.0, 0.1, 0.2], &[0.0, 0.104, 0.212]), [(0, 0), (1, 1)]);
        assert_eq!(pairs(&[0.1], &[0.0, 0.097, 0.102, 0.2]), [(0, 2)]);
        assert_eq!(pairs(&[0.0, 0.097, 0.102, 0.2], &[0.1, 0.201]), [(2, 0), (3, 1)]);
        assert_eq!(pairs(&[0.0, 1.0, 2.0], &[-0.009, 2.009, 5.0]), [(0, 0), (2, 1)]);
        assert_eq!(pairs(&[], &[1.0]), []);
        assert_eq!(pairs(&[1.0], &[]), []);
    }

    #[test]
    fn a_pose_may_be_nearest_to_two_others() {
        assert_eq!(pairs(&[1.0, 2.0, 3.0], &[0.995, 1.005]), [(0, 0), (0, 1)]);
    }

    #[test]
    fn times_need_not_be_sorted_or_numbers() {
        assert_eq!(pairs(&[2.0, 1.0, 1.0, 3.0], &[1.0, 3.001, 2.002]), [(1, 0), (3, 1), (0, 2)]);
        assert_eq!(pairs(&[f64::NAN, 1.0, 2.0], &[f64::NAN, 2.0, f64::INFINITY]), [(2, 1)]);
    }
}
